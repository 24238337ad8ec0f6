"""Scattering by pure water: density fluctuations much smaller than the wavelength, and a little depolarisation."""

import numpy as np

from varos_warp.scene.water.phase.phase_function import PhaseFunction


class Rayleigh(PhaseFunction):
    """p = 0.06225 (1 + 0.835 cos^2 theta) (Morel 1974; Mobley 1994), normalised."""

    kind = "rayleigh"

    def density(self, s) -> np.ndarray:
        """Density [1/sr], to the digits of its constants."""
        return 0.06225 * (1.0 + 0.835 * (1.0 - 2.0 * np.asarray(s, float)) ** 2)
