"""Edges, corners and thin parts of a host, where it stands out, told from hollows and level places."""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.geometry.growth.chance import mixed, uniform
from varos_warp.scene.geometry.topology import chunks

CELL_M = 0.04
"""Edges are told from the surface within about one and a half times as far [m]."""
AROUND_M = 3.5 * CELL_M
"""Farther from a place nothing counts [m]."""
PER_CELL = 4.0
"""Samples of large triangles, for each square of a cell's size."""
THIN = 0.3
"""Length of the sum of area normals, over the area, below which both sides of something thin are near."""
SHEET = 0.85
"""Share of the squares of normals along one line, above which a thin thing is a sheet; else it is a bar or a corner."""
RIM, RIM_OVER = 0.85, 0.35
"""A place is at the rim of a sheet if near it is less than such a share of a whole sheet's area, and so much less."""
SIDE = np.int64(1 << 20)
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows and columns of a symmetric matrix."""


@dataclass(frozen=True)
class Edges:
    """The middle of the surface around every cell of space that has some of it."""

    keys: np.ndarray
    """int64 [C]: keys of the cells, ascending."""
    middle: np.ndarray
    """float64 [C, 3]: middle of the surface in the cell and its neighbours, from the host's origin [m]."""
    normal: np.ndarray
    """float64 [C, 3]: mean of the surface's unit normals, whose length says how far they agree."""
    thin: np.ndarray
    """float64 [C]: what places are where normals cancel: 1 on bars and at rims of sheets, 0 within these."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """How much places [N, 3] from the host's origin stand out [N]: 1 at right edges, 0 on planes, -1 in corners.

        Bars are edges all around, sheets at their rims.
        """
        keys = _key(np.floor(points / CELL_M).astype(np.int64))
        at = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
        agree = np.linalg.norm(self.normal[at], axis=1)
        away = points - self.middle[at]
        above = np.einsum("ni,ni->n", away, self.normal[at]) / np.where(agree > 0.0, agree, 1.0)
        out = np.where(agree < THIN, self.thin[at], np.clip(2.0 * above / CELL_M, -1.0, 1.0))
        return np.where(self.keys[at] == keys, out, 0.0)


def edges_of(corners: np.ndarray, keys: np.ndarray) -> Edges:
    """Edges of a surface of triangles.

    Args:
        corners: float64 [F, 3, 3], from the host's origin [m].
        keys: uint64 [F], of the triangles.
    """
    found, sums = [np.zeros(0, np.int64)], [np.zeros((0, 13))]
    for part in chunks(len(keys)):
        points, vectors = _samples(corners[part], keys[part])
        area = np.linalg.norm(vectors, axis=1)
        cells, inverse = np.unique(_key(np.floor(points / CELL_M).astype(np.int64)), return_inverse=True)
        found.append(cells)
        squares = np.column_stack([vectors[:, i] * vectors[:, j] for i, j in PAIRS])
        columns = [area, area[:, None] * points, vectors, squares / np.where(area > 0.0, area, 1.0)[:, None]]
        sums.append(_summed(inverse, np.column_stack(columns), len(cells)))
    cells, inverse = np.unique(np.concatenate(found), return_inverse=True)
    own = _summed(inverse, np.concatenate(sums), len(cells))
    total = np.zeros_like(own)
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), -1).reshape(-1, 3)
    for step in steps @ [SIDE * SIDE, SIDE, np.int64(1)]:
        at = np.minimum(np.searchsorted(cells, cells + step), len(cells) - 1)
        total += np.where((cells[at] == cells + step)[:, None], own[at], 0.0)
    area = np.where(total[:, :1] > 0.0, total[:, :1], 1.0)
    return Edges(cells, total[:, 1:4] / area, total[:, 4:7] / area, _thin(total[:, 4:] / area, total[:, 0]))


def _thin(means, area):
    """`Edges.thin` of cells [C], of the means of normals and of their products [C, 9], and the areas about them."""
    thin = np.ones(len(means))
    cancel = np.flatnonzero(np.linalg.norm(means[:, :3], axis=1) < THIN)
    products = np.zeros((len(cancel), 3, 3))
    for (i, j), column in zip(PAIRS, means[cancel, 3:].T, strict=True):
        products[:, i, j] = products[:, j, i] = column
    sheet = cancel[np.linalg.eigvalsh(products)[:, 2] > SHEET]
    whole = 2.0 * (3.0 * CELL_M) ** 2  # both sides, straight through a cell and its neighbours
    thin[sheet] = np.clip((RIM - area[sheet] / whole) / RIM_OVER, 0.0, 1.0)
    return thin


def _samples(corners, keys):
    """Points [N, 3] of triangles, several of large ones, and the area vectors [N, 3] [m^2] that they stand for."""
    a, b, c = np.moveaxis(corners, 1, 0)
    vectors = 0.5 * np.cross(b - a, c - a)
    times = np.maximum(np.ceil(PER_CELL * np.linalg.norm(vectors, axis=1) / CELL_M**2), 1.0).astype(np.int64)
    if (times == 1).all():
        return (a + b + c) / 3.0, vectors
    face = np.repeat(np.arange(len(times)), times)
    turn = np.arange(len(face)) - np.repeat(np.cumsum(times) - times, times)
    chance = mixed(keys[face], turn.astype(np.uint64))
    u, v = np.sqrt(uniform(chance, 0))[:, None], uniform(chance, 1)[:, None]
    return (1.0 - u) * a[face] + u * (1.0 - v) * b[face] + u * v * c[face], (vectors / times[:, None])[face]


def _summed(inverse, columns, count):
    return np.column_stack([np.bincount(inverse, column, count) for column in columns.T]).astype(float, copy=False)


def _key(cells):
    return (cells + SIDE // 2) @ np.array([SIDE * SIDE, SIDE, np.int64(1)])
