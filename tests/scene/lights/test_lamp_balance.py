"""White balance for lamps: its closed form, what is refused by name, and bounds that are told."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.camera_checks import check_cameras
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.lights.balance import lamp_gains

CLEAR = {"sigma_s": [0.05, 0.06, 0.07], "sigma_a": [0.2, 0.06, 0.04], "phase": {"kind": "henyey_greenstein", "g": 0.9}}
LAMP = {"kind": "point", "position": [0.6, 0.0, 0.0], "intensity": [100.0, 80.0, 50.0]}


def scene_of(lights=(LAMP,), camera=None, **more):
    view = {"id": "M0", "resolution": [32, 18], "focus_m": 2.0, "exposure": {"white_balance": "lamps"}}
    return scene_from_dict(
        {
            "water": {"coefficients": CLEAR},
            "vehicle": {"lights": list(lights), "cameras": [view | (camera or {})]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            **more,
        }
    )


def gains_of(scene):
    return lamp_gains(scene, scene.vehicle.cameras[0])


def test_a_lamp_beside_the_camera_in_closed_form():
    """One lamp: its distance and angle count for all channels alike, so attenuation and colour remain."""
    k = np.array(CLEAR["sigma_a"]) + (1 - 0.9) * np.array(CLEAR["sigma_s"])
    seen = np.array(LAMP["intensity"]) * np.exp(-k * (np.hypot(0.6, 2.0) + 2.0))
    np.testing.assert_allclose(gains_of(scene_of()), seen[1] / seen, rtol=1e-12)


def test_without_water_the_lamps_count_by_cosine_and_distance():
    """Two lamps of two colours, beside the camera and half way to the surface."""
    near = LAMP | {"position": [0.0, 1.0, 0.0], "intensity": [10.0, 20.0, 30.0]}
    seen = np.array(LAMP["intensity"]) * 2.0 / np.hypot(0.6, 2.0) ** 3 + np.array([10.0, 20.0, 30.0])
    np.testing.assert_allclose(gains_of(scene_of([LAMP, near], water="none")), seen[1] / seen, rtol=1e-12)


def test_lamps_that_shine_elsewhere_do_not_count():
    """A cone that ends before the surface's middle, one behind the surface, and a sheet."""
    aside = {"kind": "spot", "position": [-0.6, 0, 0], "direction": [-1, 0, 0], "cone_deg": 90, "intensity": [1, 5, 9]}
    behind = LAMP | {"position": [0.0, 5.0, 0.0], "intensity": [1, 5, 9]}
    line = {"kind": "sheet", "direction": [0, 1, 0], "normal": [0, 0, 1], "fan_deg": 60, "thickness_deg": 1}
    np.testing.assert_array_equal(gains_of(scene_of([LAMP, aside, behind, line])), gains_of(scene_of()))
    with pytest.raises(InputError, match=r"vehicle\.cameras\.0\.exposure\.white_balance = 'lamps'.*none.*focus_m, 2 m"):
        gains_of(scene_of([aside, behind, line]))


def test_a_lamp_in_the_very_surface_does_not_count():
    """Its distance is 0, and it lights nothing that faces the camera."""
    there = LAMP | {"position": [0.0, 2.0, 0.0], "intensity": [1, 5, 9]}
    np.testing.assert_array_equal(gains_of(scene_of([there, LAMP])), gains_of(scene_of()))


def test_bounds_are_kept_and_told():
    scene = scene_of(camera={"focus_m": 9.0})
    assert gains_of(scene)[0] == 4.0
    (told,) = check_cameras(scene)
    assert "vehicle.cameras.0 (M0): white balance for lamps at its focus_m, 9 m, asks for more than 4" in told
    assert "red" in told
    assert check_cameras(scene_of()) == []


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"lights": []}, "it has none"),
        ({"camera": {"mount": "world", "look_at": [0, 3, 0]}}, "stands in the world"),
        (
            {
                "water": {"spectral": {"jerlov": "II"}},
                "lights": [{"kind": "point", "spectrum": "led_b4", "power_W": 40}],
                "camera": {"response": "nikon_5100"},
            },
            "water of three channels",
        ),
    ],
)
def test_where_it_means_nothing_it_is_refused_by_name(how, said):
    with pytest.raises(InputError, match=rf"vehicle\.cameras\.0\.exposure\.white_balance.*{said}.*give grey_world"):
        scene_of(**how)
