"""How a vehicle moves, 200 times per second: along its waypoints with its dynamics, or through exact poses."""

from array import array
from collections.abc import Callable
from dataclasses import replace
from math import isfinite
from typing import NamedTuple

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.courses.recorded import read_course
from varos_warp.scene.description import Scene
from varos_warp.scene.description.patterns import HullFollowing
from varos_warp.scene.optics.shutter import open_ns
from varos_warp.sim import advice
from varos_warp.sim.clock import (
    LONGEST_S,
    MAX_TICKS,
    TICK_NS,
    TICK_RATE_HZ,
    TICK_S,
    check_length,
    check_rate,
    frame_count,
    frame_time_ns,
    frames_until,
    times_ns,
)
from varos_warp.sim.guidance import Guidance, plan
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.poses import Knots, through_poses
from varos_warp.sim.vehicle.control import Regulator
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import Dynamics, State
from varos_warp.sim.vehicle.rigid_body import body_of

REPORT_TICKS = 200


class Driven(NamedTuple):
    """Where a vehicle went: what a `trajectory.Simulation` has but readings."""

    trajectory: Trajectory
    frames: Trajectory
    messages: list[str]
    reference_position: np.ndarray
    waypoint: np.ndarray


def drive(scene: Scene, parts: list | None = None, tell: Callable[[float], None] = lambda share: None) -> Driven:
    """Move the vehicle of a scene; arguments and errors are those of `trajectory.simulate`."""
    try:
        check_length(scene.trajectory.duration_s or 0.0, "trajectory.duration_s", "the sequence lasts")
        check_rate(scene.render.frame_rate_hz, "render.frame_rate_hz")
        for sensor in ("imu", "depth_gauge", "magnetometer", "dvl"):
            if block := getattr(scene.vehicle, sensor):
                check_rate(block.rate_hz, f"vehicle.{sensor}.rate_hz")
        if isinstance(scene.trajectory.pattern, HullFollowing):
            _find_course(scene, parts)
        read_course(scene)
        return _follow_poses(scene) if scene.trajectory.is_exact else _follow_waypoints(scene, tell)
    except InputError as error:
        raise error.at(scene.key_in_file(error.key or "")) from None


def _find_course(scene: Scene, parts: list | None) -> None:
    from varos_warp.scene.geometry.course import find_course  # nor elsewhere but where one is followed

    find_course(scene, parts)


COLUMNS: list[tuple] = [
    ("position", float, 3), ("velocity", float, 3), ("acceleration", float, 3), ("quaternion", float, 4),
    ("angular_velocity", float, 3), ("angular_acceleration", float, 3), ("reference", float, 3), ("waypoint", float)]
"""What the loop writes down at each tick."""


