"""The planner: a bound and a number of samples that keep the tolerance, from the scene alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from varos_warp.render import cost, pilot, truncation
from varos_warp.render.adapt import brightness
from varos_warp.render.frame import FrameRenderer, RadianceImage
from varos_warp.render.pilot import View, circle_of_confusion, judged_pixels, pilot_camera
from varos_warp.render.plan import FEWEST_SPP, MODEL_SHARE, RARE_COUNTS, SAMPLE_COST, _Planner, plan_render
from varos_warp.render.truncation import kappa, surface_path, truncated_light, volume_path
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry import Part
from varos_warp.scene.water import optical_properties

LAMPS = [{"kind": "spot", "position": [x, -0.1, 0.0], "cone_deg": 65} for x in (-0.15, 0.15)]
VAROS_WATER = {"sigma_s": [0.00175, 0.01825, 0.043125], "sigma_a": [0.12325, 0.039739, 0.0], "phase": {"g": 0.8}}
POSE = np.eye(4)


def make_scene(water=VAROS_WATER, lights=LAMPS, camera=(), **render):
    """The VAROS rig above a flat floor; ``render`` changes its block."""
    view = {"resolution": [64, 36], "rotation_euler_deg": [-25, 0, 0], "focal_mm": 3.4} | dict(camera)
    return Scene(water="none" if water is None else {"coefficients": water},
                 vehicle={"lights": lights, "cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]},
                 render={"denoise": "none", "tolerance": 0.05, "integrator": "path"} | render)


def make_renderer(scene, **how):
    """A floor 1.5 m under the vehicle."""
    corners = np.array([[-60.0, -60, -1.5], [60, -60, -1.5], [60, 60, -1.5], [-60, 60, -1.5]])
    floor = Part("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(reflectance=[0.25] * 3))
    return FrameRenderer(scene, "cpu", parts=[floor], **how)


@pytest.fixture(scope="module")
def planned():
    """A scene, its renderer and its plan."""
    scene = make_scene()
    renderer = make_renderer(scene)
    return scene, renderer, plan_render(scene, renderer, [POSE])


# ---------------------------------------------------------------------------------------------------- the criterion


MEASURED = {  # S_0 and V_1 as shares of a pixel, x_s, x_v, and lost light [%] with at most 0, 1, 2 scatterings
    "G 2 m": (0.9215, 0.0190, 0.061, 0.020, (7.82, 0.22, 0.00)),
    "G 5 m": (0.742, 0.1345, 0.151, 0.025, (25.75, 1.23, 0.06)),
    "G 10 m": (0.374, 0.482, 0.301, 0.028, (62.56, 3.23, 0.25)),
    "B 2 m": (0.828, 0.0386, 0.145, 0.047, (17.11, 1.14, 0.05)),
    "B 5 m": (0.5455, 0.205, 0.357, 0.061, (45.31, 5.28, 0.56)),
    "B 10 m": (0.222, 0.511, 0.711, 0.068, (77.63, 10.95, 1.97)),
    "coastal 2 m": (0.338, 0.240, 0.736, 0.203, (66.02, 17.76, 3.77)),
    "sigma_t=1 2 m": (0.0197, 0.3665, 2.69, 0.615, (97.78, 55.83, 27.05)),
}
"""Order-resolved Monte Carlo of the pixel in the middle, the VAROS rig over a floor of reflectance 0.25."""


@pytest.mark.parametrize("case", MEASURED)
def test_the_criterion_predicts_the_light_that_was_measured_to_be_lost(case):
    """Within 3 % at N = 0 and 1 for x_s < 1, and never more below the measured loss than the safety factor covers."""
    direct, single, x_s, x_v, measured = MEASURED[case]
    for n, loss in enumerate(measured):
        lost, total = truncated_light(n, direct, single, x_s, x_v)
        error = 100.0 * float(lost / total)
        assert truncation.SAFETY * error > loss - 0.01
        if n < 2:
            np.testing.assert_allclose(error, loss, rtol=0.03 if x_s < 1.0 else 0.05, atol=0.01)


WATERS = {"G": (0.01825, 0.057989), "B": (0.043125, 0.043125), "coastal": (0.219, 0.398), "sigma_t=1": (0.8, 1.0)}

def test_the_view_that_counts_is_the_noisiest_after_denoising():
    """Noise of single pixels, which a denoiser takes away, against half of it in blocks, which it takes for light."""
    rng, light = np.random.default_rng(3), np.full((96, 160, 3), 0.5, np.float32)

    def view(size, sigma):
        images = []
        for _ in range(2):
            noise = rng.normal(0.0, sigma, (96 // size, 160 // size, 1)).astype(np.float32)
            radiance = np.maximum(light + np.kron(noise, np.ones((size, size, 1), np.float32)), 0.0)
            images.append(RadianceImage(radiance, np.full_like(radiance, sigma)))
        return View(0, make_scene().vehicle.cameras[0], POSE, *images, np.ones((96, 160)))

    fine, coarse = view(1, 0.1), view(16, 0.05)
    assert pilot.scouted_noise(fine, "none") == pytest.approx(0.2, rel=0.05)
    assert pilot.scouted_noise(fine, "none").min() > 1.5 * pilot.scouted_noise(coarse, "none").max()
    assert pilot.scouted_noise(fine, "oidn").max() < 0.7 * pilot.scouted_noise(coarse, "oidn").min()


def test_one_bright_sample_does_not_make_a_view_the_noisiest():
    """It would be in one of two images, by chance; where every hundredth pixel has one, it counts."""
    rng = np.random.default_rng(5)

    def view(sigma, bright):
        images = [rng.normal(0.5, sigma, (36, 64, 3)).astype(np.float32) for _ in range(2)]
        images[0][rng.random((36, 64)) < bright] += 10.0
        return View(0, make_scene().vehicle.cameras[0], POSE, *(RadianceImage(image, image) for image in images), None)

    noisy, quiet = view(0.05, 0.0), view(0.02, 0.0)
    quiet.image.radiance[20, 30] += 10.0
    assert pilot.scouted_noise(quiet, "none", rare=0.0).min() > 2.0 * pilot.scouted_noise(noisy, "none").max()
    assert pilot.scouted_noise(quiet, "none").max() < 0.5 * pilot.scouted_noise(noisy, "none").min()
    assert pilot.scouted_noise(view(0.02, 0.01), "none").min() > 2.0 * pilot.scouted_noise(noisy, "none").max()


@pytest.mark.parametrize("case", MEASURED)
def test_path_lengths_give_the_optical_depths_of_the_measurement(case):
    """x_s to its last digit; x_v to its last digit and 4 % for the quadrature (32 nodes against a hard cone)."""
    name, metres = case.removesuffix(" m").rsplit(" ", 1)
    sigma_s, sigma_t = WATERS[name]
    water = {"sigma_s": [sigma_s] * 3, "sigma_a": [sigma_t - sigma_s] * 3, "phase": {"g": 0.8}}
    ahead = {"resolution": [2, 2], "sensor_mm": [1e-3, 1e-3], "focal_mm": 34.0, "rotation_euler_deg": [0, 0, 0]}
    scene = make_scene(water, camera=ahead)
    view = View(0, scene.vehicle.cameras[0], POSE, None, None, np.full((2, 2), float(metres)))
    _, _, x_s, x_v, _ = MEASURED[case]
    np.testing.assert_allclose(0.82 * sigma_s * surface_path(scene, view), x_s, rtol=0.003, atol=0.0006)
    found = sigma_s * volume_path(scene, view, optical_properties(scene))
    np.testing.assert_allclose(found, x_v, rtol=0.04, atol=0.0006)


def test_no_bound_loses_everything_or_more_than_a_wider_one():
    x = np.array([0.0, 0.1, 1.0, 2.9])
    losses = [truncated_light(n, 1.0, 1.0, x, x)[0] for n in range(7)]
    total = truncated_light(0, 1.0, 1.0, x, x)[1]
    np.testing.assert_allclose(total - losses[0], 1.0)  # the direct light alone is left
    assert np.all(np.diff(losses, axis=0)[:, 1:] < 0.0)
    np.testing.assert_array_equal([loss[0] for loss in losses[1:]], 0.0)  # water that does not scatter


def test_surface_light_from_beyond_the_measured_depth_counts_as_lost():
    lost, total = truncated_light(6, 1.0, 0.0, 3.1, 0.1)
    assert lost == total


def test_kappa_is_the_table_at_its_nodes_and_one_where_scattering_does_not_deflect():
    assert kappa(0.8, 32.5) == pytest.approx(0.82)
    assert kappa(0.95, 60.0) == pytest.approx(0.99)
    assert kappa(1.0, 17.0) == pytest.approx(1.0)
    assert kappa(0.8, 32.5) < kappa(0.85, 32.5) < kappa(0.85, 45.0) < kappa(0.924, 45.0) < 1.0


# ------------------------------------------------------------------------------------------------------ scatterings


def test_the_truncated_image_agrees_with_the_unbounded_one(planned):
    """Over places of 16 x 12 pixels, less light is lost than the tolerance; no bound at all would lose a third of it.

    Both images have the same random numbers, so that most of their noise cancels.
    """
    scene, renderer, plan = planned
    images = [renderer.render(POSE, outputs="A", spp=256, max_scatterings=bound).A for bound in
              (None, plan.max_scatterings, 0)]

    def places(image):
        return image.astype(float).reshape(3, 12, 4, 16, 3).mean(axis=(1, 3))

    full, bounded, direct = (places(image.radiance) for image in images)
    assert 2 <= plan.max_scatterings <= 4
    assert np.max(np.abs(full - bounded) / full) < scene.render.tolerance
    assert abs(bounded.mean() / full.mean() - 1.0) < MODEL_SHARE * scene.render.tolerance
    assert np.mean((full - direct)[..., 2] / full[..., 2]) > scene.render.tolerance


def test_a_tighter_tolerance_takes_more_scatterings_and_samples(planned):
    scene, renderer, loose = planned
    scene = make_scene(tolerance=0.02)
    tight = plan_render(scene, renderer, [POSE])
    assert tight.max_scatterings > loose.max_scatterings
    assert tight.spp > 4 * loose.spp


def test_clearer_water_takes_fewer_scatterings(planned):
    clear = make_scene(VAROS_WATER | {"sigma_s": [0.0005, 0.0005, 0.0005]})
    assert plan_render(clear, make_renderer(clear), [POSE]).max_scatterings < planned[2].max_scatterings


@pytest.mark.parametrize("water", [None, VAROS_WATER | {"sigma_s": [0.0, 0.0, 0.0]}])
def test_water_that_does_not_scatter_needs_no_scatterings(water):
    assert plan_render(make_scene(water, spp=4), None, [POSE]).max_scatterings == 0


@pytest.mark.parametrize(("layers", "bound"), [(["direct"], 0), (["direct", "single"], 1), (["multiple"], None)])
def test_layers_that_are_not_rendered_are_not_planned_for(layers, bound):
    assert plan_render(make_scene(spp=4, layers=layers), None, [POSE]).max_scatterings is bound


NARROW = {"kind": "spot", "cone_deg": 30}


@pytest.mark.parametrize(("changes", "reason"), [
    ({"water": VAROS_WATER | {"phase": {"g": 0.3}}}, "g from 0.5"),
    ({"water": VAROS_WATER | {"phase": {"kind": "rayleigh"}}}, "not for rayleigh"),
    ({"lights": [{"kind": "point"}]}, "20 to 120 degrees"),
    ({"lights": [*LAMPS, NARROW]}, "lamps of one kind"),
    ({"lights": []}, "no lamps"),
    ({"lights": [LAMPS[0] | {"position": [3.0, 0.0, 0.0]}]}, "within 1.5 m"),
    ({"camera": {"mount": "world"}}, "within 1.5 m"),
])
def test_where_the_criterion_was_not_measured_there_is_no_bound(changes, reason):
    plan = plan_render(make_scene(spp=4, **changes), None, [POSE])
    assert plan.max_scatterings is None
    assert reason in plan.reasons[1]


def test_turbid_water_beyond_the_measured_depths_has_no_bound():
    turbid = make_scene({"sigma_s": [0.8] * 3, "sigma_a": [0.01] * 3, "phase": {"g": 0.9}}, spp=4)
    plan = plan_render(turbid, make_renderer(turbid), [POSE])
    assert plan.max_scatterings is None
    assert "more than 6 scatterings counts" in plan.reasons[1]


# ---------------------------------------------------------------------------------------------------------- samples


def rendered(scene, renderer, plan, seed, denoise="none"):
    """Image A as planned, with other random numbers."""
    return renderer.render(POSE, plan.view(scene.vehicle.cameras[0]), "A", seed=seed, denoise=denoise, **plan.options).A


def error_of(images, truth):
    """Relative RMSE [3] of images."""
    squares = np.mean([(image - truth) ** 2 for image in images], axis=(0, 1, 2))
    return np.sqrt(squares) / brightness(truth.mean((0, 1)))


def test_the_image_keeps_the_tolerance_and_the_prediction_needlessly_neither(planned):
    """Against 8192 samples, whose own noise is a fifth; 8 images tell their error to about a tenth."""
    scene, renderer, plan = planned
    truth = renderer.render(POSE, outputs="A", spp=8192, seed=5).A.radiance.astype(float)
    found = error_of([rendered(scene, renderer, plan, seed).radiance for seed in range(80, 88)], truth)
    assert np.all(found <= plan.error)
    assert 0.6 * scene.render.tolerance < found.max() <= scene.render.tolerance


def test_the_denoised_image_keeps_the_tolerance():
    scene = make_scene(denoise="nlm", tolerance=0.06)
    renderer = make_renderer(scene)
    plan = plan_render(scene, renderer, [POSE])
    plain = plan_render(make_scene(tolerance=0.06), renderer, [POSE])
    truth = renderer.render(POSE, outputs="A", spp=4096, seed=5).A.radiance.astype(float)
    found = error_of([rendered(scene, renderer, plan, seed, "nlm").denoised for seed in range(80, 84)], truth)
    assert found.max() <= scene.render.tolerance
    assert plan.spp < plain.spp
    assert "after nlm" in plan.reasons[-1]


def test_samples_stay_within_limits_and_the_plan_says_so(planned):
    plan = plan_render(make_scene(tolerance=1.0), planned[1], [POSE])
    assert plan.spp == FEWEST_SPP
    assert "no fewer are taken" in plan.reasons[-1]
    assert plan.shortfall is None


@pytest.mark.parametrize(("seconds", "spp"), [(None, 3689), (0.1, 6)])
def test_a_tolerance_that_cannot_be_had_is_said_first(planned, seconds, spp):
    """64 x 36 pixels; a CPU's samples take 12 microseconds nominally, of paths alone 1.7 times less."""
    plan = plan_render(make_scene(tolerance=1e-4, max_seconds_per_frame=seconds), planned[1], [POSE])
    assert plan.spp == spp
    assert plan.reasons[0] == plan.shortfall
    assert plan.shortfall.startswith("tolerance NOT kept: ")
    assert "0.01 % asked" in plan.shortfall
    assert plan.error.max() > 1e-4


