"""Adaptive sampling: no bias, the tolerance kept, and few samples where there is little noise."""

import numpy as np
import pytest

from varos_warp.render import frame, residual
from varos_warp.render.adapt import (
    DARK,
    MOST_SHARED,
    MOST_SHARED_RESIDUAL,
    brightness,
    first_samples,
    more_samples,
    other_noise,
    share_out,
)
from varos_warp.render.frame import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse, Metal
from varos_warp.scene.geometry import Part

FIRST, SPP, TILES = 4, 64, (12, 16)
RARE = 0.02
RULES = {"to a tolerance": lambda noise: more_samples(noise, FIRST, 1.4, SPP),
         "shared out": lambda noise: share_out(noise, FIRST, SPP / 4)}


def sides(rng, count):
    """Mean and variance of one sample of the tiles, [side, rows, columns, 1], from 16 pixels of ``count`` samples."""
    hits = rng.binomial(count, RARE, (2, *TILES, 16))
    mean = hits / RARE / count
    variance = (hits / RARE**2 - count * mean**2) / (count - 1)
    return hits, mean.mean(-1)[..., None], variance.mean(-1)[..., None]


def trial(rng, rule, own):
    """Mean of the image when the number of samples of a side follows from the other, or (wrongly) from its own."""
    hits, mean, variance = sides(rng, FIRST)
    more = rule(other_noise(mean[::-1], variance[::-1]) if own else other_noise(mean, variance))
    total = hits + rng.binomial(more[..., None], RARE)
    return (total / RARE / (FIRST + more)[..., None]).mean()


@pytest.mark.parametrize("rule", RULES.values(), ids=RULES)
def test_the_mean_is_unbiased_and_would_not_be_if_a_side_decided_for_itself(rule):
    """2400 images of 6144 pixels with rare bright samples: 4 standard errors, and the naive way misses by far more."""
    rng = np.random.default_rng(5)
    for own in (False, True):
        means = np.array([trial(rng, rule, own) for _ in range(2400)])
        sigmas = abs(means.mean() - 1.0) / (means.std(ddof=1) / np.sqrt(len(means)))
        assert (sigmas > 20.0) if own else (sigmas < 4.0)


def uneven():
    """Mean and variance of 30 x 30 tiles: a third 100 times as noisy as the next, a third without noise."""
    mean, variance = np.full((2, 30, 30, 3), 2.0), np.full((2, 30, 30, 3), 4.0 * 0.01)
    variance[:, :10] *= 100.0
    variance[:, 20:] = 0.0
    return mean, variance


def test_tiles_get_the_samples_that_their_noise_needs():
    """Known variances: N = v / (tolerance mean)^2, within the limits."""
    noise = other_noise(*uneven())
    more = more_samples(noise, 8, 0.05, 400) + 8
    assert np.all(more[:, :9] == 400)
    assert np.all(more[:, 12:19] == 8)
    assert np.all(more[:, 22:] == 8)
    assert more_samples(noise, 8, 0.01, 400).max() + 8 == 1600  # four times 400


def test_samples_are_shared_out_in_proportion_to_the_deviation():
    """As many as asked on average, ten times as many where the deviation is ten times as large, within the limits."""
    noise = other_noise(*uneven())
    count = share_out(noise, 2, 40.0) + 2
    assert count.mean() == pytest.approx(40.0, abs=1.0)
    assert np.all(count[:, 22:] == 2)
    assert np.all(np.abs(count[:, :9] - 10.0 * count[:, 14:18].mean()) <= 10.0)
    noise[:, 0, 0] = 1e9
    count = share_out(noise, 2, 40.0) + 2
    assert count.max() == MOST_SHARED * 40
    fewer = share_out(noise, 2, 40.0, most_shared=MOST_SHARED_RESIDUAL) + 2
    assert fewer.max() == MOST_SHARED_RESIDUAL * 40
    assert count.mean() == pytest.approx(40.0, abs=1.0)
    assert not share_out(np.zeros((2, 3, 4)), 2, 40.0).any()


def test_the_share_of_a_side_does_not_follow_from_its_own_samples():
    mean, variance = uneven()
    changed = variance.copy()
    changed[0] *= np.linspace(0.5, 2.0, 30)[:, None]
    before, after = (share_out(other_noise(mean, v), 2, 40.0) for v in (variance, changed))
    assert np.array_equal(before[0], after[0])
    assert not np.array_equal(before[1], after[1])


def test_a_dark_channel_does_not_rule_and_black_images_need_nothing():
    np.testing.assert_array_equal(brightness(np.array([1.0, 0.5, 0.01])), [1.0, 0.5, DARK])
    black = np.zeros((2, 3, 3, 3))
    assert not more_samples(other_noise(black, black), 4, 0.01, 64).any()


# --------------------------------------------------------------------------------------------------------- an image


