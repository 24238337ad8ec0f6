"""Optical flow: where a camera sees again, from its next place, what it sees now."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from varos_warp.scene.optics.camera import CameraModel, Rays


class Moved(NamedTuple):
    """Motion of what each pixel sees, float64; NaN where nothing is hit."""

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
        T_next_c: From the axes of the camera to those of its next place, [4, 4], or [..., 4, 4] of each pixel.
    """
    here = rays.origin + np.where(np.isfinite(distance), distance, np.nan)[..., None] * rays.direction
    if T_next_c.ndim == 2:
        there = (here.reshape(-1, 3) @ T_next_c[:3, :3].T + T_next_c[:3, 3]).reshape(here.shape)  # one product is quick
    else:
        there = np.einsum("...ij,...j", T_next_c[..., :3, :3], here) + T_next_c[..., :3, 3]
    seen = model.project(there)
    eye = model.rays(seen).origin if model.port else np.where(np.isnan(seen[..., :1]), np.nan, np.zeros(3))
    return Moved(seen - points, there - here, eye)


CONVERGED = 1e-6
"""Rows; to find the row at which a moving camera sees a point, which tells when, and so where, it sees it."""
MOST_TRIES = 50
LOST = 1e-3
"""Rows; of a point for which these tries differ by more from each other, there is no flow."""


class MovingPart(NamedTuple):
    """An object that moves, in an image."""

    seen: np.ndarray
    """True where it is seen at an image point, bool [...]."""
    T_w_o: np.ndarray
    """Its pose for each row [height, 4, 4], or for all [1, 4, 4]."""
    T_w_next: np.ndarray
    """Its pose in the next frame, for each row [height, 4, 4], or for all [1, 4, 4]."""


def flow_by_rows(
    model: CameraModel,
    points: np.ndarray,
    rays: Rays,
    distance: np.ndarray,
    T_w_c: np.ndarray,
    T_w_next: np.ndarray,
    moving: Sequence[MovingPart] = (),
) -> Moved:
    """The flow as `flow_of` has it, between images with a rolling shutter or of a world in which objects move.

    Args:
        model, points, rays, distance: As for `flow_of`.
        T_w_c: Pose of the camera for each row [height, 4, 4].
        T_w_next: And in the next frame.
        moving: The objects.

    Returns:
        ``eye`` is in world axes.
    """
    T_c_w = np.linalg.inv(T_w_next)
    row, T_here = points[..., 1], at_row(T_w_c, points[..., 1])
    for part in moving:
        # what a pixel of the object sees, in its axes
        T_here[part.seen] = np.linalg.inv(at_row(part.T_w_o, row[part.seen])) @ T_here[part.seen]
    for _ in range(MOST_TRIES):
        T_there = at_row(T_c_w, row)
        for part in moving:
            T_there[part.seen] = T_there[part.seen] @ at_row(part.T_w_next, row[part.seen])
        found = flow_of(model, points, rays, distance, T_there @ T_here)
        before, row = row, np.where(np.isfinite(found.flow[..., 1]), points[..., 1] + found.flow[..., 1], row)
        if np.abs(row - before).max() < CONVERGED:
            break
    T = at_row(T_w_next, row)
    eye = np.einsum("...ij,...j", T[..., :3, :3], found.eye) + T[..., :3, 3]
    flow, eye = (np.where(np.abs(row - before)[..., None] > LOST, np.nan, of_pixels) for of_pixels in (found.flow, eye))
    return found._replace(flow=flow, eye=eye)


def at_row(T: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Poses [..., 4, 4] at image rows [pixels], between those [H, 4, 4] of the rows' middles."""
    place = np.clip(row - 0.5, 0.0, len(T) - 1.0)
    before = np.minimum(place.astype(int), max(len(T) - 2, 0))
    share = (place - before)[..., None, None]
    return (1.0 - share) * T[before] + share * T[np.minimum(before + 1, len(T) - 1)]
