"""Boards with a printed pattern, to calibrate cameras and their colours with."""

import numpy as np

from varos_warp.scene.description.world import CalibrationBoard, ColorChart
from varos_warp.scene.file.load import DATA
from varos_warp.scene.geometry.parts import FaceSpectra, Skin
from varos_warp.scene.spectra.spectrum import GRID
from varos_warp.scene.spectra.surfaces import chart_colours, chart_reflectances

BLACK, WHITE = 0.04, 0.8
"""Reflectances of print and board."""
CHART = (6, 4)
"""Columns and rows of patches of a colour chart."""
BITS, BORDER, SPACING = 6, 2, 0.3
"""Cells along a tag's code and in its border; gap between tags over their side where a board does not say."""


def board(block: CalibrationBoard) -> tuple[np.ndarray, np.ndarray, Skin]:
    """Vertices float64 [V, 3] [m], faces int32 [F, 3] and colours of a board.

    Each cell of the pattern is two triangles, so that edges of the pattern are edges of the mesh; a box is behind it.
    """
    x, z, black = aprilgrid(block) if block.pattern == "aprilgrid" else checkerboard(block)
    vertices, faces = _panel(x, z, block.thickness_m)
    colours = np.full(len(faces), WHITE, np.float32)
    colours[: 2 * black.size][black.ravel().repeat(2)] = BLACK
    return vertices, faces, Skin(np.broadcast_to(colours[:, None, None], (len(faces), 3, 3)).copy())


def chart(block: ColorChart) -> tuple[np.ndarray, np.ndarray, Skin]:
    """Make a colour chart, as `board` does; its skin has the spectra of the patches and of the black board."""
    columns, rows = CHART
    x, z = (
        np.cumsum(
            [
                0.0,
                0.5 * (size - n * block.patch_m - (n - 1) * block.gap_m),
                block.patch_m,
                *[block.gap_m, block.patch_m] * (n - 1),
            ]
        )
        for size, n in zip(block.size_m, CHART, strict=True)
    )
    x, z = (np.append(edges, size) for edges, size in zip((x, z), block.size_m, strict=True))
    cells = np.zeros((len(x) - 1, len(z) - 1), np.int32)
    cells[1::2, 1::2] = 1 + np.arange(columns * rows).reshape(rows, columns)[::-1].T  # rows from above
    vertices, faces = _panel(x, z, block.thickness_m)
    of_face = np.zeros(len(faces), np.int32)
    of_face[: 2 * cells.size] = cells.ravel().repeat(2)
    curves = np.array([np.full(len(GRID), BLACK), *(patch.at(GRID) for patch in chart_reflectances().values())])
    colours = np.clip(np.concatenate([np.full((1, 3), BLACK), chart_colours()]), 0.0, 1.0).astype(np.float32)
    return vertices, faces, Skin(colours[of_face][:, None].repeat(3, axis=1), spectra=FaceSpectra(of_face, curves))


def corners(block: CalibrationBoard) -> np.ndarray:
    """Corners [N, 3] [m] that detectors look for, in the board's own axes before its scale; their place is their id.

    Rows go up from the lower left, as those of Kalibr's targets do: of a checkerboard the inner corners, of an
    AprilGrid the four of every tag, so that the corner in row i and column j is one of tag (i // 2) * columns + j // 2.
    """
    if block.pattern == "checkerboard":
        (x, z, _), chosen = checkerboard(block), [np.arange(n) + 2 for n in (block.columns, block.rows)]
    else:
        (x, z, _), period = aprilgrid(block), BITS + 2 * BORDER + 1
        chosen = [(2 + period * np.arange(n)[:, None] + [0, period - 1]).ravel() for n in (block.columns, block.rows)]
    x, z = np.meshgrid(*((edges - edges.mean())[which] for edges, which in zip((x, z), chosen, strict=True)))
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=-1)


