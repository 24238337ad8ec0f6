"""Absorption and scattering of water by wavelength: Jerlov's types, constituents, files.

All coefficients are [1/m]. Between the wavelengths of a table, what it has above pure water is linear, so that the
steps of pure water's absorption, which are steeper than the tables are dense, stay where they are.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.description.water import Constituents, SpectralWater
from varos_warp.scene.spectra.seawater import pure_scattering
from varos_warp.scene.spectra.spectrum import GRID, Spectrum, bundled, read_spectra
from varos_warp.scene.water import phase_function

MEASURED = ("IB", "II", "III", "1C", "3C", "5C")
"""Jerlov types whose coefficients were measured (Williamson and Hollins 2022); the others are inverted."""
CDOM_SLOPE, MINERAL_SLOPE = 0.014, 0.0123
"""Slopes of the exponential fall of absorption by CDOM (Morel and Maritorena 2001) and by minerals (Babin et al.
2003a) [1/nm]."""
MINERAL_ABSORPTION, MINERAL_SCATTERING = 0.041, 0.5
"""Coefficients of minerals at 443 nm (Babin et al. 2003a) and at all wavelengths (2003b) [m^2/g]."""
BLACK_DISK = 4.8
"""A black disk is seen sideways up to 4.8 / c, where exp(-4.8) = 0.8 % of its contrast is left (Davies-Colley 1988)."""
LEAST_SHARE = 0.5
"""Least share of pure water's absorption from 600 nm on: below it, a file has other units."""


@dataclass(frozen=True)
class WaterSpectra:
    """Water by wavelength on `GRID`: absorption, and scattering by the water itself and by particles [1/m]."""

    a: np.ndarray
    b_water: np.ndarray
    b_particles: np.ndarray
    backscatter_fraction: float
    """Backscatter fraction of the particles' phase function; that of the water itself is a half."""
    source: str
    """Which table, model or file the coefficients are from, in words."""

    @property
    def b(self) -> np.ndarray:
        """Scattering coefficient."""
        return self.b_water + self.b_particles

    @property
    def c(self) -> np.ndarray:
        """Extinction coefficient."""
        return self.a + self.b

    @property
    def b_b(self) -> np.ndarray:
        """Scattering by more than 90 degrees."""
        return 0.5 * self.b_water + self.backscatter_fraction * self.b_particles

    @property
    def visibility_m(self) -> np.ndarray:
        """Range of a black disk, 4.8 / c, at which 0.8 % of its contrast is left [m]."""
        return BLACK_DISK / self.c


def water_spectra(scene: Scene) -> WaterSpectra:
    """The water of a scene with ``water.spectral``, by wavelength.

    Raises:
        InputError: A file of the water or of its phase function cannot be used.
    """
    block: SpectralWater = scene.water.spectral
    fraction = phase_function(scene).backscatter_fraction
    if block.jerlov is not None:
        return _jerlov("1C" if block.jerlov == "IC" else block.jerlov, fraction)
    if block.iop is not None:
        return _constituents(block.iop, fraction)
    return _from_file(scene.resolve(block.file), fraction)


def pure_absorption(wavelength_nm=GRID) -> np.ndarray:
    """Absorption of pure water [1/m] at wavelengths [nm]: Pope and Fry (1997), above 700 nm Smith and Baker (1981)."""
    return bundled("water/pure", "a")["a"].at(wavelength_nm)


def _jerlov(kind: str, fraction: float) -> WaterSpectra:
    measured = kind in MEASURED
    table = "water/jerlov_measured" if measured else "water/jerlov_inverted"
    a, b = bundled(table, f"{kind}_a", f"{kind}_b").values()
    author = "measured, Williamson and Hollins 2022" if measured else "inverted, Solonenko and Mobley 2015"
    return _split(_above_pure(a), b.at(), fraction, f"Jerlov {kind} ({author})")


def _above_pure(a: Spectrum) -> np.ndarray:
    """Absorption on `GRID`, of a table whose excess over pure water is linear between its wavelengths."""
    excess = Spectrum(a.wavelength_nm, a.values - pure_absorption(a.wavelength_nm))
    return np.maximum(pure_absorption() + excess.at(), 0.0)


def _split(a: np.ndarray, b: np.ndarray, fraction: float, source: str) -> WaterSpectra:
    """The water's own scattering taken out of all scattering, as far as that has it."""
    b_water = np.minimum(pure_scattering(GRID), b)
    return WaterSpectra(a, b_water, b - b_water, fraction, source)


def _constituents(iop: Constituents, fraction: float) -> WaterSpectra:
    """Case 1 water of Morel and Maritorena (2001) with Bricaud et al.'s (1998) absorption, and minerals."""
    chl = iop.chlorophyll_mg_m3
    table = bundled("water/phytoplankton", "factor", "exponent")
    phytoplankton = table["factor"].at() * chl ** table["exponent"].at() if chl else np.zeros(len(GRID))
    cdom = iop.cdom_440_per_m * np.exp(-CDOM_SLOPE * (GRID - 440.0))
    minerals = iop.minerals_g_m3 * MINERAL_ABSORPTION * np.exp(-MINERAL_SLOPE * (GRID - 443.0))
    slope = min(0.5 * (np.log10(max(chl, 0.02)) - 0.3), 0.0)
    b_particles = 0.416 * chl**0.766 * (GRID / 550.0) ** slope + iop.minerals_g_m3 * MINERAL_SCATTERING
    return WaterSpectra(
        pure_absorption() + phytoplankton + cdom + minerals,
        pure_scattering(GRID, iop.temperature_C, iop.salinity),
        b_particles,
        fraction,
        "constituents",
    )


def _from_file(path: Path, fraction: float) -> WaterSpectra:
    """Water of a file with the columns wavelength_nm, a, b."""
    key = "water.spectral.file"
    a, b = read_spectra(path, key, "spectrum of water", ("a", "b")).values()
    red = GRID >= 600.0
    share = a.at()[red] / pure_absorption()[red]
    if share.min() < LEAST_SHARE:
        at = GRID[red][np.argmin(share)]
        value = float(a.at(at))
        units = " This looks like 1/cm: multiply a and b by 100." if share.max() < 0.05 else ""
        raise InputError(
            f"a is {value:.4g} at {at:g} nm, where pure water alone absorbs {pure_absorption(at):.3g} 1/m",
            file=path,
            key=key,
            remedy=f"Give a and b of all that is in the water, in 1/m.{units}",
        )
    return _split(_above_pure(a), b.at(), fraction, f"file {path.name}")
