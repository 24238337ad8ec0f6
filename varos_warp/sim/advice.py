"""What a person should know about a course before and after it was driven: messages in plain words, never errors."""

from collections.abc import Iterator
from itertools import pairwise
from math import isclose, pi

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.scene.courses.recorded import RecordedCourse
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Trajectory
from varos_warp.scene.frames import attitudes
from varos_warp.sim.clock import TICK_S
from varos_warp.sim.guidance import Course, Leg
from varos_warp.sim.poses import REST_S, Knots
from varos_warp.sim.vehicle.body import Sphere
from varos_warp.sim.vehicle.control import Gains, is_slow, steady_offset
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.rigid_body import RigidBody
from varos_warp.sim.vehicle.thrusters import PITCH, ROLL

SHARES = np.linspace(0.0, 1.0, 201)
"""Shares of a leg's time at which its needs are looked at."""

LITTLE_LESS = 0.98
"""Share of the speed asked for that is not worth a word."""

LITTLE_TURN_DEG = 0.1
"""Angle that is not worth a word either."""

FEW_FRAMES, SLOW = 10, 0.2
"""Number of frames below which a sequence is a look at a scene; share of course and speed below which it hardly
moves."""

ONE_G = 9.81
"""Acceleration [m/s^2] beyond which recorded poses probably have noise."""

FORWARD, MOSTLY, LITTLE_WAY_M = 1, 0.8, 1.0
"""Axis along which a vehicle looks; share of the way that is most of it; and a way that says nothing of its axes."""

MOST_SPEED, MOST_ACCELERATION, MOST_RATE = 15.0, 20.0, 2.0 * pi
"""Speed [m/s], acceleration [m/s^2] and rate of turn [rad/s] beyond which exact poses are probably a mistake."""


def on_course(scene: Scene, course: Course, body: Sphere, gains: Gains, current: Current) -> Iterator[str]:
    """What can be foreseen: legs beyond the vehicle's powers, half turns, slow thrusters, a current that pushes it."""
    found: dict[str, dict[int, None]] = {}  # the waypoints by what there is to say, in order and once
    for i, leg in enumerate(course.legs):
        for text in _on_leg(leg, body):
            found.setdefault(text, {})[course.leads_to(i)] = None
    for text, targets in found.items():
        yield f"waypoint {next(iter(targets))}{f' and {len(targets) - 1} more' if len(targets) > 1 else ''}: {text}"
    yield from _on_speed(course)
    if isinstance(body, RigidBody) and body.free:
        yield from _on_free_axes(scene, course, body)
    controller = scene.vehicle.controller
    fastest = max(controller.translation_q[0], controller.rotation_q[0]) / controller.r
    if is_slow(body.actuator_frequency, fastest**0.5):
        yield (
            f"vehicle.actuator_frequency = {body.actuator_frequency:.3g} rad/s is slow for the controller's weights "
            f"(at least {5.0 * fastest**0.25:.3g} is wanted); the regulator allows for it, but is sluggish"
        )
    drift = float(np.linalg.norm(current.drift))
    if drift > body.max_speed:
        yield (
            f"the current of {drift:.2f} m/s is faster than the vehicle ({body.max_speed:.2f} m/s): "
            "it will be swept away"
        )
    if abs(body.net_buoyancy) > body.max_force:
        yield (
            f"vehicle.net_buoyancy = {body.net_buoyancy:g} N is more than {body.limit_keys[0]} = "
            f"{body.max_force:g} N: it will {'rise' if body.net_buoyancy > 0.0 else 'sink'}"
        )
    push = body.drag_force(drift) * (current.drift / drift if drift else 0.0) * np.ones(3)
    if controller.feed_forward != "full":
        push[2] += body.net_buoyancy
    offset = steady_offset(body, gains.translation, float(np.linalg.norm(push)))
    radius = min(gate.radius for gate in course.gates)
    if controller.integral == 0.0 and offset > radius:
        yield (
            f"a steady force keeps the vehicle {offset:.3f} m off its waypoints, more than the {radius:g} m at "
            "which it goes on; waypoints will time out (set vehicle.controller.integral, e.g. 0.05, or raise "
            "trajectory.handover_radius_m)"
        )


def _on_speed(course: Course) -> Iterator[str]:
    """Advice if no leg has the constant speed asked for: it is lost in turns and on the way from stop to stop."""
    leg = max(course.legs, key=lambda leg: leg.peak_speed / leg.speed)
    if leg.blends is not None and leg.peak_speed < LITTLE_LESS * leg.speed:
        bends = _bends(course)
        yield (
            f"trajectory.speed: asked for {leg.speed:.3g} m/s, but {'turns are too narrow or ' * bends}stops are "
            f"too near to each other for more than {leg.peak_speed:.3g} m/s (raise trajectory.max_acceleration"
            f"{' and max_angular_speed_deg' * bends}, or lower the speed)"
        )


