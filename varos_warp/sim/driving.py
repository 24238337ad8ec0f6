"""How a vehicle moves, 200 times per second: along its waypoints with its dynamics, or through exact poses."""

from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from varos_warp.errors import InputError
from varos_warp.products.sensors.registry import mounted
from varos_warp.scene.courses.recorded import read_course
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import OF_NEXT_FRAME
from varos_warp.scene.description.patterns import HullFollowing
from varos_warp.scene.optics.shutter import open_ns
from varos_warp.sim import advice
from varos_warp.sim.clock import (
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
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.poses import Knots, through_poses
from varos_warp.sim.vehicle.flight import COLUMNS, Flight, Logged, logged

REPORT_TICKS = 200


class Driven(NamedTuple):
    """Motion of a vehicle over a sequence: what a `trajectory.Simulation` has but readings."""

    trajectory: Trajectory
    frames: Trajectory
    messages: list[str]
    reference_position: np.ndarray
    waypoint: np.ndarray


def drive(scene: Scene, parts: list | None = None, tell: Callable[[float], None] = lambda share: None) -> Driven:
    """Move the vehicle of a scene; arguments and errors are those of `trajectory.simulate`."""
    prepare(scene, parts)
    with keys_of(scene):
        return _follow_poses(scene) if scene.trajectory.is_exact else _follow_waypoints(scene, tell)


@contextmanager
def keys_of(scene: Scene) -> Iterator[None]:
    """Errors name the keys as the file of the scene has them."""
    try:
        yield
    except InputError as error:
        raise error.at(scene.key_in_file(error.key or "")) from None


def prepare(scene: Scene, parts: list | None) -> None:
    """Refuse what is too long or too often, and find or read the course that the scene speaks of."""
    with keys_of(scene):
        check_length(scene.trajectory.duration_s or 0.0, "trajectory.duration_s", "the sequence lasts")
        check_rate(scene.render.frame_rate_hz, "render.frame_rate_hz")
        for sensor, block in mounted(scene.vehicle):
            check_rate(block.rate_hz, f"vehicle.{sensor.key}.rate_hz")
        if isinstance(scene.trajectory.pattern, HullFollowing):
            from varos_warp.scene.geometry.course import find_course  # nor elsewhere but where one is followed

            find_course(scene, parts)
        read_course(scene)


def _rows(scene: Scene, frames: int) -> int:
    """Rows up to what sensors read, until shutters close, and with F or N to the frame after the last."""
    last = frames - 1 if OF_NEXT_FRAME.isdisjoint(scene.render.outputs) else frames
    after_ns = frame_time_ns(last, scene.render.frame_rate_hz) + open_ns(scene.vehicle.cameras)
    return max(rows_read(scene, frames), -(-after_ns // TICK_NS) + 1)


def rows_read(scene: Scene, frames: int) -> int:
    """Rows up to the sample that the IMU takes after the last frame (readers interpolate between samples)."""
    last, imu = (frames - 1) / scene.render.frame_rate_hz, scene.vehicle.imu
    rate = imu.rate_hz if imu else TICK_RATE_HZ
    after_ns = round(frames_until(last, rate) * (1e9 / rate))
    return -(-after_ns // TICK_NS) + 1


def _driven(scene: Scene, frames: int, log: Logged, messages: list[str]) -> Driven:
    at_frames = log.trajectory.at(times_ns(frames, scene.render.frame_rate_hz))
    return Driven(log.trajectory, at_frames, messages, log.reference, log.waypoint)


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
    log = posed(knots, columns)
    messages = list(advice.on_poses(course, knots, columns, (frames - 1) / rate))
    return _driven(scene, frames, log, messages)


def posed(knots: Knots, columns: dict[str, np.ndarray], first: int = 0) -> Logged:
    """What `through_poses` made, from the tick ``first`` on; the reference is the position itself."""
    ticks, q = np.arange(first, first + len(columns["position"])), columns["quaternion"]
    pose = np.minimum(np.searchsorted(knots.times, ticks, side="left"), len(knots.times) - 1)
    trajectory = Trajectory(ticks * TICK_NS, **columns | {"quaternion": np.where(q[:, :1] < 0.0, -q, q)})
    return Logged(trajectory, columns["position"], pose)


def _follow_waypoints(scene: Scene, tell: Callable[[float], None]) -> Driven:
    flight, duration, rate = Flight(scene), scene.trajectory.duration_s, scene.render.frame_rate_hz
    course = flight.course
    frames = frame_count(duration, rate) if duration else None
    values = _fly(
        flight,
        rows=_rows(scene, frames) if frames else None,
        rows_after=lambda tick: _rows(scene, frames_until(tick * TICK_S, rate)),
        tell=lambda tick: tell(min(1.0, tick * TICK_S / (duration or course.duration))),
    )
    end = flight.end
    frames = frames or frames_until(end * TICK_S, rate)  # type: ignore[operator]  # where frames is unknown, end is known
    log = logged(values, flight.origin)
    position = log.trajectory.position
    messages = [
        *advice.on_course(scene, course, flight.body, flight.regulator.gains, flight.current),
        *flight.guidance.messages,
        *advice.on_pace(scene, course, position[: 1 + round((frames - 1) / rate / TICK_S)], frames),
        *advice.on_run(scene, end, frames / rate, flight.regulator.saturated_ticks),
    ]
    return _driven(scene, frames, log, messages)


def _fly(
    flight: Flight, *, rows: int | None, rows_after: Callable[[int], int], tell: Callable[[int], None]
) -> np.ndarray:
    """The loop over a flight from its first tick: a row of `COLUMNS` for each.

    It goes on for so many ``rows``, or where that is None until the course ends, and then for ``rows_after`` in all;
    ``tell`` is called with the tick.
    """
    log = array("d")
    while rows is None or flight.tick < rows:
        looked = flight.look()
        if flight.end is not None:
            rows = rows or rows_after(flight.end)
        for values in looked:
            log.extend(values)
        flight.advance()
        if flight.tick % REPORT_TICKS == 0:
            tell(flight.tick)
            flight.check(waits=rows is None)
    flight.check(waits=False)
    return np.frombuffer(log, COLUMNS)[:rows]  # the course may end well after the last frame
