"""What is told of bands before rendering: too few for backscattered light, and colours that are not told apart."""

import numpy as np
import pytest

from varos_warp.scene.checks import check_scene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.info import water_info
from varos_warp.scene.passes import backscatter_error, described, passes
from varos_warp.scene.spectra.bands import scene_bands
from varos_warp.scene.spectra.spectrum import GRID
from varos_warp.scene.water import optical_properties, phase_function
from varos_warp.scene.water.phase.rayleigh import Rayleigh


def scene_of(folder=".", water="IB", response="nikon_5100", color_matrix=None, **render):
    view = {"id": "M0", "resolution": [64, 36], "response": response, "color_matrix": color_matrix}
    return scene_from_dict(
        {
            "water": {"spectral": {"jerlov": water}},
            "vehicle": {"lights": [{"spectrum": "led_b4", "power_W": 10.0}], "cameras": [view]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "render": render,
        },
        folder,
    )


def warnings_of(scene):
    return check_scene(scene, build_parts(scene))


@pytest.mark.parametrize("bands", [3, 4, 6])
@pytest.mark.parametrize("water", ["IB", "3C"])
def test_the_stated_error_of_backscatter_is_that_of_the_scenes_of_all_passes(bands, water):
    """Of what the first lamp sends straight back from one place: with each pass's phase function, and band by band."""
    scene = scene_of(water=water, bands=bands)
    (camera,) = scene.vehicle.cameras
    found, ways = scene_bands(scene, camera), np.linspace(*scene_bands(scene, camera).range_m, 4)
    ours, known = np.zeros((2, len(ways), 3))
    rayleigh, particles = (phase.eval_s(np.ones(1))[0] for phase in (Rayleigh(), phase_function(scene)))
    for one in passes(scene, camera):
        water, light = optical_properties(one.scene), np.array(one.scene.lights[0].intensity)
        at = np.searchsorted(found.wavelength_nm, one.wavelength_nm)
        sent = light * np.exp(-np.outer(ways, water.sigma_t))
        back = water.sigma_s * water.phase.eval_s(np.ones(1))[0]
        ours += (sent * back) @ one.weights.T
        known += (sent * (found.b_water[at] * rayleigh + found.b_particles[at] * particles)) @ one.weights.T
    error = np.abs(ours / known - 1.0).max(axis=0)
    np.testing.assert_allclose(backscatter_error(scene, camera), error, rtol=1e-3, atol=1e-6)
    assert described(scene)[0]["backscatter"] == pytest.approx(error, rel=1e-3, abs=1e-6)
    assert water_info(scene)["bands"][0]["backscatter"] == pytest.approx(error, rel=1e-3, abs=1e-6)


def test_bands_that_are_too_few_for_backscatter_are_told():
    (told,) = (one for one in warnings_of(scene_of(bands=6)) if "backscattered" in one)
    assert told.startswith("vehicle.cameras.0 (M0): backscattered light is off by up to 5.4 % with 6 bands")
    assert not any("backscattered" in one for one in warnings_of(scene_of()))


def test_a_matrix_fitted_to_a_grey_camera_is_told(tmp_path):
    even = np.interp(GRID, [400, 550, 700], [0.2, 1.0, 0.3])
    rows = "\n".join(f"{nm:g},{v},{v},{v}" for nm, v in zip(GRID, even, strict=True))
    (tmp_path / "grey.csv").write_text(f"wavelength_nm,r,g,b\n{rows}\n")
    (told,) = (
        one
        for one in warnings_of(scene_of(tmp_path, response="grey.csv", color_matrix="auto"))
        if "color_matrix" in one
    )
    assert "rank 1" in told
    assert "vehicle.cameras.0.color_matrix" in told
    assert not any("color_matrix" in one for one in warnings_of(scene_of(color_matrix="auto")))