def test_a_scene_without_light_takes_the_fewest_samples():
    dark = make_scene(lights=[])
    plan = plan_render(dark, make_renderer(dark), [POSE])
    assert (plan.spp, plan.max_scatterings) == (FEWEST_SPP, None)


def test_the_noisiest_of_the_poses_rules(planned):
    """One that looks up into the water, where nothing but scattered light is seen, and one that looks at the floor."""
    scene, renderer, plan = planned
    up = POSE.copy()
    up[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    alone = plan_render(scene, renderer, [up])
    both = plan_render(scene, renderer, [POSE, up])
    assert max(alone.spp, plan.spp) > 1.5 * min(alone.spp, plan.spp)
    assert both.spp == pytest.approx(max(plan.spp, alone.spp), rel=0.3)  # what the pilot's chance leaves open


# -------------------------------------------------------------------------------------------- errors without reference


def images_of(truth, sigma, count, seed=1):
    """Images [H, W, 3] with independent noise."""
    rng = np.random.default_rng(seed)
    return [RadianceImage((truth + rng.normal(scale=sigma, size=truth.shape)).astype(np.float32),
                          np.full(truth.shape, sigma, np.float32)) for _ in range(count)]


def test_an_error_is_found_without_a_reference_by_images_that_are_noisier():
    """Of a blur of 3 x 3 pixels on a checker: the same as against the truth, within 5 %."""
    from scipy.ndimage import uniform_filter

    truth = 1.0 + 0.2 * (np.indices((90, 160)).sum(0) // 4 % 2)[..., None] * np.ones(3)
    blurred = [uniform_filter(image.radiance, (3, 3, 1)) for image in images_of(truth, 0.05, 4)]
    judges = [image.radiance for image in images_of(truth, 0.1, 2, seed=9)]
    np.testing.assert_allclose(pilot.error(blurred, judges), error_of(blurred, truth), rtol=0.05)


def test_what_is_left_out_is_found_under_noise_of_the_same_size():
    """Its upper end: not below the truth, and not above it by more than chance leaves open."""
    truth = np.ones((90, 160, 3))
    full, other = images_of(truth, 0.02, 2), images_of(truth, 0.02, 2, seed=2)
    less = [RadianceImage(image.radiance - np.float32(0.02), image.stderr) for image in other]
    found = pilot.omission_error(full, less)
    assert np.all((found >= 0.0195) & (found < 0.023))
    same = pilot.omission_error(full, full)
    np.testing.assert_array_equal(same, 0.0)


def test_the_blur_of_a_lens_is_that_of_its_disk():
    """A disk 1.5 pixels wide over a wave 16 pixels long: against its transfer function 2 J1(x) / x, within 5 %."""
    from scipy.special import j1

    wave = 1.0 + 0.3 * np.cos(2 * np.pi * (np.arange(160) + 0.5) / 16)[None, :, None] * np.ones((90, 1, 3))
    x = 2 * np.pi / 16 * 1.5 / 2
    expected = 0.3 / np.sqrt(2) * (1.0 - 2.0 * j1(x) / x)
    np.testing.assert_allclose(pilot.blur_error(wave, 1.5), expected, rtol=0.05)


def test_the_circle_of_confusion_is_that_of_a_thin_lens():
    """A focal length of 3.4 mm, f/1.7: an aperture of 2 mm, 985.5 pixels; focused at 3 m, a point at 1 m."""
    camera = Camera(f_stop=1.7, focus_m=3.0)
    diameter = 0.002 * (1.0 - 1.0 / 3.0) * 3.4 / 4.416 * 1280
    assert circle_of_confusion(camera, np.full((5, 5), 1.0)) == pytest.approx(diameter, rel=1e-6)
    assert circle_of_confusion(camera, np.full((5, 5), 3.0)) == 0.0
    assert circle_of_confusion(Camera(f_stop=0.0), np.full((5, 5), 1.0)) == 0.0


# ------------------------------------------------------------------------------------------------- lens, reflections


def test_a_small_aperture_is_left_out_and_a_large_one_is_not():
    plans = {}
    for f_stop in (1.0, 60.0):
        scene = make_scene(camera={"resolution": [64, 36], "f_stop": f_stop, "focus_m": 5.0}, tolerance=0.2)
        plans[f_stop] = plan_render(scene, make_renderer(scene), [POSE])
    assert plans[60.0].pinhole
    assert plans[60.0].view(scene.vehicle.cameras[0]).f_stop == 0.0
    assert not plans[1.0].pinhole or "0.0" in plans[1.0].reasons[2]


def test_reflections_are_left_out_over_a_dark_floor_and_not_inside_a_bright_tank():
    """A flat floor sends hardly any light back to itself; five walls of reflectance 0.8 do."""
    walls = np.array([[x, y, z] for x in (-2.0, 2) for y in (-2.0, 3) for z in (-1.5, 1.5)])
    quads = [(0, 4, 6, 2), (0, 2, 3, 1), (4, 5, 7, 6), (2, 6, 7, 3), (0, 1, 5, 4), (1, 3, 7, 5)]
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], np.int32)
    tank = Part("tank", walls, faces, Diffuse(reflectance=[0.8] * 3))
    scene = make_scene(tolerance=0.1)
    floor, inside = (plan_render(scene, renderer, [POSE]) for renderer in
                     (make_renderer(scene), FrameRenderer(scene, "cpu", parts=[tank])))
    assert floor.max_bounces == 1
    assert inside.max_bounces is None
    assert "would lose" in inside.reasons[2]


