"""From waypoints to a smooth reference: the soft hand-over between waypoints (paper 3.3.2).

    r(t) = P_0 + sum_i w((t - t_i) / T_i) (P_{i+1} - P_i),   q(t) = q_0 prod_i exp(w_i phi_i),   w septic, 0 to 1

The vehicle's position only decides when a leg starts; time drives its weight. Weights that follow the distance to the
next waypoint, as the paper may be read, have a fixed point at turns of 90 degrees and more, where the vehicle stalls.
A leg may start before the one in front of it has ended, so the course passes a waypoint closely instead of stopping
there; at most two legs act at a time and the reference stays inside the hull of three consecutive waypoints.
"""

from dataclasses import dataclass
from math import degrees, inf, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.scene.description import vehicle as description
from varos_warp.scene.frames import attitudes
from varos_warp.sim import quaternion
from varos_warp.sim.clock import TICK_S
from varos_warp.sim.quaternion import Quaternion, Vector

PEAK_RATE, PEAK_ACCELERATION = 35.0 / 16.0, 84.0 * sqrt(5.0) / 25.0
"""Largest first and second derivative of the septic weight."""
MIN_LEG_S = 1.0
"""Shortest time of a leg; also how long a course of no length lasts [s]."""
CLOSE_M, CLOSE_DEG = 0.1, 2.0
"""Two waypoints closer than this are the paper's way to ask for a strict one."""
STRICT_M, STRICT_DEG = 0.005, 0.5
"""How near the vehicle itself must come to a strict waypoint."""
BLOCK_TICKS = 512
"""The reference is made in blocks of so many ticks, however long a leg is."""


def weight(s) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The septic from 0 to 1 and its first two derivatives; held outside [0, 1]. Three derivatives vanish at the ends.

    Between the ends 1 - w(s) = w(1 - s); the nearer end is evaluated, so that 0 <= w <= 1 holds to the last digit.
    """
    s = np.clip(s, 0.0, 1.0)
    near = np.minimum(s, 1.0 - s)
    w = near**4 * (35.0 + near * (-84.0 + near * (70.0 - 20.0 * near)))
    return (np.where(s > 0.5, 1.0 - w, w), 140.0 * (s * (1.0 - s))**3,
            420.0 * (s * (1.0 - s))**2 * (1.0 - 2.0 * s))


# ---------------------------------------------------------------------------------------------------------- the plan


def turn(first: Rotation, second: Rotation) -> np.ndarray:
    """Rotation vector [3] [rad] from one attitude to another, at most half a turn long.

    At exactly half a turn both ways are equally short; the sign of the quaternions decides, so that to +180 and to
    -180 degrees turn opposite ways.
    """
    q = (first.inv() * second).as_quat(canonical=False, scalar_first=True)
    if abs(q[0]) < 1e-12:
        return pi * q[1:] / np.linalg.norm(q[1:])
    return np.array(quaternion.log(tuple(q.tolist())))


@dataclass(frozen=True)
class Leg:
    """The way from one waypoint to the next."""

    step: np.ndarray
    """P_{i+1} - P_i [3] [m]."""
    turn: np.ndarray
    """phi_i [3] [rad], in the axes of the attitude that it starts from."""
    duration: float
    """T_i [s]."""
    speed: float
    """Asked peak speed [m/s]."""

    @property
    def peak_speed(self) -> float:
        """Largest speed of this leg alone [m/s]."""
        return PEAK_RATE * float(np.linalg.norm(self.step)) / self.duration


@dataclass(frozen=True)
class Gate:
    """What must hold before the leg that leaves a waypoint may start."""

    overlap: float
    """Time before the end of the leg to the waypoint [s]; negative is a rest."""
    radius: float
    """Distance of the vehicle to the waypoint [m]."""
    angle: float = inf
    """Angle between their attitudes [rad]."""


@dataclass(frozen=True)
class Course:
    """Waypoints, the legs between them and a gate behind each leg; the last gate ends the course.

    A single waypoint makes a leg of no length, from itself to itself.
    """

    positions: np.ndarray
    attitudes: list[Rotation]
    legs: list[Leg]
    gates: list[Gate]
    timeout: float
    target: int = 1
    """The scene's index of the waypoint that the first leg leads to."""

    @property
    def duration(self) -> float:
        """Time of the reference when no gate has to wait [s]."""
        return sum(leg.duration - gate.overlap for leg, gate in zip(self.legs, self.gates, strict=True))

    @property
    def longest(self) -> int:
        """The scene's index of the waypoint that takes longest to get to, with the rest there."""
        return self.target + int(np.argmax([leg.duration - min(gate.overlap, 0.0)
                                            for leg, gate in zip(self.legs, self.gates, strict=True)]))


