"""How the error of an image falls with its samples: the law that the planner reads the samples from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

FEWEST_SPP, MOST_SPP = 2, 4096
STEEPEST = {"field": -0.75, "path": -0.5, "reference": -0.5}
FLATTEST = -0.15
"""Exponents of the error in the number of samples: the most that a low-discrepancy sequence has shown with the field,
that of independent samples, which paths keep to, and the least that a denoiser has shown."""
REACH = 3
"""Up to so many times more samples than were judged, their error may be extrapolated."""


@dataclass(frozen=True)
class ErrorLaw:
    """Relative RMSE against samples per pixel: a power law through what was measured, one per channel.

    What a denoiser leaves falls steeply at first and slower then. So beyond the most samples that were judged, the
    exponent is half-way to that between the last two numbers of them, if that is slower; they alone tell it roughly. So
    chance in these two asks for more samples, never for fewer.

    There must be two numbers of samples or more.
    """

    spp: list[int]
    measured: np.ndarray
    """Errors [level, 3]."""
    noisy: np.ndarray | None = None
    """The same before denoising, where that was asked."""
    judges: Sequence[np.ndarray] = ()
    """The images that found them, for further ones."""
    steepest: float = STEEPEST["field"]
    """Exponent, at the least."""

    def _fit(self, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error [3] with one sample, and the exponents [3]: least squares of the logarithms."""
        x, y = np.log(self.spp), np.log(np.maximum(errors, 1e-12))
        exponent = np.clip((x - x.mean()) @ (y - y.mean(0)) / np.sum((x - x.mean()) ** 2), self.steepest, FLATTEST)
        return np.exp(y.mean(0) - exponent * x.mean()), exponent

    def _beyond(self) -> np.ndarray:
        """Exponents [3] beyond the most samples that were judged."""
        before, last = np.log(np.maximum(self.measured[-2:], 1e-12))
        slope = (last - before) / np.log(self.spp[-1] / self.spp[-2])
        _, exponent = self._fit(self.measured)
        return 0.5 * (exponent + np.clip(slope, exponent, FLATTEST))

    def error(self, spp: float) -> np.ndarray:
        """Error [3] with a number of samples."""
        one, exponent = self._fit(self.measured)
        judged = min(float(spp), self.spp[-1])
        found = one * judged**exponent * (float(spp) / judged) ** self._beyond()
        return np.where(self.measured.any(0), found, 0.0)

    def noise(self, spp: int) -> np.ndarray:
        """Error [3] before denoising."""
        one, exponent = self._fit(self.noisy)
        return np.where(self.noisy.any(0), one * float(spp) ** exponent, 0.0)

    def samples(self, target: float) -> int:
        """The fewest samples whose error is below ``target`` in every channel."""
        one, exponent = self._fit(self.measured)
        needed = (target / one) ** (1.0 / exponent)
        most = self.spp[-1]
        farther = most * (target / (one * most**exponent)) ** (1.0 / self._beyond())
        needed = np.where(self.measured.any(0), np.where(needed > most, farther, needed), 0.0)
        return int(np.ceil(min(needed.max(), 1e9)))

    def whole_samples(self, target: float) -> int:
        """The same within what is ever taken; many in steps of four."""
        needed = self.samples(target)
        return int(np.clip(needed if needed <= 16 else 4 * np.ceil(needed / 4), FEWEST_SPP, MOST_SPP))
