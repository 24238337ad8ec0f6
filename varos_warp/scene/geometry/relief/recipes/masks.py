"""Masks that the form of a mesh tells: edges, grooves, what faces up, what is sheltered."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import sparse

from varos_warp.scene.geometry.lazily import once
from varos_warp.scene.geometry.relief.recipes.diffusion import smoothed
from varos_warp.scene.geometry.relief.recipes.runs import Slopes, slopes_of

EDGES = 3.0
"""Scale of convexity, in edges."""
NONE = sparse.csr_array((0, 0))
BROAD = 2.0
"""Scale of what shelters, over that of convexity."""


@dataclass(frozen=True, eq=False)
class Shape:
    """The form of a mesh at its N vertices; what is not asked for is not computed."""

    p: np.ndarray
    """float64 [N, 3]: places [m]."""
    n: np.ndarray
    """float64 [N, 3]: unit normals."""
    scale: np.ndarray
    """float64 [N]: scale of convexity [m]."""
    neighbours: sparse.csr_array
    """float64 [N, N]: 1 where an edge joins two vertices."""

    @property
    def up(self) -> np.ndarray:
        """float64 [N]: z of the normals."""
        return self.n[:, 2]

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
        return Some(self.p[rows], self.n[rows], self.scale[rows], NONE, self, rows)


@dataclass(frozen=True, eq=False)
class Some(Shape):
    """The form of a mesh at some of its vertices."""

    whole: Shape
    rows: np.ndarray
    """int [N]: numbers of these vertices in the mesh."""

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
    # small numbers while they are sorted: it takes half the time
    found = sparse.coo_array((np.ones(len(row), np.int8), (row, col)), shape=(count, count)).tocsr()
    return sparse.csr_array((np.ones(len(found.indices)), found.indices, found.indptr), shape=found.shape)


def shape_of(p: np.ndarray, neighbours: sparse.csr_array, n: np.ndarray, edge: np.ndarray) -> Shape:
    """The masks of a mesh, at a scale of EDGES edges.

    Args:
        p: Places, float64 [N, 3] [m].
        neighbours: Which of them edges join, [N, N].
        n: Unit normals, float64 [N, 3].
        edge: Length of the edges at the vertices, float64 [N] [m].
    """
    return Shape(p, n, EDGES * edge, neighbours)


def convexity_of(p: np.ndarray, n: np.ndarray, neighbours: sparse.csr_array, scale: np.ndarray | float) -> np.ndarray:
    """`Shape.convexity` at a scale [m], one or [N]; of a base mesh it is `Sites.sharp`. float64 [N]."""
    return _convexity(p, smoothed(p, p, neighbours, scale), n, scale)


def _convexity(p, smooth, n, scale):
    return np.clip(np.einsum("ij,ij->i", p - smooth, n) / scale, -1.0, 1.0)
