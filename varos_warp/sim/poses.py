"""Trajectories through exact poses, without dynamics: a static observer, a path from elsewhere, an object that moves.

Position and attitude are twice continuously differentiable at all times, so that the IMU feels every change of speed:
splines through the poses, at whose ends the vehicle has the speed that they give it. After the last pose it brakes and
is at rest within ``REST_S``; likewise it has come from rest before the first.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from varos_warp.errors import InputError
from varos_warp.scene.courses.recorded import RecordedCourse
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.description.placed import Stop
from varos_warp.scene.frames import attitudes, transform
from varos_warp.scene.geometry.parts import Moving
from varos_warp.sim.clock import TICK_NS, TICK_RATE_HZ, TICK_S

REST_S = 2.0
"""Time from the last pose to rest, and from rest to the first pose [s]."""

SPEED = CubicHermiteSpline([0.0, 1.0], [1.0, 0.0], [0.0, 0.0])
"""What is left of the speed at the last pose, by the share of the time to rest; it begins and ends without a jolt."""

STEP_NS = 1_000_000
"""Time between the poses that a velocity is made of [ns]."""

JOLT = CubicHermiteSpline([0.0, 1.0], [0.0, 0.0], [1.0, 0.0])
"""Speed that comes of a unit acceleration at the last pose, which fades away in a unit of time."""

MOST_KNOTS, BEYOND = 2**17, 64
"""Attitudes of a spline, more than a scene file can list, and those of its neighbours that it knows."""

RATES = ((1, ("velocity", "angular_velocity")), (2, ("acceleration", "angular_acceleration")))
"""Order of the derivatives of position and attitude, and their names."""


def pose_times(poses: Sequence[description.Pose | Stop]) -> np.ndarray:
    """Times of the poses [n] in ticks, which must increase; those within a microtick of a tick are on it."""
    times = np.array([pose.time_s for pose in poses]) * TICK_RATE_HZ
    times = np.where(np.abs(times - np.round(times)) < 1e-6, np.round(times), times)
    backward = np.flatnonzero(np.diff(times) <= 0.0)
    if len(backward):
        i = int(backward[0]) + 1
        raise InputError(
            f"is not after the pose before it, at {poses[i - 1].time_s:g} s",
            key=f"trajectory.poses.{i}.time_s",
            value=poses[i].time_s,
            remedy="Give the poses in order of time, each its own time",
        )
    return times


@dataclass(frozen=True)
class Knots:
    """Poses at times, which splines pass through."""

    times: np.ndarray
    """[n] in ticks, increasing."""
    positions: np.ndarray
    """[n, 3] [m]."""
    turned: Rotation
    """n attitudes."""

    @classmethod
    def of(cls, poses: Sequence[description.Pose | Stop]) -> "Knots":
        """Knots from the poses of blocks, whose times must increase, or of a recorded course."""
        if isinstance(poses, RecordedCourse):
            return cls(poses.time_ns / TICK_NS, poses.position, poses.attitude)
        return cls(
            pose_times(poses),
            np.array([pose.position for pose in poses], float),
            Rotation.concatenate(attitudes(poses)),
        )


def through_poses(knots: Knots, ticks: int) -> dict[str, np.ndarray]:
    """Columns of a `trajectory.Trajectory` (all but ``time_ns``) at the ticks 0 ... ``ticks`` - 1.

    A pose whose time falls on a tick is that row, to the last digit.
    """
    return at_ticks(knots, np.arange(ticks, dtype=float))


def poses_along(stops: Sequence[Stop], time_ns: np.ndarray) -> np.ndarray:
    """Poses T_w_o [N, 4, 4] of an object on its path at times int64 [N] [ns], also before the first stop."""
    columns = at_ticks(Knots.of(stops), np.asarray(time_ns) / TICK_NS)
    return transform(Rotation.from_quat(columns["quaternion"], scalar_first=True).as_matrix(), columns["position"])


def courses_of_moving(parts: Sequence, others: Mapping[str, Callable] | None = None) -> dict[str, Callable]:
    """Poses [N, 4, 4] of all that moves as functions of times int64 [N] [ns], by name: along paths, or as others.

    Of the bodies of ``others``, as `companions.companions` has them, parts do not know where they are.
    """
    along = {part.name: partial(poses_along, part.path) for part in parts if isinstance(part, Moving) and part.path}
    return along | dict(others or {})


def poses_of_moving(
    parts: Sequence, time_ns: np.ndarray, others: Mapping[str, Callable] | None = None
) -> dict[str, np.ndarray]:
    """Poses [N, 4, 4] of everything that moves at times int64 [N] [ns], by its name."""
    return {key: course(time_ns) for key, course in courses_of_moving(parts, others).items()}


def velocity_with(poses: Callable[[np.ndarray], np.ndarray], points: np.ndarray, time_ns: np.ndarray) -> np.ndarray:
    """Velocity [N, 3] [m/s] of what is at points [N, 3] of the world at times int64 [N] [ns] and moves along ``poses``.

    By differences to the second order, of this instant and those before: where a course ends it is what it was.
    """
    now, before, earlier = (poses(np.asarray(time_ns) - k * STEP_NS) for k in range(3))
    own = np.einsum("nji,nj->ni", now[:, :3, :3], points - now[:, :3, 3])  # in axes of what moves

    def moved(then):
        return np.einsum("nij,nj->ni", then[:, :3, :3] - now[:, :3, :3], own) + then[:, :3, 3] - now[:, :3, 3]

    return (moved(earlier) - 4.0 * moved(before)) / (2e-9 * STEP_NS)


def at_ticks(knots: Knots, tick: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of a `trajectory.Trajectory` (all but ``time_ns``) at times [N] in ticks and parts of them."""
    times, positions, q, ticks = knots.times, knots.positions, knots.turned.as_quat(scalar_first=True), len(tick)
    on_course = np.clip(tick, times[0], times[-1])
    pose = np.searchsorted(times, on_course)
    columns = {"position": positions[pose], "quaternion": q[pose]}
    columns |= {name: np.zeros((ticks, 3)) for _, names in RATES for name in names}
    if len(times) > 1:
        between = times[pose] != on_course
        path = CubicSpline(times * TICK_S, positions - positions[0], bc_type="natural")
        t = on_course * TICK_S
        columns["position"][between] = (path(t) + positions[0])[between]
        for order, names in RATES:
            columns[names[0]][:] = path(t, order)
        for rows, attitude in _attitude_splines(times * TICK_S, knots.turned, t):
            columns["quaternion"][rows & between] = attitude(t[rows]).as_quat(scalar_first=True)[between[rows]]
            for order, names in RATES:
                columns[names[1]][rows] = attitude(t[rows], order)
        legs = np.minimum(np.diff(times)[[0, -1]] * TICK_S, REST_S)
        _run_out(columns, tick != on_course, (tick - on_course) * TICK_S, legs)
    return columns


