"""What the vehicle's sensors read along a trajectory (IMU and depth gauge: paper 3.2.2 and 3.2.3)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from varos_warp.scene import frames
from varos_warp.scene.description import vehicle as description
from varos_warp.sim.clock import samples_until, times_ns
from varos_warp.sim.motion import Trajectory, applied, product
from varos_warp.sim.poses import courses_of_moving, velocity_with
from varos_warp.sim.sensors.dvl import Dvl, beam_directions, bottom_track
from varos_warp.sim.sensors.noise import ImuNoiseStream, imu_noise

if TYPE_CHECKING:
    from varos_warp.scene.geometry.query import Solids


@dataclass(frozen=True)
class Imu:
    """Readings of the IMU in its own axes, instantaneous, one row per sample."""

    time_ns: np.ndarray
    """int64 [M]"""
    acceleration: np.ndarray
    """Specific force [M, 3] [m/s^2]: +9.81 along the up axis at rest."""
    angular_velocity: np.ndarray
    """[M, 3] [rad/s]"""
    acceleration_bias: np.ndarray
    angular_velocity_bias: np.ndarray
    """The slowly varying part of the noise in the readings [M, 3]; zero unless the scene asks for noise."""
    true_acceleration: np.ndarray
    true_angular_velocity: np.ndarray
    """The readings without noise [M, 3]."""


@dataclass(frozen=True)
class DepthGauge:
    """Readings of the depth gauge: ``time_ns`` int64 [M], ``depth`` [M] [m] below the surface, positive down."""

    time_ns: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True)
class Magnetometer:
    """Readings of the magnetometer: ``time_ns`` int64 [M], ``field`` [M, 3] [T] in its own axes."""

    time_ns: np.ndarray
    field: np.ndarray


def sampled(trajectory: Trajectory, rate_hz: float, first: int = 0) -> Trajectory:
    """A trajectory at the samples of a rate, from that with the number ``first`` up to its end."""
    return trajectory.at(times_ns(samples_until(int(trajectory.time_ns[-1]), rate_hz), rate_hz, first))


def measure_imu(trajectory: Trajectory, imu: description.Imu, gravity: float = 9.81, seed: int = 0, first: int = 0,
                stream: ImuNoiseStream | None = None) -> Imu:
    """Eq. (2) of the paper: a = R_sv (R_vr (dd p - g) + ([w]x[w]x + [dw]x) l), omega = R_sv w.

    Args:
        trajectory: Of the vehicle.
        imu: Where the sensor sits (l, the lever arm in vehicle axes), how it is turned (R_vs) and its rate.
        gravity: [m/s^2]; g = (0, 0, -gravity).
        seed: Of the noise, if the block asks for any.
        first: Number of the first sample to take.
        stream: Where the noise comes from if this is not the whole sequence; absent: made here.
    """
    there = sampled(trajectory, imu.rate_hz, first)
    omega, alpha, lever = there.angular_velocity, there.angular_acceleration, np.asarray(imu.position, float)
    acceleration = applied(there.rotation().inv(), there.acceleration + [0.0, 0.0, gravity])
    acceleration += np.cross(omega, np.cross(omega, lever)) + np.cross(alpha, lever)
    R_v_s = frames.attitude(imu)
    acceleration, omega = product(acceleration, R_v_s), product(omega, R_v_s)  # rows: (R_sv x)' = x' R_vs
    times, none = there.time_ns, np.zeros_like(omega)
    if imu.noise is None:
        return Imu(times, acceleration, omega, none, none, acceleration, omega)
    force, rate = stream.take(len(omega)) if stream else imu_noise(imu.noise, len(omega), imu.rate_hz, seed)
    return Imu(times, acceleration + force.white + force.bias, omega + rate.white + rate.bias, force.bias, rate.bias,
               acceleration, omega)


def measure_depth(trajectory: Trajectory, gauge: description.Mounted, surface_depth_m: float, first: int = 0
                  ) -> DepthGauge:
    """Depth of the gauge itself, which may sit off the vehicle's origin; from the sample with the number ``first``."""
    there = sampled(trajectory, gauge.rate_hz, first)
    lever = applied(there.rotation(), np.asarray(gauge.position, float))
    return DepthGauge(there.time_ns, surface_depth_m - (there.position[:, 2] + lever[:, 2]))


