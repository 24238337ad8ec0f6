"""Images in water by wavelength, against images of three channels and against integrals by the nanometre."""

import numpy as np
import pytest
import trimesh
import warp as wp

from varos_warp.kernels.film.bands import add_weighted, add_weighted_variance
from varos_warp.render.radiance import RadianceRenderer, added_errors
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.lights.spectral import spectral_intensity
from varos_warp.scene.optics.seawater import CHANNELS_NM, seawater_index
from varos_warp.scene.passes import BandWater, passes
from varos_warp.scene.spectra.bands import scene_bands
from varos_warp.scene.spectra.lamps import camera_response
from varos_warp.scene.spectra.spectrum import STEPS
from varos_warp.scene.spectra.surfaces import reflectance_of_rgb
from varos_warp.scene.spectra.water import water_spectra

T_W_V = np.eye(4)
SHOT = {"spp": 4, "integrator": "path", "denoise": "none", "denoise_b": "none"}
LAMP = {"kind": "spot", "position": [0.3, 0, 0], "cone_deg": 120, "blend": 0.5}
WALL_M = 1.8
"""From the camera, which looks along y."""


def scene_of(water, lamp, folder, reflectance=(0.5, 0.5, 0.5), response="nikon_5100", view=None, **render):
    trimesh.creation.box([4.0, 0.4, 4.0]).export(folder / "wall.ply")
    wall = {"file": "wall.ply", "position": [0, WALL_M + 0.2, 0], "material": "paint"}
    camera = {"id": "M0", "resolution": [24, 16], "focal_mm": 4.0} | ({"response": response} if response else {})
    return scene_from_dict(
        {
            "water": water,
            "objects": [wall],
            "materials": {"paint": {"kind": "diffuse", "reflectance": reflectance}},
            "vehicle": {"lights": [LAMP | lamp], "cameras": [camera | (view or {})]},
            "render": render,
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        },
        folder,
    )


@pytest.fixture
def even(tmp_path):
    """Spectra that are the same at all wavelengths: of a lamp, and of water with a = 0.9 and b = 0.3 1/m."""
    (tmp_path / "lamp.csv").write_text("wavelength_nm,power\n400,1\n700,1\n")
    rows = "".join(f"{nm},0.9,0.3\n" for nm in range(400, 701))  # between rows, tables follow pure water
    (tmp_path / "water.csv").write_text("wavelength_nm,a,b\n" + rows)
    return tmp_path


def rendered(scene, outputs="AB"):
    return FrameRenderer(scene, "cpu").render(T_W_V, "M0", outputs, **SHOT)