def _attitude_splines(
    times: np.ndarray, turned: Rotation, t: np.ndarray
) -> Iterator[tuple[np.ndarray, RotationSpline]]:
    """Splines through attitudes at times [n] [s], and which of the times [N] each is for, bool [N].

    A spline takes 2 kB for each attitude, so no more than `MOST_KNOTS` share one. It knows `BEYOND` more at its ends,
    so that its neighbours go on as it does: what an attitude does to rates falls by 2 + sqrt(3) from one to the next.
    """
    if len(times) <= MOST_KNOTS:
        yield np.ones(len(t), bool), RotationSpline(times, turned)
        return
    piece = np.minimum(np.searchsorted(times, t, side="right") - 1, len(times) - 2) // MOST_KNOTS
    for k in np.unique(piece):
        knots = slice(max(k * MOST_KNOTS - BEYOND, 0), (k + 1) * MOST_KNOTS + BEYOND)
        yield piece == k, RotationSpline(times[knots], turned[knots])


def _run_out(columns: dict[str, np.ndarray], rows: np.ndarray, seconds: np.ndarray, fading: np.ndarray) -> None:
    """Brake after the last pose, and gather speed before the first, which is the same backwards in time; in place.

    At the end of the course, whose state the ``rows`` off it (bool [N]) hold, the rates are w and alpha (v and a).
    After it, at ``seconds`` [N] from there, the vehicle turns by A(t) about alpha and by W(t) about w: both axes are
    fixed, and the rates and accelerations follow exactly. ``fading`` [2] [s] is the time in which the acceleration at
    the beginning and at the end fades away.
    """
    after, sign = np.abs(seconds[rows, None]), np.sign(seconds[rows, None])
    T, x = REST_S, (after / REST_S).clip(max=1.0)
    W, dW, ddW = sign * T * SPEED.antiderivative()(x), SPEED(x), sign / T * SPEED.derivative()(x)
    T = np.where(sign < 0.0, *fading)
    x = (after / T).clip(max=1.0)
    A, dA, ddA = T * T * JOLT.antiderivative()(x), sign * T * JOLT(x), JOLT.derivative()(x)
    v, a = columns["velocity"][rows], columns["acceleration"][rows]
    w, alpha = columns["angular_velocity"][rows], columns["angular_acceleration"][rows]
    last, turn = Rotation.from_quat(columns["quaternion"][rows], scalar_first=True), Rotation.from_rotvec(W * w)
    first_rate = turn.inv().apply(dA * alpha)
    columns["position"][rows] += W * v + A * a
    columns["velocity"][rows] = dW * v + dA * a
    columns["acceleration"][rows] = ddW * v + ddA * a
    columns["quaternion"][rows] = (last * Rotation.from_rotvec(A * alpha) * turn).as_quat(scalar_first=True)
    columns["angular_velocity"][rows] = dW * w + first_rate
    columns["angular_acceleration"][rows] = ddW * w + turn.inv().apply(ddA * alpha) - np.cross(dW * w, first_rate)
