"""Points on what the cameras see, back-projected from D: where Gaussian splatting and COLMAP's tools begin."""

from dataclasses import dataclass

import numpy as np

from varos_warp.dataset.export.shared.job import Job
from varos_warp.dataset.reader.points import points_at
from varos_warp.dataset.reader.rows import sight

COUNT = 50_000
"""Points in all, as many from each image."""


@dataclass(frozen=True)
class Seed:
    """Points that one image saw."""

    xyz: np.ndarray
    """World coordinates, float64 [N, 3], [m]."""
    rgb: np.ndarray
    """Colour of the pixel, uint8 [N, 3]."""
    uv: np.ndarray
    """Place in the image, float64 [N, 2] [px]; the centre of the top left pixel is (0.5, 0.5)."""


def seeds(job: Job, camera: str) -> list[Seed]:
    """Points from every frame of a camera, at pixels drawn anew in each; the same at every call; none without D.

    They are as exact as D is: half of one of its 65535 steps along the camera's z, and the middle of a pixel.
    """
    if not job.has_depth:
        return [Seed(np.empty((0, 3)), np.empty((0, 3), np.uint8), np.empty((0, 2)))] * len(job.data)
    count = -(-COUNT // (len(job.cameras) * len(job.data)))
    model = job.data.camera_model(camera)

    def points(frame: int) -> Seed:
        z, colors = job.data.planar_depth(frame, camera), job.data.pixels(job.images, frame, camera)
        seen = np.flatnonzero(np.isfinite(z) & (z > 0))
        rng = np.random.default_rng([job.data.cameras.index(camera), frame])
        row, col = np.unravel_index(np.sort(rng.choice(seen, min(count, len(seen)), replace=False)), z.shape)
        xyz = points_at(model, sight(job.data, frame, camera), row, col, z[row, col])
        return Seed(xyz, colors[row, col], np.column_stack([col, row]) + 0.5)

    return job.each(f"points {camera}", points)