def plan(trajectory: description.Trajectory) -> Course:
    """Legs and gates of a scene's waypoints."""
    is_single = len(trajectory.waypoints) == 1
    waypoints = trajectory.waypoints * 2 if is_single else trajectory.waypoints
    positions = np.array([w.position for w in waypoints], float)
    turned = attitudes(waypoints)
    legs = [_leg(trajectory, waypoints[i + 1], positions[i + 1] - positions[i], turn(turned[i], turned[i + 1]))
            for i in range(len(waypoints) - 1)]
    strict = _strict(waypoints, legs)
    gates = [_gate(trajectory, waypoints[i + 1], strict[i + 1], legs[i:i + 2]) for i in range(len(legs))]
    return Course(positions, turned, legs, gates, trajectory.handover_timeout_s, 0 if is_single else 1)


def _leg(trajectory, target, step, turned) -> Leg:
    speed = target.speed or trajectory.speed
    length, angle = float(np.linalg.norm(step)), float(np.linalg.norm(turned))
    duration = max(PEAK_RATE * length / speed, PEAK_RATE * angle / np.radians(trajectory.max_angular_speed_deg),
                   sqrt(PEAK_ACCELERATION * length / trajectory.max_acceleration), MIN_LEG_S)
    return Leg(step, turned, float(duration), speed)


def _strict(waypoints, legs) -> list[bool]:
    """Which waypoints are to be reached exactly: those that say so, and both of two that lie close together."""
    strict = [w.strict for w in waypoints]
    for i, leg in enumerate(legs):
        is_close = np.linalg.norm(leg.step) < CLOSE_M and degrees(np.linalg.norm(leg.turn)) < CLOSE_DEG
        if is_close and waypoints[i] is not waypoints[i + 1]:
            strict[i] = strict[i + 1] = True
    return strict


def _gate(trajectory, waypoint, strict: bool, legs) -> Gate:
    if strict:
        dwell = trajectory.dwell_s if waypoint.dwell_s is None else waypoint.dwell_s
        return Gate(-dwell, min(STRICT_M, trajectory.handover_radius_m), np.radians(STRICT_DEG))
    if waypoint.dwell_s is not None:
        return Gate(-waypoint.dwell_s, trajectory.handover_radius_m)
    # the shorter leg bounds the overlap: otherwise a third leg could become active and weights negative
    overlap = trajectory.overlap * min(leg.duration for leg in legs) if len(legs) == 2 else 0.0
    return Gate(overlap, trajectory.handover_radius_m)


# ----------------------------------------------------------------------------------------------------- the reference


class Reference(NamedTuple):
    """What the controller is asked to follow at one tick; axes as in `dynamics.State`."""

    position: Vector
    velocity: Vector
    acceleration: Vector
    attitude: Quaternion
    omega: Vector
    alpha: Vector


class Window(NamedTuple):
    """A stretch of reference, one row per tick; after its last row it stays at rest."""

    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    """[n, 3], world axes, like the two before it."""
    attitude: Rotation
    """n rotations, vehicle to world."""
    omega: np.ndarray
    alpha: np.ndarray
    """Angular velocity and acceleration [n, 3], vehicle axes."""

    def rows(self) -> list[Reference]:
        """The same as plain floats."""
        columns = self._replace(attitude=self.attitude.as_quat(scalar_first=True))
        return [Reference(*map(tuple, row)) for row in zip(*(c.tolist() for c in columns), strict=True)]


def at_rest(position: np.ndarray, attitude: Rotation) -> Window:
    """A single row that holds a pose."""
    nothing = np.zeros((1, 3))
    return Window(np.array([position], float), nothing, nothing, Rotation.concatenate([attitude]), nothing, nothing)


