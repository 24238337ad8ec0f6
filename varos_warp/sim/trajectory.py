"""From a scene to what happens in it: `simulate` runs the vehicle along its waypoints, 200 times per second."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite
from typing import NamedTuple

import numpy as np

from varos_warp.errors import InputError
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
from varos_warp.sim.poses import pose_times, through_poses
from varos_warp.sim.sensors.dvl import Dvl
from varos_warp.sim.sensors.readings import (
    DepthGauge,
    Imu,
    Magnetometer,
    measure_depth,
    measure_dvl,
    measure_field,
    measure_imu,
)
from varos_warp.sim.vehicle.control import Regulator
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import Dynamics, State
from varos_warp.sim.vehicle.rigid_body import body_of

REPORT_TICKS = 200


@dataclass(frozen=True)
class Simulation:
    """A trajectory, where it is at the frames, and what the sensors read."""

    trajectory: Trajectory
    """Motion of the vehicle, up to the first IMU sample after the last frame and the tick after that; for output F, up
    to one frame more."""
    frames: Trajectory
    """The same at the frames' times, the first at 0."""
    imu: Imu | None
    depth_gauge: DepthGauge | None
    """Readings, or None where the vehicle has none."""
    messages: list[str]
    """Warnings and events in plain words."""
    reference_position: np.ndarray
    """What the controller was asked to follow [N, 3] [m]; the position itself for exact poses."""
    waypoint: np.ndarray
    """Index of the waypoint (or pose) that the reference heads for, int [N]."""
    magnetometer: Magnetometer | None = None
    dvl: Dvl | None = None

    def motion(self, time_ns: int) -> Callable[[np.ndarray], np.ndarray]:
        """Poses of the vehicle around a time: a function of times from there, int64 [N] [ns], to T_w_v [N, 4, 4].

        Before the first row the accelerations are those of that row.
        """
        return lambda offset_ns: self.trajectory.from_before(time_ns + offset_ns).poses()


class PathSamples(NamedTuple):
    """Where a vehicle is and was meant to be, densely enough to check clearances."""

    time_ns: np.ndarray
    position: np.ndarray
    reference: np.ndarray
    waypoint: np.ndarray


def path_samples(simulation: Simulation, spacing_m: float = 0.05) -> PathSamples:
    """Rows of a simulation thinned so that neither path moves more than ``spacing_m`` between two of them.

    Both ends are kept. Steps longer than the spacing (a vehicle faster than 10 m/s at 5 cm) are left as they are.
    """
    def travelled(path):
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])

    trajectory = simulation.trajectory
    distance = np.column_stack([travelled(trajectory.position), travelled(simulation.reference_position)])
    keep, last = [0], distance[0]
    while keep[-1] < len(distance) - 1:
        # the furthest row that is still within the spacing of the last one kept, by both paths
        within = min(np.searchsorted(distance[:, j], last[j] + spacing_m, side="right") - 1 for j in range(2))
        keep.append(max(int(within), keep[-1] + 1))
        last = distance[keep[-1]]
    return PathSamples(trajectory.time_ns[keep], trajectory.position[keep], simulation.reference_position[keep],
                       simulation.waypoint[keep])


def course_facts(simulation: Simulation) -> dict[str, float]:
    """Length [m] of the vehicle's way from the first frame to the last, and the time between them [s]."""
    last_ns = simulation.frames.time_ns[-1]
    way = simulation.trajectory.position[simulation.trajectory.time_ns <= last_ns]
    return {"length_m": float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum()), "duration_s": 1e-9 * float(last_ns)}


# --------------------------------------------------------------------------------------------------------- simulation


