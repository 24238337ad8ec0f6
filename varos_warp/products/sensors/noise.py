"""Seeded noise of the sensors: white noise, and a bias that walks at random; and how a dataset is checked for it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.sensors.protocol import Evidence

EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Noise:
    """White noise and bias, each [n, axes], to be added to a measurement."""

    white: np.ndarray
    bias: np.ndarray


def noise(
    count: int,
    rate_hz: float,
    density: float,
    random_walk: float,
    rng: np.random.Generator,
    bias: float | tuple[float, ...] | np.ndarray = 0.0,
    turn_on_bias: float = 0.0,
    axes: int = 3,
) -> Noise:
    """Noise of one sensor at ``rate_hz`` (IEEE Std 952; Kalibr's IMU noise model).

    ``density`` [unit/sqrt(Hz)] is of white noise: the standard deviation of a sample is density * sqrt(rate). The bias
    grows as random_walk * sqrt(t), from its constant part ``bias`` [axes], or [unit] for all axes, and a part that is
    drawn once with the standard deviation ``turn_on_bias``.
    """
    white = density * np.sqrt(rate_hz) * rng.standard_normal((count, axes))
    steps = random_walk / np.sqrt(rate_hz) * rng.standard_normal((count, axes))
    start = np.asarray(bias) + turn_on_bias * rng.standard_normal(axes)
    return Noise(white, np.cumsum(steps, axis=0) - steps[:1] + start)


def white_variance(about: Mapping[str, Any], key: str = "noise_density") -> float:
    """Variance of the white noise of one reading, of what dataset.json says of the sensor; 0 where it has none."""
    return ((about.get("noise") or {}).get(key) or 0.0) ** 2 * about["rate_hz"]


def check_noise(found: Evidence, quantity: str, slack: float, unit: str) -> None:
    """Readings with noise are no farther off truth and bias than white noise can be, and those of profile and seed."""
    about = found.about
    read, truth, bias = (samples[quantity] for samples in (found.read, found.truth, found.bias))
    most = 8 * about["noise"]["noise_density"] * np.sqrt(about["rate_hz"])
    found.measure(
        "reading off truth and bias, at most",
        np.abs(read - truth - bias).max(initial=0.0),
        most + about["noise"].get("resolution", 0.0) / 2 + slack,
        unit,
    )
    found.repeated(slack, unit)
