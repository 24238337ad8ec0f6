"""Reflectance by wavelength: colours raised to smooth spectra, and the colour chart."""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.scene.spectra.spectrum import DATA, GRID, Spectrum, bundled

PATCHES = tuple(
    next(
        line for line in (DATA / "surfaces" / "colour_chart.csv").read_text().splitlines() if not line.startswith("#")
    ).split(",")[1:]
)
"""Names of the 24 patches of the colour chart, row by row from the top left."""
SRGB_OF_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
"""Linear sRGB of tristimulus values (IEC 61966-2-1)."""


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


def rgb_of_reflectance(spectra: Sequence[Spectrum]) -> np.ndarray:
    """Linear sRGB colours [N, 3] of reflectance spectra under D65, by the CIE 1931 observer from 380 to 780 nm.

    Colours beyond sRGB have values below 0 or above 1.
    """
    observer = bundled("observer", "x", "y", "z", "d65")
    nm, d65 = observer["d65"].wavelength_nm, observer["d65"].values
    seen = np.array([observer[name].values for name in "xyz"]) * d65
    return np.array([spectrum.at(nm) for spectrum in spectra]) @ seen.T / seen[1].sum() @ SRGB_OF_XYZ.T


def chart_reflectances() -> dict[str, Spectrum]:
    """Measured reflectances of the 24 patches of the colour chart, by name."""
    return bundled("surfaces/colour_chart", *PATCHES)


@cache
def chart_colours() -> np.ndarray:
    """Linear sRGB colours [24, 3] of the patches under D65; red of cyan, which lies beyond sRGB, is -0.03."""
    return rgb_of_reflectance(list(chart_reflectances().values()))
