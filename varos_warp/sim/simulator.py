"""The vehicle of a scene one tick at a time: a loop over `Simulator` gives the bytes of `simulate`."""

from array import array
from copy import deepcopy
from dataclasses import dataclass
from itertools import chain
from operator import index

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.products.sensors.registry import Readings, needs_solids
from varos_warp.scene.description import Scene
from varos_warp.scene.frames import transform
from varos_warp.sim.clock import TICK_NS, frame_count
from varos_warp.sim.companions import companions
from varos_warp.sim.driving import Driven, drive, keys_of, posed, prepare, rows_read
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.poses import Knots, at_ticks
from varos_warp.sim.quaternion import Vector
from varos_warp.sim.sensors.suite import Sensors
from varos_warp.sim.trajectory import geometry_of
from varos_warp.sim.vehicle.flight import COLUMNS, Flight, Logged, logged

BLOCK_TICKS = 10_000
"""Ticks that are taken from the splines at once after those of the sequence."""
LARGEST = 1e100
"""Bound on the components of a command [N], [N m], whose squares are to be numbers."""
SEEDS = 2**31
"""Seeds of a scene are less."""


@dataclass(frozen=True, kw_only=True)
class Step(Readings):
    """The vehicle at a tick, and what its sensors read since the tick before; names and axes as in `Trajectory`.

    ``imu``, ``depth_gauge`` and the other `Readings` are as in `Simulation`, with a row for each reading, often none;
    None where the vehicle has no such sensor. A reading between two ticks comes with the later one.
    """

    time_ns: int
    """Time from 0 [ns]; a tick is 5 000 000."""
    position: np.ndarray
    """[3] [m], world axes, as are velocity and acceleration."""
    velocity: np.ndarray
    """[3] [m/s]"""
    acceleration: np.ndarray
    """[3] [m/s^2], from the force balance."""
    quaternion: np.ndarray
    """[4] Hamilton (w, x, y, z), vehicle to world, w >= 0."""
    angular_velocity: np.ndarray
    """[3] [rad/s], vehicle axes."""
    angular_acceleration: np.ndarray
    """[3] [rad/s^2], vehicle axes."""
    reference_position: np.ndarray
    """What the scene's controller is asked to follow [3] [m]; the position itself for exact poses."""
    waypoint: int
    """Index of the waypoint (or pose) that the reference heads for."""

    @property
    def T_w_v(self) -> np.ndarray:
        """Pose [4, 4], vehicle to world, float64."""
        return transform(Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix(), self.position)


class Simulator:
    """The vehicle of a scene with its sensors and their noise, one tick of 5 ms at a time.

    It begins at time 0 with the first waypoint or pose. ``state`` and the results of `step`, one after the other until
    it is ``finished``, are the rows and readings of ``vw.simulate(scene)``, to the byte. After that it goes on: the
    controller holds the last waypoint, and a course of exact poses comes to rest.

    Args:
        scene: As for `simulate`. Without ``trajectory.duration_s`` its course is driven once in advance, because the
            length of the sequence is known only then.
        parts: The scene's geometry, from ``build_parts``, which only sensors with beams need; absent: built where there
            is one.

    Attributes:
        scene: The scene, with the seed of the last `reset`.
        state: The vehicle now, with the readings since the tick before.

    Raises:
        InputError: As `simulate` does.
    """

    scene: Scene
    state: Step
    _logged: Logged

    def __init__(self, scene: Scene, parts: list | None = None):
        self.scene, self._parts = scene, geometry_of(scene, parts)
        self._learn()
        self._begin()

    @property
    def time_ns(self) -> int:
        """Time [ns] since the start."""
        return self.state.time_ns

    @property
    def pose(self) -> np.ndarray:
        """Pose T_w_v [4, 4] of the vehicle now, float64; what ``FrameRenderer.render`` takes."""
        return self.state.T_w_v

    @property
    def finished(self) -> bool:
        """True if all that `simulate` reads has been read: up to the IMU sample after the last frame."""
        return self.time_ns >= self._end_ns

    @property
    def messages(self) -> list[str]:
        """Waypoints that the vehicle did not reach in time so far, in plain words."""
        return [self.scene.key_in_file(words) for words in self._motion.messages]

    def step(self, force: ArrayLike | None = None, torque: ArrayLike | None = None) -> Step:
        """Go to the next tick.

        Args:
            force: Force [3] [N] in the vehicle's axes as they are now, for thrusters to give until the next tick. They
                do as with the controller's command: they lag behind it, and where it is more than they can do all of it
                is scaled down. Absent: 0 if there is a ``torque``, else what the scene's controller commands.
            torque: Moment [3] [N m], likewise.

        Returns:
            The vehicle at the next tick, and the readings since this one.

        Raises:
            InputError: A vector is not three finite numbers, a force is given to a vehicle that goes through exact
                poses, or the motion is no longer finite.
        """
        before = self._logged.trajectory
        command = None
        if force is not None or torque is not None:
            command = _vector(force, "force", "N"), _vector(torque, "torque", "N m")
        with keys_of(self.scene):
            self._motion.advance(command)
        self._logged = self._motion.look()
        self.state = self._step(before.followed_by(self._logged.trajectory))
        return self.state

    def reset(self, seed: int | None = None) -> Step:
        """Go back to time 0; the same steps give the same bytes again.

        Args:
            seed: Of noise and current from now on, instead of the scene's. What was built of the scene stays, such as
                copies that are strewn by its seed. Absent: the seed as it is.

        Returns:
            The vehicle at time 0.

        Raises:
            InputError: It is no seed.
        """
        if seed is not None and (seed := _seed(seed)) != self.scene.seed:
            self.scene = self.scene.model_copy(update={"seed": seed})
            self._learn()
        self._begin()
        return self.state

    def copy(self) -> "Simulator":
        """Another one in the same state, which goes its own way from here; both share the scene and its geometry."""
        shared = [self.scene, self._parts, self._others, *(self._run or ()), self._sensors.around]
        return deepcopy(self, {id(one): one for one in shared if one is not None})

    def _learn(self) -> None:
        """What holds for all runs with a seed: how long the sequence is, and where other vehicles are."""
        course, rate = self.scene.trajectory, self.scene.render.frame_rate_hz
        prepare(self.scene, self._parts)
        known = course.duration_s and not course.is_exact
        run = None if known else drive(self.scene, self._parts)
        frames = len(run.frames) if run else frame_count(course.duration_s or 0.0, rate)
        self._end_ns = (rows_read(self.scene, frames) - 1) * TICK_NS
        self._run = run if course.is_exact else None
        self._others = companions(self.scene) if needs_solids(self.scene.vehicle) else None

    def _begin(self) -> None:
        with keys_of(self.scene):
            self._motion = _Replayed(self.scene, self._run) if self._run else _Driven(self.scene)
        self._sensors = Sensors(self.scene, self._end_ns, self._parts, self._others)
        self._logged = self._motion.look()
        self.state = self._step(self._logged.trajectory)

    def _step(self, motion: Trajectory) -> Step:
        row = {name: column[-1] for name, column in vars(motion).items()}
        return Step(
            **row | {"time_ns": int(row["time_ns"])},
            **vars(self._sensors.read(motion)),
            reference_position=self._logged.reference[-1],
            waypoint=int(self._logged.waypoint[-1]),
        )


