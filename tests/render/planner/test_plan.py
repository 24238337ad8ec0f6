"""The planner: an integrator and a number of samples that keep the tolerance, from the scene alone."""

import re
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from physics.rig import VAROS_LAMPS, VAROS_WATER

from varos_warp.dataset.run.planning import plan_sequence
from varos_warp.errors import InputError
from varos_warp.render.image.adapt import brightness
from varos_warp.render.kinds import sample_step
from varos_warp.render.planner import cost
from varos_warp.render.planner import plan as plan_module
from varos_warp.render.planner.errors import SAMPLES, error
from varos_warp.render.planner.pilot import Frames, View, pilot_camera, pixels_tried
from varos_warp.render.planner.plan import RARE_COUNTS, SAMPLE_COST, Planner, plan_render
from varos_warp.render.renderer import FrameRenderer, RadianceImage
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

PAPER_WATER = VAROS_WATER | {"phase": {"g": 0.8}}
POSE = np.eye(4)
TOLD = []
"""Steps of planning and their shares, as the plan of the fixture was told of them."""


def make_scene(water=PAPER_WATER, lights=VAROS_LAMPS, camera=(), **render):
    """The VAROS rig above a flat floor; ``render`` changes its block."""
    view = {"resolution": [48, 27], "rotation_euler_deg": [-25, 0, 0], "focal_mm": 3.4} | dict(camera)
    return Scene(
        water="none" if water is None else {"coefficients": water},
        vehicle={"lights": lights, "cameras": [view]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        render={"denoise": "none", "tolerance": 0.1, "integrator": "path"} | render,
    )


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
    TOLD.clear()  # where tests of other files come between, it is planned anew
    return scene, renderer, plan_render(scene, renderer, [POSE], progress=lambda *step: TOLD.append(step))


@pytest.fixture(scope="module")
def known(planned):
    """By the field, right to 0.2 %: its 192 samples have at most a seventh of the noise that is allowed below."""
    image = planned[1].render(POSE, outputs="A", spp=192, seed=5, integrator="field").A
    radiance = image.radiance.astype(float)
    noise = np.sqrt(np.square(image.stderr, dtype=float).mean((0, 1))) / brightness(radiance.mean((0, 1)))
    assert noise.max() < planned[0].render.tolerance / 7
    return radiance


# ------------------------------------------------------------------------------------------------- views, integrators


def test_the_view_that_counts_is_the_noisiest_after_denoising():
    """Noise of single pixels, which a denoiser takes away, against half of it in blocks, which it takes for light."""
    rng, light = np.random.default_rng(3), np.full((96, 160, 3), 0.5, np.float32)

    def view(size, sigma):
        images = []
        for _ in range(2):
            noise = rng.normal(0.0, sigma, (96 // size, 160 // size, 1)).astype(np.float32)
            radiance = np.maximum(light + np.kron(noise, np.ones((size, size, 1), np.float32)), 0.0)
            images.append(RadianceImage(radiance, np.full_like(radiance, sigma)))
        return View(0, make_scene().vehicle.cameras[0], tuple(images))

    fine, coarse = view(1, 0.1), view(16, 0.05)
    assert fine.noise("none") == pytest.approx(0.2, rel=0.05)
    assert fine.noise("none").min() > 1.5 * coarse.noise("none").max()
    assert fine.noise("oidn").max() < 0.7 * coarse.noise("oidn").min()


def test_one_bright_sample_does_not_make_a_view_the_noisiest():
    """It would be in one of two images, by chance; where every hundredth pixel has one, it counts."""
    rng = np.random.default_rng(5)

    def view(sigma, bright):
        images = [rng.normal(0.5, sigma, (36, 64, 3)).astype(np.float32) for _ in range(2)]
        images[0][rng.random((36, 64)) < bright] += 10.0
        return View(0, make_scene().vehicle.cameras[0], tuple(RadianceImage(image, image) for image in images))

    noisy, quiet = view(0.05, 0.0), view(0.02, 0.0)
    quiet.images[0].radiance[20, 30] += 10.0
    assert quiet.noise("none", rare=0.0).min() > 2.0 * noisy.noise("none").max()
    assert quiet.noise("none").max() < 0.5 * noisy.noise("none").min()
    assert view(0.02, 0.01).noise("none").min() > 2.0 * noisy.noise("none").max()


@pytest.mark.parametrize("water", [None, PAPER_WATER | {"sigma_s": [0.0, 0.0, 0.0]}])
def test_water_that_does_not_scatter_has_no_field(water):
    plan = plan_render(make_scene(water, spp=4, integrator="auto"), None, [POSE])
    assert plan.reasons[0] == "integrator path: the water does not scatter"


# ------------------------------------------------------------------------------------------------------------ ports


def test_a_port_is_weighed_at_the_distances_that_its_camera_sees():
    camera = {"rotation_euler_deg": [-45, 0, 0], "port": {"kind": "flat", "distance_m": 0.2, "thickness_m": 0.02}}
    scene = make_scene(spp=4, camera=camera, outputs=["D"])
    renderer = make_renderer(scene)
    plan = plan_render(scene, renderer, [POSE])
    (sentence,) = plan.ports
    near, far = np.quantile(renderer.render(POSE, outputs="D").D.range, (0.01, 0.99))
    assert re.fullmatch(
        r"port of M0 needed: a pinhole with the best distortion is off by [\d.]+ px rms, [\d.]+ px at "
        rf"most \({near:.2g} to {far:.2g} m\)",
        sentence,
    )
    assert sentence in plan.to_dict()["reasons"]
    assert plan_render(make_scene(spp=4, outputs=["D"]), None, [POSE]).ports == []


def test_a_port_without_which_all_looks_the_same_is_said_to_be_needless():
    scene = make_scene(spp=4, camera={"port": {"kind": "dome", "radius_m": 0.05}}, outputs=["D"])
    renderer = make_renderer(scene)
    (sentence,) = plan_render(scene, renderer, [POSE]).ports
    assert sentence.startswith("port of M0 not needed: within 0.05 px a pinhole without port shows the same (")
    assert sentence.endswith(", with the keys focal_mm: 3.4")
    up = scene.vehicle.cameras[0].model_copy(update={"rotation_euler_deg": (90.0, 0.0, 0.0)})
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"cameras": [up]})})
    assert plan_render(scene, renderer, [POSE]).ports == []  # it sees nothing


