"""Motion of the vehicle: its rows of 200 Hz, and everything between them."""

from collections.abc import Iterator
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from varos_warp.scene.frames import transform


@dataclass(frozen=True)
class Trajectory:
    """Motion of the vehicle at increasing times, float64; `Simulation.trajectory` has one row per tick of 5 ms."""

    time_ns: np.ndarray
    """int64 [N], from 0."""
    position: np.ndarray
    """[N, 3] [m], world axes, as are velocity and acceleration."""
    velocity: np.ndarray
    """[N, 3] [m/s]"""
    acceleration: np.ndarray
    """[N, 3] [m/s^2], from the force balance, never from differences."""
    quaternion: np.ndarray
    """[N, 4] Hamilton (w, x, y, z), vehicle to world, w >= 0."""
    angular_velocity: np.ndarray
    """[N, 3] [rad/s], vehicle axes."""
    angular_acceleration: np.ndarray
    """[N, 3] [rad/s^2], vehicle axes."""

    def __len__(self) -> int:
        return len(self.time_ns)

    def rotation(self) -> Rotation:
        """Attitude of all rows, vehicle to world."""
        return Rotation.from_quat(self.quaternion, scalar_first=True)

    def T_w_v(self, k: int) -> np.ndarray:
        """Pose [4, 4] at row ``k``, vehicle to world."""
        return transform(Rotation.from_quat(self.quaternion[k], scalar_first=True).as_matrix(), self.position[k])

    def velocity_of(self, lever: np.ndarray) -> np.ndarray:
        """Velocity [N, 3] [m/s], world axes, of a point of the vehicle at ``lever`` [3] in its axes."""
        return self.velocity + self.rotation().apply(np.cross(self.angular_velocity, lever))

    def poses(self) -> np.ndarray:
        """Poses [N, 4, 4] of all rows, vehicle to world."""
        return transform(self.rotation().as_matrix(), self.position)

    def at(self, time_ns: ArrayLike) -> "Trajectory":
        """The motion at other times: rows as they are, and between two of them what joins their states.

        That is the polynomial of degree five, of the position and of the rotation vector from the earlier row, which
        has their place, velocity and acceleration at both ends. So the motion has a continuous acceleration, of which
        velocity and place are the integrals. The errors of place, velocity and acceleration fall with the sixth, fifth
        and fourth power of the step.

        Args:
            time_ns: int64 [M], or one, from the first row's time to the last's.

        Raises:
            ValueError: If one is before the first row or after the last, or not a whole number.
        """
        time_ns = np.atleast_1d(time_ns)
        if time_ns.dtype.kind not in "iu" and time_ns.size:
            raise ValueError(f"times are whole nanoseconds, not {time_ns.dtype}")
        time_ns = time_ns.astype(np.int64)
        if time_ns.size and not self.time_ns[0] <= time_ns.min() <= time_ns.max() <= self.time_ns[-1]:
            raise ValueError(f"the motion is known from {self.time_ns[0]} to {self.time_ns[-1]} ns")
        before = np.searchsorted(self.time_ns, time_ns, side="right") - 1
        there = self.rows(before)
        off = np.flatnonzero(there.time_ns != time_ns)
        if off.size:
            joined = _between(self.rows(before[off]), self.rows(before[off] + 1), time_ns[off])
            for mine, theirs in zip(there._columns(), joined._columns(), strict=True):
                mine[off] = theirs
        return there

    def from_before(self, time_ns: np.ndarray) -> "Trajectory":
        """The motion as `at` has it, and before the first row with the accelerations of that row."""
        there = self.at(np.maximum(time_ns, self.time_ns[0]))
        early = np.flatnonzero(time_ns < self.time_ns[0])
        if early.size:
            before = _before(self.rows(slice(1)), time_ns[early])
            for mine, theirs in zip(there._columns(), before._columns(), strict=True):
                mine[early] = theirs
        return there

    def followed_by(self, later: "Trajectory") -> "Trajectory":
        """These rows and those of a later piece."""
        return Trajectory(*map(np.concatenate, zip(self._columns(), later._columns(), strict=True)))

    def _columns(self) -> Iterator[np.ndarray]:
        return (getattr(self, field.name) for field in fields(self))

    def rows(self, index: np.ndarray | slice) -> "Trajectory":
        """Some of the rows; of a slice they are not copied."""
        return Trajectory(*(column[index] for column in self._columns()))


def applied(rotation: Rotation, vectors: np.ndarray) -> np.ndarray:
    """Vectors [N, 3] (or [3], the same for all) turned by N rotations, each to the byte as it would be among others.

    For a single row NumPy adds in another order than for several, so one is turned twice.
    """
    if len(rotation) != 1:
        return rotation.apply(vectors)
    return rotation[[0, 0]].apply(np.repeat(np.atleast_2d(vectors), 2, axis=0))[:1]


