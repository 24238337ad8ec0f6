"""Diffusion on meshes: values smoothed at a scale, by conjugate gradients over tiles of vertices.

Threads share the tiles; sums go over tiles in their order, so that no byte depends on the number of threads.
"""

from collections.abc import Callable

import numpy as np
from scipy import sparse

from varos_warp.device.launch import in_threads, tiles_of

ITERATIONS = 80
TOLERANCE = 1e-2
"""Of the conjugate gradients: by how much of what is smoothed away they may be off."""
FOLD = 64
"""Rows of an array that are multiplied as one."""

Tile = tuple[slice, sparse.csr_array]
"""Rows, and their part of the matrix of neighbours."""


def smoothed(
    values: np.ndarray,
    p: np.ndarray,
    neighbours: sparse.csr_array,
    scale: np.ndarray | float,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """Values [N, K] after implicit diffusion on the mesh, q - scale^2 Laplace(q) = values.

    The mean over a ring of radius e is q + e^2 / 4 Laplace(q), so the Laplacian is that of the graph, times 4 / e^2
    with e^2 the mean square of a vertex' edges. Conjugate gradients take as many steps as a scale has edges; averaging
    again and again would take the square of that. ``near`` [N, K] is what the search begins from: the values where
    nothing nearer is known.
    """
    mass = _edge_squares(p, neighbours) / (4.0 * np.square(scale))
    degree = np.diff(neighbours.indptr)
    mass = np.where(degree > 0, np.maximum(mass, 1e-9), 1.0).astype(np.float32)
    # as wide as the values: numpy takes several times as long where it has to repeat a column
    mass, diagonal = (np.repeat(x[:, None], values.shape[1], axis=1) for x in (mass, mass + degree.astype(np.float32)))
    adjacency = neighbours.astype(np.float32)
    offset = values.mean(axis=0)  # single precision is for what differs
    start = (values - offset).astype(np.float32)
    first = start if near is None else (near - offset).astype(np.float32)
    tiles = [(rows, adjacency[rows]) for rows in tiles_of(len(p))]
    return offset + _Search(mass, diagonal, tiles).run(start, first)


class _Search:
    """Conjugate gradients in (diagonal - neighbours) q = mass values, with the diagonal as preconditioner."""

    def __init__(self, mass: np.ndarray, diagonal: np.ndarray, tiles: list[Tile]):
        self._mass, self._diagonal, self._tiles = mass, diagonal, tiles

    def run(self, values: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The solution float64 [N, K], each column by itself; ``q`` [N, K] is what it is sought from.

        It ends where no column's residual is longer than `TOLERANCE` of that of the values themselves.
        """
        q, (residual, direction, image) = q.copy(), (np.empty_like(q) for _ in range(3))
        goal = TOLERANCE**2 * self._sum(lambda tile: self._begin(values, values, residual, direction, tile))
        power = self._sum(lambda tile: self._begin(values, q, residual, direction, tile))
        for _ in range(ITERATIONS):
            if (power <= goal).all():
                break
            along = self._sum(lambda tile: self._project(direction, image, tile))
            step = (power / np.maximum(along, 1e-300)).astype(np.float32)
            before, power = power, self._sum(lambda tile, by=step: self._step(q, residual, direction, image, by, tile))
            share = (power / np.maximum(before, 1e-300)).astype(np.float32)
            self._sum(lambda tile, by=share: self._turn(direction, residual, by, tile))
        return q.astype(np.float64)

    def _sum(self, part: Callable[[Tile], np.ndarray | float]):
        return sum(in_threads(part, self._tiles))

    def _product(self, q, tile):
        rows, near = tile
        return self._diagonal[rows] * q[rows] - near @ q

    def _begin(self, values, q, residual, direction, tile):
        rows, _ = tile
        np.subtract(self._mass[rows] * values[rows], self._product(q, tile), out=residual[rows])
        np.divide(residual[rows], self._diagonal[rows], out=direction[rows])
        return _dots(residual[rows], direction[rows])

    def _project(self, direction, image, tile):
        rows, _ = tile
        image[rows] = self._product(direction, tile)
        return _dots(direction[rows], image[rows])

    def _step(self, q, residual, direction, image, by, tile):
        rows, _ = tile
        q[rows] += _times(direction[rows], by)
        residual[rows] += _times(image[rows], -by)
        return _dots(residual[rows], residual[rows] / self._diagonal[rows])

    def _turn(self, direction, residual, by, tile):
        rows, _ = tile
        direction[rows] = residual[rows] / self._diagonal[rows] + _times(direction[rows], by)
        return 0.0


def _times(way, factors):
    """A way [N, K] times a factor [K] for each column.

    Many rows are taken as one long one: over rows of three numpy takes three times as long.
    """
    whole, width = len(way) - len(way) % FOLD, FOLD * len(factors)
    out = np.empty_like(way)
    np.multiply(way[:whole].reshape(-1, width), np.tile(factors, FOLD), out=out[:whole].reshape(-1, width))
    np.multiply(way[whole:], factors, out=out[whole:])
    return out


def _dots(a, b):
    """Dot products of columns, in float64."""
    return np.einsum("ij,ij->j", a, b, dtype=np.float64)


def _edge_squares(p, neighbours):
    """Sum [N] of the squared lengths of the edges at each vertex."""
    sums = np.zeros(len(p))

    def fill(rows):
        row, other = ends_of(neighbours, rows)
        apart = p[rows.start + row] - p[other]
        sums[rows] = np.bincount(row, np.einsum("ij,ij->i", apart, apart), rows.stop - rows.start)

    in_threads(fill, tiles_of(len(p)))
    return sums


def ends_of(neighbours: sparse.csr_array, rows: slice) -> tuple[np.ndarray, np.ndarray]:
    """Both ends [E] of the edges at some vertices: the number of the one in ``rows``, and that of the other."""
    starts = neighbours.indptr[rows.start : rows.stop + 1]
    return np.repeat(np.arange(len(starts) - 1), np.diff(starts)), neighbours.indices[starts[0] : starts[-1]]