# ------------------------------------------------------------------------------------------------- what is promised


def test_what_the_scene_fixes_is_taken_as_it_is_and_nothing_is_rendered():
    plan = plan_render(make_scene(spp=37, max_scatterings=5), None, [POSE])
    assert (plan.spp, plan.max_scatterings) == (37, 5)
    assert plan.reasons == ["integrator path: given", "max_scatterings 5: given", "spp 37: given"]
    assert plan.error is None
    assert "at most 5 scatterings" in plan.models["A"]


def test_samples_are_planned_for_the_bounds_that_are_given(planned):
    plan = plan_render(make_scene(max_scatterings=0, max_bounces=1), planned[1], [POSE])
    assert (plan.max_scatterings, plan.max_bounces) == (0, 1)
    assert plan.spp < planned[2].spp  # direct light alone, at the edges of the cones, has less noise


def test_without_a_nothing_is_rendered_for_the_plan():
    plan = plan_render(make_scene(outputs=["B", "C", "D"]), None, [POSE])
    assert set(plan.models) == set("BCD")
    assert plan.error is None


def test_the_plan_does_not_depend_on_threads_or_time(planned):
    scene, _, plan = planned
    again = plan_render(scene, make_renderer(scene, threads=1), [POSE], measure_cost=True)
    assert again.cost["seconds_per_frame"] > 0.0
    assert plan.to_dict() == {key: value for key, value in again.to_dict().items() if key != "cost"}


