"""F against D: the flow of a point follows from its distance, the poses of two frames and the camera."""

from collections.abc import Iterator

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.moving import motions, of_moving, rolls
from varos_warp.render.image.flow import Moved, flow_of
from varos_warp.render.image.frame import FlowImage
from varos_warp.render.image.outputs import DEPTH_LEVELS
from varos_warp.scene.frames import inverse

EVERY = 5
"""Rows and columns between the pixels that are looked at."""
HALF_STEP = 0.51
"""Of D: its rounding, and a little for that of its float32."""
SLACK_PX, SLACK_M = 1e-3, 1e-5
"""What float32 may round in the flow and in the motion."""


def against_depth(data: Dataset, camera: str, frame: int, found: FlowImage, levels: np.ndarray) -> Iterator[str]:
    """What is wrong with F, where the pose of the next frame is on record; ``levels`` are the pixels of D [H, W]."""
    T_w_next = data.next_T_w_c(frame, camera)
    row, col = (places[::EVERY, ::EVERY].ravel() for places in np.indices(levels.shape))
    inside = (levels[row, col] > 0) & (levels[row, col] < DEPTH_LEVELS)
    if data.moving:
        if "S" not in data.outputs:
            return  # whose pixels are whose is not known
        # of a rolling shutter, each row has what moves where it is at a time of its own
        inside &= ~(of_moving(data, frame, camera)[row, col] & rolls(data, camera))
    row, col = row[inside], col[inside]
    if T_w_next is None or not row.size:
        return
    T_w_c, T_next_w = data.T_w_c(frame, camera), inverse(T_w_next)
    T = np.tile(T_next_w @ T_w_c, (len(row), 1, 1)) if data.moving else T_next_w @ T_w_c
    numbers = data.pixels("S", frame, camera)[row, col] if data.moving else np.zeros(0)
    for number, motion in motions(data, frame).items():
        T[numbers == number] = T_next_w @ motion @ T_w_c
    ends = [_moved(data, camera, T, row, col, levels[row, col] + offset) for offset in (-HALF_STEP, HALF_STEP)]
    for name, image, slack in (("flow", found.flow, SLACK_PX), ("motion", found.motion, SLACK_M)):
        values = np.stack([getattr(end, name) for end in ends])
        known, value = np.isfinite(values).all((0, -1)), image[row, col]
        off = np.maximum(values.min(0) - value, value - values.max(0)).max(-1)  # NaN where one is not known
        wrong = known & ~(off <= slack) | np.isnan(values).all((0, -1)) & np.isfinite(value).all(-1)
        if wrong.any():
            i = int(np.argmax(wrong))
            yield (f"the {name} of {wrong.sum()} of {wrong.size} pixels does not follow from D and the poses of two "
                   f"frames, the first in row {row[i]}, column {col[i]}")


def _moved(data: Dataset, camera: str, T: np.ndarray, row: np.ndarray, col: np.ndarray, levels: np.ndarray) -> Moved:
    """What pixels move that have values of D between its steps."""
    model, points = data.camera_model(camera), np.stack([col + 0.5, row + 0.5], -1)
    rays, distance = model.rays(points), data.meta["depth"]["range_m"][0] + levels * data.meta["depth"]["scale_m"]
    if data.meta["depth"]["kind"] == "z":
        distance = (distance - rays.origin[:, 2]) / rays.direction[:, 2]
    return flow_of(model, points, rays, distance, T)
