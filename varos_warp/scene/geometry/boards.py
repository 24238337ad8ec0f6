"""Boards with a printed pattern, to calibrate cameras with."""

import numpy as np

from varos_warp.scene.description.world import CalibrationBoard
from varos_warp.scene.geometry.parts import Skin

BLACK, WHITE = 0.04, 0.8
"""Reflectances of print and board."""


def checkerboard(block: CalibrationBoard) -> tuple[np.ndarray, np.ndarray, Skin]:
    """Vertices float64 [V, 3] [m], faces int32 [F, 3] and colours of a board, its square at the lower left black.

    Each square is two triangles, so that edges of the pattern are edges of the mesh; a box is behind it.
    """
    squares = np.array([block.columns + 1, block.rows + 1])
    x, z = ((np.arange(-1, n + 2) - 0.5 * n) * block.square_m for n in squares)
    i, j = (index.ravel() for index in np.indices((len(x) - 1, len(z) - 1)))
    black = (i >= 1) & (i <= squares[0]) & (j >= 1) & (j <= squares[1]) & ((i + j) % 2 == 0)
    quads = [_grid(x, z, 0.0, turned=False), _grid(x, z, block.thickness_m, turned=True),
             _rim(x, z, block.thickness_m)]
    corners = np.concatenate(quads)  # [quads, 4, 3], counter-clockwise from outside
    colours = np.full(len(corners), WHITE, np.float32)
    colours[:len(black)][black] = BLACK
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    faces = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)
    return vertices, faces, Skin(np.broadcast_to(colours.repeat(2)[:, None, None], (len(faces), 3, 3)).copy())


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
