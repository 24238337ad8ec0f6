"""How many triangles surfaces with relief take, and the one factor on their edges that keeps them within a bound."""

from dataclasses import dataclass, replace

import numpy as np

from varos_warp.scene.geometry.relief.density import Pixels, longest_edge
from varos_warp.scene.geometry.relief.subdivision import refine
from varos_warp.scene.geometry.topology import area_normals, chunks

MOST_TRIANGLES = 3_000_000
"""Most triangles of all surfaces with relief, unless the scene says another number; they load in half a minute on two
cores."""
FILL = 0.17
"""Area of a triangle over the square of the longest edge that is wanted there, on average, as `refine` leaves them
(measured on grids and spheres: 0.16 to 0.18)."""
COARSE = 8.0
"""Factor on the edges of the meshes that the count is estimated from."""
MOST_CROWDED = 2.0
LARGEST_FACTOR = 256.0
STEPS = 40


@dataclass(frozen=True, eq=False)
class Rough:
    """A surface whose triangles are counted: areas of a coarse mesh's triangles, and how wide a pixel is there."""

    area: np.ndarray
    """float64 [F] [m^2]"""
    pixel: np.ndarray
    """float64 [F] [m]"""
    least: int
    """Triangles that it has anyway."""
    crowded: float = 1.0
    """Triangles of the coarse mesh over those expected: needles take more, and halved edges are powers of two."""

    def count(self, factor: float) -> float:
        """About how many triangles it takes."""
        return max(self.crowded * self._expected(factor), self.least)

    def _expected(self, factor):
        return float((self.area / (FILL * np.square(longest_edge(self.pixel, factor)))).sum())


def rough(vertices: np.ndarray, faces: np.ndarray, pixel: Pixels, normals: np.ndarray | None = None) -> Rough:
    """What to count the triangles of a mesh by.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
    """
    v, f, _ = refine(vertices, faces, lambda points, normals: longest_edge(pixel(points, normals), COARSE), normals)
    middles, twice = np.concatenate([v[f[some]].mean(axis=1) for some in chunks(len(f))]), area_normals(v, f)
    area = np.linalg.norm(twice, axis=1)
    facing = np.zeros(twice.shape) if normals is None else twice / np.maximum(area, 1e-300)[:, None]
    found = Rough(0.5 * area, pixel(middles, facing), len(faces))
    return replace(found, crowded=float(np.clip(len(f) / found.count(COARSE), 1.0, MOST_CROWDED)))


def factor_for(surfaces: list[Rough], most: int) -> float:
    """The least factor of 1 or more on all edges with which the surfaces take about ``most`` triangles.

    Where the meshes have so many already, the bound is half as many again as they have.
    """
    most = max(most, int(1.5 * sum(surface.least for surface in surfaces)))

    def count(factor):
        return sum(surface.count(factor) for surface in surfaces)

    if count(1.0) <= most:
        return 1.0
    low, high = 1.0, LARGEST_FACTOR
    for _ in range(STEPS):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if count(middle) <= most else (middle, high)
    return float(high)