def add_leg(before: Window, leg: Leg, ticks: np.ndarray, h: float = TICK_S) -> Window:
    """The reference with a leg, on top of what earlier ones contribute.

    Rates: with E = exp(w phi), omega <- E'omega + dw phi and alpha <- E'alpha + ddw phi + (E'omega) x (dw phi).

    Args:
        before: The earlier ones at these ticks.
        leg: The leg.
        ticks: Since the leg started [n].
        h: Length of a tick [s].
    """
    rows = np.minimum(np.arange(len(ticks)), len(before.position) - 1)
    s = ticks * h / leg.duration
    w, rate, acceleration = (value[:, None] for value in weight(s))
    rate, acceleration = rate / leg.duration, acceleration / leg.duration**2
    E = Rotation.from_rotvec(w * leg.turn)
    carried = E.inv().apply(before.omega[rows])
    return Window(
        before.position[rows] + w * leg.step,
        before.velocity[rows] + rate * leg.step,
        before.acceleration[rows] + acceleration * leg.step,
        before.attitude[rows] * E,
        carried + rate * leg.turn,
        E.inv().apply(before.alpha[rows]) + acceleration * leg.turn + np.cross(carried, rate * leg.turn))


class Guidance:
    """Walks through a course: starts each leg when its gate lets the vehicle pass."""

    def __init__(self, course: Course, h: float = TICK_S):
        self.leg, self.finished = -1, False
        """Index of the newest leg, and whether the last gate has been passed."""
        self.messages: list[str] = []
        """Gates that the vehicle did not pass in time."""
        self._course, self._h = course, h
        self._targets = [tuple(p) for p in course.positions.tolist()]
        self._attitudes = [tuple(a.as_quat(scalar_first=True).tolist()) for a in course.attitudes]
        self.start = self._attitudes[0]
        """Attitude at the first waypoint."""
        self._behind = at_rest(course.positions[0], course.attitudes[0])  # the legs that have ended
        self._active: list[tuple[int, Leg]] = []  # first tick, leg; in order
        self._first, self._rows = 0, []  # the block of references
        self._start_leg(0)

    @property
    def target(self) -> int:
        """Index of the waypoint that the reference heads for."""
        return self._course.target + self.leg

    def reference(self, tick: int, position: Vector, attitude: Quaternion) -> Reference:
        """The reference at this tick, for a vehicle at this pose. Ask every tick once, in order."""
        if tick >= self._opens and not self.finished and self._passes(tick, position, attitude):
            if self.leg + 1 < len(self._course.legs):
                self._start_leg(tick)
            else:
                self.finished = True
        if tick - self._first >= len(self._rows):
            window, ticks = self._behind, np.arange(tick, tick + BLOCK_TICKS)
            for start, leg in self._active:
                window = add_leg(window, leg, ticks - start, self._h)
            self._first, self._rows = tick, window.rows()
        return self._rows[tick - self._first]

    def _start_leg(self, tick: int) -> None:
        self.leg += 1
        leg, gate = self._course.legs[self.leg], self._course.gates[self.leg]
        while self._active and (tick - self._active[0][0]) * self._h >= self._active[0][1].duration:
            start, ended = self._active.pop(0)
            self._behind = add_leg(self._behind, ended, np.array([tick - start]), self._h)
        self._active.append((tick, leg))
        self._rows = []
        self._opens = tick + int(np.ceil(round((leg.duration - gate.overlap) / self._h, 6)))

    def _passes(self, tick: int, position: Vector, attitude: Quaternion) -> bool:
        gate, target = self._course.gates[self.leg], self._targets[self.leg + 1]
        distance = sqrt(sum((a - b)**2 for a, b in zip(position, target, strict=True)))
        if distance <= gate.radius and (gate.angle == inf or self._angle(attitude) <= gate.angle):
            return True
        if (tick - self._opens) * self._h < self._course.timeout:
            return False
        self.messages.append(
            f"waypoint {self.target}: gave up waiting at {tick * self._h:.2f} s, {distance:.3f} m and "
            f"{degrees(self._angle(attitude)):.2f} deg off (asked: {gate.radius:g} m); went on "
            f"after trajectory.handover_timeout_s = {self._course.timeout:g}")
        return True

    def _angle(self, attitude: Quaternion) -> float:
        target = self._attitudes[self.leg + 1]
        turned = quaternion.log(quaternion.multiply(quaternion.conjugate(target), attitude))
        return sqrt(sum(x * x for x in turned))