def test_even_spectra_give_the_image_of_three_channels(even):
    """Of each pass, with its own phase function; power over the cone's solid angle is the intensity."""
    scene = scene_of(
        {"spectral": {"file": "water.csv", "phase": {"kind": "rayleigh"}}},
        {"spectrum": "lamp.csv", "power_W": 50.0},
        even,
    )
    intensity = float(spectral_intensity(scene.lights[0], scene).sum() * 300.0 / 301.0)
    a = water_spectra(scene).a
    assert np.ptp(a) < 1e-12
    plain = scene_of(
        {"coefficients": {"sigma_a": [0.9] * 3, "sigma_s": [0.3] * 3, "phase": {"kind": "rayleigh"}}},
        {"intensity": [intensity] * 3},
        even,
        response=None,
    )
    ours, theirs = rendered(scene), rendered(plain)
    np.testing.assert_allclose(ours.A.radiance, theirs.A.radiance, rtol=2e-4)
    np.testing.assert_allclose(ours.B.radiance, theirs.B.radiance, rtol=1e-5)
    for layer, light in theirs.A.layers.items():
        np.testing.assert_allclose(ours.A.layers[layer], light, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(ours.A.stderr, theirs.A.stderr, rtol=1e-3)


@pytest.mark.parametrize("reflectance", [(0.5, 0.5, 0.5), (0.5, 0.1, 0.05), (0.1, 0.2, 0.5)])
@pytest.mark.parametrize("kind", ["IB", "3C"])
def test_direct_light_is_that_of_an_integral_by_the_nanometre(tmp_path, kind, reflectance):
    """Radiance of the wall's middle: I r cos / (pi d^2) over lamp, water, paint and camera, within the stated error."""
    lamp = {"spectrum": "led_b4", "lumen": 5000.0, "position": [0.0, 0.0, 0.0]}
    scene = scene_of({"spectral": {"jerlov": kind}}, lamp, tmp_path, reflectance, tolerance=0.02)
    camera, distance = scene.vehicle.cameras[0], WALL_M
    A = FrameRenderer(scene, "cpu").render(T_W_V, "M0", "A", layers=("direct",), **SHOT).A
    bands = scene_bands(scene, camera)
    response = camera_response("nikon_5100", scene.resolve, "response")
    light = spectral_intensity(scene.lights[0], scene)
    white = (response * STEPS * light).sum(1)
    beam = reflectance_of_rgb(reflectance) * np.exp(-2.0 * distance * water_spectra(scene).c) / np.pi / distance**2
    # balanced for the lamp: white close by has the lamp's whole intensity in every channel
    exact = (response * STEPS * light * beam).sum(1) / white * (STEPS @ light)
    middle = A.radiance[7:9, 11:13].mean(axis=(0, 1))
    pixels = 0.02  # across the pixels in the middle, and of the balance by bands
    assert (np.abs(middle / exact - 1.0) < bands.worst + pixels).all()


def test_what_the_water_lets_through_falls_less_with_distance(tmp_path):
    """Image T: by Beer and Lambert in each band; the effective attenuation of red falls, as red goes first."""
    scene = scene_of({"spectral": {"jerlov": "IB"}}, {"spectrum": "led_b4", "power_W": 50.0}, tmp_path)
    frame = FrameRenderer(scene, "cpu").render(T_W_V, "M0", "DT")
    water = BandWater.of_camera(scene, scene.vehicle.cameras[0])
    np.testing.assert_allclose(water.white.sum(1), 1.0, rtol=1e-12)
    hit = np.isfinite(frame.D.range)
    assert hit.any()
    np.testing.assert_allclose(frame.T.transmittance[hit], water.left(frame.D.range[hit]), rtol=1e-6)
    d = np.array([1.0, 5.0, 10.0, 20.0])
    attenuation = -np.log(water.left(d)) / d[:, None]
    assert (np.diff(attenuation[:, 0]) < 0.0).all()


def test_without_lights_it_is_dark_but_for_b(tmp_path):
    dark = scene_of({"spectral": {"jerlov": "1C"}}, {"spectrum": "led_b4", "power_W": 50.0}, tmp_path)
    dark = dark.model_copy(update={"vehicle": dark.vehicle.model_copy(update={"lights": []})})
    frame = rendered(dark)
    assert not frame.A.radiance.any()
    assert frame.B.radiance.any()


def test_passes_have_all_bands_once(tmp_path):
    scene = scene_of({"spectral": {"jerlov": "1C"}}, {"spectrum": "led_b4", "power_W": 50.0}, tmp_path, bands=7)
    made = passes(scene, scene.vehicle.cameras[0])
    assert len(made) == 3
    np.testing.assert_array_equal(made[2].weights[:, 1:], 0.0)
    np.testing.assert_allclose(sum(one.of_ambient for one in made).sum(1), 1.0, rtol=1e-12)
    for one in made:
        assert (one.to_bands >= 0.0).all()
        np.testing.assert_allclose(one.to_bands.sum(1), 1.0, rtol=1e-12)


def test_a_port_refracts_each_band_by_its_own_index(even):
    """The right edge of a wall, seen aslant through flat glass: as in three channels of the bands' indices."""
    glass = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008, "n_glass": 1.49, "normal": [0.7, 0, 1]}
    port = {"port": glass, "look_at": [1.2, WALL_M, 0], "resolution": [96, 16]}
    water, index = {"phase": {"kind": "rayleigh"}}, {"temperature_C": 10.0, "salinity": 35.0}
    scene = scene_of(
        {"spectral": {"file": "water.csv"} | water},
        {"spectrum": "lamp.csv", "power_W": 50.0},
        even,
        bands=3,
        view=port | {"n_water": index},
    )
    (one,) = passes(scene, scene.vehicle.cameras[0])
    nm = scene_bands(scene, scene.vehicle.cameras[0]).wavelength_nm
    light = [float(spectral_intensity(scene.lights[0], scene)[0])] * 3
    how = {"coefficients": {"sigma_a": [0.9] * 3, "sigma_s": [0.3] * 3} | water}

    def plain(indices):
        return (
            rendered(
                scene_of(
                    how, {"intensity": light}, even, response=None, view=port | {"n_water": [float(n) for n in indices]}
                ),
                "A",
            ).A.radiance
            @ one.weights.T
        )

    ours = rendered(scene, "A").A.radiance
    np.testing.assert_allclose(ours, plain(seawater_index(10.0, 35.0, nm)), rtol=2e-3, atol=1e-4 * ours.max())
    wrong = plain(seawater_index(10.0, 35.0, np.array(CHANNELS_NM)))
    assert np.abs(ours - wrong).max() > 0.02 * ours.max()


