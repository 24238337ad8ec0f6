"""Optical properties of the water: the three forms of a scene file become sigma_s, sigma_a and a phase function.

Oceanography's a, b and c are sigma_a, sigma_s and sigma_t. All coefficients are [1/m] per channel R, G, B.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from varos_warp.kernels.world.medium import Medium
from varos_warp.scene.description import Scene
from varos_warp.scene.description.water import Principled
from varos_warp.scene.water.jerlov import JERLOV
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.phase_function import PhaseFunction
from varos_warp.scene.water.phase.registry import make_phase


@dataclass(frozen=True)
class OpticalProperties:
    """Homogeneous water: scattering and absorption [1/m], float64 [3], and its phase function.

    What holds a `Medium` of kernels keeps this too: the phase function owns the arrays that the medium points to.
    """

    sigma_s: np.ndarray
    sigma_a: np.ndarray
    phase: PhaseFunction
    source: str
    """Form of the scene file it came from: none, principled, coefficients or jerlov."""

    @property
    def g(self) -> float:
        """Mean cosine of the phase function."""
        return self.phase.mean_cosine

    @property
    def sigma_t(self) -> np.ndarray:
        """Extinction [1/m], float64 [3]."""
        return self.sigma_s + self.sigma_a

    def left(self, distance: np.ndarray) -> np.ndarray:
        """Share of light that is neither absorbed nor scattered over distances [...] [m], float64 [..., 3]."""
        return np.exp(-self.sigma_t * np.asarray(distance)[..., None])

    @property
    def albedo(self) -> np.ndarray:
        """sigma_s / sigma_t, 0 where there is no extinction, float64 [3]."""
        return np.divide(self.sigma_s, self.sigma_t, out=np.zeros(3), where=self.sigma_t > 0.0)


def optical_properties(scene: Scene) -> OpticalProperties:
    """Water of a scene; ``water: none`` has neither scattering nor absorption.

    Raises:
        InputError: A file of the phase function cannot be used.
        ValueError: The water is by wavelength.
    """
    water = scene.water
    if scene.is_spectral:
        raise ValueError("water by wavelength has no three channels: scene/passes.py gives scenes of its bands")
    if water == "none":
        return OpticalProperties(np.zeros(3), np.zeros(3), HenyeyGreenstein(0.0), "none")
    if water.principled is not None:
        return _from_principled(water.principled)
    if water.coefficients is not None:
        block, source = water.coefficients, "coefficients"
        sigma_s, sigma_a = block.sigma_s, block.sigma_a
    else:
        block, source = water.jerlov, "jerlov"
        sigma_a, sigma_s = JERLOV["1C" if block.type == "IC" else block.type]
    phase = make_phase(block.phase, scene.resolve, f"water.{source}.phase")
    return OpticalProperties(np.array(sigma_s), np.array(sigma_a), phase, source)


def _from_principled(water: Principled) -> OpticalProperties:
    """Blender's Principled Volume, as Cycles computes it (paper, table 1)."""
    color, absorption = np.array(water.color), np.array(water.absorption_color)
    sigma_s = water.density * color
    sigma_a = water.density * np.maximum(1.0 - color, 0.0) * np.maximum(1.0 - np.sqrt(absorption), 0.0)
    return OpticalProperties(sigma_s, sigma_a, HenyeyGreenstein(water.anisotropy), "principled")


def phase_function(scene: Scene) -> PhaseFunction:
    """Phase function of the water of a scene; of water by wavelength, that of its particles."""
    if scene.is_spectral:
        return make_phase(scene.water.spectral.phase, scene.resolve, "water.spectral.phase")
    return optical_properties(scene).phase


def medium_record(water: OpticalProperties, device: str) -> Medium:
    """What kernels on a device know of the water; its arrays live as long as ``water`` does."""
    medium = Medium()
    medium.sigma_s = wp.vec3(*water.sigma_s)
    medium.sigma_t = wp.vec3(*water.sigma_t)
    medium.phase = water.phase.device_record(device)
    return medium
