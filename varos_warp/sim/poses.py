"""Trajectories through exact poses, without dynamics: a static observer, a path from elsewhere, a test.

Between the poses position and attitude are interpolated twice continuously differentiable, so that the IMU has
analytic accelerations. Before the first and after the last pose the vehicle stands still.
"""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from varos_warp.errors import InputError
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.frames import attitudes
from varos_warp.sim.clock import TICK_RATE_HZ, TICK_S


def pose_times(poses: list[description.Pose]) -> np.ndarray:
    """Times of the poses [n] in ticks; those within a microtick of a tick are on it.

    Raises:
        InputError: They do not increase.
    """
    times = np.array([pose.time_s for pose in poses]) * TICK_RATE_HZ
    times = np.where(np.abs(times - np.round(times)) < 1e-6, np.round(times), times)
    backward = np.flatnonzero(np.diff(times) <= 0.0)
    if len(backward):
        i = int(backward[0]) + 1
        raise InputError(f"is not after the pose before it, at {poses[i - 1].time_s:g} s",
                         key=f"trajectory.poses.{i}.time_s", value=poses[i].time_s,
                         remedy="Give the poses in order of time, each its own time")
    return times


def through_poses(poses: list[description.Pose], ticks: int) -> dict[str, np.ndarray]:
    """Columns of a `trajectory.Trajectory` (all but ``time_ns``) at the ticks 0 ... ``ticks`` - 1.

    A pose whose time falls on a tick is that row, to the last digit.
    """
    times, turned = pose_times(poses), attitudes(poses)
    positions = np.array([pose.position for pose in poses], float)
    q = np.array([attitude.as_quat(scalar_first=True) for attitude in turned])
    tick = np.arange(ticks, dtype=float)
    clamped = np.clip(tick, times[0], times[-1])
    pose = np.searchsorted(times, clamped)
    columns = {"position": positions[pose], "quaternion": q[pose]}
    columns |= {name: np.zeros((ticks, 3))
                for name in ("velocity", "acceleration", "angular_velocity", "angular_acceleration")}
    if len(poses) > 1:
        between, moving = times[pose] != clamped, tick == clamped
        path = CubicSpline(times * TICK_S, positions - positions[0], bc_type="natural")
        attitude = RotationSpline(times * TICK_S, Rotation.concatenate(turned))
        t = clamped * TICK_S
        columns["position"][between] = (path(t) + positions[0])[between]
        columns["quaternion"][between] = attitude(t).as_quat(scalar_first=True)[between]
        for order, names in ((1, ("velocity", "angular_velocity")), (2, ("acceleration", "angular_acceleration"))):
            for name, spline in zip(names, (path, attitude), strict=True):
                columns[name][moving] = spline(t, order)[moving]
    return columns