def _rows(scene: Scene, frames: int) -> int:
    """Rows up to what sensors read, until shutters close, and with F to the frame after the last."""
    last = frames if "F" in scene.render.outputs else frames - 1
    after_ns = frame_time_ns(last, scene.render.frame_rate_hz) + open_ns(scene.vehicle.cameras)
    return max(rows_read(scene, frames), -(-after_ns // TICK_NS) + 1)


def rows_read(scene: Scene, frames: int) -> int:
    """Rows up to the sample that the IMU takes after the last frame (readers interpolate between samples)."""
    last, imu = (frames - 1) / scene.render.frame_rate_hz, scene.vehicle.imu
    rate = imu.rate_hz if imu else TICK_RATE_HZ
    after_ns = round(frames_until(last, rate) * (1e9 / rate))
    return -(-after_ns // TICK_NS) + 1


def _driven(scene: Scene, frames: int, columns: dict[str, np.ndarray], *more) -> Driven:
    q = columns["quaternion"]
    columns["quaternion"] = np.where(q[:, :1] < 0.0, -q, q)
    trajectory = Trajectory(times_ns(len(q), TICK_RATE_HZ), **columns)
    return Driven(trajectory, trajectory.at(times_ns(frames, scene.render.frame_rate_hz)), *more)


def _follow_poses(scene: Scene) -> Driven:
    course, duration, rate = scene.trajectory, scene.trajectory.duration_s, scene.render.frame_rate_hz
    knots = Knots.of(course.stops)
    last = knots.times[-1] if len(knots.times) > 1 else 0.0
    if not duration:
        key = course.key(len(knots.times) - 1)
        check_length(last * TICK_S, key if course.file else f"{key}.time_s", "the poses last")
    frames = frame_count(duration, rate) if duration else frames_until(last * TICK_S, rate)
    rows = _rows(scene, frames)
    columns = through_poses(knots, rows)
    messages = list(advice.on_poses(course, knots, columns, (frames - 1) / rate))
    pose = np.minimum(np.searchsorted(knots.times, np.arange(rows), side="left"), len(knots.times) - 1)
    return _driven(scene, frames, columns, messages, columns["position"], pose)


def _follow_waypoints(scene: Scene, tell: Callable[[float], None]) -> Driven:
    body, current = body_of(scene.vehicle, scene.gravity), Current(scene.current, scene.seed)
    course, duration, rate = plan(scene.trajectory, body.free), scene.trajectory.duration_s, scene.render.frame_rate_hz
    if not duration:
        check_length(course.duration, scene.trajectory.key(course.longest), "the course takes")
    regulator = Regulator(body, scene.vehicle.controller)
    # relative to the first waypoint: far from the world's origin the same course is driven to the same digits
    origin = course.positions[0]
    guidance = Guidance(replace(course, positions=course.positions - origin))
    dynamics = Dynamics(body, current, actuator_frame=scene.vehicle.actuator_frame)
    frames = frame_count(duration, rate) if duration else None

    log, end = _fly(guidance, regulator, dynamics, key=scene.trajectory.key,
                    rows=_rows(scene, frames) if frames else None,
                    rows_after=lambda tick: _rows(scene, frames_until(tick * TICK_S, rate)),
                    tell=lambda tick: tell(min(1.0, tick * TICK_S / (duration or course.duration))))
    frames = frames or frames_until(end * TICK_S, rate)  # type: ignore[operator]  # where frames is unknown, end is known
    columns = {name: np.ascontiguousarray(log[name]) for name, *_ in COLUMNS}
    reference, waypoint = columns.pop("reference") + origin, columns.pop("waypoint").astype(int)
    columns["position"] += origin
    messages = [*advice.on_course(scene, course, body, regulator.gains, current), *guidance.messages,
                *advice.on_pace(scene, course, columns["position"][:1 + round((frames - 1) / rate / TICK_S)], frames),
                *advice.on_run(scene, end, frames / rate, regulator.saturated_ticks)]
    return _driven(scene, frames, columns, messages, reference, waypoint)


def _fly(guidance: Guidance, regulator: Regulator, dynamics: Dynamics, *, key: Callable[[int], str], rows: int | None,
         rows_after: Callable[[int], int], tell: Callable[[int], None]) -> tuple[np.ndarray, int | None]:
    """The loop: guidance, control, thrusters, body. From rest at the first waypoint.

    Args:
        guidance, regulator, dynamics: Where to go, what to tell the thrusters, what that does.
        key: Of the scene, for a waypoint that is not reached.
        rows: How many ticks to simulate; None to go on until the course ends.
        rows_after: Ticks to simulate in all when the course ends at this one.
        tell: Called with the tick.

    Returns:
        A row of `COLUMNS` for each tick, and the tick at which the course ended, if it did.
    """
    state, end, tick, log = State(q=guidance.start), None, 0, array("d")
    while rows is None or tick < rows:
        reference = guidance.reference(tick, state.p, state.q)
        if guidance.finished and end is None:
            end, rows = tick, rows or rows_after(tick)
        acceleration, angular_acceleration = dynamics.accelerations(state, tick)
        for values in (state.p, state.v, acceleration, state.q, state.omega, angular_acceleration,
                       reference.position, (float(guidance.target),)):
            log.extend(values)
        force, torque = regulator.command(reference, state, dynamics.thrust(state))
        state = dynamics.advance(state, force, torque, tick)
        tick += 1
        if tick % REPORT_TICKS == 0:
            tell(tick)
            _check_finite(state)
            if tick >= MAX_TICKS and rows is None:
                raise InputError(f"the vehicle still waits to reach it after {LONGEST_S} s, the longest sequence",
                                 key=key(guidance.target),
                                 remedy="Lower trajectory.handover_timeout_s, raise handover_radius_m, or give the "
                                        "vehicle the thrust to get there")
    _check_finite(state)
    return np.frombuffer(log, COLUMNS)[:rows], end  # the course may end well after the last frame


def _check_finite(state: State) -> None:
    if not all(isfinite(x) for vector in state for x in vector):
        raise InputError("the simulated vehicle ran away", key="vehicle",
                         remedy="Check its drag, mass and thrusters, and the weights of vehicle.controller")