def as_images(values):
    """One pixel of each of some vectors on the device."""
    return [wp.array(np.reshape(v, (1, 1, 3)).astype(np.float32), dtype=wp.vec3, device="cpu") for v in values]


def test_errors_of_bands_add_up_and_one_without_weight_counts_for_nothing():
    weights = [np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, -2.0]]), np.array([[1.0, 0.0, 0.0]] * 3)]
    deviations = [[0.1, 0.2, 0.3], [0.4, np.inf, np.inf]]
    errors, variances, light = (wp.zeros((1, 1), dtype=wp.vec3, device="cpu") for _ in "evl")
    added = np.zeros((1, 1, 3))
    for w, own, ones in zip(weights, deviations, as_images(np.ones((2, 3))), strict=True):
        one, squared = as_images([own, np.square(own)])
        for kernel, image, matrix, total in (
            (add_weighted, one, np.abs(w), errors),
            (add_weighted, ones, w, light),
            (add_weighted_variance, squared, np.abs(w), variances),
        ):
            wp.launch(kernel, dim=(1, 1), inputs=[image, wp.mat33d(*w_of(matrix))], outputs=[total], device="cpu")
        added = added + added_errors(np.reshape(own, (1, 1, 3)), w)
    for found in (errors.numpy(), np.sqrt(variances.numpy()), added):
        np.testing.assert_allclose(found[0, 0], [0.5, 0.55, 1.0], rtol=1e-6)
    np.testing.assert_allclose(light.numpy()[0, 0], [2.0, 2.0, -1.0], rtol=1e-6)


def w_of(matrix):
    return np.ravel(matrix).tolist()


