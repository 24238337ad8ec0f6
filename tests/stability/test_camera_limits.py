"""Where cameras, films and files end: fields of view, sizes, samples, half floats, exposure; on either side."""

import numpy as np
import pytest
from physics.rig import floor, one_ray_scene, point, water

from benchmarks.stability.transport_images import (
    exposure_error,
    field_error,
    film_errors,
    half_error,
    resolution_seconds,
)
from varos_warp.products.images.radiance import to_half
from varos_warp.render.image import exposure
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.checks import check_scene
from varos_warp.scene.description import Scene


@pytest.mark.parametrize("angle", [1e-5, 1.0, 90.0, 179.0, 179.999])
def test_fields_of_view_from_an_arc_second_to_all_ahead(angle):
    assert field_error(angle) < 1e-6


@pytest.mark.parametrize("side", [1, 2, 1024])
def test_images_of_one_pixel_and_of_millions_are_numbers(side):
    assert min(resolution_seconds(side)) > 0.0


@pytest.mark.parametrize(("resolution", "warned"), [((3270, 3270), False), ((3280, 3280), True), ((8192, 8192), True)])
def test_images_that_take_gigabytes_are_warned_of(resolution, warned):
    scene = Scene(
        vehicle={"cameras": [{"resolution": resolution, "sensor_mm": (4.0, 4.0)}]},
        trajectory={"poses": [{"position": (0, 0, 0)}]},
    )
    assert any("GiB" in warning for warning in check_scene(scene, [])) == warned


def test_a_million_samples_add_up_and_would_not_in_float32():
    film, plain_sum, _, stderr = film_errors(10**6)
    assert film < 1e-12
    assert stderr < 1e-9
    assert plain_sum > 1e-5


@pytest.mark.parametrize("radiance", [6.2e-5, 1.0, 6500.0])
def test_half_floats_hold_what_they_promise(radiance):
    assert half_error(radiance) < 2.0**-11
    assert half_error(1e-6) > 1e-2
    assert np.isnan(half_error(7e3))


@pytest.mark.parametrize(("brightest", "warned"), [(6.2e-5, False), (6.0e-5, True), (1e-9, True), (0.0, False)])
def test_images_too_dark_for_half_floats_are_warned_of(brightest, warned, recwarn):
    to_half(np.array([[[0.0, brightest / 2, brightest]]], np.float32))
    assert any("darker" in str(warning.message) for warning in recwarn) == warned


@pytest.mark.parametrize("radiance", [1e-38, 1e-10, 1.0, 1e10, 3e38])
def test_black_and_constant_images_are_exposed(radiance):
    assert exposure_error(radiance) < 1e-6
    black = exposure.statistics(np.zeros((4, 4, 3), np.float32))
    constant = exposure.statistics(np.full((4, 4, 3), radiance, np.float32))
    gains = exposure.gains("adaptive", "A", np.arange(3.0), [black, constant, black])
    np.testing.assert_allclose(gains, exposure.KEY_VALUE / radiance, rtol=1e-6)
    assert exposure.gains("adaptive", "A", np.zeros(1), [black])[0] == 1.0


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("integrator", ["path", "reference"])
def test_samples_that_are_no_numbers_are_counted_and_reach_no_image(integrator):
    """A lamp of 1e38 W/sr, which no scene file may have, over- and underflows on the way of its light."""
    scene = one_ray_scene([point((0.15, 0.0, -0.1))], water(0.05, 0.1, 0.8), pixels=4)
    lamp = scene.vehicle.lights[0].model_copy(update={"intensity": (3e38,) * 3})
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"lights": [lamp]})})
    renderer = FrameRenderer(scene, "cpu", parts=[floor(0.5, 0.9)])
    image = renderer.render(np.eye(4), outputs="A", spp=16, integrator=integrator).A
    assert np.isfinite(image.radiance).all()
    assert np.isfinite(image.stderr).all()
    taken = 16 * (5 if integrator == "path" else 1)  # four segments of the camera and a subpath
    assert 0 < image.lost_samples <= 4 * 4 * taken
