"""What an exposure does to B, which other checks hold against poses and D of the middle of the exposure.

A point leaves a streak. Where its speed changes meanwhile, or by perspective, the streak's mean lies beside the point.
"""

from typing import NamedTuple

import numpy as np

from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project, seen_pixels
from varos_warp.scene.optics.shutter import in_ns

POINTS = 400
"""Number of points of an image that are looked at."""
INSTANTS, WEIGHTS = np.linspace(-0.5, 0.5, 5), np.array([1.0, 4.0, 2.0, 4.0, 1.0]) / 12.0
"""Instants of an exposure, as shares of it from its middle, and their weights: Simpson's rule."""


class Blur(NamedTuple):
    """Motion blur of an image."""

    streak: np.ndarray
    """[2] [px]: from where points are at the beginning of the exposure to where they are at its end; their mean."""
    displaced: float
    """[px]: how far the mean of a streak is from its point, at most."""


SHARP = Blur(np.zeros(2), 0.0)
UNKNOWN = Blur(np.full(2, np.nan), np.inf)
"""Blur of an image where the vehicle's motion is not on record."""


def blur_of(data: Dataset, frame: int, camera: str, depth: np.ndarray) -> Blur:
    """How far B of a frame is blurred; ``depth`` [H, W] [m] is along the axis."""
    about, model = data.camera(camera), data.camera_model(camera)
    exposure_s = rows.exposure_s(about)
    row, col, z = seen_pixels(depth, POINTS)
    if not exposure_s or about["mount"] == "world" or not len(z):
        return SHARP
    points = points_at(model, rows.sight(data, frame, camera), row, col, z)
    poses = [rows.by_motion(data, frame, camera, later) for later in in_ns(exposure_s * INSTANTS).tolist()]
    if any(T is None for T in poses):
        return UNKNOWN
    seen = np.stack([project(points, model, T)[:, :2] for T in poses])
    seen = seen[:, np.isfinite(seen).all((0, 2))]
    beside = np.tensordot(WEIGHTS, seen - seen[len(seen) // 2], 1)
    if not len(beside):
        return UNKNOWN
    return Blur((seen[-1] - seen[0]).mean(0), float(np.hypot(*beside.T).max()))
