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
    tick = np.arange(ticks, dtype=float)
    moving = (tick >= times[0]) & (tick <= times[-1]) & (len(poses) > 1)
    clamped = np.clip(tick, times[0], times[-1])
    columns = _splines(times * TICK_S, positions, turned, clamped * TICK_S) if len(poses) > 1 else _rest(ticks)
    for name in ("velocity", "acceleration", "angular_velocity", "angular_acceleration"):
        columns[name][~moving] = 0.0
    nearest = np.where(tick <= times[0], 0, np.where(tick >= times[-1], len(poses) - 1, -1))
    inner = (times == np.round(times)) & (times < ticks)
    nearest[times[inner].astype(int)] = np.flatnonzero(inner)
    exact = nearest >= 0
    q = np.array([a.as_quat(scalar_first=True) for a in turned])
    columns["position"][exact], columns["quaternion"][exact] = positions[nearest[exact]], q[nearest[exact]]
    return columns


def _rest(ticks: int) -> dict[str, np.ndarray]:
    names = ("position", "velocity", "acceleration", "angular_velocity", "angular_acceleration")
    return {name: np.zeros((ticks, 3)) for name in names} | {"quaternion": np.zeros((ticks, 4))}


def _splines(times, positions, turned, t) -> dict[str, np.ndarray]:
    path = CubicSpline(times, positions - positions[0], bc_type="natural")
    attitude = RotationSpline(times, Rotation.concatenate(turned))
    return {"position": path(t) + positions[0], "velocity": path(t, 1), "acceleration": path(t, 2),
            "quaternion": attitude(t).as_quat(scalar_first=True),
            "angular_velocity": attitude(t, 1), "angular_acceleration": attitude(t, 2)}
