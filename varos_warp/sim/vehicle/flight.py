"""A vehicle on its way along waypoints, one tick after the other: guidance, control, thrusters, body."""

from dataclasses import replace
from math import isfinite
from typing import NamedTuple

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.sim import quaternion
from varos_warp.sim.clock import LONGEST_S, MAX_TICKS, TICK_NS, check_length
from varos_warp.sim.guidance import Guidance, plan
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.quaternion import Vector
from varos_warp.sim.vehicle.control import Regulator, saturated
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import Dynamics, State
from varos_warp.sim.vehicle.rigid_body import body_of

COLUMNS: list[tuple] = [
    ("position", float, 3),
    ("velocity", float, 3),
    ("acceleration", float, 3),
    ("quaternion", float, 4),
    ("angular_velocity", float, 3),
    ("angular_acceleration", float, 3),
    ("reference", float, 3),
    ("waypoint", float),
]
"""What `Flight.look` finds at a tick."""


class Logged(NamedTuple):
    """Ticks that were written down."""

    trajectory: Trajectory
    reference: np.ndarray
    """Position of the reference [N, 3] [m]."""
    waypoint: np.ndarray
    """Index of the waypoint that it heads for, int [N]."""


def logged(log: np.ndarray, origin: np.ndarray, first: int = 0) -> Logged:
    """Rows of `COLUMNS` [N], from the tick ``first`` on, in the world; their positions are relative to ``origin``."""
    columns = {name: np.ascontiguousarray(log[name]) for name, *_ in COLUMNS}
    reference, waypoint = columns.pop("reference") + origin, columns.pop("waypoint").astype(int)
    columns["position"] += origin
    q = columns["quaternion"]
    columns["quaternion"] = np.where(q[:, :1] < 0.0, -q, q)
    return Logged(Trajectory(np.arange(first, first + len(log)) * TICK_NS, **columns), reference, waypoint)


class Flight:
    """The vehicle of a scene that starts at rest at its first waypoint. `look` once at every tick, then `advance`.

    Positions are relative to `origin`, the first waypoint: far from the world's origin the same course is driven to the
    same digits. A course that takes too long, or parameters that cannot be simulated, are refused.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self.body, self.current = body_of(scene.vehicle, scene.gravity), Current(scene.current, scene.seed)
        self.course = plan(scene.trajectory, self.body.free)
        if not scene.trajectory.duration_s:
            check_length(self.course.duration, scene.trajectory.key(self.course.longest), "the course takes")
        self.regulator = Regulator(self.body, scene.vehicle.controller)
        self.origin = self.course.positions[0]
        self.guidance = Guidance(replace(self.course, positions=self.course.positions - self.origin))
        self._dynamics = Dynamics(self.body, self.current, actuator_frame=scene.vehicle.actuator_frame)
        self.state, self.tick = State(q=self.guidance.start), 0
        self.end: int | None = None
        """Tick at which the course ended, if it has."""

    def look(self) -> tuple[tuple[float, ...], ...]:
        """What there is at this tick, as `COLUMNS` name it."""
        state = self.state
        self._reference = self.guidance.reference(self.tick, state.p, state.q)
        if self.guidance.finished and self.end is None:
            self.end = self.tick
        acceleration, angular_acceleration = self._dynamics.accelerations(state, self.tick)
        return (
            state.p,
            state.v,
            acceleration,
            state.q,
            state.omega,
            angular_acceleration,
            self._reference.position,
            (float(self.guidance.target),),
        )

    def advance(self) -> None:
        """Go to the next tick as the controller commands."""
        self._go(*self.regulator.command(self._reference, self.state, self._dynamics.thrust(self.state)))

    def advance_with(self, force: Vector, torque: Vector) -> None:
        """Go to the next tick with a force [N] and a moment [N m] in vehicle axes, as far as the vehicle can do it."""
        force, torque, _, _ = saturated(self.body, force, torque)
        self._go(quaternion.rotate(self.state.q, force), torque)

    def _go(self, force: Vector, torque: Vector) -> None:
        self.state = self._dynamics.advance(self.state, force, torque, self.tick)
        self.tick += 1

    def check(self, waits: bool) -> None:
        """Refuse a motion that is not finite, and one that ``waits`` for a waypoint longer than can be simulated."""
        if not all(isfinite(x) for vector in self.state for x in vector):
            raise InputError(
                "the simulated vehicle ran away",
                key="vehicle",
                remedy="Check its drag, mass and thrusters, and the weights of vehicle.controller",
            )
        if waits and self.tick >= MAX_TICKS:
            raise InputError(
                f"the vehicle still waits to reach it after {LONGEST_S} s, the longest sequence",
                key=self._scene.trajectory.key(self.guidance.target),
                remedy="Lower trajectory.handover_timeout_s, raise handover_radius_m, or give the "
                "vehicle the thrust to get there",
            )
