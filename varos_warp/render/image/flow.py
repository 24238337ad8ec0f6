"""Optical flow: where a camera sees again, from its next place, what it sees now."""

from typing import NamedTuple

import numpy as np

from varos_warp.scene.optics.camera import CameraModel, Rays


class Moved(NamedTuple):
    """Of what each pixel sees, float64; NaN where nothing is hit."""

    flow: np.ndarray
    """[..., 2] [pixels], to the right and down; NaN also where the camera cannot see it from its next place."""
    motion: np.ndarray
    """[..., 3] [m]: its place in the axes of the next camera less that in those of this one."""
    eye: np.ndarray
    """[..., 3] [m] in the axes of the next camera: where its light gets there, the lens or the port; NaN as flow."""


def flow_of(model: CameraModel, points: np.ndarray, rays: Rays, distance: np.ndarray, T_next_c: np.ndarray) -> Moved:
    """The flow of a world that stands still.

    Args:
        model: The camera at its next place.
        points: Image points [..., 2] [pixels], the centres of pixels.
        rays: Of them [...], in the axes of the camera.
        distance: Of what they see, along the rays [...] [m], as `DepthImage.range`; inf for none.
        T_next_c: From the axes of the camera to those of its next place, [4, 4].
    """
    here = rays.origin + np.where(np.isfinite(distance), distance, np.nan)[..., None] * rays.direction
    there = (here.reshape(-1, 3) @ T_next_c[:3, :3].T + T_next_c[:3, 3]).reshape(here.shape)  # one product is quick
    seen = model.project(there)
    eye = model.rays(seen).origin if model.port else np.where(np.isnan(seen[..., :1]), np.nan, np.zeros(3))
    return Moved(seen - points, there - here, eye)
