"""The refractive index of sea water."""

import numpy as np

CHANNELS_NM = (600.0, 550.0, 450.0)
"""Wavelengths that stand for R, G and B, as for Jerlov's water types (scene/water/jerlov.py)."""
SEA = 1.34
"""Index of the water behind a port where nothing else is said."""


def seawater_index(temperature_C: float, salinity: float, wavelength_nm: float | np.ndarray) -> float | np.ndarray:
    """Quan and Fry (1995), Appl. Opt. 34, 3477: 0 to 30 C, 0 to 35 per mille, 400 to 700 nm; relative to air."""
    T, S, nm = temperature_C, salinity, wavelength_nm
    n = 1.31405 + (1.779e-4 - 1.05e-6 * T + 1.6e-8 * T * T) * S - 2.02e-6 * T * T
    return n + (15.868 + 0.01155 * S - 0.00423 * T) / nm - 4382.0 / nm**2 + 1.1455e6 / nm**3