@pytest.fixture(scope="module")
def renderer():
    """Half a floor in turbid water: one side of the image is noisier than the other; paths only."""
    water = {"sigma_s": [0.05, 0.1, 0.2], "sigma_a": [0.1, 0.05, 0.05], "phase": {"g": 0.8}}
    view = {"resolution": [40, 28], "rotation_euler_deg": [-35, 0, 0]}
    lamps = [{"kind": "spot", "position": [x, -0.1, 0.0], "cone_deg": 65} for x in (-0.15, 0.15)]
    scene = Scene(water={"coefficients": water}, vehicle={"lights": lamps, "cameras": [view]},
                  trajectory={"poses": [{"position": [0, 0, 0]}]}, render={"denoise": "none", "integrator": "path"})
    corners = np.array([[-9.0, -9, -1.5], [0.2, -9, -1.5], [0.2, 9, -1.5], [-9, 9, -1.5]])
    floor = Part("floor", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse(reflectance=[0.4] * 3))
    return FrameRenderer(scene, "cpu", parts=[floor])


def test_an_image_keeps_its_tolerance_with_fewer_samples_and_the_same_mean(renderer):
    """Against 2048 samples: RMSE within the tolerance, the mean of 12 images within 4 standard errors of it."""
    tolerance, spp = 0.3, 256
    truth = renderer.render(np.eye(4), outputs="A", spp=2048, seed=7).A
    images = [renderer.render(np.eye(4), outputs="A", spp=spp, tolerance=tolerance, seed=100 + k).A for k in range(12)]
    level = brightness(truth.radiance.astype(float).mean((0, 1)))
    errors = [np.sqrt(np.mean((image.radiance - truth.radiance) ** 2, axis=(0, 1))) / level for image in images]
    assert np.mean(errors, axis=0).max() < tolerance
    assert all(first_samples(spp) <= image.spp < 0.95 * spp for image in images)
    means = np.array([image.radiance.astype(float).mean((0, 1)) for image in images])
    spread = np.sqrt(means.var(axis=0, ddof=1) / len(means) + np.square(truth.stderr, dtype=float).mean((0, 1)) / 1120)
    assert np.all(np.abs(means.mean(0) - truth.radiance.astype(float).mean((0, 1))) < 4.0 * spread)


def test_the_standard_error_is_that_of_the_spread_between_images(renderer):
    """Mean square over pixels and 12 images; its own spread with heavy tails is about 10 %."""
    images = [renderer.render(np.eye(4), outputs="A", spp=64, tolerance=0.3, seed=200 + k).A for k in range(12)]
    found = np.mean([np.square(image.stderr, dtype=float) for image in images])
    assert np.mean(np.var([image.radiance.astype(float) for image in images], axis=0, ddof=1)) == pytest.approx(
        found, rel=0.3)


# ------------------------------------------------------------------------------------------------------------- tables


def plate(name, half, z, material):
    corners = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    return Part(name, corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material)


@pytest.fixture(scope="module")
def bright_spot():
    """A dark floor with a small white plate under a lamp, by tables: most noise is in a few tiles."""
    view = {"resolution": [96, 64], "rotation_euler_deg": [-90, 0, 0]}
    lamps = [{"kind": "spot", "position": [0.3, 0.0, 0.0], "direction": [0, 0, -1], "cone_deg": 65}]
    water = {"sigma_s": [0.002, 0.02, 0.04], "sigma_a": [0.1, 0.04, 0.01], "phase": {"g": 0.8}}
    scene = Scene(water={"coefficients": water}, vehicle={"lights": lamps, "cameras": [view]},
                  trajectory={"poses": [{"position": [0, 0, 0]}]}, render={"denoise": "none", "integrator": "tables"})

    return FrameRenderer(scene, "cpu", parts=[plate("floor", 9.0, -2.0, Diffuse(reflectance=[0.05] * 3)),
                                              plate("plate", 0.11, -1.4, Diffuse(reflectance=[0.9] * 3))])


def test_tables_take_as_many_samples_as_asked_with_less_error_than_an_even_share(bright_spot, monkeypatch):
    """And the same mean: 12 images of each kind, 4 standard errors of what they differ by."""
    def images(seed):
        return [bright_spot.render(np.eye(4), outputs="A", spp=12, seed=seed + k).A for k in range(12)]

    shared = images(0)
    assert all(image.spp == pytest.approx(12.0, abs=0.5) for image in shared)
    monkeypatch.setattr(frame, "share_out",
                        lambda noise, taken, spp, cost=1.0, most_shared=0: np.full(noise.shape, round(spp) - taken))
    even = images(100)
    shared, even = (np.array([image.radiance for image in kind], float) for kind in (shared, even))
    assert shared.var(axis=0, ddof=1).mean() < 0.6 * even.var(axis=0, ddof=1).mean()
    means = [kind.mean((1, 2)) for kind in (shared, even)]
    error = np.sqrt(sum(mean.var(axis=0, ddof=1) / len(mean) for mean in means))
    assert np.all(np.abs(means[0].mean(0) - means[1].mean(0)) < 4.0 * error)


