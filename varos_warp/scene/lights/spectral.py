"""Lights by wavelength: from watt or lumen in all directions together to intensity."""

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import Light
from varos_warp.scene.lights.distribution import Distribution, own_distribution
from varos_warp.scene.lights.goniometry import NODES
from varos_warp.scene.spectra.lamps import lamp_spectrum, per_watt, watts_of_lumen


def spectral_intensity(light: Light, scene: Scene) -> np.ndarray:
    """Radiant intensity [W/sr/nm] of a light with ``spectrum`` on `spectra.spectrum.GRID`, as ``intensity`` means it.

    That is inside the cone or at the peak of the profile, of the lamp itself, before its port.

    Raises:
        InputError: A file of the light cannot be used.
    """
    lamp = lamp_spectrum(light.spectrum, scene.resolve, f"{scene.key_of_light(light)}.spectrum")
    watts = light.power_W if light.power_W is not None else watts_of_lumen(lamp, light.lumen)
    return watts / solid_angle(light, scene) * per_watt(lamp)


def solid_angle(light: Light, scene: Scene) -> float:
    """What the power of a light is over its highest intensity [sr], of the lamp itself, before its port."""
    if light.kind == "sheet":
        x, y = np.tan(np.radians([light.fan_deg, light.thickness_deg]) / 2.0)
        return float(4.0 * np.arctan(x * y / np.sqrt(1.0 + x * x + y * y)))
    return _solid_angle(own_distribution(light, scene))


def _solid_angle(shape: Distribution) -> float:
    """The integral over all directions of a relative intensity."""
    whole = 2.0 * np.pi * (1.0 - np.cos(shape.half_angle))
    if not shape.has_profile:
        return float(whole * (1.0 - shape.blend / 2.0))  # the soft edge is a smoothstep of the solid angle itself
    x = np.linspace(0.0, 1.0, NODES + 1)
    return float(whole * np.trapezoid(2.0 * x * shape.table.mean(axis=0), x))