def test_errors_of_models_add_up_and_noise_adds_in_squares(planned):
    plan = planned[2]
    *models, samples = [np.array(decision.error) for decision in plan.decisions]
    np.testing.assert_allclose(plan.error, np.sqrt(np.sum(models, axis=0) ** 2 + samples**2))
    assert np.all(np.sum(models, axis=0) <= MODEL_SHARE * planned[0].render.tolerance)


def test_the_pilot_keeps_the_field_of_view():
    camera = make_scene(camera={"resolution": [1280, 720]}).vehicle.cameras[0]
    small = pilot_camera(camera)
    assert small.resolution == (160, 90)
    assert small.model_copy(update={"resolution": camera.resolution}) == camera
    assert pilot_camera(small) == small


@pytest.mark.parametrize(("resolution", "frames", "pixels"), [
    ((1280, 720), 1, 320 * 180), ((1280, 720), 250, 230_400), ((1280, 720), 4713, 1280 * 720),
    ((64, 48), 9000, 64 * 48)])
def test_long_sequences_are_judged_at_their_own_resolution(resolution, frames, pixels):
    camera = make_scene(camera={"resolution": list(resolution)}).vehicle.cameras[0]
    found = pilot_camera(camera, judged_pixels(camera, frames)).resolution
    assert np.prod(found) == pytest.approx(pixels, rel=0.01)


