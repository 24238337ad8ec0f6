"""Lights by wavelength: the power of what shines is that of the file."""

import numpy as np
import pytest

from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.lights.distribution import own_distribution
from varos_warp.scene.lights.spectral import solid_angle, spectral_intensity
from varos_warp.scene.spectra.spectrum import STEPS

SHAPES = [
    {"kind": "spot", "cone_deg": 65},
    {"kind": "spot", "cone_deg": 100, "blend": 0.4},
    {"kind": "point"},
    {"kind": "spot", "cone_deg": 40, "blend": 0.2, "port": {}},
    {"kind": "profile", "file": "led_flood", "port": {}},
]


def scene_with(light):
    return scene_from_dict(
        {
            "water": {"spectral": {"jerlov": "II"}},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "vehicle": {"lights": [light], "cameras": [{"response": "nikon_5100"}]},
        }
    )


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_intensity_over_all_directions_is_the_power(shape):
    """By the midpoint rule over 400 000 angles to the axis; edges are hit to one of them."""
    scene = scene_with({**shape, "spectrum": "led_b4", "power_W": 12.0})
    light = scene.lights[0]
    bare = own_distribution(light, scene)
    angle = (np.arange(400_000) + 0.5) * np.pi / 400_000
    sphere = 2.0 * np.pi * np.sin(angle) * np.pi / 400_000
    watts = (STEPS @ spectral_intensity(light, scene)) * (sphere @ bare.at(angle))
    assert watts == pytest.approx(12.0, rel=1e-4)


def test_a_sheet_is_a_thin_pyramid():
    """Of 60 by 0.3 degrees: about 2 sin(30 degrees) times the thickness in radians."""
    thickness = np.radians(0.3)
    scene = scene_with(
        {"kind": "sheet", "normal": [0, 0, 1], "fan_deg": 60, "thickness_deg": 0.3, "spectrum": "led_b4", "lumen": 100}
    )
    assert solid_angle(scene.lights[0], scene) == pytest.approx(2.0 * np.sin(np.radians(30)) * thickness, rel=1e-4)


def test_lumen_of_an_led_are_watts():
    """An LED of 5109 K gives about 300 to 340 lm per watt of its visible light."""
    scene = scene_with({"kind": "point", "spectrum": "led_b4", "lumen": 1000.0})
    watts = 4.0 * np.pi * (STEPS @ spectral_intensity(scene.lights[0], scene))
    assert 1000.0 / 345.0 < watts < 1000.0 / 295.0
