"""A smooth reference from waypoints: the soft hand-over between waypoints (paper 3.3.2).

    r(t) = P_0 + sum_i w((t - t_i) / T_i) (P_{i+1} - P_i),   q(t) = q_0 prod_i exp(w_i phi_i),   w septic, 0 to 1

The vehicle's position only decides when a leg starts; time drives its weight. Weights that follow the distance to the
next waypoint, as the paper may be read, have a fixed point at turns of 90 degrees and more, where the vehicle stalls.
A leg may start before the one in front of it has ended, so the course passes a waypoint closely instead of stopping
there; at most two legs act at a time and the reference stays inside the hull of three consecutive waypoints.

At constant speed (`trajectory.constant_speed`) the weight rises evenly instead: it gathers speed while that of the leg
before it loses it, so their sum is constant, and a corner is rounded by the change of velocity.
"""

from dataclasses import dataclass
from itertools import count, pairwise, takewhile
from math import degrees, inf, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.scene.description import vehicle as description
from varos_warp.scene.frames import attitudes
from varos_warp.sim import quaternion
from varos_warp.sim.clock import LONGEST_S, TICK_S
from varos_warp.sim.quaternion import Quaternion, Vector
from varos_warp.sim.vehicle.thrusters import PITCH, ROLL

PEAK_RATE, PEAK_ACCELERATION = 35.0 / 16.0, 84.0 * sqrt(5.0) / 25.0
"""Largest first and second derivative of the septic weight."""
PEAK_OF_RAMP = 1.5
"""Largest acceleration of a change of speed at constant speed, by its mean."""
SLOWER = 1.02
"""Step in which legs are slowed down until they have room for the changes of speed beside them."""
MIN_LEG_S = 1.0
"""Shortest time of a leg; also how long a course of no length lasts [s]. At constant speed, time that a hand-over takes
where the legs are no shorter."""
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
    return (np.where(s > 0.5, 1.0 - w, w), 140.0 * (s * (1.0 - s)) ** 3, 420.0 * (s * (1.0 - s)) ** 2 * (1.0 - 2.0 * s))


