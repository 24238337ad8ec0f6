"""Find whether a step kept the model: what was seen of it is still there, with its area, and little else has come.

A shrinkwrap makes nothing or slivers of what is thinner than its first grid can tell, and both can be watertight.
"""

import numpy as np

from varos_warp.scene.geometry.joining import median_edge
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.terrain.comparison import mesh_area, sample_surface

SAMPLES = 10_000
"""Points on the model of which those that are seen are looked for in the result."""

NEAR = 0.02
"""What is farther from the result than this share of the longer side is lost; or than an edge, if longer."""

MOST_LOST, RUIN = 0.1, 0.5
"""Share of what is seen that may be lost (crevices, loose pieces) without a word, and with a warning."""

LEAST_AREA = 0.25
"""Area of a result, as a share of what is seen of the model; a rough one loses more than half by honest decimation."""


class Model:
    """A mesh before the steps that could ruin it.

    Args:
        region: Only what is in xmin, ymin, xmax, ymax [m] is looked for.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, device: str = "cpu", region=None):
        self.low, self.size, self.device = vertices.min(axis=0), np.ptp(vertices, axis=0), device
        vertices = self._scaled(vertices)
        self.surface = Surface(vertices, faces, device)
        points, face = sample_surface(vertices, faces, SAMPLES)
        seen = np.zeros(len(points), bool)
        for direction in np.vstack([np.eye(3), -np.eye(3)]):
            seen |= self.surface.first_hits(points - 2.0 * direction, direction)[0] == face
        if region is not None:
            place = points[:, :2] * self.size.max() + self.low[:2]
            seen &= ((place >= region[:2]) & (place <= region[2:])).all(axis=1)
        self.points = points[seen] if seen.any() else points
        self.area = mesh_area(vertices, faces) * len(self.points) / len(points)

    def _scaled(self, vertices):
        """Vertices in units of the longer side: the library's distances are good to an absolute tolerance."""
        return (vertices - self.low) / self.size.max()

    def lost_in(self, vertices: np.ndarray, faces: np.ndarray) -> tuple[str | None, bool]:
        """What a step that made another mesh of the model lost, in words (None: little), and whether it is a ruin."""
        sizes = (self.size, np.ptp(vertices, axis=0))
        extents = " m became ".join(" x ".join(f"{x:.3g}" for x in size) for size in sizes)
        vertices, side = self._scaled(vertices), self.size.max()
        near = max(NEAR, median_edge(vertices, faces))
        far = float(np.mean(Surface(vertices, faces, self.device).nearest(self.points)[0] > near))
        area = mesh_area(vertices, faces) / self.area
        off = float(np.median(self.surface.nearest(sample_surface(vertices, faces, SAMPLES)[0])[0]))
        if far <= MOST_LOST and area >= LEAST_AREA and off <= near:
            return None, False
        return (
            f"loses much of the model: {100 * far:.0f} % of what is seen of it is more than {near * side:.3g} m "
            f"away from the result, {100 * area:.0f} % of its area is left, half of the result is more than "
            f"{off * side:.3g} m away from the model; {extents} m"
        ), far > RUIN or area < LEAST_AREA or off > near