class _Driven:
    """The motion of a vehicle with dynamics."""

    def __init__(self, scene: Scene):
        self._flight = Flight(scene)

    @property
    def messages(self) -> list[str]:
        return self._flight.guidance.messages

    def look(self) -> Logged:
        """This tick, a single row."""
        row = np.frombuffer(array("d", chain(*self._flight.look())), COLUMNS)
        return logged(row, self._flight.origin, self._flight.tick)

    def advance(self, command: tuple[Vector, Vector] | None) -> None:
        """Advance to the next tick, as the controller commands where nobody else does."""
        if command is None:
            self._flight.advance()
        else:
            self._flight.advance_with(*command)
        self._flight.check(waits=False)


class _Replayed:
    """The motion through exact poses: that of a run, and what comes after it."""

    messages: tuple[str, ...] = ()

    def __init__(self, scene: Scene, run: Driven):
        self._knots, self._tick, self._first = Knots.of(scene.trajectory.stops), 0, 0  # type: ignore[arg-type]
        self._block = Logged(run.trajectory, run.reference_position, run.waypoint)

    def look(self) -> Logged:
        """This tick, a single row."""
        row = slice(self._tick - self._first, self._tick - self._first + 1)
        return Logged(self._block.trajectory.rows(row), self._block.reference[row], self._block.waypoint[row])

    def advance(self, command: tuple[Vector, Vector] | None) -> None:
        """Advance to the next tick; there is nothing to command."""
        if command is not None:
            raise InputError(
                "exact poses move the vehicle, and no force does",
                key="trajectory",
                remedy="Call step() without force and torque, or give the scene waypoints",
            )
        self._tick += 1
        if self._tick - self._first == len(self._block.trajectory):
            knots, self._first = self._knots, self._tick
            ticks = np.arange(self._first, self._first + BLOCK_TICKS, dtype=float)
            self._block = posed(knots, at_ticks(knots, ticks), self._first)


def _vector(value: ArrayLike | None, key: str, unit: str) -> Vector:
    """Three plain floats; none is zero."""
    if value is None:
        return (0.0, 0.0, 0.0)
    try:
        vector = np.asarray(value, np.float64)
        good = vector.shape == (3,) and bool((np.abs(vector) < LARGEST).all())
    except (TypeError, ValueError):
        good = False
    if not good:
        raise InputError(
            f"is not three finite numbers (below {LARGEST:g})",
            key=key,
            value=value,
            remedy=f"Give x, y and z in the vehicle's axes [{unit}]",
        )
    x, y, z = vector.tolist()
    return (x, y, z)


def _seed(value: int) -> int:
    try:
        if 0 <= index(value) < SEEDS:
            return index(value)
    except TypeError:
        pass
    raise InputError("is no seed", key="seed", value=value, remedy=f"Give a whole number from 0 to {SEEDS - 1}")
