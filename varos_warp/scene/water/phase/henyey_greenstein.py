"""The phase function of Henyey and Greenstein (1941), Astrophys. J. 93, 70."""

from functools import cached_property

import numpy as np

from varos_warp.scene.water.phase.phase_function import PhaseFunction


class HenyeyGreenstein(PhaseFunction):
    """p = (1 - g^2)/(4 pi (1 + g^2 - 2 g cos theta)^(3/2)), with mean cosine g; kernels have the closed form."""

    kind = "henyey_greenstein"
    is_henyey_greenstein = True

    def __init__(self, g: float):
        self.g = float(g)

    @property
    def key(self) -> tuple:
        """Kind and mean cosine."""
        return (self.kind, self.g)

    def density(self, s) -> np.ndarray:
        """Density [1/sr]."""
        return (1.0 - self.g**2) / (4.0 * np.pi * ((1.0 - self.g) ** 2 + 4.0 * self.g * np.asarray(s, float)) ** 1.5)

    @cached_property
    def integral(self) -> float:
        """Integral over the sphere: the density is normalised."""
        return 1.0

    def cdf(self, s) -> np.ndarray:
        """Share of the light that is scattered by at most the angle of ``s``, without cancellation at any g."""
        g, s = self.g, np.asarray(s, float)
        root = np.sqrt((1.0 - g) ** 2 + 4.0 * g * s)
        return 2.0 * (1.0 + g) * s / (root * (1.0 - g + root))

    def sample(self, u) -> np.ndarray:
        """Cosines that shares ``u`` in [0, 1] of the light stay below: -1 at 0, 1 at 1."""
        g, u = self.g, np.asarray(u, float)
        return 1.0 - 2.0 * (1.0 - u) * (1.0 + g * u) * (1.0 - g) ** 2 / (1.0 - g + 2.0 * g * u) ** 2

    def moments(self, n: int) -> np.ndarray:
        """Legendre moments chi_l = g^l."""
        return self.g ** np.arange(n + 1)

    @cached_property
    def mean_cosine(self) -> float:
        """Mean of cos theta."""
        return self.g

    @cached_property
    def backscatter_fraction(self) -> float:
        """Share of the light that is scattered by more than 90 degrees."""
        return float(1.0 - self.cdf(0.5))
