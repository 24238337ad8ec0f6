"""Poses from which each row of an image is seen: of a rolling shutter every row has a time and a pose of its own."""

import contextlib
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.scene.frames import transform
from varos_warp.scene.optics.shutter import in_ns, offsets_of_rows_s
from varos_warp.sim.clock import frame_time_ns


def is_rolling(about: dict) -> bool:
    """Whether the rows of a camera's images have poses of their own; ``about`` is its entry in dataset.json."""
    return "row_poses" in (about.get("exposure") or {})


def exposure_s(about: dict) -> float:
    """How long each pixel is exposed [s]; 0: an instant."""
    return (about.get("exposure") or {"time_s": 0.0})["time_s"]


def lasts(about: dict) -> bool:
    """Whether images of a camera are of more than one instant: it has an exposure time, or rolls."""
    exposure = about.get("exposure") or {}
    return bool(exposure.get("time_s") or exposure.get("readout_s"))


def offsets_ns(about: dict) -> np.ndarray:
    """Time from a frame's time stamp to the middle of the exposure of each row, int64 [H] [ns]."""
    return in_ns(offsets_of_rows_s(about["height"], (about.get("exposure") or {"readout_s": 0.0})["readout_s"]))


def sight(data: Any, frame: int, camera: str | None = None) -> np.ndarray:
    """Pose [4, 4] from which a camera sees, or of a rolling shutter that of each row [H, 4, 4]: for `points_at`."""
    T_w_c, about = data.T_w_c(frame, camera), data.camera(camera)
    if not is_rolling(about):
        return T_w_c
    row_poses = data._once(("rows", about["id"]), lambda: read(data, camera))[data._index(frame)]
    return transform(Rotation.from_quat(row_poses[:, 3:], scalar_first=True).as_matrix(), row_poses[:, :3])


def read(data: Any, camera: str | None = None) -> np.ndarray:
    """Poses of all rows as they are on disk, float64 [frames, H, 7], read where they are looked at."""
    about = data.camera(camera)
    path, expected = data.layout.row_poses(about["id"]), (len(data), about["height"], 7)
    with files.reading(path):
        row_poses = np.lib.format.open_memmap(path, mode="r")
        if row_poses.shape != expected or row_poses.dtype != np.float64:
            raise ValueError(f"{row_poses.dtype} {row_poses.shape}, not float64 {expected}")
    return row_poses


def by_motion(data: Any, frame: int, camera: str | None = None, later_ns: int = 0) -> np.ndarray | None:
    """`sight` as the vehicle's motion makes it, of any frame and so much later; None where that is not on record."""
    about = data.camera(camera)
    if "T_v_c" not in about or "vehicle" not in data.recorded:
        return None
    motion, offset = data.trajectory(), offsets_ns(about) if is_rolling(about) else np.zeros(1, np.int64)
    time_ns = frame_time_ns(frame, data.meta["frames"]["rate_hz"]) + offset + later_ns
    if time_ns[-1] > motion.time_ns[-1]:
        return None
    T = motion.from_before(time_ns).poses() @ np.array(about["T_v_c"], float)
    return T if is_rolling(about) else T[0]


def next_pose(data: Any, frame: int, camera: str | None = None) -> np.ndarray | None:
    """`Dataset.next_T_w_c`."""
    about = data.camera(camera)
    if "T_w_c" in about:
        return np.array(about["T_w_c"], float)
    with contextlib.suppress(IndexError):
        return data.T_w_c(frame + 1, camera)
    if "vehicle" not in data.recorded:
        return None
    motion, time_ns = data.trajectory(), frame_time_ns(frame + 1, data.meta["frames"]["rate_hz"])
    if time_ns > motion.time_ns[-1]:
        return None
    return motion.at([time_ns]).T_w_v(0) @ np.array(about["T_v_c"], float)


def next_sight(data: Any, frame: int, camera: str | None = None) -> np.ndarray | None:
    """`sight` of the next frame of the sequence, to which F is the flow; None if it is not on record."""
    if not is_rolling(data.camera(camera)):
        return data.next_T_w_c(frame, camera)
    if frame + 1 in data.frames:
        return sight(data, frame + 1, camera)
    return by_motion(data, frame + 1, camera)
