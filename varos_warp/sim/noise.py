"""Seeded IMU noise in Kalibr's units: white noise plus a random walk of the bias. Off unless the scene asks for it."""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene import description


@dataclass(frozen=True)
class Noise:
    """White noise and bias, each [n, 3], to be added to a measurement."""

    white: np.ndarray
    bias: np.ndarray


def noise(count: int, rate_hz: float, density: float, random_walk: float, rng: np.random.Generator) -> Noise:
    """Noise of one sensor triad at ``rate_hz``; the bias starts at zero.

    Args:
        count: Samples.
        rate_hz: Sample rate.
        density: White noise [unit/sqrt(Hz)]; the standard deviation of a sample is density * sqrt(rate).
        random_walk: Of the bias [unit * sqrt(Hz)]; it grows as random_walk * sqrt(t).
        rng: Where the numbers come from.
    """
    white = density * np.sqrt(rate_hz) * rng.standard_normal((count, 3))
    steps = random_walk / np.sqrt(rate_hz) * rng.standard_normal((count, 3))
    return Noise(white, np.cumsum(steps, axis=0) - steps[0])


def imu_noise(model: description.ImuNoise, count: int, rate_hz: float, seed: int) -> tuple[Noise, Noise]:
    """Noise of the accelerometer [m/s^2] and of the gyroscope [rad/s], in this order."""
    accelerometer, gyroscope = (np.random.default_rng([seed, 0x696D75, i]) for i in range(2))
    return (noise(count, rate_hz, model.accelerometer_noise_density, model.accelerometer_random_walk, accelerometer),
            noise(count, rate_hz, model.gyroscope_noise_density, model.gyroscope_random_walk, gyroscope))
