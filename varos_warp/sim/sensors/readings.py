"""What the vehicle's IMU and depth gauge read along a trajectory (paper 3.2.2 and 3.2.3)."""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene import frames
from varos_warp.scene.description import vehicle as description
from varos_warp.sim.clock import ticks_per_sample
from varos_warp.sim.sensors.noise import imu_noise


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


def measure_imu(trajectory, imu: description.Imu, gravity: float = 9.81, seed: int = 0) -> Imu:
    """Eq. (2) of the paper: a = R_sv (R_vr (dd p - g) + ([w]x[w]x + [dw]x) l), omega = R_sv w.

    Args:
        trajectory: A `trajectory.Trajectory`.
        imu: Where the sensor sits (l, the lever arm in vehicle axes), how it is turned (R_vs) and its rate.
        gravity: [m/s^2]; g = (0, 0, -gravity).
        seed: Of the noise, if the block asks for any.

    Raises:
        InputError: The rate does not divide 200 Hz.
    """
    step = ticks_per_sample(imu.rate_hz, "vehicle.imu.rate_hz")
    pick = slice(None, None, step)
    omega, alpha = trajectory.angular_velocity[pick], trajectory.angular_acceleration[pick]
    lever = np.asarray(imu.position, float)
    felt = trajectory.acceleration[pick] + [0.0, 0.0, gravity]
    acceleration = trajectory.rotation()[pick].inv().apply(felt)
    acceleration += np.cross(omega, np.cross(omega, lever)) + np.cross(alpha, lever)
    R_v_s = frames.attitude(imu)
    acceleration, omega = acceleration @ R_v_s, omega @ R_v_s  # rows: (R_sv x)' = x' R_vs
    times, none = trajectory.time_ns[pick], np.zeros_like(omega)
    if imu.noise is None:
        return Imu(times, acceleration, omega, none, none, acceleration, omega)
    force, rate = imu_noise(imu.noise, len(omega), imu.rate_hz, seed)
    return Imu(times, acceleration + force.white + force.bias, omega + rate.white + rate.bias, force.bias, rate.bias,
               acceleration, omega)


def measure_depth(trajectory, gauge: description.Mounted, surface_depth_m: float) -> DepthGauge:
    """Depth of the gauge itself, which may sit off the vehicle's origin.

    Raises:
        InputError: The rate does not divide 200 Hz.
    """
    pick = slice(None, None, ticks_per_sample(gauge.rate_hz, "vehicle.depth_gauge.rate_hz"))
    lever = trajectory.rotation()[pick].apply(np.asarray(gauge.position, float))
    return DepthGauge(trajectory.time_ns[pick], surface_depth_m - (trajectory.position[pick, 2] + lever[:, 2]))