def _bends(course: Course) -> bool:
    """Return whether the vehicle turns, or its way does, anywhere."""
    along = [leg.step / size for leg in course.legs if (size := np.linalg.norm(leg.step))]
    angles = [*(np.linalg.norm(leg.turn) for leg in course.legs), *(np.linalg.norm(a - b) for a, b in pairwise(along))]
    return bool(np.degrees(max(angles)) > LITTLE_TURN_DEG)


def _on_free_axes(scene: Scene, course: Course, body: RigidBody) -> Iterator[str]:
    """What waypoints ask of axes that the thrusters leave to the righting moment, and a flow that overcomes it."""
    angles = Rotation.concatenate(attitudes(scene.trajectory.stops)).as_euler("ZXY", degrees=True)
    for axis in body.free:
        name, column = {PITCH: ("pitch", 1), ROLL: ("roll", 2)}[axis]
        asked = float(np.abs(angles[:, column]).max())
        if asked > LITTLE_TURN_DEG:
            yield (
                f"vehicle.rigid_body.thrusters: they do not control {name}, so the {asked:.3g} deg of it that "
                "waypoints ask for are left out (mount the camera so, or add thrusters)"
            )
    fastest = max(leg.peak_speed for leg in course.legs)
    if PITCH in body.free and fastest > body.broaching_speed:
        yield (
            f"vehicle.metacentric_height: from {body.broaching_speed:.2f} m/s on the water turns the vehicle across "
            f"its way, against the righting moment; the course asks for {fastest:.2f} m/s (raise it, or lower the "
            "speed, or the added mass in z)"
        )


def _on_leg(leg: Leg, body: Sphere) -> Iterator[str]:
    """Speed, thrust and moment that a leg on its own takes, where they exceed the limits; a turn with two ways."""
    if leg.peak_speed > body.max_speed:
        yield (
            f"asked for {leg.peak_speed:.2f} m/s, but the vehicle cannot go faster than {body.max_speed:.2f} m/s; "
            f"it will lag behind and the hand-over will wait (lower the speed or raise {body.limit_keys[0]})"
        )
    _, rate, acceleration = leg.weight(SHARES * leg.duration)
    if leg.blends is not None:  # the next leg goes on with the speed; max_acceleration bounds what is left
        acceleration = np.zeros_like(acceleration)
    for change, inertia, drag, limit, name in (
        (leg.step, body.virtual_mass, body.drag_force, body.max_force, body.limit_keys[0]),
        (leg.turn, body.inertia, body.drag_torque, body.max_torque, body.limit_keys[1]),
    ):
        size = np.linalg.norm(change)
        need = np.abs(inertia * size * acceleration + drag(size * rate)).max()
        if need > limit:
            yield (
                f"the leg to it takes {need:.3g}, more than {name} = {limit:.3g}; expect overshoot "
                "(lower the speed, max_acceleration or max_angular_speed_deg)"
            )
    if isclose(float(np.linalg.norm(leg.turn)), pi, rel_tol=1e-9):
        axis = ", ".join(f"{x:.3f}" for x in leg.turn / float(np.linalg.norm(leg.turn)) + 0.0)
        yield (
            f"exactly half a turn, both ways are equally short; turns about ({axis}) in vehicle axes "
            "(+180 and -180 deg turn opposite ways)"
        )


