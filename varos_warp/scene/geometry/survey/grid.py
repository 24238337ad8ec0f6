"""Grids of heights: cut out, joined, thinned, and made a mesh.

A cell of the mesh has a node at each corner and is made where all four have a height. It is divided along the shorter
of its diagonals in space (the one from the first node if they are equal); faces run counter-clockwise seen from above.
"""

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from varos_warp.errors import InputError
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.content import Raster

ON_A_NODE = 1e-3
"""Share of the spacing by which grids may be off each other, and nodes off a region."""


class Holes(NamedTuple):
    """Places without height that the surface surrounds."""

    count: int
    area_m2: float
    """Area seen from above [m^2]."""


def spacing(T: np.ndarray) -> tuple[float, float]:
    """The distance of neighbouring nodes along a row and down a column."""
    return float(np.hypot(*T[:, 0])), float(np.hypot(*T[:, 1]))


def places(T: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """X, y of nodes, float64 [..., 2]."""
    return np.stack([T[i, 0] * columns + T[i, 1] * rows + T[i, 2] for i in (0, 1)], axis=-1)


def extent(raster: Raster) -> np.ndarray:
    """Xmin, ymin, xmax, ymax of the nodes."""
    rows, columns = raster.values.shape
    corners = places(raster.T, np.array([0, 0, rows - 1, rows - 1]), np.array([0, columns - 1, 0, columns - 1]))
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)])


def window(raster: Raster, region: tuple[float, float, float, float]) -> Raster:
    """The part of a grid whose nodes lie in a region xmin, ymin, xmax, ymax; empty where none does."""
    slack = ON_A_NODE * min(spacing(raster.T))
    low, high = np.subtract(region[:2], slack), np.add(region[2:], slack)
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    inside = np.linalg.solve(raster.T[:, :2], (corners - raster.T[:, 2]).T)  # columns, rows
    first = np.clip(np.ceil(inside.min(axis=1) - 1e-9), 0, raster.values.shape[::-1]).astype(int)
    last = np.clip(np.floor(inside.max(axis=1) + 1e-9) + 1, first, raster.values.shape[::-1]).astype(int)
    values = raster.values[first[1] : last[1], first[0] : last[0]]
    T = np.column_stack([raster.T[:, :2], places(raster.T, first[1], first[0])])
    if T[0, 1] or T[1, 0]:  # turned against the region
        xy = places(T, np.arange(values.shape[0])[:, None], np.arange(values.shape[1]))
        values = np.where(((xy >= low) & (xy <= high)).all(axis=-1), values, np.nan)
    return Raster(values, T, raster.reference, raster.notes)


def mosaic(rasters: list[Raster], names: list[str], key: str) -> Raster:
    """Join tiles of one grid; where they overlap, the first that has a height counts.

    Raises:
        InputError: A tile has another spacing, or its nodes lie between those of the first.
    """
    first = rasters[0]
    if len(rasters) == 1:
        return first
    A = first.T[:, :2]
    starts = []
    for raster, name in zip(rasters, names, strict=True):
        start = np.linalg.solve(A, raster.T[:, 2] - first.T[:, 2])
        drift = np.abs(np.linalg.solve(A, raster.T[:, :2]) - np.eye(2)).max() * max(raster.values.shape)
        if max(drift, np.abs(start - np.rint(start)).max()) > ON_A_NODE:
            raise InputError(
                f"its nodes are not those of the grid of {names[0]}",
                file=name,
                key=f"{key}.file",
                remedy="Lay the tiles on one grid: gdalwarp -tap, or gdalbuildvrt and gdal_translate.",
            )
        starts.append(np.rint(start).astype(int))
    low = np.min(starts, axis=0)
    high = np.max([start + raster.values.shape[::-1] for start, raster in zip(starts, rasters, strict=True)], axis=0)
    columns, rows = high - low
    check_limit("HEIGHTS", int(columns) * int(rows), key=f"{key}.file")
    values = np.full((rows, columns), np.nan)
    for (column, row), raster in zip(starts - low, rasters, strict=True):
        part = values[row : row + raster.values.shape[0], column : column + raster.values.shape[1]]
        np.copyto(part, raster.values, where=np.isnan(part))
    T = np.column_stack([A, places(first.T, low[1], low[0])])
    return Raster(values, T, first.reference, [note for raster in rasters for note in raster.notes])


def thinned(raster: Raster, resolution: float) -> tuple[Raster, tuple[int, int]]:
    """Means of blocks of nodes about as wide as ``resolution``, and how many nodes they have along each side.

    A block has a mean if at least half of its nodes have heights. Nodes beyond the last whole block are left out.
    """
    rows, columns = raster.values.shape
    n, m = (
        max(1, min(round(resolution / size), count))
        for size, count in zip(spacing(raster.T), (columns, rows), strict=True)
    )
    if n == m == 1:
        return raster, (1, 1)
    blocks = raster.values[: rows // m * m, : columns // n * n].reshape(rows // m, m, columns // n, n)
    there = ~np.isnan(blocks)
    count = there.sum(axis=(1, 3))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(there, blocks, 0.0).sum(axis=(1, 3)) / count
    mean[2 * count < n * m] = np.nan
    T = np.column_stack([raster.T[:, 0] * n, raster.T[:, 1] * m, places(raster.T, 0.5 * (m - 1), 0.5 * (n - 1))])
    return Raster(mean, T, raster.reference, raster.notes), (n, m)


def holes(there: np.ndarray, T: np.ndarray) -> Holes:
    """Count the groups of cells that are not ``there``, bool [rows, columns], and do not reach the outline."""
    labels, count = ndimage.label(~there)
    outer = np.unique(np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]]))
    cells = np.bincount(labels.ravel(), minlength=count + 1)
    cells[np.append(outer, 0)] = 0
    return Holes(int(np.count_nonzero(cells)), float(cells.sum() * abs(np.linalg.det(T[:, :2]))))


def mesh_of(raster: Raster, key: str) -> tuple[np.ndarray, np.ndarray, Holes]:
    """Vertices float64 [V, 3] and faces int32 [F, 3], counter-clockwise seen from above, and the holes."""
    z, T = raster.values, raster.T
    valid = ~np.isnan(z)
    there = valid[:-1, :-1] & valid[:-1, 1:] & valid[1:, 1:] & valid[1:, :-1]
    row, column = np.nonzero(there)
    check_limit("TRIANGLES", 2 * len(row), key=f"{key}.resolution_m")
    used = np.zeros(z.shape, bool)
    for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)):
        used[row + i, column + j] = True
    number = (np.cumsum(used, dtype=np.int64) - 1).reshape(z.shape)
    a, b, c, d = (number[row + i, column + j] for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    vertices = np.column_stack([places(T, *np.nonzero(used)), z[used]])
    level = [np.square(T[:, 0] + sign * T[:, 1]).sum() for sign in (1.0, -1.0)]  # of the diagonals ac and bd
    other = level[0] + np.square(vertices[a, 2] - vertices[c, 2]) > level[1] + np.square(
        vertices[b, 2] - vertices[d, 2]
    )
    faces = np.stack([a, d, np.where(other, b, c), np.where(other, d, a), c, b], axis=1).reshape(-1, 3)
    if np.linalg.det(T[:, :2]) > 0.0:  # rows run north
        faces = faces[:, ::-1]
    return vertices, faces.astype(np.int32), holes(there, T)
