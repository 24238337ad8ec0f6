"""What is taken out of an image for its bodies: light scattered once, and what bodies add in the mean over seeds."""

import itertools

import numpy as np
import pytest
import warp as wp
from flakes import LAMP, WATER, Snowing, snow_scene
from scipy.integrate import quad

from varos_warp.kernels.particles.bodies import Particles
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.water.phase.lambert_sphere import LambertSphere

NARROW = {"resolution": [8, 8], "sensor_mm": [8, 8], "focal_mm": 20000}  # all its rays are one
SEEDS = 128
SIGMA_S, SIGMA_T = np.array([0.2, 0.3, 0.25]), np.array([0.5, 0.4, 0.3])
LAMPS = {
    "sharp cone": LAMP | {"blend": 0.0, "cone_deg": 60},
    "soft cone": LAMP | {"blend": 0.8, "cone_deg": 60},
    "near the ray": LAMP | {"position": [0.02, 1.0, 0.0], "direction": [-0.3, 1.0, 0.0], "cone_deg": 120},
}


def expected_of(snowing, **options):
    n = snowing(**options)
    return ((n.light - n.added) / n.passed[..., None]).astype(float)


def profile(lamp, cos):
    half = np.cos(np.radians(lamp["cone_deg"] / 2))
    if lamp["blend"] == 0:
        return float(cos >= half)
    s = np.clip((cos - half) / (lamp["blend"] * (1 - half)), 0, 1)
    return s * s * (3 - 2 * s)


@pytest.mark.parametrize("name", LAMPS)
def test_the_mean_of_one_ray_is_the_integral_along_it(name):
    """Of share, phase function and the lamp's light there, by adaptive quadrature; all of the sizes are drawn."""
    lamp, share = LAMPS[name], 0.005
    position = np.array(lamp["position"], float)
    axis = np.array(lamp["direction"]) / np.linalg.norm(lamp["direction"])
    reach = min(8.0, 4.0 / SIGMA_T.min())

    def integrand(t, channel):
        way = np.array([0, t, 0]) - position
        distance = np.linalg.norm(way)
        drawn = np.clip((t - 0.05) / 0.05, 0, 1) * np.clip((distance - 0.05) / 0.05, 0, 1)
        drawn *= np.clip(4 * (1 - t / reach), 0, 1)
        phase = LambertSphere().density(0.5 * (1 + way[1] / distance))
        return (
            share
            * SIGMA_S[channel]
            * drawn
            * phase
            * lamp["intensity"][channel]
            * profile(lamp, way @ axis / distance)
            * np.exp(-SIGMA_T[channel] * (t + distance))
            / distance**2
        )

    ends = np.linspace(0.05, reach, 200)
    expected = [
        sum(quad(integrand, a, b, (channel,), limit=200, epsrel=1e-6)[0] for a, b in itertools.pairwise(ends))
        for channel in range(3)
    ]
    E = expected_of(Snowing(snow_scene(NARROW, lights=[lamp]))).mean((0, 1))
    np.testing.assert_allclose(E, expected, rtol=2e-3)


def test_with_the_waters_own_phase_function_it_is_the_layer_of_light_scattered_once():
    """Everything drawn: the mean is the whole of it. The lit part of the rays begins beyond where bodies fade."""
    scene = snow_scene(
        {"resolution": [32, 32], "sensor_mm": [1, 1], "focal_mm": 6},
        lights=[LAMP | {"position": [0.6, 0.0, 0.0], "direction": [-0.2, 1, 0], "cone_deg": 50}],
    )
    snowing = Snowing(scene)
    law = snowing.snow.laws[0]

    def whole(record, law, time_ns):
        kind = Particles()
        kind.assign(record)
        kind.sigma_s, kind.phase = wp.vec3(*law.water.sigma_s), law.water.phase.device_record("cpu")
        kind.drawn = wp.array([1.0, 1.0], dtype=float, device="cpu")
        kind.covered, kind.step, kind.reach = wp.zeros(2, dtype=float, device="cpu"), 1e3, 900.0
        kind.least_angle = 1.0  # no bodies
        return kind

    snowing.snow._moved = whole
    E = expected_of(snowing).mean((0, 1))
    single = snowing.renderer.render(
        np.eye(4), outputs="A", integrator="path", layers=["single"], spp=256, snow=False
    ).A
    A = single.radiance.mean((0, 1), dtype=float)
    error = np.sqrt((single.stderr.astype(float) ** 2).sum((0, 1))) / single.stderr[..., 0].size / A
    assert error.max() < 5e-4
    np.testing.assert_allclose(E, A, rtol=2e-3)
    assert law.sigma_s.max() < law.water.sigma_s.max()


