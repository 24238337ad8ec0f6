"""Diffusion on meshes: values smoothed at a scale, by conjugate gradients over tiles of vertices.

Threads share the tiles; sums go over tiles in their order, so that no byte depends on the number of threads.
"""

import numpy as np
import warp as wp
from scipy import sparse

from varos_warp.device.devices import upload, usable_cores
from varos_warp.device.launch import in_threads, launch_rows, tiles_of
from varos_warp.kernels.mesh import diffusion as kernels

ITERATIONS = 80
TOLERANCE = 1e-2
"""Residual at which the conjugate gradients end, over that of the values."""


def smoothed(
    values: np.ndarray,
    p: np.ndarray,
    neighbours: sparse.csr_array,
    scale: np.ndarray | float,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """Values [N, 3] after implicit diffusion on the mesh, q - scale^2 Laplace(q) = values.

    The mean over a ring of radius e is q + e^2 / 4 Laplace(q), so the Laplacian is that of the graph, times 4 / e^2
    with e^2 the mean square of a vertex' edges. Conjugate gradients take as many steps as a scale has edges; averaging
    again and again would take the square of that. ``near`` [N, 3] is what the search begins from: the values where
    nothing nearer is known.
    """
    mass = _edge_squares(p, neighbours) / (4.0 * np.square(scale))
    degree = np.diff(neighbours.indptr)
    mass = np.where(degree > 0, np.maximum(mass, 1e-9), 1.0).astype(np.float32)
    offset = values.mean(axis=0)  # single precision is for what differs
    start = (values - offset).astype(np.float32)
    first = start if near is None else (near - offset).astype(np.float32)
    return offset + _Search(mass, mass + degree.astype(np.float32), neighbours).run(start, first)


class _Search:
    """Conjugate gradients in (diagonal - neighbours) q = mass values, with the diagonal as preconditioner."""

    def __init__(self, mass: np.ndarray, diagonal: np.ndarray, neighbours: sparse.csr_array):
        tiles = tiles_of(len(mass))
        self._count = len(tiles)
        self._search = search = kernels.Search()
        search.rows = _sent(np.array([0, *(tile.stop for tile in tiles)]))
        search.starts, search.joined = _sent(neighbours.indptr), _sent(neighbours.indices)
        search.mass, search.diagonal = (upload(x, wp.float32, "cpu") for x in (mass, diagonal))

    def run(self, values: np.ndarray, q: np.ndarray) -> np.ndarray:
        """The solution float64 [N, 3], each column by itself; ``q`` [N, 3] is what it is sought from.

        It ends where no column's residual is longer than `TOLERANCE` of that of the values themselves.
        """
        search = self._search
        search.values, first = (upload(x, wp.vec3, "cpu") for x in (values, q))
        search.q = wp.clone(first)
        search.residual, search.direction, search.image = (wp.empty_like(first) for _ in range(3))
        if self._count == 1:
            self._run(kernels.solve, iterations=ITERATIONS, tolerance=TOLERANCE**2)
        else:
            self._steps()
        return search.q.numpy().astype(np.float64)

    def _steps(self):
        """What `kernels.solve` does, by many threads."""
        goal = TOLERANCE**2 * self._sum(kernels.begin, q=self._search.values)
        power = self._sum(kernels.begin, q=self._search.q)
        for _ in range(ITERATIONS):
            if (power <= goal).all():
                break
            along = self._sum(kernels.project)
            before, power = power, self._sum(kernels.step, by=_ratio(power, along))
            self._run(kernels.turn, by=_ratio(power, before))

    def _sum(self, kernel: wp.Kernel, **arguments) -> np.ndarray:
        """The sum [3] of what a kernel finds for each tile, in their order."""
        sums = wp.empty(self._count, dtype=wp.vec3d, device="cpu")
        self._run(kernel, sums=sums, **arguments)
        return sum(sums.numpy(), np.zeros(3))

    def _run(self, kernel: wp.Kernel, **arguments) -> None:
        rows = -(-self._count // usable_cores())  # a launch takes as long as a tenth of a tile
        launch_rows(kernel, (self._count,), {"search": self._search, **arguments}, "cpu", rows=rows)


def _sent(numbers):
    return upload(numbers.astype(np.int32, copy=False), wp.int32, "cpu")


def _ratio(a, b):
    return wp.vec3(*(a / np.maximum(b, 1e-300)).astype(np.float32).tolist())


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
    """Ends [E] of the edges at some vertices: the number of the one in ``rows``, and that of the other."""
    starts = neighbours.indptr[rows.start : rows.stop + 1]
    return np.repeat(np.arange(len(starts) - 1), np.diff(starts)), neighbours.indices[starts[0] : starts[-1]]