@pytest.mark.parametrize("integrator", ["path", "field", "reference"])
def test_an_image_is_the_weighted_sum_of_its_passes(even, any_field, monkeypatch, integrator):
    """Each pass as it is taken, added in numpy; five bands, so that one channel of the last pass has no weight."""
    water = {"spectral": {"file": "water.csv", "phase": {"kind": "rayleigh"}}}
    renderer = FrameRenderer(scene_of(water, {"spectrum": "lamp.csv", "power_W": 50.0}, even, bands=5), "cpu")
    view, of_pass, take = renderer.scene.vehicle.cameras[0], [], RadianceRenderer.take_water

    def noted(self, shot):
        of_pass.append(take(self, shot))
        return of_pass[-1]

    monkeypatch.setattr(RadianceRenderer, "take_water", noted)
    how = {"outputs": "A", "integrator": integrator, "spp": 4, "denoise": "oidn"}
    made = renderer.render(T_W_V, **how).A
    weights = [one.weights for one, _ in renderer.radiance.passes(view)]
    assert len(of_pass) == len(weights) == 2
    assert not weights[1][:, 2].any()

    def summed(name, of=lambda values: values, weigh=lambda w: w):
        return sum(
            of(taken.images[name].numpy().astype(float)) @ weigh(w).T for taken, w in zip(of_pass, weights, strict=True)
        )

    for name in ("direct", "single", "multiple"):
        np.testing.assert_allclose(made.layers[name], summed(name), rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(made.radiance, sum(made.layers.values()))
    np.testing.assert_allclose(made.stderr, summed("stderr", weigh=np.abs), rtol=1e-6)
    if integrator != "reference":
        np.testing.assert_allclose(made.correction, summed("correction"), rtol=1e-5, atol=1e-6 * made.radiance.max())
        np.testing.assert_allclose(np.sqrt(made.base_variance), summed("base_variance", np.sqrt, np.abs), rtol=1e-5)
    assert made.spp == pytest.approx(4.0, rel=0.02)
    brief = renderer.render(T_W_V, **how, copied=["denoised"]).A
    np.testing.assert_array_equal(brief.denoised, made.denoised)


def test_what_moves_is_where_it_is_in_every_pass(tmp_path, monkeypatch):
    """A chart, whose patches have spectra of their own, as in a scene where it is from the start; nothing is relit."""

    def scene(stops):
        return scene_from_dict(
            {
                "water": {"spectral": {"jerlov": "1C"}},
                "render": {"bands": 6},
                "seed": 1,
                "objects": [
                    {
                        "kind": "color_chart",
                        "path": [{"time_s": t, "position": [0, y, 0]} for t, y in zip((0.0, 1.0), stops, strict=True)],
                    }
                ],
                "vehicle": {
                    "lights": [LAMP | {"spectrum": "led_b4", "power_W": 50.0}],
                    "cameras": [{"id": "M0", "resolution": [24, 16], "focal_mm": 4.0, "response": "nikon_5100"}],
                },
                "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            },
            tmp_path,
        )

    def image(stops, time_ns):
        renderer = FrameRenderer(scene(stops), "cpu")
        renderer.radiance.passes(renderer.scene.vehicle.cameras[0])
        with monkeypatch.context() as patch:
            patch.setattr(DeviceScene, "relit", None)
            return renderer.render(T_W_V, "M0", "A", time_ns=time_ns, **SHOT).A.radiance

    away = image((0.6, 1.2), 10**9)
    np.testing.assert_allclose(away, image((1.2, 0.6), 0), rtol=1e-5, atol=1e-6 * away.max())
    assert np.abs(away - image((0.6, 1.2), 0)).max() > 0.1 * away.max()


def test_bands_in_which_there_is_no_water_leave_those_in_which_there_is_some(even):
    """Open water that scatters from 500 nm on only: passes below see nothing, and the image is of the others."""
    rows = "".join(f"{nm},{0.9 if nm > 500 else 0.0},{0.3 if nm > 500 else 0.0}\n" for nm in range(400, 701))
    (even / "water.csv").write_text("wavelength_nm,a,b\n" + rows)
    scene = scene_of({"spectral": {"file": "water.csv"}}, {"spectrum": "lamp.csv", "power_W": 50.0}, even, bands=9)
    renderer = FrameRenderer(scene.model_copy(update={"objects": []}), "cpu")
    view = renderer.scene.vehicle.cameras[0]
    water = [one.scene.water.coefficients for one, _ in renderer.radiance.passes(view)]
    assert not any(np.any(one.sigma_s) for one in water[:1])
    assert any(np.any(one.sigma_s) for one in water)
    assert renderer.render(T_W_V, "M0", "A", **SHOT).A.radiance.max() > 0.0


@pytest.mark.parametrize("by_field", [0, 1])
def test_the_field_may_serve_some_passes_only(even, any_field, monkeypatch, by_field):
    """As where one has water for which it cannot be solved: guides are of all passes, or there are none."""
    water = {"spectral": {"file": "water.csv", "phase": {"kind": "rayleigh"}}}
    scene = scene_of(water, {"spectrum": "lamp.csv", "power_W": 50.0}, even, bands=5)
    renderer = FrameRenderer(scene, "cpu")
    of_passes = [one for _, one in renderer.radiance.passes(scene.vehicle.cameras[0])]
    monkeypatch.setattr(
        RadianceRenderer, "_integrator", lambda self, options: "field" if self is of_passes[by_field] else "path"
    )
    made = renderer.render(T_W_V, "M0", "A", spp=4, denoise="oidn").A
    assert made.albedo is None
    assert made.spp == pytest.approx(4.0, rel=0.02)
    assert np.isfinite(made.denoised).all()


def test_b_is_divided_by_the_albedo_in_the_channels_of_the_camera(tmp_path):
    """A wall under the open sky is its albedo."""
    pytest.importorskip("pyoidn")
    lamp = {"spectrum": "led_b4", "power_W": 50.0}
    scene = scene_of({"spectral": {"jerlov": "3C"}}, lamp, tmp_path, reflectance=(0.1, 0.2, 0.5))
    image = FrameRenderer(scene, "cpu").render(T_W_V, "M0", "B", spp_b=4, denoise_b="oidn").B
    np.testing.assert_allclose(image.albedo, image.radiance, rtol=1e-5)
