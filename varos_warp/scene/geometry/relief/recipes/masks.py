"""Masks that the form of a mesh tells: edges, grooves, what faces up, what is sheltered."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import sparse

from varos_warp.device.launch import in_threads, tiles_of
from varos_warp.scene.geometry.lazily import once
from varos_warp.scene.geometry.relief.recipes.runs import Slopes, slopes_of

ITERATIONS = 80
TOLERANCE = 1e-2
"""Of the conjugate gradients: by how much of what is smoothed away they may be off."""
FOLD = 64
"""Rows of an array that are multiplied as one."""
EDGES = 3.0
"""Scale of convexity, in edges."""
NO_FACES = np.zeros((0, 3), np.int32)
BROAD = 2.0
"""Scale of what shelters, over that of convexity."""


@dataclass(frozen=True, eq=False)
class Shape:
    """The form of a mesh at its N vertices; what is not asked for is not computed."""

    p: np.ndarray
    """float64 [N, 3]: places [m]."""
    faces: np.ndarray
    """int [F, 3]"""
    n: np.ndarray
    """float64 [N, 3]: unit normals."""
    scale: np.ndarray
    """float64 [N]: of convexity [m]."""

    @property
    def up(self) -> np.ndarray:
        """float64 [N]: z of the normals."""
        return self.n[:, 2]

    @once
    def neighbours(self) -> sparse.csr_array:
        """float64 [N, N]: 1 where an edge joins two vertices."""
        return neighbours_of(len(self.p), self.faces)

    @once
    def _smooth(self) -> np.ndarray:
        return smoothed(self.p, self.p, self.neighbours, self.scale)

    @once
    def convexity(self) -> np.ndarray:
        """float64 [N]: height over the surface smoothed at the scale asked for, over that scale.

        It is +0.3 or so on a sharp edge of 90 degrees, likewise negative in a groove; clipped to [-1, 1]. A ball of
        radius R has 2 s / R where the scale s is small beside it.
        """
        return _convexity(self.p, self._smooth, self.n, self.scale)

    @once
    def hollow(self) -> np.ndarray:
        """float64 [N]: 0 on flat and convex places to 1 in sharp grooves of that scale."""
        return np.clip(-3.0 * self.convexity, 0.0, 1.0)

    @once
    def exposure(self) -> np.ndarray:
        """float64 [N]: 1 where water passes freely to 0 deep in hollows of twice the scale; 0.8 on a plane."""
        broad = smoothed(self.p, self.p, self.neighbours, BROAD * self.scale, near=self._smooth)
        return np.clip(0.8 + 2.5 * np.minimum(_convexity(self.p, broad, self.n, BROAD * self.scale), 0.08), 0.0, 1.0)

    @once
    def slopes(self) -> Slopes:
        """The ways of water down the surface."""
        return slopes_of(self.p, self.n, self.neighbours)

    def some(self, rows: np.ndarray) -> Self:
        """The masks at some of the vertices, by their numbers; nothing can run down from one to another of them."""
        return Some(self.p[rows], NO_FACES, self.n[rows], self.scale[rows], self, rows)


@dataclass(frozen=True, eq=False)
class Some(Shape):
    """The form of a mesh at some of its vertices."""

    whole: Shape
    rows: np.ndarray
    """int [N]: their numbers in it."""

    @once
    def convexity(self) -> np.ndarray:
        """float64 [N]: that of the whole mesh there."""
        return self.whole.convexity[self.rows]

    @once
    def exposure(self) -> np.ndarray:
        """float64 [N]: that of the whole mesh there."""
        return self.whole.exposure[self.rows]


def neighbours_of(count: int, faces: np.ndarray) -> sparse.csr_array:
    """Which of ``count`` vertices edges join, symmetric."""
    row, col = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    joined = sparse.coo_array((np.ones(len(row)), (row, col)), shape=(count, count)).tocsr()
    joined.data[:] = 1.0
    return joined


def shape_of(p: np.ndarray, faces: np.ndarray, n: np.ndarray, edge: np.ndarray) -> Shape:
    """The masks of a mesh, at a scale of EDGES edges.

    Args:
        p: Places, float64 [N, 3] [m].
        faces: int [F, 3].
        n: Unit normals, float64 [N, 3].
        edge: Length of the edges at the vertices, float64 [N] [m].
    """
    return Shape(p, faces, n, EDGES * edge)


def convexity_of(p: np.ndarray, n: np.ndarray, neighbours: sparse.csr_array, scale: np.ndarray | float) -> np.ndarray:
    """`Shape.convexity` at a scale [m], one or [N]; of a base mesh it is `Sites.sharp`. float64 [N]."""
    return _convexity(p, smoothed(p, p, neighbours, scale), n, scale)


def _convexity(p, smooth, n, scale):
    return np.clip(np.einsum("ij,ij->i", p - smooth, n) / scale, -1.0, 1.0)


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
    squares = _edge_squares(p, neighbours)
    mass = np.bincount(squares.row, squares.data, minlength=len(p)) / (4.0 * np.square(scale))
    degree = np.diff(neighbours.indptr)
    mass = np.where(degree > 0, np.maximum(mass, 1e-9), 1.0).astype(np.float32)
    # as wide as the values: numpy takes several times as long where it has to repeat a column
    mass, diagonal = (np.repeat(x[:, None], values.shape[1], axis=1) for x in (mass, mass + degree.astype(np.float32)))
    adjacency = neighbours.astype(np.float32)
    tiles = [(rows, adjacency[rows]) for rows in tiles_of(len(p))]
    offset = values.mean(axis=0)  # single precision is for what differs
    start = (values - offset).astype(np.float32)
    first = start if near is None else (near - offset).astype(np.float32)

    def product(q):
        image = np.empty_like(q)

        def fill(tile):
            rows, near = tile
            np.subtract(diagonal[rows] * q[rows], near @ q, out=image[rows])

        in_threads(fill, tiles)
        return image

    # how far off the values themselves are is what the tolerance goes by, wherever the search begins
    rest = mass * start - product(start)
    goal = TOLERANCE**2 * _dots(rest, rest / diagonal)
    found = _conjugate_gradients(product, mass * start, first, diagonal, goal)
    return offset + found


def _conjugate_gradients(product, right, q, diagonal, goal):
    """Solution [N, K] of a positive definite system, each column by itself, with the diagonal as preconditioner.

    The search begins from ``q`` and ends where no column's residual is longer than the root of its ``goal``.
    """
    residual = right - product(q)
    direction = residual / diagonal
    power = _dots(residual, direction)
    for _ in range(ITERATIONS):
        if (power <= goal).all():
            break
        image = product(direction)
        step = (power / np.maximum(_dots(direction, image), 1e-300)).astype(np.float32)
        q, residual = _moved(q, direction, step), _moved(residual, image, -step)
        scaled = residual / diagonal
        before, power = power, _dots(residual, scaled)
        direction = _moved(scaled, direction, (power / np.maximum(before, 1e-300)).astype(np.float32))
    return q.astype(np.float64)


def _moved(a, way, factors):
    """An array [N, K] plus a way [N, K] times a factor [K] for each column.

    Many rows are taken as one long one: over rows of three numpy takes three times as long.
    """
    whole, width = len(a) - len(a) % FOLD, FOLD * len(factors)
    out = np.empty_like(a)
    np.multiply(way[:whole].reshape(-1, width), np.tile(factors, FOLD), out=out[:whole].reshape(-1, width))
    np.multiply(way[whole:], factors, out=out[whole:])
    out += a
    return out


def _dots(a, b):
    """Dot products of columns, in float64; einsum adds in an order that does not depend on the number of threads."""
    return np.einsum("ij,ij->j", a, b, dtype=np.float64)


def _edge_squares(p, neighbours) -> sparse.coo_array:
    """Squared lengths of the edges, in the pattern of the neighbours."""
    joined = neighbours.tocoo()
    apart = p[joined.row] - p[joined.col]
    return sparse.coo_array((np.einsum("ij,ij->i", apart, apart), (joined.row, joined.col)), shape=joined.shape)