def measure_field(trajectory: Trajectory, magnetometer: description.Magnetometer, first: int = 0) -> Magnetometer:
    """The world's field in the sensor's axes, R_sv R_vw B, from the sample with the number ``first``.

    It is the same everywhere, so the lever arm has no part.
    """
    there = sampled(trajectory, magnetometer.rate_hz, first)
    field = applied(there.rotation().inv(), np.asarray(magnetometer.field_T, float))
    return Magnetometer(there.time_ns, product(field, frames.attitude(magnetometer)))


def measure_dvl(trajectory: Trajectory, dvl: description.Dvl, parts: "list | Solids",
                others: Mapping[str, Callable] | None = None, first: int = 0) -> Dvl:
    """Beams d of the sensor: range along d to what is there at the time, and velocity d . (u - R_sv (R_vw v + w x l)).

    u is the velocity of what a beam meets, in sensor axes: 0 where it stands still.

    Args:
        trajectory: Of the vehicle.
        dvl: Where the sensor sits (l, the lever arm in vehicle axes), how it is turned (R_vs), its rate and beams.
        parts: Everything solid, from ``build_parts``.
        others: Poses of other vehicles, whose bodies are among the parts.
        first: Number of the first sample to take.
    """
    there, beams = sampled(trajectory, dvl.rate_hz, first), beam_directions(dvl)
    velocity = velocity_of_sensor(there, dvl.position, frames.attitude(dvl))
    T_w_s = there.poses() @ frames.pose_matrix(dvl)
    distance, away = met_by_beams(there.time_ns, T_w_s, beams, dvl.range_m, parts, others)
    return bottom_track(there.time_ns, beams, distance, away - product(velocity, beams.T))


def met_by_beams(time_ns: np.ndarray, T_w_s: np.ndarray, beams: np.ndarray, range_m: Sequence[float],
                 parts: "list | Solids", others: Mapping[str, Callable] | None = None
                 ) -> tuple[np.ndarray, np.ndarray]:
    """Distance [M, 4] along beams to what is there at the time, NaN without lock, and its velocity along them [M, 4].

    Args:
        time_ns: int64 [M].
        T_w_s: Poses of the sensor [M, 4, 4].
        beams: Unit vectors [4, 3], sensor axes.
        range_m: Least and most [m].
        parts: Everything solid, from ``build_parts``.
        others: Poses of other vehicles, whose bodies are among the parts.
    """
    from varos_warp.scene.geometry.query import Solids  # Warp is loaded only where there is a DVL

    solids = parts if isinstance(parts, Solids) else Solids(parts)
    start, when = np.repeat(T_w_s[:, :3, 3], len(beams), axis=0), np.repeat(time_ns, len(beams))
    directions = (beams @ T_w_s[:, :3, :3].swapaxes(1, 2)).reshape(-1, 3)
    least, most = range_m
    courses = courses_of_moving(solids.parts, others)
    distance, met = solids.first_met(start, directions, most, {key: at(when) for key, at in courses.items()})
    away = np.zeros(len(distance))
    for k, course in enumerate(courses.values()):
        rays = np.flatnonzero(met == k)
        points = start[rays] + distance[rays, None] * directions[rays]
        velocity = velocity_with(course, points, when[rays])
        away[rays] = (velocity * directions[rays]).sum(axis=1)
    distance = np.where((distance >= least) & np.isfinite(distance), distance, np.nan)
    return distance.reshape(-1, len(beams)), away.reshape(-1, len(beams))


def velocity_of_sensor(there: Trajectory, lever, R_v_s: np.ndarray) -> np.ndarray:
    """R_sv (R_vw v + w x l) [M, 3] [m/s]: the sensor's velocity in its own axes."""
    velocity = applied(there.rotation().inv(), there.velocity)
    return product(velocity + np.cross(there.angular_velocity, np.asarray(lever, float)), R_v_s)