def on_poses(course: Trajectory, knots: Knots, motion: dict[str, np.ndarray], last_frame_s: float) -> Iterator[str]:
    """Advice if exact poses do not say what happens, or ask for what no underwater vehicle does.

    ``motion`` has columns of the trajectory through the ``knots``.
    """
    times, file = knots.times * TICK_S, course.file is not None
    yield from getattr(course.stops, "messages", ())
    block = "trajectory.file" if file else "trajectory.poses"
    if len(times) > 1 and times[0] > 0.0:
        yield (
            f"{block}: before the first pose at {times[0]:g} s the vehicle comes from being at rest "
            f"{REST_S:g} s earlier"
        )
    if len(times) > 1 and last_frame_s > times[-1] + 0.5 * TICK_S:
        yield (f"{block}: after the last pose at {times[-1]:g} s the vehicle brakes and is at rest {REST_S:g} s later")
    turns = (knots.turned[:-1].inv() * knots.turned[1:]).magnitude() if len(times) > 1 else np.zeros(0)
    for i in np.flatnonzero(np.isclose(turns, pi, rtol=1e-9, atol=0.0)) + 1:
        yield (
            f"{_place(course, i)}: exactly half a turn from the pose before it; "
            "which way it turns is arbitrary (add a pose between)"
        )
    remedy = (
        (
            "recorded poses have noise, of which a spline makes much acceleration: see trajectory.smoothing_s, and "
            "check the units of times and positions"
        )
        if file
        else "check time_s and the unit of position"
    )
    for name, most, scale, unit in (
        ("velocity", MOST_SPEED, 1.0, "m/s"),
        ("acceleration", ONE_G if file else MOST_ACCELERATION, 1.0, "m/s^2"),
        ("angular_velocity", MOST_RATE, 180.0 / pi, "deg/s"),
    ):
        size = np.linalg.norm(motion[name], axis=1)
        worst = int(np.argmax(size))
        if size[worst] > most:
            i = min(int(np.searchsorted(knots.times, worst)), len(times) - 1)
            yield (
                f"{_place(course, i)}: {scale * size[worst]:.3g} {unit} at {worst * TICK_S:.4g} s, near this pose; "
                f"no underwater vehicle does more than {scale * most:.3g} {unit} ({remedy})"
            )
    if file:
        yield from _on_heading(course, motion)


def _place(course: Trajectory, pose: int) -> str:
    """Place of a pose in the scene or its file, in words."""
    stops = course.stops
    return f"trajectory.file: line {stops.line[pose]}" if isinstance(stops, RecordedCourse) else course.key(pose)


def _on_heading(course: Trajectory, motion: dict[str, np.ndarray]) -> Iterator[str]:
    """A vehicle that seldom goes where it looks: the axes of its attitudes may be others than those that are taken."""
    speed = np.linalg.norm(motion["velocity"], axis=1)
    if (course.attitude or "recorded") != "recorded" or not (total := speed.sum()) * TICK_S > LITTLE_WAY_M:
        return
    own = Rotation.from_quat(motion["quaternion"], scalar_first=True).inv().apply(motion["velocity"])
    shares = np.abs(own).sum(axis=0) / total
    across = int(np.argmax(shares))
    if across != FORWARD and shares[across] > MOSTLY and shares[FORWARD] < 1.0 - MOSTLY:
        way = "sideways" if across == 0 else "up and down"
        yield (
            f"trajectory.file: most of the time the vehicle goes {way}, by its attitudes; check trajectory.body, of "
            "and frame, which say in which axes they are"
        )


def on_pace(scene: Scene, course: Course, position: np.ndarray, frames: int) -> Iterator[str]:
    """Advice if ``duration_s`` ends a sequence while the vehicle still gathers speed, so that it hardly moves.

    ``position`` [n, 3] [m] is of the vehicle from the first frame to the last.
    """
    if not scene.trajectory.duration_s or frames < FEW_FRAMES:
        return
    way = float(np.linalg.norm(np.diff(position, axis=0), axis=1).sum())
    mean, rate = way / ((len(position) - 1) * TICK_S), np.radians(scene.trajectory.max_angular_speed_deg)
    lengths, turns = (
        np.array([np.linalg.norm(each) for each in steps])
        for steps in zip(*((leg.step, leg.turn) for leg in course.legs), strict=True)
    )
    begun = np.cumsum(lengths) - lengths <= way
    seconds = lengths[begun] / np.array([leg.speed for leg in course.legs])[begun]  # at the speed asked for
    share, asked = way / max(lengths.sum(), TICK_S), lengths[begun].sum() / max(seconds.sum(), TICK_S)
    if share < SLOW and mean < SLOW * asked and (turns[begun] <= rate * seconds).all():
        keep = "" if scene.trajectory.keeps_speed else "give trajectory.constant_speed: true and "
        yield (
            f"trajectory.duration_s: ends the sequence after {100.0 * share:.2g} % of the course, at a mean of "
            f"{mean:.2g} of the {asked:.3g} m/s asked for: the vehicle begins at rest (for a short sequence at "
            f"speed {keep}raise trajectory.max_acceleration, or give poses; else a longer duration_s)"
        )


def on_run(scene: Scene, end: int | None, seconds: float, saturated: int) -> Iterator[str]:
    """What happened: the sequence lasts longer than the course, thrusters were at their limit."""
    last, asked = len(scene.trajectory.stops) - 1, scene.trajectory.duration_s
    if end is not None and last and asked and seconds > end * TICK_S:
        yield f"the course ends at {end * TICK_S:.2f} s; the vehicle holds the last waypoint until {asked:g} s"
    if saturated:
        yield f"the thrusters were at their limit for {saturated * TICK_S:.2f} s"