# ---------------------------------------------------------------------------------------------------------- samples


def rendered(scene, renderer, plan, seed, denoise="none"):
    """Image A as planned, with other random numbers."""
    return renderer.render(POSE, outputs="A", seed=seed, denoise=denoise, **plan.options).A


def error_of(images, truth):
    """Relative RMSE [3] of images."""
    squares = np.mean([(image - truth) ** 2 for image in images], axis=(0, 1, 2))
    return np.sqrt(squares) / brightness(truth.mean((0, 1)))


def test_a_tighter_tolerance_takes_more_samples(planned):
    _, renderer, tight = planned
    assert tight.spp > 4 * plan_render(make_scene(tolerance=0.25), renderer, [POSE]).spp


def test_the_image_keeps_the_tolerance_and_the_prediction_needlessly_neither(planned, known):
    """8 images tell their error to about a tenth; what is foretold is that of the worst of four."""
    scene, renderer, plan = planned
    found = error_of([rendered(scene, renderer, plan, seed).radiance for seed in range(80, 88)], known)
    assert np.all(found <= plan.error)
    assert 0.5 * scene.render.tolerance < found.max() <= scene.render.tolerance


def test_the_denoised_image_keeps_the_tolerance(planned, known):
    _, renderer, plain = planned
    scene = make_scene(denoise="nlm")
    plan = plan_render(scene, renderer, [POSE])
    found = error_of([rendered(scene, renderer, plan, seed, "nlm").denoised for seed in range(80, 84)], known)
    assert found.max() <= scene.render.tolerance
    assert plan.spp < plain.spp
    assert "after nlm" in plan.reasons[-1]


@pytest.mark.parametrize("tolerance", [0.0, -0.1, np.nan])
def test_a_tolerance_that_means_nothing_is_bad_input(planned, tolerance):
    """A scene file cannot say it; Python can, past the checks of the file."""
    scene = planned[0].model_copy(update={"render": planned[0].render.model_copy(update={"tolerance": tolerance})})
    with pytest.raises(InputError, match=r"render\.tolerance = "):
        plan_render(scene, planned[1], [POSE])


def test_samples_stay_within_limits_and_the_plan_says_so(planned):
    plan = plan_render(make_scene(tolerance=1.0), planned[1], [POSE])
    assert plan.spp == SAMPLES[plan.integrator].fewest
    assert "no fewer are taken" in plan.reasons[-1]
    assert plan.shortfall is None


@pytest.mark.parametrize(
    ("camera", "fewest", "step"),
    [
        ({}, 0.25, 0.125),
        ({"resolution": [48, 1]}, 2, 1.0),
        ({"port": {"kind": "flat", "distance_m": 0.02}, "n_water": [1.331, 1.335, 1.342]}, 6, 6.0),
    ],
)
def test_samples_are_planned_in_steps_that_the_camera_takes(camera, fewest, step):
    """A port parts colours if the water has an index for each; then samples come in sixes."""
    scene = make_scene(camera=camera, integrator="field")
    poses = Frames.of(scene, None, [POSE], None, None)
    samples = Planner(scene, poses).samples
    assert (samples.fewest, samples.step) == (fewest, step)
    assert sample_step(scene.vehicle.cameras[0], True) == (step if step >= 1 else 0)


