"""F against D: the flow of a point follows from its distance, the poses of two frames and the camera."""

from collections.abc import Iterator

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.rows import next_sight, sight
from varos_warp.dataset.validate.objects import moving_parts, solid
from varos_warp.products.images.depth import DEPTH_LEVELS
from varos_warp.products.images.flow import FlowImage
from varos_warp.render.image.flow import Moved, MovingPart, flow_by_rows, flow_of
from varos_warp.scene.description.image_types import SEGMENTS
from varos_warp.scene.frames import inverse

EVERY = 5
"""Rows and columns between the pixels that are looked at."""
HALF_STEP = 0.51
"""Largest error of D in its steps: its rounding, and a little for that of its float32."""
SLACK_PX, SLACK_M = 1e-3, 1e-5
"""What float32 may round in the flow and in the motion."""


def against_depth(data: Dataset, camera: str, frame: int, found: FlowImage, levels: np.ndarray) -> Iterator[str]:
    """What is wrong with F, where the pose of the next frame is on record; ``levels`` are the pixels of D [H, W]."""
    T_w_next = next_sight(data, frame, camera)
    row, col = (places[::EVERY, ::EVERY].ravel() for places in np.indices(levels.shape))
    inside = (levels[row, col] > 0) & (levels[row, col] < DEPTH_LEVELS)
    row, col = row[inside], col[inside]
    unknown = solid(data) and SEGMENTS not in data.outputs  # whose pixels are whose
    if T_w_next is None or not row.size or unknown:
        return
    poses = sight(data, frame, camera), T_w_next
    moving = moving_parts(data, frame, camera, row, col)
    ends = [
        _moved(data, camera, poses, row, col, levels[row, col] + offset, moving) for offset in (-HALF_STEP, HALF_STEP)
    ]
    for name, image, slack in (("flow", found.flow, SLACK_PX), ("motion", found.motion, SLACK_M)):
        values = np.stack([getattr(end, name) for end in ends])
        known, value = np.isfinite(values).all((0, -1)), image[row, col]
        off = np.maximum(values.min(0) - value, value - values.max(0)).max(-1)  # NaN where one is not known
        wrong = known & ~(off <= slack) | np.isnan(values).all((0, -1)) & np.isfinite(value).all(-1)
        if wrong.any():
            i = int(np.argmax(wrong))
            yield (
                f"the {name} of {wrong.sum()} of {wrong.size} pixels does not follow from D and the poses of two "
                f"frames, the first in row {row[i]}, column {col[i]}"
            )


def _moved(
    data: Dataset,
    camera: str,
    poses: tuple[np.ndarray, np.ndarray],
    row: np.ndarray,
    col: np.ndarray,
    levels: np.ndarray,
    moving: list[MovingPart],
) -> Moved:
    """What pixels move that have values of D between its steps; ``poses``: of the frame and of the next."""
    model, points = data.camera_model(camera), np.stack([col + 0.5, row + 0.5], -1)
    rays, distance = model.rays(points), data.meta["depth"]["range_m"][0] + levels * data.meta["depth"]["scale_m"]
    if data.meta["depth"]["kind"] == "z":
        distance = (distance - rays.origin[:, 2]) / rays.direction[:, 2]
    if poses[0].ndim == 3 or moving:
        return flow_by_rows(model, points, rays, distance, *(T.reshape(-1, 4, 4) for T in poses), moving)
    return flow_of(model, points, rays, distance, inverse(poses[1]) @ poses[0])
