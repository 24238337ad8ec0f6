"""Lamps and cameras by wavelength: files, what comes with the package, watt and lumen."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from varos_warp.scene.spectra.spectrum import STEPS, Spectrum, bundled, named_or_file, read_spectra

HALOGEN_K = 3200.0
"""Temperature of a halogen lamp's filament [K], which shines as a black body."""
LUMEN_PER_WATT = 683.0
"""Luminous efficacy at 555 nm [lm/W]."""
SECOND_RADIATION_CONSTANT = 1.438776877e7
"""hc / k [nm K] (CODATA 2018)."""


def lamp_spectrum(name: str, resolve: Callable[[str], Path], key: str) -> Spectrum:
    """Relative power by wavelength of a lamp of the package, or of a CSV file with the columns wavelength_nm and power.

    Raises:
        InputError: The file is missing, or is no spectrum.
    """
    if name == "halogen_3200K":
        return black_body(HALOGEN_K)
    path = named_or_file(name, "lamps", "spectrum of a lamp", resolve, key)
    return read_spectra(path, key, "spectrum of a lamp", ("power",))["power"]


def black_body(temperature_k: float) -> Spectrum:
    """Planck's law, 1 at 560 nm: power by wavelength that a body of a temperature [K] gives off."""
    nm = np.arange(380.0, 781.0)

    def planck(w):
        return w**-5.0 / np.expm1(SECOND_RADIATION_CONSTANT / (w * temperature_k))

    return Spectrum(nm, planck(nm) / planck(560.0))


def per_watt(lamp: Spectrum) -> np.ndarray:
    """Power of a lamp of one watt within 400 to 700 nm, by wavelength on `GRID` [1/nm]."""
    return lamp.at() / lamp.integral()


def watts_of_lumen(lamp: Spectrum, lumen: float) -> float:
    """Power within 400 to 700 nm [W] of a lamp of so much luminous flux [lm]."""
    seen = bundled("photopic", "V")["V"].at()
    return lumen / (LUMEN_PER_WATT * float(STEPS @ (per_watt(lamp) * seen)))


def camera_response(name: str, resolve: Callable[[str], Path], key: str) -> np.ndarray:
    """Sensitivities of a camera of the package, or in a CSV file (wavelength_nm, r, g, b), on `GRID`, float64 [3, 301].

    Raises:
        InputError: The file is missing, or is no such table.
    """
    path = named_or_file(name, "cameras", "spectral response of a camera", resolve, key)
    found = read_spectra(path, key, "spectral response of a camera", ("r", "g", "b"))
    return np.array([found[channel].at() for channel in "rgb"])