OVERHEAD = 50_000


class Clockwork:
    """Stands in for a renderer: every sample of A and B and every pixel of C and D takes a microsecond, and 50 ms."""

    device, device_name, compile_seconds = "cpu", "clockwork", 0.0

    def __init__(self):
        self.now = 0.0

    def render(self, T_w_v, camera, outputs, *, spp, spp_b, **how):
        pixels = camera.resolution[0] * camera.resolution[1]
        self.now += 1e-6 * (pixels * {"A": spp, "B": spp_b}.get(outputs, 1) + OVERHEAD)
        self.compile_seconds += 5.0
        self.now += 5.0


@pytest.mark.parametrize(("outputs", "microseconds"), [(["A", "B", "C", "D"], 16 + 20 + 1), (["D"], 1), (["A"], 16)])
def test_the_cost_is_that_of_whole_images_without_compiling(monkeypatch, outputs, microseconds):
    clockwork = Clockwork()
    monkeypatch.setattr(cost.time, "perf_counter", lambda: clockwork.now)
    scene = make_scene(camera={"resolution": [1280, 720]}, spp=16, max_scatterings=1, outputs=outputs)
    found = plan_render(scene, clockwork, [POSE] * 50, measure_cost=True).to_dict()["cost"]
    expected = 1e-6 * (1280 * 720 * microseconds + OVERHEAD * (3 if len(outputs) > 1 else 1))
    assert found["seconds_per_frame"] == pytest.approx(expected, rel=0.005)  # three digits
    assert found["seconds_in_all"] == pytest.approx(50 * found["seconds_per_frame"], rel=0.005)
    assert found["frames"] == 50