def blocks(values):
    height, width = (n // 8 * 8 for n in values.shape[:2])
    return values[:height, :width].reshape(height // 8, 8, width // 8, 8, -1).mean((1, 3), dtype=float)


@pytest.fixture(scope="module")
def seeds():
    """Blocks of S and E, and of what bodies let pass, [seed, row, column, channel]."""
    scene = snow_scene(
        {"resolution": [32, 24], "sensor_mm": [8, 6]},
        {"radius_m": [4e-4, 1.2e-3]},
        lights=[LAMP | {"position": [0.6, -0.2, 0.3], "direction": [-0.3, 1, -0.1], "cone_deg": 170}],
    )
    renderer, found = FrameRenderer(scene, "cpu"), []
    for seed in range(SEEDS):
        renderer.snow.scene = scene.model_copy(update={"seed": 100 + seed})
        n = renderer.render(np.eye(4), outputs="N", seed=seed).N
        found.append((blocks(n.light), blocks((n.light - n.added) / n.passed[..., None]), blocks(n.passed[..., None])))
    return tuple(map(np.array, zip(*found, strict=True)))


def test_the_mean_over_seeds_is_what_is_taken_out(seeds):
    """Of every block of 8 x 8 pixels, within 4 standard errors, and of the frame."""
    off = seeds[0] - seeds[1]
    z = off.mean(0) / (off.std(0, ddof=1) / np.sqrt(SEEDS))
    frames = off.mean((1, 2, 3))
    assert abs(frames.mean()) < 3 * frames.std(ddof=1) / np.sqrt(SEEDS)
    assert frames.std(ddof=1) / np.sqrt(SEEDS) < 0.07 * seeds[1].mean()  # so a bias of a fifth would show, no less
    assert np.abs(z).max() < 4


def test_bodies_let_pass_in_the_mean_what_they_let_pass_of_the_frame(seeds):
    """Of the frame: a single block of so few seeds hardly ever has a large body close by."""
    frames = seeds[2].mean((1, 2, 3)) - 1
    assert abs(frames.mean()) < 3 * frames.std(ddof=1) / np.sqrt(SEEDS)


# ------------------------------------------------------------------------------------------------- what never changes

SMALL = {"resolution": [24, 16], "sensor_mm": [6, 4]}


def test_denoising_never_touches_the_bodies():
    """Denoised with bodies is what they make of the denoised image without."""
    renderer = FrameRenderer(snow_scene(SMALL), "cpu")
    how = {"outputs": "A", "integrator": "path", "spp": 4, "denoise": "nlm"}
    with_snow, without = (renderer.render(np.eye(4), **how, snow=snow).A for snow in (True, False))
    snow = with_snow.snow
    np.testing.assert_allclose(with_snow.denoised, np.maximum(snow.over(without.denoised), 0.0), rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(with_snow.radiance, snow.over(without.radiance))
    assert np.abs(snow.added).max() > 0


def test_images_that_are_done_have_the_same_bodies_to_the_byte():
    """Laid over on the device, as for a run on a GPU, or on the host, where more is kept."""
    renderer, how = FrameRenderer(snow_scene(SMALL), "cpu"), {"outputs": "A", "integrator": "path", "spp": 4}
    whole = renderer.render(np.eye(4), **how, denoise="none").A
    done = renderer.render(np.eye(4), **how, denoise="none", copied=["radiance", "denoised"]).A
    assert (done.snow, done.stderr) == (None, None)
    np.testing.assert_array_equal(done.radiance, whole.radiance)
    np.testing.assert_array_equal(done.denoised, whole.denoised)
    assert np.abs(whole.layers["snow"]).max() > 0


def test_without_bodies_an_image_has_the_bytes_of_a_scene_without_particles():
    how = {"outputs": "A", "integrator": "path", "spp": 4, "denoise": "nlm"}
    none = (
        FrameRenderer(snow_scene(SMALL, water=WATER, particles=None).model_copy(update={"particles": ()}), "cpu")
        .render(np.eye(4), **how)
        .A
    )
    off = FrameRenderer(snow_scene(SMALL), "cpu").render(np.eye(4), **how, snow=False).A
    for name in ("radiance", "stderr", "denoised"):
        assert np.array_equal(getattr(none, name), getattr(off, name)), name


def test_threads_do_not_change_a_byte():
    one, two = (FrameRenderer(snow_scene(), "cpu", threads=n).render(np.eye(4), outputs="N").N for n in (1, 2))
    for name in ("added", "light", "passed", "coverage"):
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


@pytest.mark.gpu
def test_a_gpu_sees_the_bodies_of_a_cpu():
    """Up to float32: images of bodies move by thousandths of a pixel, whose shares of light change as much."""
    scene = snow_scene({"exposure": {"time_s": 0.02, "readout_s": 0.01}}, {"share": 0.008})
    cpu, gpu = (FrameRenderer(scene, device).render(np.eye(4), outputs="N").N for device in ("cpu", "cuda:0"))
    assert np.abs(gpu.light - cpu.light).sum(dtype=float) < 1e-3 * cpu.light.sum(dtype=float)
    expected = [(snow.light - snow.added) / snow.passed[..., None] for snow in (cpu, gpu)]
    np.testing.assert_allclose(expected[1], expected[0], atol=1e-4 * expected[0].max())
    np.testing.assert_allclose(gpu.passed, cpu.passed, atol=2e-3)