@pytest.mark.parametrize(
    ("tolerance", "seconds", "spp", "asked"),
    [(1e-4, None, 2766, "0.01 %"), (5e-324, 0.1, 4, "4.9e-322 %")],
    ids=["small", "tiny"],
)
def test_a_tolerance_that_cannot_be_had_is_said_first(planned, monkeypatch, tolerance, seconds, spp, asked):
    """64 x 36 pixels; a CPU's samples take 16 microseconds nominally, of paths alone 1.7 times less.

    The pilot may stop at few samples: it finds more to be needed than may be taken in any case.
    """
    monkeypatch.setattr(plan_module, "MOST_TRIED", 8)
    scene = make_scene(camera={"resolution": [64, 36]}, tolerance=tolerance, max_seconds_per_frame=seconds)
    plan = plan_render(scene, planned[1], [POSE])
    assert plan.spp == spp
    assert plan.reasons[0] == plan.shortfall
    assert plan.shortfall.startswith("tolerance NOT kept: ")
    assert f"{asked} asked" in plan.shortfall
    assert plan.error.max() > tolerance


def test_a_scene_without_light_takes_the_fewest_samples():
    dark = make_scene(lights=[])
    plan = plan_render(dark, make_renderer(dark), [POSE])
    assert plan.spp == SAMPLES[plan.integrator].fewest


def test_the_noisiest_of_the_poses_rules(planned):
    """One 1.5 m above the floor, and one half a metre, where there is less scattered light."""
    scene, renderer, plan = planned
    close = POSE.copy()
    close[2, 3] = -1.0
    alone = plan_render(scene, renderer, [close])
    both = plan_render(scene, renderer, [POSE, close])
    assert max(alone.spp, plan.spp) > 1.5 * min(alone.spp, plan.spp)
    assert both.spp == pytest.approx(max(plan.spp, alone.spp), rel=0.3)  # what the pilot's chance leaves open


# -------------------------------------------------------------------------------------------- errors without reference


def images_of(truth, sigma, count, seed=1):
    """Images [H, W, 3] with independent noise."""
    rng = np.random.default_rng(seed)
    return [
        RadianceImage(
            (truth + rng.normal(scale=sigma, size=truth.shape)).astype(np.float32),
            np.full(truth.shape, sigma, np.float32),
        )
        for _ in range(count)
    ]


