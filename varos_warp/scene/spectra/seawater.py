"""Scattering of pure sea water by wavelength, temperature and salinity: Zhang, Hu and He (2009), Opt. Express 17, 5698.

Light is scattered by fluctuations of density and of salinity; half of it backwards. Temperatures t in degrees Celsius,
salinities s in g/kg, wavelengths in air [nm].
"""

import numpy as np

AVOGADRO, BOLTZMANN, MOLAR_MASS = 6.0221417930e23, 1.3806503e-23, 18e-3
DEPOLARISATION = 0.039
"""Depolarisation of scattered light (Farinato and Rowell 1976)."""


def _refractive_index(nm: np.ndarray, t: float, s: float) -> tuple[np.ndarray, np.ndarray]:
    """Absolute refractive index and its derivative by salinity: Quan and Fry (1995), air by Ciddor (1996)."""
    air = 1.0 + (5792105.0 / (238.0185 - (nm / 1e3) ** -2) + 167917.0 / (57.362 - (nm / 1e3) ** -2)) / 1e8
    by_salinity = 1.779e-4 - 1.05e-6 * t + 1.6e-8 * t * t
    n = (
        1.31405
        + by_salinity * s
        - 2.02e-6 * t * t
        + (15.868 + 0.01155 * s - 0.00423 * t) / nm
        - 4382.0 / nm**2
        + 1.1455e6 / nm**3
    )
    return n * air, (by_salinity + 0.01155 / nm) * air


def _compressibility(t: float, s: float) -> float:
    """Isothermal compressibility [1/Pa]: secant bulk modulus of Millero et al. (1980)."""
    pure = np.polyval([-5.155288e-5, 1.360477e-2, -2.327105, 148.4206, 19652.21], t)
    by_s = np.polyval([-6.167e-5, 1.09987e-2, -0.603459, 54.6746], t)
    return 1e-5 / (pure + by_s * s + np.polyval([-5.3009e-4, 1.6483e-2, 7.944e-2], t) * s**1.5)


def _density(t: float, s: float) -> float:
    """Density [kg/m^3]: the equation of state of UNESCO (1981) at the surface."""
    pure = np.polyval([6.536332e-9, -1.120083e-6, 1.001685e-4, -9.09529e-3, 6.793952e-2, 999.842594], t)
    by_s = np.polyval([5.3875e-9, -8.2467e-7, 7.6438e-5, -4.0899e-3, 8.24493e-1], t)
    return pure + by_s * s + np.polyval([-1.6546e-6, 1.0227e-4, -5.72466e-3], t) * s**1.5 + 4.8314e-4 * s * s


def _log_activity_by_salinity(t: float, s: float) -> float:
    """Derivative of the logarithm of the activity of water by salinity: Millero and Leung (1976)."""
    return (
        np.polyval([2.40808e-11, -3.12165e-9, 2.40452e-7, -5.58651e-4], t)
        + 1.5 * np.polyval([-1.39872e-11, 2.08919e-9, -9.9422e-8, 1.79613e-5], t) * s**0.5
        + 2.0 * np.polyval([-1.93316e-11, -1.37674e-9, -2.31065e-6], t) * s
    )


def pure_scattering(wavelength_nm, temperature_c: float = 20.0, salinity: float = 35.0) -> np.ndarray:
    """Scattering coefficient of pure sea water [1/m] at wavelengths [nm], for 0 to 30 degrees and 0 to 40 g/kg."""
    nm, t, s = np.asarray(wavelength_nm, float), temperature_c, salinity
    n, n_by_s = _refractive_index(nm, t, s)
    n2 = n * n
    by_density = (n2 - 1.0) * (1.0 + 2.0 / 3.0 * (n2 + 2.0) * (n / 3.0 - 1.0 / (3.0 * n)) ** 2)
    density = np.pi**2 / 2.0 * BOLTZMANN * (t + 273.15) * _compressibility(t, s) * by_density**2
    concentration = s * MOLAR_MASS * n_by_s**2 / _density(t, s) / -_log_activity_by_salinity(t, s) / AVOGADRO
    depolarised = (6.0 + 6.0 * DEPOLARISATION) / (6.0 - 7.0 * DEPOLARISATION)
    at_90 = (nm * 1e-9) ** -4 * depolarised * (density + 2.0 * np.pi**2 * n2 * concentration)
    return 8.0 * np.pi / 3.0 * at_90 * (2.0 + DEPOLARISATION) / (1.0 + DEPOLARISATION)
