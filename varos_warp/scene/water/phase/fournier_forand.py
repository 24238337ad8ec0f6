"""The phase function of Fournier and Forand for sea water, in its form of 1999.

Fournier and Forand (1994), Proc. SPIE 2258, 194; Fournier and Jonasz (1999), Proc. SPIE 3761, 62; backscatter and the
one-parameter family: Mobley, Sundman and Boss (2002), Appl. Opt. 41, 1035.
"""

from functools import cached_property

import numpy as np
from scipy.optimize import brentq

from varos_warp.scene.water.phase.phase_function import PhaseFunction
from varos_warp.scene.water.phase.power_table import S_CUT

NEAR_ONE = 1e-5
"""Largest |1 - delta| of the series; there, both the closed form's digits and the series' error are some 1e-10."""


class FournierForand(PhaseFunction):
    """Spheres with a power law of sizes, by anomalous diffraction and Mie's peak behind.

    Args:
        n: Refractive index of the particles relative to water, above 1.
        mu: Slope of the size distribution, 3 to 5.
    """

    kind = "fournier_forand"

    def __init__(self, n: float, mu: float):
        self.n, self.mu = float(n), float(mu)
        self._nu = 0.5 * (3.0 - self.mu)
        self._per_s = 4.0 / (3.0 * (self.n - 1.0) ** 2)  # delta = per_s s; at 180 degrees, s = 1

    @classmethod
    def from_backscatter_fraction(cls, fraction: float) -> "FournierForand":
        """The member with B = ``fraction``, 0.0001 to 0.15, of the family n = 1.01 + 0.1542 (mu - 3)."""

        def member(mu):
            return cls(1.01 + 0.1542 * (mu - 3.0), mu)

        return member(brentq(lambda mu: member(mu).backscatter_fraction - fraction, 3.0 + 1e-6, 5.0, xtol=1e-14))

    @property
    def key(self) -> tuple:
        """Kind, relative index and slope."""
        return (self.kind, self.n, self.mu)

    def describe(self) -> dict:
        """Its facts in plain JSON types."""
        return {**super().describe(), "n": self.n, "mu": self.mu}

    def density(self, s) -> np.ndarray:
        """Density [1/sr]."""
        s, nu, d180 = np.asarray(s, float), self._nu, self._per_s
        power = d180**nu
        behind = (1.0 - power) * (3.0 * (1.0 - 2.0 * s) ** 2 - 1.0) / (16.0 * np.pi * (d180 - 1.0) * power)
        return self._diffraction(s) + behind

    def _diffraction(self, s: np.ndarray) -> np.ndarray:
        """The first of its two terms; 0/0 at delta = 1, where a series takes over."""
        nu, delta = self._nu, self._per_s * s
        off = 1.0 - delta
        near = np.abs(off) < NEAR_ONE
        off = np.where(near, 1.0, off)
        log_power = nu * np.log(delta)
        short = -np.expm1(log_power)  # 1 - delta^nu
        closed = (nu * off - short + (delta * short - nu * off) / s) / (off**2 * np.exp(log_power))
        off = 1.0 - delta
        series = nu * ((nu - 1.0) - (nu + 1.0) / s) / 2.0
        series = series + nu * (nu + 1.0) * off * (2.0 * (nu - 1.0) - (2.0 * nu + 1.0) / s) / 6.0
        return np.where(near, series, closed) / (4.0 * np.pi)

    def _share_below(self, s: float) -> float:
        """Closed form of the distribution, less its second term: 1e-13 at S_CUT, and 0 at 90 degrees."""
        delta = self._per_s * s
        power = delta**self._nu
        return float((1.0 - delta * power - (1.0 - power) * s) / ((1.0 - delta) * power))

    @cached_property
    def light_ahead(self) -> float:
        """Share of the light below S_CUT."""
        return self._share_below(S_CUT)

    @cached_property
    def backscatter_fraction(self) -> float:
        """B = b_b/b (Mobley et al. 2002)."""
        return 1.0 - self._share_below(0.5)