@pytest.mark.parametrize("listed", [7000, 1000])
def test_samples_of_the_residual_are_each_taken_once_whatever_the_batches(bright_spot, monkeypatch, listed):
    """Bytes do not depend on how many walks are under way at a time."""
    expected = bright_spot.render(np.eye(4), outputs="A", spp=16, seed=3).A
    monkeypatch.setattr(residual, "MOST_STARTS", {"cpu": listed})
    monkeypatch.setattr(residual, "MOST_LISTED", 2 * 96 * 64)
    found = bright_spot.render(np.eye(4), outputs="A", spp=16, seed=3).A
    assert np.array_equal(found.radiance, expected.radiance)


@pytest.mark.parametrize("resolution", [(1, 1), (2, 1), (9, 3)])
def test_images_smaller_than_a_tile_have_samples_too(bright_spot, resolution):
    camera = bright_spot.scene.vehicle.cameras[0].model_copy(update={"resolution": resolution})
    image = bright_spot.render(np.eye(4), camera, "A", spp=16).A
    assert np.isfinite(image.radiance).all()
    assert image.spp >= (16 if resolution == (1, 1) else 2)


def plate_on_a_floor(half: float) -> FrameRenderer:
    """A bare metal plate, so wide to each side, on a floor under a lamp."""
    view = {"resolution": [48, 32], "rotation_euler_deg": [-90, 0, 0]}
    lamps = [{"kind": "spot", "position": [0.3, 0.0, 0.0], "direction": [0, 0, -1], "cone_deg": 65}]
    water = {"sigma_s": [0.002, 0.02, 0.04], "sigma_a": [0.1, 0.04, 0.01], "phase": {"g": 0.8}}
    scene = Scene(water={"coefficients": water}, vehicle={"lights": lamps, "cameras": [view]},
                  trajectory={"poses": [{"position": [0, 0, 0]}]}, render={"integrator": "tables"})

    parts = [plate("floor", 9.0, -2.0, Diffuse(reflectance=[0.3] * 3)),
             plate("plate", half, -1.4, Metal(kind="metal", base=[0.6, 0.6, 0.6], roughness=0.4))]
    return FrameRenderer(scene, "cpu", parts=parts)


def test_metal_gets_more_samples_where_the_residual_is_denoised_without_bias():
    """24 images of each kind: the same mean; metal has far less variance (a third, measured, and 5 % uncertain)."""
    renderer = plate_on_a_floor(0.08)
    metal = renderer.render(np.eye(4), outputs="S").S.instance == 2
    assert 0.01 < metal.mean() < 0.1
    plain, denoised = (np.array([renderer.render(np.eye(4), outputs="A", spp=24, seed=50 * k + i,
                                                 denoise=method).A.residual
                                 for i in range(24)], float) for k, method in enumerate(("none", "oidn")))
    for where in (metal, ~metal):
        means = [images[:, where].mean(1) for images in (plain, denoised)]
        error = np.sqrt(sum(mean.var(axis=0, ddof=1) / len(mean) for mean in means))
        assert np.all(np.abs(means[0].mean(0) - means[1].mean(0)) < 4.0 * error)
    assert denoised[:, metal].var(axis=0, ddof=1).mean() < 0.6 * plain[:, metal].var(axis=0, ddof=1).mean()


@pytest.mark.parametrize("half", [0.2, 0.8, 9.0])
def test_images_with_metal_have_no_more_samples_of_the_residual_than_planned(monkeypatch, half):
    """Within the rounding of each tile's number; some metal, mostly metal, nothing else."""
    taken, glow = [], residual.Residual._glow

    def counted(self, view, camera, level, places, points):
        taken.append(places.shape[0])
        return glow(self, view, camera, level, places, points)

    monkeypatch.setattr(residual.Residual, "_glow", counted)
    renderer = plate_on_a_floor(half)
    for spp in (8, 24):
        taken.clear()
        renderer.render(np.eye(4), outputs="A", spp=spp, denoise="oidn")
        planned = 1.0 + (spp - 2) / frame.PIXEL_SAMPLES_DENOISED
        assert sum(taken) / (48 * 32) == pytest.approx(planned, rel=0.15)
        assert len(taken) == 2  # some are left to be shared out


def test_shares_cost_as_much_as_there_is_to_spend():
    """And a costly tile gets fewer, by the root of what one costs."""
    noise, cost = np.ones((2, 30, 40)), np.ones((2, 30, 40))
    cost[:, :, 20:] = 4.0
    shares = 2 + share_out(noise, 2, 20.0, cost)
    assert (cost * shares).mean() == pytest.approx(20.0, rel=0.01)
    assert shares[..., :20].mean() == pytest.approx(2.0 * shares[..., 20:].mean(), rel=0.02)
