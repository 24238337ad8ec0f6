"""Seeded noise of the sensors: white noise, and a bias that walks at random (of the IMU in Kalibr's units).

The scene's own ``vehicle.imu.noise`` and the noise that is added to a finished dataset are made here, alike.
"""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.description import vehicle as description
from varos_warp.scene.description.noise_profile import DepthGaugeNoise, DvlNoise, MagnetometerNoise
from varos_warp.sim.sensors.dvl import Dvl, bottom_track

_IMU, _DEPTH_GAUGE, _MAGNETOMETER, _DVL = 0x696D75, 0x646570, 0x6D6167, 0x64766C
"""They part the random numbers of the sensors."""
BLOCK = 4096
"""Samples that a stream draws at once after those of the sequence."""


@dataclass(frozen=True)
class Noise:
    """White noise and bias, each [n, axes], to be added to a measurement."""

    white: np.ndarray
    bias: np.ndarray


def noise(count: int, rate_hz: float, density: float, random_walk: float, rng: np.random.Generator,
          bias=0.0, turn_on_bias: float = 0.0, axes: int = 3) -> Noise:
    """Noise of one sensor at ``rate_hz`` (IEEE Std 952; Kalibr's IMU noise model).

    Args:
        count: Samples.
        rate_hz: Sample rate.
        density: White noise [unit/sqrt(Hz)]; the standard deviation of a sample is density * sqrt(rate).
        random_walk: Of the bias [unit * sqrt(Hz)]; it grows as random_walk * sqrt(t).
        rng: Where the numbers come from.
        bias: Constant part of the bias [axes] or for all axes [unit].
        turn_on_bias: Standard deviation of the part that is drawn once [unit].
        axes: Of the sensor.
    """
    white = density * np.sqrt(rate_hz) * rng.standard_normal((count, axes))
    steps = random_walk / np.sqrt(rate_hz) * rng.standard_normal((count, axes))
    start = np.asarray(bias) + turn_on_bias * rng.standard_normal(axes)
    return Noise(white, np.cumsum(steps, axis=0) - steps[:1] + start)


def imu_noise(model: description.ImuNoise, count: int, rate_hz: float, seed: int) -> tuple[Noise, Noise]:
    """Noise of the accelerometer [m/s^2] and of the gyroscope [rad/s], in this order."""
    return tuple(
        noise(count, rate_hz, *(getattr(model, f"{sensor}_{part}") for part in ("noise_density", "random_walk")),
              np.random.default_rng([seed, _IMU, i]), getattr(model, f"{sensor}_bias"),
              getattr(model, f"{sensor}_turn_on_bias"))
        for i, sensor in enumerate(("accelerometer", "gyroscope")))


class ImuNoiseStream:
    """Noise of an IMU, a few samples at a time; the first ``count`` are those that `imu_noise` draws at once.

    `imu_noise` draws the steps of the bias behind all white noise, so a walk depends on how long the sequence is, and
    ``count`` must be known from the beginning. The samples after these come in blocks with random numbers of their own.
    """

    def __init__(self, model: description.ImuNoise, count: int, rate_hz: float, seed: int):
        self._model, self._rate_hz, self._seed, self._taken, self._blocks = model, rate_hz, seed, 0, 1
        self._drawn = imu_noise(model, count, rate_hz, seed)

    def take(self, count: int) -> tuple[Noise, Noise]:
        """The next samples, as `imu_noise` gives them."""
        while len(self._drawn[0].white) < self._taken + count:
            self._draw()
        rows = slice(self._taken, self._taken + count)
        self._taken += count
        force, rate = (Noise(made.white[rows], made.bias[rows]) for made in self._drawn)
        return force, rate

    def _draw(self) -> None:
        """Put a block behind the samples that are left; its bias walks on from the last one's."""
        made = [noise(BLOCK + 1, self._rate_hz, getattr(self._model, f"{sensor}_noise_density"),
                      getattr(self._model, f"{sensor}_random_walk"),
                      np.random.default_rng([self._seed, _IMU, i, self._blocks]), before.bias[-1])
                for i, (sensor, before) in enumerate(zip(("accelerometer", "gyroscope"), self._drawn, strict=True))]
        force, rate = (Noise(np.concatenate([old.white[self._taken:], new.white[1:]]),
                             np.concatenate([old.bias[self._taken:], new.bias[1:]]))
                       for old, new in zip(self._drawn, made, strict=True))
        self._drawn, self._taken, self._blocks = (force, rate), 0, self._blocks + 1


def depth_gauge_noise(model: DepthGaugeNoise, depth: np.ndarray, rate_hz: float, seed: int
                      ) -> tuple[np.ndarray, np.ndarray]:
    """Readings of the depth gauge [n] and the bias in them [n], [m], of true depths [n]."""
    rng = np.random.default_rng([seed, _DEPTH_GAUGE])
    made = noise(len(depth), rate_hz, model.noise_density, model.random_walk, rng, model.bias, model.turn_on_bias, 1)
    reading = depth + made.white[:, 0] + made.bias[:, 0]
    if model.resolution > 0.0:
        reading = np.rint(reading / model.resolution) * model.resolution
    return reading, made.bias[:, 0]


def magnetometer_noise(model: MagnetometerNoise, count: int, rate_hz: float, seed: int) -> Noise:
    """Noise of the magnetometer [T]."""
    rng = np.random.default_rng([seed, _MAGNETOMETER])
    return noise(count, rate_hz, model.noise_density, model.random_walk, rng, model.bias, model.turn_on_bias)


def dvl_noise(model: DvlNoise, truth: Dvl, beams: np.ndarray, seed: int) -> Dvl:
    """Readings of the DVL, of true ones, for beams [4, 3] in its axes: each beam errs, and lock is as it was."""
    rng = np.random.default_rng([seed, _DVL])
    velocity = (1.0 + model.scale) * truth.beam_velocity
    velocity = velocity + model.velocity_std * rng.standard_normal(velocity.shape)
    distance = truth.range + model.range_std * rng.standard_normal(truth.range.shape)
    return bottom_track(truth.time_ns, beams, distance, velocity)