def product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Rows [N, n] times a matrix [n, m], each to the byte as it would be among others: see `applied`."""
    return rows @ matrix if len(rows) != 1 else (np.repeat(rows, 2, axis=0) @ matrix)[:1]


def _before(first: Trajectory, time_ns: np.ndarray) -> Trajectory:
    """The motion at times [N] before its first row, with the accelerations of that row."""
    t = 1e-9 * (time_ns - first.time_ns)[:, None]
    R = first.rotation() * Rotation.from_rotvec(t * first.angular_velocity + t**2 / 2 * first.angular_acceleration)
    return Trajectory(
        time_ns,
        first.position + t * first.velocity + t**2 / 2 * first.acceleration,
        first.velocity + t * first.acceleration,
        np.tile(first.acceleration, (len(t), 1)),
        R.as_quat(canonical=True, scalar_first=True),
        first.angular_velocity + t * first.angular_acceleration,
        np.tile(first.angular_acceleration, (len(t), 1)),
    )


def _between(start: Trajectory, end: Trajectory, time_ns: np.ndarray) -> Trajectory:
    """The motion at a time between each two rows."""
    h, t = (1e-9 * (time - start.time_ns)[:, None] for time in (end.time_ns, time_ns))
    moved = end.position - start.position
    position, velocity, acceleration = _quintic(
        (start.velocity, start.acceleration), (moved, end.velocity, end.acceleration), h, t
    )
    R = start.rotation()
    turned = _vector_rates((R.inv() * end.rotation()).as_rotvec(), end.angular_velocity, end.angular_acceleration)
    phi, rate, rate_of_rate = _quintic((start.angular_velocity, start.angular_acceleration), turned, h, t)
    q = (R * Rotation.from_rotvec(phi)).as_quat(scalar_first=True)
    return Trajectory(
        time_ns,
        start.position + position,
        velocity,
        acceleration,
        np.where(q[:, :1] < 0.0, -q, q),
        *_body_rates(phi, rate, rate_of_rate),
    )


def _quintic(
    start: tuple[np.ndarray, ...], end: tuple[np.ndarray, ...], h: np.ndarray, t: np.ndarray
) -> tuple[np.ndarray, ...]:
    """What starts at 0: value, first and second derivative at ``t`` from the two at 0 and the three at ``h``."""
    (v, a), (p1, v1, a1) = start, end
    dp, dv, da = p1 - h * v - h**2 / 2 * a, (v1 - v - h * a) * h, (a1 - a) * h**2
    c3, c4, c5 = 10 * dp - 4 * dv + da / 2, -15 * dp + 7 * dv - da, 6 * dp - 3 * dv + da / 2
    s = t / h
    return (
        t * v + t**2 / 2 * a + s**3 * (c3 + s * (c4 + s * c5)),
        v + t * a + s**2 / h * (3 * c3 + s * (4 * c4 + s * 5 * c5)),
        a + s / h**2 * (6 * c3 + s * (12 * c4 + s * 20 * c5)),
    )


def _vector_rates(phi: np.ndarray, omega: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, ...]:
    """A rotation vector and its first and second derivative, from those of the attitude in body axes [n, 3] each.

    The inverse of the right Jacobian of SO(3), as a series: less than 1e-9 is left out up to a turn of 0.1 rad.
    """
    square = (phi * phi).sum(axis=1, keepdims=True)
    c = 1 / 12 + square / 720
    once = np.cross(phi, omega)
    rate = omega + once / 2 + c * np.cross(phi, once)
    dc = (phi * rate).sum(axis=1, keepdims=True) / 360
    change = np.cross(phi, alpha) + np.cross(rate, omega)
    return (
        phi,
        rate,
        (alpha + change / 2 + dc * np.cross(phi, once) + c * (np.cross(rate, once) + np.cross(phi, change))),
    )


def _body_rates(phi: np.ndarray, rate: np.ndarray, rate_of_rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity and acceleration in body axes: the inverse of `_vector_rates`, as exact."""
    square = (phi * phi).sum(axis=1, keepdims=True)
    half = (phi * rate).sum(axis=1, keepdims=True)
    a, da = 1 / 2 - square / 24 + square**2 / 720, -half / 12 + half * square / 180
    b, db = 1 / 6 - square / 120, -half / 60
    once, change = np.cross(phi, rate), np.cross(phi, rate_of_rate)
    omega = rate - a * once + b * np.cross(phi, once)
    alpha = (
        rate_of_rate
        - a * change
        - da * once
        + b * (np.cross(rate, once) + np.cross(phi, change))
        + db * np.cross(phi, once)
    )
    return omega, alpha
