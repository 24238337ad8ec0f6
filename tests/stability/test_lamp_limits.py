"""Where light transport ends over the lamps: near the ray and the wall, narrow, wide, weak, strong; on either side."""

import numpy as np
import pytest
from physics.rig import VAROS_WATER, spot, to_vehicle
from pydantic import ValidationError

from benchmarks.stability.transport_lamps import beside_error, cone_error, flux_error, intensity_error, lit_error
from varos_warp.errors import InputError
from varos_warp.render.field.open_water import unavailable
from varos_warp.render.renderer import FrameRenderer, resolve_integrator
from varos_warp.scene.description import Scene
from varos_warp.scene.description.lights import PointLight, SpotLight


@pytest.mark.parametrize("ahead", [2.0, 0.0])
@pytest.mark.parametrize("side", [0.01, 1e-4, 3e-6])
def test_a_lamp_near_the_ray_is_right_to_micrometres_and_finite_beyond(side, ahead):
    """In view and on the camera. Beyond a micrometre the truth grows on, and the image does not."""
    assert beside_error(side, ahead, "field") < 1e-3
    assert beside_error(side, ahead, "path") < 0.03
    for integrator in ("field", "path"):
        assert 0.5 < beside_error(1e-7, ahead, integrator) < 1.0


@pytest.mark.parametrize("size", [20.0, 200.0])
@pytest.mark.parametrize("distance", [1e-6, 1e-4, 1.0, 1e4])
def test_a_surface_is_lit_as_the_inverse_square_says_from_micrometres_on(distance, size):
    for integrator in ("path", "reference"):
        assert lit_error(distance, max(size, 20 * distance), integrator) < 1e-6
    assert lit_error(5e-7, size, "path") == pytest.approx(0.75, abs=1e-3)  # a distance of 1e-6 m is the least there is


@pytest.mark.parametrize("blend", [0.0, 0.15, 1.0])
@pytest.mark.parametrize(("cone", "error"), [(1.0, 2e-3), (2.0, 2e-4), (179.0, 1e-6), (359.9, 1e-6)])
def test_spots_send_out_their_power_where_a_scene_may_name_them(cone, error, blend):
    """1 - cos of half a degree is 3.8e-5, of which single precision keeps three digits."""
    assert SpotLight(cone_deg=cone, blend=blend)
    assert flux_error(cone, blend) < error


@pytest.mark.parametrize("cone", [0.1, 0.99, 359.91, 359.999])
def test_other_spots_are_refused(cone):
    with pytest.raises(ValidationError, match="cone_deg"):
        SpotLight(cone_deg=cone)


@pytest.mark.parametrize(("cone", "blend", "error"), [(0.1, 0.0, 0.05), (359.99, 1.0, 0.5)])
def test_spots_fail_right_beyond(cone, blend, error):
    assert flux_error(cone, blend) > error


@pytest.mark.parametrize(
    ("cone", "expected"),
    [
        (1.0, "path"),
        (19.9, "path"),
        (20.0, "field"),
        (179.0, "field"),
        (179.1, "path"),
        (359.0, "path"),
        (360.0, "field"),
    ],
)
def test_cones_are_tables_from_20_to_179_degrees_and_paths_beyond(cone, expected):
    scene = Scene(
        water={"coefficients": VAROS_WATER | {"phase": {"g": 0.8}}},
        vehicle={"lights": [spot((0.1, 0, 0), cone_deg=cone)]},
        trajectory={"poses": [{"position": (0, 0, 0)}]},
    )
    assert resolve_integrator("auto", None, lambda: unavailable(scene)) == expected
    if expected == "path":
        with pytest.raises(InputError, match="cone"):
            resolve_integrator("field", None, lambda: unavailable(scene))
    for blend in (0.0, 1.0):
        if cone < 360.0:  # then the blend does not matter
            assert cone_error(cone, blend, expected) < (1e-3 if expected == "field" else 0.01)


@pytest.mark.parametrize("integrator", ["field", "path", "reference"])
@pytest.mark.parametrize("exponent", [-20, -10, 10, 20])
def test_light_is_in_proportion_to_the_intensity_of_its_lamp(exponent, integrator):
    assert intensity_error(exponent, integrator) < 1e-6


@pytest.mark.parametrize("intensity", [9e-21, 1.1e20])
def test_other_intensities_are_refused(intensity):
    for light in (PointLight, SpotLight):
        with pytest.raises(ValidationError, match="intensity"):
            light(kind=light.model_fields["kind"].annotation.__args__[0], intensity=(1.0, intensity, 0.0))
    assert PointLight(kind="point", intensity=(0.0, 1e-20, 1e20))


def test_weaker_lamps_would_be_wrong():
    assert intensity_error(-30, "path") > 0.1


def test_the_pixel_that_a_lamp_is_seen_in_hardly_varies():
    """Light scattered around the lamp goes as 1/h; of 300 with even samples of the pixel one is 5.7 times as bright."""
    view = {"id": "M0", "resolution": [9, 7], "look_at": to_vehicle((0, 0, 1))}
    lamp = spot((0.35, -0.2, 2.5), (-0.1, 0.1, -1.0), 80.0)
    scene = Scene(
        water={"coefficients": VAROS_WATER},
        vehicle={"lights": [lamp], "cameras": [view]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
    )
    renderer = FrameRenderer(scene, "cpu")
    images = np.array(
        [
            renderer.render(np.eye(4), outputs="A", integrator="path", spp=8, layers=("single",), seed=seed).A.radiance
            for seed in range(300)
        ],
        float,
    )
    values = images[:, *np.unravel_index(images.mean((0, 3)).argmax(), images.shape[1:3])]
    relative = values / values.mean(axis=0)
    assert relative.max() < 3.0