def ramp(t: np.ndarray, blend: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Way, speed and acceleration [n] of what gets from rest to unit speed within ``blend`` [s], by s^2 (3 - 2 s)."""
    s = np.clip(t / blend, 0.0, 1.0)
    return (
        blend * s**3 * (1.0 - 0.5 * s) + np.maximum(t - blend, 0.0),
        s * s * (3.0 - 2.0 * s),
        6.0 * s * (1.0 - s) / blend,
    )


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
    """Asked peak speed, or with ``blends`` asked speed [m/s]."""
    blends: tuple[float, float] | None = None
    """Times [s] at the beginning and end of the leg in which the speed rises and falls, and is constant between;
    None: the weight is the septic."""

    @property
    def peak_speed(self) -> float:
        """Largest speed of this leg alone [m/s]."""
        length = float(np.linalg.norm(self.step))
        return PEAK_RATE * length / self.duration if self.blends is None else length / self.ideal_time

    @property
    def ideal_time(self) -> float:
        """Time [s] that the leg would take if its speed rose and fell at once."""
        return self.duration - 0.5 * sum(self.blends or ())

    def weight(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Weight and its first two derivatives [1/s], [1/s^2] at times [n] [s] since the leg started."""
        if self.blends is None:
            w, rate, acceleration = weight(t / self.duration)
            return w, rate / self.duration, acceleration / self.duration**2
        rising, falling = self.blends
        first, second = ramp(t, rising), ramp(t - (self.duration - falling), falling)
        return tuple((a - b) / self.ideal_time for a, b in zip(first, second, strict=True))  # type: ignore[return-value]


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
    targets: list[int] | None = None
    """The scene's index of the waypoint that each leg leads to; None: 1, 2, 3 ..."""

    @property
    def duration(self) -> float:
        """Time of the reference when no gate has to wait [s]."""
        return sum(leg.duration - gate.overlap for leg, gate in zip(self.legs, self.gates, strict=True))

    @property
    def longest(self) -> int:
        """The scene's index of the waypoint that takes longest to get to, with the rest there."""
        return self.leads_to(
            int(
                np.argmax(
                    [leg.duration - min(gate.overlap, 0.0) for leg, gate in zip(self.legs, self.gates, strict=True)]
                )
            )
        )

    def leads_to(self, leg: int) -> int:
        """The scene's index of the waypoint that a leg leads to."""
        return leg + 1 if self.targets is None else self.targets[leg]


def plan(trajectory: description.Trajectory, free: tuple[int, ...] = ()) -> Course:
    """Legs and gates of a scene's waypoints; of axes that the thrusters leave ``free`` none is asked to turn."""
    waypoints, targets = trajectory.stops, None
    if len(waypoints) == 1:
        waypoints, targets = waypoints * 2, [0]
    positions = np.array([w.position for w in waypoints], float)
    turned = level(attitudes(waypoints), free) if free else attitudes(waypoints)
    keeps_speed = trajectory.keeps_speed and targets is None
    if keeps_speed:
        waypoints, positions, turned, targets = _graded(waypoints, positions, turned)
    steps, turns = np.diff(positions, axis=0), [turn(a, b) for a, b in pairwise(turned)]
    if keeps_speed:
        legs, strict = _even_legs(trajectory, waypoints, steps, np.array(turns)), [w.strict for w in waypoints]
    else:
        legs = [_leg(trajectory, *leg) for leg in zip(waypoints[1:], steps, turns, strict=True)]
        strict = _strict(waypoints, legs)
    gates = [_gate(trajectory, waypoints[i + 1], strict[i + 1], legs[i : i + 2]) for i in range(len(legs))]
    return Course(positions, turned, legs, gates, trajectory.handover_timeout_s, targets)


def level(turned: list[Rotation], free: tuple[int, ...]) -> list[Rotation]:
    """Attitudes without pitch or roll, or both, where these are `free`."""
    angles = Rotation.concatenate(turned).as_euler("ZXY")
    angles[:, [{PITCH: 1, ROLL: 2}[axis] for axis in free]] = 0.0
    return list(Rotation.from_euler("ZXY", angles))


def _leg(trajectory, target, step, turned) -> Leg:
    speed = target.speed or trajectory.speed
    length, angle = float(np.linalg.norm(step)), float(np.linalg.norm(turned))
    duration = max(
        PEAK_RATE * length / speed,
        PEAK_RATE * angle / np.radians(trajectory.max_angular_speed_deg),
        sqrt(PEAK_ACCELERATION * length / trajectory.max_acceleration),
        MIN_LEG_S,
    )
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
    if legs[0].blends is not None:
        # the vehicle is to be near the reference, which is on its way to the waypoint for half the hand-over
        overlap = legs[0].blends[1] if len(legs) == 2 else 0.0
        return Gate(overlap, trajectory.handover_radius_m + 0.5 * overlap * legs[0].peak_speed)
    # the shorter leg bounds the overlap: otherwise a third leg could become active and weights negative
    overlap = trajectory.overlap * min(leg.duration for leg in legs) if len(legs) == 2 else 0.0
    return Gate(overlap, trajectory.handover_radius_m)


# ----------------------------------------------------------------------------------------------------- constant speed


def _is_stop(waypoint) -> bool:
    return waypoint.strict or waypoint.dwell_s is not None


def _graded(waypoints, positions: np.ndarray, turned: list[Rotation]):
    """Waypoints with others between them, by which long legs get shorter towards short ones, as a mesh is graded.

    So the vehicle can slow down for a narrow turn where it begins, and not all the way to it.

    Returns:
        Waypoints, their positions [n, 3] and attitudes, and for each leg the index of the given waypoint ahead.
    """
    lengths = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    beside = np.pad(np.maximum(lengths, CLOSE_M), 1, constant_values=np.inf)
    places, dense, attitude, targets = [positions[:1]], [waypoints[0]], [turned[0]], []
    for i, length in enumerate(lengths):
        start, end = (
            np.inf if _is_stop(w) else size for w, size in zip(waypoints[i : i + 2], beside[i : i + 3 : 2], strict=True)
        )
        shares = np.array([*_cuts(length, start), *(1.0 - x for x in reversed(_cuts(length, end)))])[:, None]
        places += [positions[i] + shares * (positions[i + 1] - positions[i]), positions[i + 1 : i + 2]]
        attitude += [turned[i] * Rotation.from_rotvec(x * turn(*turned[i : i + 2])) for x in shares] + [turned[i + 1]]
        passed = waypoints[i + 1].model_copy(update={"strict": False, "dwell_s": None})
        dense += [passed] * len(shares) + [waypoints[i + 1]]
        targets += [i + 1] * (len(shares) + 1)
    return dense, np.concatenate(places), attitude, targets


def _cuts(length: float, neighbour: float) -> list[float]:
    """Shares of a leg at which it is cut: pieces as long as the neighbour, twice, four times ... in its first third."""
    ends = (neighbour * (2.0**k - 1.0) / length for k in count(1)) if length else iter([1.0])
    return list(takewhile(lambda share: share <= 1.0 / 3.0, ends))


@np.errstate(over="ignore", divide="ignore")  # what takes for ever is refused because it does
def _even_legs(trajectory, waypoints, steps: np.ndarray, turns: np.ndarray) -> list[Leg]:
    """Legs of constant speed, which pass it on to each other; from rest to rest between waypoints to stop at."""
    last = len(steps)
    stops = [0, *(i for i in range(1, last) if _is_stop(waypoints[i])), last]
    speeds = np.array([w.speed or trajectory.speed for w in waypoints[1:]])
    times = np.maximum.reduce(
        [
            np.linalg.norm(steps, axis=1) / speeds,
            np.full(last, 2.0 * TICK_S),
            np.linalg.norm(turns, axis=1) / np.radians(trajectory.max_angular_speed_deg),
        ]
    )
    legs, times = [], np.minimum(times, 10.0 * LONGEST_S)
    for first, end in pairwise(stops):
        few = slice(first, end)
        even, blends = _blended(steps[few], times[few], trajectory.max_acceleration)
        legs += [
            Leg(step, turned, float(time + 0.5 * (a + b)), float(speed), (float(a), float(b)))
            for step, turned, time, speed, a, b in zip(
                steps[few], turns[few], even, speeds[few], blends, blends[1:], strict=False
            )
        ]
    return legs


def _blended(steps: np.ndarray, times: np.ndarray, max_acceleration: float) -> tuple[np.ndarray, np.ndarray]:
    """Times of legs [n] and of the changes of velocity before, between and after them [n + 1], whole ticks [s].

    A change lasts as long as the acceleration asks for, and must be over in the times of the legs at both sides of it.
    Where it would not be, the faster one is driven more slowly: so the vehicle gathers speed over many short legs.
    """
    while True:
        velocity = np.pad(steps / times[:, None], ((1, 1), (0, 0)))
        needed = PEAK_OF_RAMP * np.linalg.norm(np.diff(velocity, axis=0), axis=1) / max_acceleration
        beside = np.pad(times, 1, constant_values=np.inf)
        room = np.minimum(beside[:-1], beside[1:])
        tight = np.flatnonzero(needed > room)
        if not len(tight) or times.sum() > LONGEST_S:
            break
        speed = np.linalg.norm(velocity, axis=1)
        times = times.copy()
        times[np.unique(np.where(speed[tight] > speed[tight + 1], tight - 1, tight))] *= SLOWER
    ends = np.rint(np.cumsum(times) / TICK_S)
    times = np.diff(ends, prepend=0.0) * TICK_S
    beside = np.pad(times, 1, constant_values=np.inf)
    blends = np.minimum(np.maximum(needed, MIN_LEG_S), np.minimum(beside[:-1], beside[1:]))
    return times, np.floor(blends / (2.0 * TICK_S) + 1e-6) * 2.0 * TICK_S  # halves of them are whole ticks, too


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
        """Rows of the reference as plain floats."""
        columns = self._replace(attitude=self.attitude.as_quat(scalar_first=True))
        return [Reference(*map(tuple, row)) for row in zip(*(c.tolist() for c in columns), strict=True)]


def at_rest(position: np.ndarray, attitude: Rotation) -> Window:
    """A single row that holds a pose."""
    nothing = np.zeros((1, 3))
    return Window(np.array([position], float), nothing, nothing, Rotation.concatenate([attitude]), nothing, nothing)


def add_leg(before: Window, leg: Leg, ticks: np.ndarray, h: float = TICK_S) -> Window:
    """The reference with a leg, on top of what earlier ones contribute; ``ticks`` [n] are since the leg started.

    Rates: with E = exp(w phi), omega <- E'omega + dw phi and alpha <- E'alpha + ddw phi + (E'omega) x (dw phi).
    """
    rows = np.minimum(np.arange(len(ticks)), len(before.position) - 1)
    w, rate, acceleration = (value[:, None] for value in leg.weight(ticks * h))
    E = Rotation.from_rotvec(w * leg.turn)
    carried = E.inv().apply(before.omega[rows])
    return Window(
        before.position[rows] + w * leg.step,
        before.velocity[rows] + rate * leg.step,
        before.acceleration[rows] + acceleration * leg.step,
        before.attitude[rows] * E,
        carried + rate * leg.turn,
        E.inv().apply(before.alpha[rows]) + acceleration * leg.turn + np.cross(carried, rate * leg.turn),
    )


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
        return self._course.leads_to(self.leg)

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
        distance = sqrt(sum((a - b) ** 2 for a, b in zip(position, target, strict=True)))
        if distance <= gate.radius and (gate.angle == inf or self._angle(attitude) <= gate.angle):
            return True
        if (tick - self._opens) * self._h < self._course.timeout:
            return False
        self.messages.append(
            f"waypoint {self.target}: gave up waiting at {tick * self._h:.2f} s, {distance:.3f} m and "
            f"{degrees(self._angle(attitude)):.2f} deg off (asked: {gate.radius:g} m); went on "
            f"after trajectory.handover_timeout_s = {self._course.timeout:g}"
        )
        return True

    def _angle(self, attitude: Quaternion) -> float:
        target = self._attitudes[self.leg + 1]
        turned = quaternion.log(quaternion.multiply(quaternion.conjugate(target), attitude))
        return sqrt(sum(x * x for x in turned))
