"""The chance that a small visual odometry fails at a step, forecast from images alone.

A logistic regression; its coefficients, what it was fitted on and how well it did on scenes that it had not seen are in
``data/readiness/forecast.json``, which ``benchmarks/failure_forecast.py`` makes.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources

import numpy as np

FILE = resources.files("varos_warp") / "data" / "readiness" / "forecast.json"
SIGNS = ("verified_matches", "verified_share", "tracked", "contrast", "black_level")
"""Measures by frame that it is made from, none of which needs truth."""
COUNTS = ("verified_matches", "tracked")
"""Signs that count by the logarithm of one more than their value."""


def regressors(row: Mapping[str, float | None]) -> np.ndarray:
    """Float64 [5] from the measures of a step; one that nothing was found for counts as 0."""
    values = {name: float(row.get(name) or 0.0) for name in SIGNS}
    return np.array([np.log1p(value) if name in COUNTS else value for name, value in values.items()])


@dataclass(frozen=True)
class Forecast:
    """The regression: of ``(x - mean) / scale``, x as `regressors` gives it."""

    mean: np.ndarray
    scale: np.ndarray
    coefficients: np.ndarray
    intercept: float

    def chance(self, x: np.ndarray) -> np.ndarray:
        """Return the chance of failure, 0 to 1 [...], for regressors [..., 5]."""
        return 1.0 / (1.0 + np.exp(-(((x - self.mean) / self.scale) @ self.coefficients + self.intercept)))


@cache
def shipped() -> Forecast:
    """The one that comes with the package."""
    told = json.loads(FILE.read_text(encoding="utf-8"))
    columns = [np.array([told[name][sign] for sign in SIGNS]) for name in ("mean", "scale", "coefficients")]
    return Forecast(*columns, told["intercept"])


def failure_chances(measures: Mapping[str, Sequence[float | None]]) -> list[float | None]:
    """Forecast the chance that each step fails from measures by frame; None for the last frame, which has no step."""
    steps = len(measures["verified_matches"]) - 1
    rows = [regressors({name: measures[name][step] for name in SIGNS if name in measures}) for step in range(steps)]
    return [*shipped().chance(np.array(rows)).tolist(), None]
