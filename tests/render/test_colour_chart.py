"""What cameras see of a colour chart, against sums and integrals of lamp, water, patch and camera."""

import numpy as np
import pytest

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.passes import passes
from varos_warp.scene.spectra.bands import scene_bands
from varos_warp.scene.spectra.lamps import camera_response, lamp_spectrum
from varos_warp.scene.spectra.spectrum import GRID, STEPS
from varos_warp.scene.spectra.surfaces import PATCHES, chart_colours, chart_reflectances
from varos_warp.scene.spectra.water import pure_absorption, water_spectra

T_W_V = np.eye(4)
SHOT = {"spp": 1, "integrator": "path", "denoise": "none", "denoise_b": "none", "layers": ("direct",)}
CHART_M = 0.5
"""From the camera; light goes there and back."""
CHART = {"kind": "color_chart", "position": [0, CHART_M, 0]}
PAINTED = {"material": "white"}
MATERIALS = {"white": {"kind": "diffuse", "reflectance": [1.0, 1.0, 1.0]}}


def scene_of(folder, chart=None, by_wavelength=True, **more):
    """A chart that fills the view, with the lamp at the camera, in water that absorbs as pure water does."""
    if by_wavelength:
        nm = np.arange(400, 701)
        rows = "".join(f"{w},{a:.8g},1e-9\n" for w, a in zip(nm, pure_absorption(nm), strict=True))
        (folder / "pure.csv").write_text("wavelength_nm,a,b\n" + rows)
    lamp = {"kind": "point"} | ({"spectrum": "led_b4", "power_W": 30.0} if by_wavelength else {"intensity": [1, 1, 1]})
    camera = {"id": "M0", "resolution": [240, 180], "sensor_mm": [4.0, 3.0], "focal_mm": 6.8}
    return scene_from_dict(
        {
            "water": {"spectral": {"file": "pure.csv"}} if by_wavelength else "none",
            "materials": MATERIALS,
            "objects": [CHART | (chart or {})],
            "vehicle": {"lights": [lamp], "cameras": [camera | ({"response": "nikon_5100"} if by_wavelength else {})]},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        }
        | more,
        folder,
    )


def patches_of(scene, letter="A"):
    """Mean of each patch's middle, float64 [24, 3]."""
    renderer = FrameRenderer(scene, "cpu")
    image = getattr(renderer.render(T_W_V, "M0", letter, **SHOT), letter).radiance
    column, row = np.meshgrid(np.arange(6), np.arange(4))
    middle = np.stack([(column.ravel() - 2.5) * 0.046, np.full(24, CHART_M), (1.5 - row.ravel()) * 0.046], axis=-1)
    u, v = np.floor(renderer.project(middle, T_W_V)).astype(int).T
    return np.array([image[y - 3 : y + 4, x - 3 : x + 4].mean(axis=(0, 1)) for x, y in zip(u, v, strict=True)])


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """The scene, and what its camera sees of the patches as shares of what it sees of a white board there."""
    folder = tmp_path_factory.mktemp("chart")
    scene = scene_of(folder)
    return scene, patches_of(scene) / patches_of(scene_of(folder, PAINTED))


def test_patches_have_their_spectra_at_each_band(seen):
    """Not those that colours would make: to single precision."""
    scene, found = seen
    bands = scene_bands(scene, scene.vehicle.cameras[0])
    light = bands.weights * bands.lamps[0] * np.exp(-2.0 * CHART_M * (bands.a + bands.b_water + bands.b_particles))
    for name, ours in zip(PATCHES, found, strict=True):
        reflectance = chart_reflectances()[name].at(bands.wavelength_nm)
        np.testing.assert_allclose(ours, light @ reflectance / light.sum(axis=1), rtol=3e-3, err_msg=name)


def test_patches_are_integrals_by_the_nanometre_within_the_stated_error(seen):
    scene, found = seen
    camera = scene.vehicle.cameras[0]
    bands = scene_bands(scene, camera)
    light = (
        camera_response("nikon_5100", scene.resolve, "response")
        * lamp_spectrum("led_b4", scene.resolve, "").at()
        * np.exp(-2.0 * CHART_M * water_spectra(scene).c)
        * STEPS
    )
    reflectance = np.array([patch.at(GRID) for patch in chart_reflectances().values()])
    exact = reflectance @ light.T / light.sum(axis=1)
    assert (np.abs(found / exact - 1.0) < (1.0 + bands.worst) / (1.0 - bands.worst) - 1.0).all()  # and that of white


def test_greys_are_as_grey_as_they_were_measured(seen):
    """Each step of the last row is darker, and of one colour within the bend of its spectrum from 420 nm up."""
    found = seen[1][PATCHES.index("white") :]
    np.testing.assert_allclose(found[:, 1], [0.887, 0.582, 0.358, 0.203, 0.093, 0.034], rtol=0.02)
    assert (np.ptp(found, axis=1) < 0.05 * found.mean(axis=1)).all()


def test_without_wavelengths_they_have_their_colours_under_d65(tmp_path):
    found = patches_of(scene_of(tmp_path, by_wavelength=False)) / patches_of(
        scene_of(tmp_path, PAINTED, by_wavelength=False)
    )
    np.testing.assert_allclose(found, np.clip(chart_colours(), 0.0, 1.0), rtol=3e-3, atol=1e-5)


def test_a_chart_that_moves_is_seen_as_one_that_stands(seen, tmp_path):
    path = [{"time_s": t, "position": [0, CHART_M, z]} for t, z in ((0, 0.0), (10, 0.1))]
    moving, still = scene_of(tmp_path, {"path": path}), scene_of(tmp_path)
    np.testing.assert_allclose(patches_of(moving), patches_of(still), rtol=1e-3)


@pytest.mark.parametrize("joined", [False, True])
def test_copies_have_the_spectra_too_whether_they_join_the_mesh_or_not(tmp_path, joined):
    """And nothing else has: the terrain's colours become spectra in the bands."""
    copies = {"object": {"kind": "color_chart"}, "count": 3}
    terrain = {"kind": "procedural", "size_m": 20, "resolution": 17}
    scene = scene_of(tmp_path, PAINTED, terrain=terrain, scatter=[copies])
    world = DeviceScene(scene, build_parts(scene), "cpu", joins_copies=joined)
    one = passes(scene, scene.vehicle.cameras[0])[0]
    before = world.data.corner_values.numpy().copy()
    lit = world.relit(one.scene, one)
    np.testing.assert_array_equal(world.data.corner_values.numpy(), before)
    as_measured = [np.array_equal(matrix, np.eye(3)) for matrix in lit.data.to_bands.numpy()]
    assert as_measured == [name.startswith("scatter.0") for name in world.part_names]
    values = lit.data.corner_values.numpy().reshape(-1, 3, 3)
    cyan = np.float32(chart_reflectances()["cyan"].at(one.wavelength_nm))
    assert (values == cyan).all(axis=(1, 2)).sum() == 2 * (3 if joined else 1)