def simulate(scene: Scene, parts: list | None = None, *, progress: Callable[[float], None] | None = None) -> Simulation:
    """Move the scene's vehicle and read its sensors. The same scene gives the same bytes.

    Args:
        scene: Waypoints to follow with the vehicle's dynamics, or exact poses.
        parts: The scene's geometry, from ``build_parts``, which only a DVL needs; absent: built where there is one.
        progress: Called now and then with the share of the work done, 0 to 1.

    Raises:
        InputError: Poses are out of order, parameters cannot be simulated, a rate is less than one sample in a day,
            or the sequence would last longer than that.
    """
    check_length(scene.trajectory.duration_s or 0.0, "trajectory.duration_s", "the sequence lasts")
    check_rate(scene.render.frame_rate_hz, "render.frame_rate_hz")
    for sensor in ("imu", "depth_gauge", "magnetometer", "dvl"):
        if block := getattr(scene.vehicle, sensor):
            check_rate(block.rate_hz, f"vehicle.{sensor}.rate_hz")
    if isinstance(scene.trajectory.pattern, HullFollowing):
        _find_course(scene, parts)
    tell = progress or (lambda share: None)
    run = _follow_waypoints(scene, tell) if scene.trajectory.poses is None else _follow_poses(scene)
    vehicle, read = scene.vehicle, _rows_read(scene, len(run.frames))
    trajectory = run.trajectory.rows(slice(read))  # no more for F, or noise would be drawn otherwise
    tell(1.0)
    return replace(
        run, imu=measure_imu(trajectory, vehicle.imu, scene.gravity, scene.seed) if vehicle.imu else None,
        depth_gauge=measure_depth(trajectory, vehicle.depth_gauge, scene.surface_depth_m) if vehicle.depth_gauge
        else None,
        magnetometer=measure_field(trajectory, vehicle.magnetometer) if vehicle.magnetometer else None,
        dvl=measure_dvl(trajectory, vehicle.dvl, _geometry(scene) if parts is None else parts) if vehicle.dvl
        else None)


def _find_course(scene: Scene, parts: list | None) -> None:
    from varos_warp.scene.geometry.course import find_course  # nor elsewhere but where one is followed

    find_course(scene, parts)


def _geometry(scene: Scene) -> list:
    from varos_warp.scene.geometry.build import build_parts  # meshes are loaded only where there is a DVL

    return build_parts(scene)


COLUMNS: list[tuple] = [
    ("position", float, 3), ("velocity", float, 3), ("acceleration", float, 3), ("quaternion", float, 4),
    ("angular_velocity", float, 3), ("angular_acceleration", float, 3), ("reference", float, 3), ("waypoint", float)]
"""What the loop writes down at each tick."""


def _rows(scene: Scene, frames: int) -> int:
    """Rows up to what sensors read, until shutters close, and with F to the frame after the last."""
    last = frames if "F" in scene.render.outputs else frames - 1
    after_ns = frame_time_ns(last, scene.render.frame_rate_hz) + open_ns(scene.vehicle.cameras)
    return max(_rows_read(scene, frames), -(-after_ns // TICK_NS) + 1)


def _rows_read(scene: Scene, frames: int) -> int:
    """Rows up to the sample that the IMU takes after the last frame (readers interpolate between samples)."""
    last, imu = (frames - 1) / scene.render.frame_rate_hz, scene.vehicle.imu
    rate = imu.rate_hz if imu else TICK_RATE_HZ
    after_ns = round(frames_until(last, rate) * (1e9 / rate))
    return -(-after_ns // TICK_NS) + 1


def _simulation(scene: Scene, frames: int, columns: dict[str, np.ndarray], *more) -> Simulation:
    q = columns["quaternion"]
    columns["quaternion"] = np.where(q[:, :1] < 0.0, -q, q)
    trajectory = Trajectory(times_ns(len(q), TICK_RATE_HZ), **columns)
    return Simulation(trajectory, trajectory.at(times_ns(frames, scene.render.frame_rate_hz)), None, None, *more)


def _follow_poses(scene: Scene) -> Simulation:
    poses, duration, rate = scene.trajectory.poses or [], scene.trajectory.duration_s, scene.render.frame_rate_hz
    times = pose_times(poses)
    last = times[-1] if len(poses) > 1 else 0.0
    if not duration:
        check_length(last * TICK_S, f"trajectory.poses.{len(poses) - 1}.time_s", "the poses last")
    frames = frame_count(duration, rate) if duration else frames_until(last * TICK_S, rate)
    rows = _rows(scene, frames)
    columns = through_poses(poses, rows)
    messages = list(advice.on_poses(poses, columns, (frames - 1) / rate))
    pose = np.minimum(np.searchsorted(times, np.arange(rows), side="left"), len(poses) - 1)
    return _simulation(scene, frames, columns, messages, columns["position"], pose)


def _follow_waypoints(scene: Scene, tell: Callable[[float], None]) -> Simulation:
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
                *advice.on_run(scene, guidance, end, frames / rate, regulator.saturated_ticks)]
    return _simulation(scene, frames, columns, messages, reference, waypoint)


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