def test_an_error_is_found_without_a_reference_by_images_that_are_noisier():
    """Of a blur of 3 x 3 pixels on a checker: the same as against the truth, within 5 %."""
    from scipy.ndimage import uniform_filter

    truth = 1.0 + 0.2 * (np.indices((90, 160)).sum(0) // 4 % 2)[..., None] * np.ones(3)
    blurred = [uniform_filter(image.radiance, (3, 3, 1)) for image in images_of(truth, 0.05, 4)]
    estimates = [image.radiance for image in images_of(truth, 0.1, 2, seed=9)]
    np.testing.assert_allclose(error(blurred, estimates), error_of(blurred, truth), rtol=0.05)


# ------------------------------------------------------------------------------------------------- what is promised


def test_what_the_scene_fixes_is_taken_as_it_is_and_nothing_is_rendered():
    plan = plan_render(make_scene(spp=37, max_scatterings=5), None, [POSE])
    assert (plan.spp, plan.max_scatterings) == (37, 5)
    assert plan.reasons == ["integrator path: given", "spp 37: given"]
    assert plan.error is None
    assert "at most 5 scatterings" in plan.models["A"]


def test_samples_are_planned_for_the_bounds_that_are_given(planned):
    plan = plan_render(make_scene(max_scatterings=0, max_bounces=1), planned[1], [POSE])
    assert (plan.max_scatterings, plan.max_bounces) == (0, 1)
    assert plan.spp < planned[2].spp  # direct light alone, at the edges of the cones, has less noise


def test_without_a_nothing_is_rendered_for_the_plan():
    plan = plan_render(make_scene(outputs=["B", "C", "D", "F"]), None, [POSE])
    assert set(plan.models) == set("BCDF")
    assert plan.error is None


def test_the_plan_does_not_depend_on_threads_or_time(planned):
    """Images of four tiles of rows (device/launch.py)."""
    scene, _, plan = planned
    again = plan_render(scene, make_renderer(scene, threads=1), [POSE], measure_cost=True)
    assert again.cost["seconds_per_frame"] > 0.0
    assert plan.to_dict() == {key: value for key, value in again.to_dict().items() if key != "cost"}


def test_errors_of_models_add_up_and_noise_adds_in_squares(planned):
    plan = planned[2]
    *models, samples = [np.array(decision.error) for decision in plan.decisions]
    np.testing.assert_allclose(plan.error, np.sqrt(np.sum(models, axis=0) ** 2 + samples**2))


def test_planning_tells_how_far_it_is(planned):
    assert list(dict.fromkeys(name for name, _ in TOLD)) == ["views", "samples", "more samples"]
    for name in ("views", "samples"):
        shares = [share for told, share in TOLD if told == name]
        assert shares == sorted(shares)
        assert 0.0 == shares[0] < shares[-1] <= 1.0


def test_the_pilot_keeps_the_field_of_view():
    camera = make_scene(camera={"resolution": [1280, 720]}).vehicle.cameras[0]
    small = pilot_camera(camera)
    assert small.resolution == (160, 90)
    assert small.model_copy(update={"resolution": camera.resolution}) == camera
    assert pilot_camera(small) == small


@pytest.mark.parametrize(
    ("resolution", "frames", "pixels"),
    [
        ((1280, 720), 1, 320 * 180),
        ((1280, 720), 100, 0.4 * 1280 * 720),
        ((1280, 720), 4713, 1280 * 720),
        ((64, 48), 9000, 64 * 48),
    ],
)
def test_long_sequences_are_planned_at_their_own_resolution(resolution, frames, pixels):
    camera = make_scene(camera={"resolution": list(resolution)}).vehicle.cameras[0]
    found = pilot_camera(camera, pixels_tried(camera, frames)).resolution
    assert np.prod(found) == pytest.approx(pixels, rel=0.01)


class Watched:
    """Stands in for a renderer: images of noise; what it is told of the vehicle and the time is kept."""

    device, device_name, compile_seconds = "cpu", "watched", 0.0

    def __init__(self):
        self.told = []

    def render(self, T_w_v, camera, outputs, *, spp, seed, motion, time_ns, **how):
        self.told.append((T_w_v[0, 3], motion(np.array([7]))[0, 0, 3], time_ns))
        noise = np.random.default_rng([seed or 0, spp]).normal(size=(27, 48, 3)) / np.sqrt(spp)
        image = RadianceImage((1.0 + noise).astype(np.float32), np.ones((27, 48, 3), np.float32))
        return SimpleNamespace(A=SimpleNamespace(**vars(image) | {"denoised": image.radiance, "spp": spp}))


def test_frames_are_tried_as_a_run_makes_them_each_at_its_own_time_and_blurred():
    """Along x by one metre in each 3 ns, from x = 100 m on."""

    def pose(time_ns):
        T = POSE.copy()
        T[0, 3] = time_ns / 3
        return T

    times, watched = [3 * k for k in range(100, 700)], Watched()
    plan_render(
        make_scene(tolerance=0.2),
        watched,
        list(map(pose, times)),
        time_ns=times,
        motion=lambda time_ns: lambda offset_ns: np.array([pose(time_ns + offset) for offset in offset_ns]),
    )
    assert len({time_ns for *_, time_ns in watched.told}) > 5
    for x, moved, time_ns in watched.told:
        assert (x, moved) == (time_ns / 3, (time_ns + 7) / 3)


OVERHEAD, DENOISING, CORES = 50_000, 3, 7


class Clockwork:
    """Stands in for a renderer: every sample of A and B and every pixel of C and D takes a microsecond, and 50 ms.

    The denoiser takes a few more for a pixel of A and B.
    """

    device, device_name, compile_seconds = "cpu", "clockwork", 0.0

    def __init__(self):
        self.now, self.compiled = 0.0, set()

    def render(self, T_w_v, camera, outputs, *, spp, spp_b, **how):
        assert ("F" in outputs) == ("following" in how)
        pixels = camera.resolution[0] * camera.resolution[1]
        self.now += 1e-6 * (pixels * {"A": spp, "B": spp_b}.get(outputs, 1) + OVERHEAD)
        if outputs not in self.compiled:
            self.compiled.add(outputs)
            self.now += 5.0
        return SimpleNamespace(A=pixels, B=pixels)

    def denoise(self, pixels, method):
        self.now += 1e-6 * DENOISING * pixels


@pytest.mark.parametrize(
    ("outputs", "microseconds"),
    [(["A", "B", "C", "D", "F"], 16 + DENOISING + 20 + DENOISING + 1), (["D"], 1), (["F"], 1), (["A"], 16 + DENOISING)],
)
def test_the_cost_is_that_of_whole_images_with_denoising_without_compiling(monkeypatch, outputs, microseconds):
    clockwork = Clockwork()
    monkeypatch.setattr(cost.time, "process_time", lambda: CORES * clockwork.now)
    monkeypatch.setattr(cost, "usable_cores", lambda: CORES)
    monkeypatch.setattr(cost, "denoise_image", clockwork.denoise)
    scene = make_scene(camera={"resolution": [1280, 720]}, spp=16, spp_b=20, max_scatterings=1, outputs=outputs)
    found = plan_render(scene, clockwork, [POSE] * 50, measure_cost=True).to_dict()["cost"]
    constants = OVERHEAD * (1.0 + 1.25 + 1.0 if len(outputs) > 1 else 1.0)  # of 20 samples 16 are rendered
    expected = 1e-6 * (1280 * 720 * microseconds + constants)
    assert found["seconds_per_frame"] == pytest.approx(expected, rel=0.005)  # three digits
    assert found["seconds_in_all"] == pytest.approx(50 * found["seconds_per_frame"], rel=0.005)
    assert found["frames"] == 50


# -------------------------------------------------------------------------------------------------------------- field


def test_with_the_field_fewer_samples_are_needed(planned):
    """The same floor."""
    plans = {name: plan_render(make_scene(integrator=name), planned[1], [POSE]) for name in ("field", "auto")}
    plans["path"] = planned[2]
    assert plans["field"].spp == plans["auto"].spp
    assert plans["field"].models["A"].startswith("path tracer with the field of open water")
    assert plans["field"].spp < plans["path"].spp


def test_the_field_gives_way_to_paths_where_scatterings_are_bounded():
    scene = make_scene(integrator="auto", max_scatterings=1)
    assert plan_render(scene, make_renderer(scene), [POSE]).models["A"].startswith("path tracer")


def test_an_image_that_lacks_light_carried_by_rare_pixels_is_found_too_dark():
    """One pixel in a thousand of each estimate holds 5 % of the light, as in turbid water; a denoiser cuts them."""
    rng = np.random.default_rng(7)
    image = np.full((60, 80, 3), 0.95, np.float32)
    estimates = [
        np.where(rng.random((60, 80, 1)) < 1e-3, 50.95, 0.95).astype(np.float32).repeat(3, -1) for _ in range(64)
    ]
    found = error([image], estimates, sigmas=0.0)
    light = 0.05 / np.sqrt(64 * 4800 * 1e-3)  # standard error of the rare light's mean
    np.testing.assert_allclose(found, 0.05, atol=5.0 * light)


@pytest.mark.parametrize(
    ("paths", "field", "gain"),
    [
        ((4.0, 3.0), (2.0, 3.0), 2.0),
        ((0.4, 1.3), (1.0, 1.0), 1.3 / RARE_COUNTS),
        ((0.3, 17.0), (1.0, 1.0), 17.0 / RARE_COUNTS),
    ],
)
def test_rare_bright_samples_count_that_two_denoised_images_hide(monkeypatch, paths, field, gain):
    """Squares of the noise after and before denoising: the latter tells where paths have rare bright samples."""
    made = {"path": paths, "field": field}
    monkeypatch.setattr(
        Planner,
        "image",
        lambda self, frame, camera, spp, number, integrator: SimpleNamespace(spp=spp, squares=made[integrator]),
    )
    monkeypatch.setattr(
        View, "noise", lambda self, method, rare: np.sqrt([0.0, self.images[0].squares[method == "none"], 0.0])
    )
    scene = make_scene(denoise="oidn")
    planner = Planner(scene, Frames.of(scene, None, []))
    planner.worst = View(0, scene.vehicle.cameras[0], ())
    assert planner.gain_of_field() == pytest.approx(gain * SAMPLE_COST["path"] / SAMPLE_COST["field"])


def test_an_integrator_is_refused_only_where_an_image_takes_one():
    """A of clear water has no field; a run of B, C and D needs none."""

    def planned_for(*outputs):
        scene = make_scene(None, integrator="field", outputs=outputs, spp=1)
        still = SimpleNamespace(poses=lambda: POSE[None], time_ns=np.zeros(1, np.int64))
        renderer = SimpleNamespace(compiling=lambda outputs: nullcontext())
        return plan_sequence(scene, renderer, still, None, quiet=True)

    assert planned_for("B", "C", "D").models.keys() == {"B", "C", "D"}
    with pytest.raises(InputError, match="does not scatter"):
        planned_for("A")
