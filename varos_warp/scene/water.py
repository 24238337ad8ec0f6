"""Optical properties of the water: the three forms of a scene file become sigma_s, sigma_a and g.

Oceanography's a, b and c are sigma_a, sigma_s and sigma_t. All coefficients are [1/m] per channel R, G, B.
"""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Coefficients, Jerlov, Principled


@dataclass(frozen=True)
class OpticalProperties:
    """Homogeneous water: scattering and absorption [1/m], float64 [3], and the mean cosine of its phase function."""

    sigma_s: np.ndarray
    sigma_a: np.ndarray
    g: float
    source: str
    """Form of the scene file it came from: none, principled, coefficients or jerlov."""

    @property
    def sigma_t(self) -> np.ndarray:
        """Extinction [1/m], float64 [3]."""
        return self.sigma_s + self.sigma_a

    @property
    def albedo(self) -> np.ndarray:
        """sigma_s / sigma_t, 0 where there is no extinction, float64 [3]."""
        return np.divide(self.sigma_s, self.sigma_t, out=np.zeros(3), where=self.sigma_t > 0.0)


def from_principled(water: Principled) -> OpticalProperties:
    """Blender's Principled Volume, as Cycles computes it (paper, table 1)."""
    color, absorption = np.array(water.color), np.array(water.absorption_color)
    sigma_s = water.density * color
    sigma_a = water.density * np.maximum(1.0 - color, 0.0) * np.maximum(1.0 - np.sqrt(absorption), 0.0)
    return OpticalProperties(sigma_s, sigma_a, water.anisotropy, "principled")


def from_coefficients(water: Coefficients) -> OpticalProperties:
    """Coefficients as they are."""
    return OpticalProperties(np.array(water.sigma_s), np.array(water.sigma_a), water.phase.g, "coefficients")


JERLOV = {
    "I": ((0.228, 0.062, 0.018), (0.00122, 0.0017, 0.00381)),
    "IA": ((0.228, 0.0622, 0.0221), (0.00283, 0.00354, 0.00631)),
    "IB": ((0.227, 0.0655, 0.0407), (0.118, 0.122, 0.135)),
    "II": ((0.231, 0.0724, 0.0623), (0.17, 0.177, 0.195)),
    "III": ((0.241, 0.0878, 0.112), (0.278, 0.287, 0.309)),
    "1C": ((0.248, 0.0988, 0.148), (0.416, 0.427, 0.455)),
    "3C": ((0.268, 0.128, 0.2), (0.627, 0.644, 0.686)),
    "5C": ((0.285, 0.159, 0.313), (1.16, 1.19, 1.27)),
    "7C": ((0.301, 0.195, 0.542), (2.03, 2.35, 3.3)),
    "9C": ((0.39, 0.348, 0.943), (2.69, 3.12, 4.39)),
}
"""Absorption and scattering [1/m] of Jerlov's types at 600, 550 and 450 nm, which stand for R, G and B.

IB to 5C as measured by Williamson and Hollins (2022), Appl. Opt. 61, 9951 (Open Government Licence v3.0); the others,
which they did not measure, from Solonenko and Mobley (2015), Appl. Opt. 54, 5392, who inverted Jerlov's attenuation.
"""


def from_jerlov(water: Jerlov) -> OpticalProperties:
    """Table of a Jerlov water type; ``IC`` is read as ``1C``."""
    sigma_a, sigma_s = JERLOV["1C" if water.type == "IC" else water.type]
    return OpticalProperties(np.array(sigma_s), np.array(sigma_a), water.phase.g, "jerlov")


def optical_properties(scene: Scene) -> OpticalProperties:
    """Water of a scene; ``water: none`` has neither scattering nor absorption."""
    water = scene.water
    if water == "none":
        return OpticalProperties(np.zeros(3), np.zeros(3), 0.0, "none")
    if water.principled is not None:
        return from_principled(water.principled)
    if water.coefficients is not None:
        return from_coefficients(water.coefficients)
    return from_jerlov(water.jerlov)