def checkerboard(block: CalibrationBoard) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges x [X + 1] and z [Z + 1] [m] of its cells, and which are black, bool [X, Z]: that at the lower left is."""
    black = np.indices((block.columns + 1, block.rows + 1)).sum(axis=0) % 2 == 0
    x, z = (np.arange(n + 3) * block.square_m for n in black.shape)
    return x, z, np.pad(black, 1)


def aprilgrid(block: CalibrationBoard) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Edges and black cells, as `checkerboard` gives them, of what Kalibr's ``kalibr_create_target_pdf`` prints.

    Tag 0 is at the lower left, 1 beside it. Squares as wide as the gaps lie between the corners of tags, also at the
    outer ones; the margin is a gap wide.
    """
    gap = (block.spacing or SPACING) * block.tag_m
    cell = block.tag_m / (BITS + 2 * BORDER)
    period = BITS + 2 * BORDER + 1  # cells of a tag, and the gap before it
    black = np.zeros((1 + period * block.columns, 1 + period * block.rows), bool)
    black[::period, ::period] = True
    for number, bits in enumerate(tags(block.rows * block.columns)):
        row, column = divmod(number, block.columns)
        at = (slice(1 + period * k, period * (k + 1)) for k in (column, row))
        black[tuple(at)] = np.pad(bits[::-1].T, BORDER, constant_values=True)  # from images' rows to x, z
    x, z = (np.cumsum([0.0, gap, *([gap, *[cell] * (period - 1)] * n), gap, gap]) for n in (block.columns, block.rows))
    return x, z, np.pad(black, 1)


def tags(count: int) -> np.ndarray:
    """Black cells of the first tags of 36h11, bool [count, 6, 6], rows from above (AprilTag, tag36h11.c)."""
    codes = np.array([int(line, 16) for line in (DATA / "tag36h11.txt").read_text().split()[:count]])
    return (codes[:, None] >> np.arange(BITS * BITS)[::-1] & 1 == 0).reshape(-1, BITS, BITS)


def _panel(x: np.ndarray, z: np.ndarray, thickness: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a box whose front has the edges x and z, centred; first two faces of each cell [X, Z]."""
    x, z = x - x.mean(), z - z.mean()
    quads = [_grid(x, z, 0.0, turned=False), _grid(x, z, thickness, turned=True), _rim(x, z, thickness)]
    corners = np.concatenate(quads)  # [quads, 4, 3], counter-clockwise from outside
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)


def _grid(x, z, y, *, turned) -> np.ndarray:
    """Corners [quads, 4, 3] of a grid in the plane y, seen counter-clockwise from -y, or from +y if turned."""
    low = np.stack(np.meshgrid(x[:-1], z[:-1], indexing="ij"), -1).reshape(-1, 2)
    high = np.stack(np.meshgrid(x[1:], z[1:], indexing="ij"), -1).reshape(-1, 2)
    flat = np.stack([low, np.stack([high[:, 0], low[:, 1]], -1), high, np.stack([low[:, 0], high[:, 1]], -1)], 1)
    quads = np.insert(flat, 1, y, axis=-1)
    return quads[:, ::-1] if turned else quads


def _rim(x, z, back) -> np.ndarray:
    """Corners [quads, 4, 3] of the sides, from the plane of the pattern to the back, along the edges of the grids."""
    bottom, right = (np.stack(np.broadcast_arrays(*side), -1) for side in ((x[:-1], z[0]), (x[-1], z[:-1])))
    top, left = (np.stack(np.broadcast_arrays(*side), -1) for side in ((x[:0:-1], z[-1]), (x[0], z[:0:-1])))
    outline = np.concatenate([bottom, right, top, left])
    front, behind = (np.insert(outline, 1, y, axis=-1) for y in (0.0, back))
    return np.stack([front, behind, np.roll(behind, -1, axis=0), np.roll(front, -1, axis=0)], axis=1)