# -------------------------------------------------------------------------------------------------------------- field


def test_with_the_field_no_scattering_is_left_out_and_fewer_samples_are_needed():
    """The same floor: the plan says so, and its samples reach the tolerance by the spread of renderings."""
    plans = {name: plan_render(scene, make_renderer(scene), [POSE]) for name in ("path", "field", "auto")
             for scene in [make_scene(integrator=name)]}
    assert plans["field"].spp == plans["auto"].spp
    assert plans["field"].max_scatterings is None
    assert "the field holds all orders" in plans["field"].reasons[1]
    assert plans["field"].models["A"].startswith("path tracer with the field of open water")
    assert plans["field"].spp < plans["path"].spp


def test_the_field_gives_way_to_paths_where_scatterings_are_bounded():
    scene = make_scene(integrator="auto", max_scatterings=1)
    assert plan_render(scene, make_renderer(scene), [POSE]).models["A"].startswith("path tracer")


def test_an_image_that_lacks_light_carried_by_rare_pixels_is_found_too_dark():
    """One pixel in a thousand of each judge holds 5 % of the light, as in turbid water; a denoiser cuts such pixels."""
    rng = np.random.default_rng(7)
    image = np.full((60, 80, 3), 0.95, np.float32)
    judges = [np.where(rng.random((60, 80, 1)) < 1e-3, 50.95, 0.95).astype(np.float32).repeat(3, -1) for _ in range(64)]
    found = pilot.error([image], judges, sigmas=0.0)
    light = 0.05 / np.sqrt(64 * 4800 * 1e-3)  # standard error of the rare light's mean
    np.testing.assert_allclose(found, 0.05, atol=5.0 * light)


@pytest.mark.parametrize(("paths", "field", "gain"), [
    ((4.0, 3.0), (2.0, 3.0), 2.0),
    ((0.4, 1.3), (1.0, 1.0), 1.3 / RARE_COUNTS),
    ((0.3, 17.0), (1.0, 1.0), 17.0 / RARE_COUNTS),
])
def test_rare_bright_samples_count_that_two_denoised_images_hide(monkeypatch, paths, field, gain):
    """Squares of the noise after and before denoising: the latter tells where paths have rare bright samples."""
    square = {"path": paths, "field": field}
    monkeypatch.setattr(pilot, "twins", lambda renderer, view, integrator, spp, **how: SimpleNamespace(
        image=SimpleNamespace(spp=spp), integrator=integrator))
    monkeypatch.setattr(pilot, "scouted_noise", lambda pair, method, rare: np.sqrt(
        [0.0, square[pair.integrator][method == "none"], 0.0]))
    planner = _Planner(make_scene(denoise="oidn"), None, [], [])
    planner.worst = None
    assert planner.gain_of_field() == pytest.approx(gain * SAMPLE_COST["path"] / SAMPLE_COST["field"])
