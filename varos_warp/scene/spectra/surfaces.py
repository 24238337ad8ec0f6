"""Reflectance by wavelength: colours raised to smooth spectra, and the colour chart."""

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.scene.spectra.spectrum import DATA, GRID, Spectrum, bundled

PATCHES = tuple(next(line for line in (DATA / "surfaces" / "colour_chart.csv").read_text().splitlines()
                     if not line.startswith("#")).split(",")[1:])
"""Names of the 24 patches of the colour chart, row by row from the top left."""


def reflectance_of_rgb(rgb: ArrayLike, wavelength_nm: ArrayLike = GRID) -> np.ndarray:
    """Reflectance spectra of linear sRGB colours between 0 and 1.

    Mallett and Yuksel (2019): a sum of three curves that together are 1, so that spectra stay between 0 and 1, white
    and greys are even, and the colour under D65 is the one asked for.

    Args:
        rgb: Colours [..., 3].
        wavelength_nm: Where they are wanted [N].

    Returns:
        Reflectances [..., N].
    """
    basis = bundled("surfaces/rgb_basis", "r", "g", "b")
    curves = np.array([basis[channel].at(wavelength_nm) for channel in "rgb"])
    return np.asarray(rgb, float) @ (curves / curves.sum(axis=0))


def chart_reflectances() -> dict[str, Spectrum]:
    """Measured reflectances of the 24 patches of the colour chart, by name."""
    return bundled("surfaces/colour_chart", *PATCHES)
