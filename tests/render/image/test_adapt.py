"""Adaptive sampling: no bias, as many samples as asked, and few where there is little noise."""

import numpy as np
import pytest
import warp as wp
from physics.rig import VAROS_LAMPS, VAROS_WATER
from spread import evenly

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.film.adapt import DARK
from varos_warp.render import radiance
from varos_warp.render.image import adapt
from varos_warp.render.image.adapt import MOST_SHARED, brightness
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.render import MOST_SPP
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

FIRST, SPP, TILES = 4, 16, (12, 16)
RARE = 0.02
CPU = Launcher("cpu")


def other_noise(mean, variance):
    """Of arrays [kind, side, rows, columns, 3], or with one channel for all."""
    shape = np.broadcast_shapes(mean.shape, (3,))
    tiles = [wp.array(np.broadcast_to(values, shape), dtype=wp.vec3d, device="cpu") for values in (mean, variance)]
    return adapt.other_noise(CPU, *tiles).numpy()


def share_out(noise, taken, spp, cost):
    """Of numbers for each kind."""
    on_device = wp.array(noise, dtype=wp.float64, device="cpu")
    return adapt.share_out(CPU, on_device, *map(np.atleast_1d, (taken, spp, cost))).numpy()


def sides(rng, count):
    """Mean and variance of one sample of the tiles, [side, rows, columns, 1], from 16 pixels of ``count`` samples."""
    hits = rng.binomial(count, RARE, (2, *TILES, 16))
    mean = hits / RARE / count
    variance = (hits / RARE**2 - count * mean**2) / (count - 1)
    return hits, mean.mean(-1)[..., None], variance.mean(-1)[..., None]


def trial(rng, own):
    """Mean of the image when the number of samples of a side follows from the other, or (wrongly) from its own."""
    hits, mean, variance = sides(rng, FIRST)
    noise = other_noise(mean[None, ::-1], variance[None, ::-1]) if own else other_noise(mean[None], variance[None])
    more = share_out(noise, 4 * FIRST, SPP, 1.0)[0] // 4
    total = hits + rng.binomial(more[..., None], RARE)
    return (total / RARE / (FIRST + more)[..., None]).mean()


def test_the_mean_is_unbiased_and_would_not_be_if_a_side_decided_for_itself():
    """2400 images of 6144 pixels with rare bright samples: 4 standard errors, and the naive way misses by far more."""
    rng = np.random.default_rng(5)
    for own in (False, True):
        means = np.array([trial(rng, own) for _ in range(2400)])
        sigmas = abs(means.mean() - 1.0) / (means.std(ddof=1) / np.sqrt(len(means)))
        assert (sigmas > 20.0) if own else (sigmas < 4.0)


def uneven():
    """Mean and variance of 30 x 30 tiles: a third 100 times as noisy as the next, a third without noise."""
    mean, variance = np.full((1, 2, 30, 30, 3), 2.0), np.full((1, 2, 30, 30, 3), 4.0 * 0.01)
    variance[:, :, :10] *= 100.0
    variance[:, :, 20:] = 0.0
    return mean, variance


def test_samples_are_shared_out_in_proportion_to_the_deviation():
    """As many as asked on average, ten times as many where the deviation is ten times as large, within the limits."""
    noise = other_noise(*uneven())
    count = share_out(noise, 8, 40.0, 1.0)[0] / 4 + 2
    assert count.mean() == pytest.approx(40.0, abs=1.0)
    assert np.all(count[:, 22:] == 2)
    assert np.all(np.abs(count[:, :9] - 10.0 * count[:, 14:18].mean()) <= 10.0)
    noise[:, :, 0, 0] = 1e9
    count = share_out(noise, 8, 40.0, 1.0)[0] / 4 + 2
    assert count.max() == MOST_SHARED * 40
    assert count.mean() == pytest.approx(40.0, abs=1.0)
    assert not share_out(np.zeros((1, 2, 3, 4)), 8, 40.0, 1.0).any()


@pytest.mark.parametrize("spp", [0.3, 0.5, 1.0, 1.25])
def test_below_one_sample_a_pixel_blocks_take_whole_numbers_and_as_many_as_asked(spp):
    """Quiet tiles have one of four pixels; whole samples of a pixel follow one of each."""
    mean, variance = uneven()
    of_block = share_out(other_noise(mean, variance), 1, spp, 1.0)[0] + 1
    assert of_block.mean() / 4 == pytest.approx(spp, rel=0.02)
    assert np.all(of_block[:, 22:] == 1)
    assert np.all((of_block <= 4) | (of_block % 4 == 0))
    assert len(np.unique(of_block)) > 1


def test_the_most_samples_that_may_be_asked_for_are_counted():
    """By 32 bits, though a few tiles take many times their even share."""
    noise = np.full((2, 2, 10, 10), 1e-6)
    noise[0, :, 0, 0] = 1e3
    more = share_out(noise, [8, 1], [4.0 * MOST_SPP, 1.0 * MOST_SPP], [0.13, 1.0])
    assert more.min() >= 0


def test_the_share_of_a_side_does_not_follow_from_its_own_samples():
    mean, variance = uneven()
    changed = variance.copy()
    changed[:, 0] *= np.linspace(0.5, 2.0, 30)[:, None]
    before, after = (share_out(other_noise(mean, v), 8, 40.0, 1.0)[0] for v in (variance, changed))
    assert np.array_equal(before[0], after[0])
    assert not np.array_equal(before[1], after[1])


def test_noise_is_that_of_the_worst_channel_beside_the_mean_of_the_image_where_that_is_not_dark():
    """Seen by the other side, and no less than the mean of the tiles around."""
    mean = np.broadcast_to([1.0, 0.5, 0.01], (1, 2, 4, 5, 3)).copy()
    mean[:, 1] *= 2.0
    variance = np.zeros(mean.shape)
    variance[0, 0, 1, 2] = [1.0, 1.0, 0.2]  # over 1, 0.25 and DARK^2
    variance[0, 1, 3, 4] = [1.0, 0.0, 0.0]  # a corner, which counts four times
    noise = other_noise(mean, variance)[0]
    assert noise[1, 1, 2] == pytest.approx(0.2 / DARK**2)
    around = noise[1, :3, 1:4].copy()
    around[1, 1] = around[0, 0]
    np.testing.assert_allclose(around, 0.2 / DARK**2 / 9)
    assert noise[0, 3, 4] == pytest.approx(0.25)
    assert noise[0, 2, 3] == pytest.approx(0.25 / 9)
    assert noise[0, 3, 3] == pytest.approx(0.25 * 2 / 9)
    assert np.count_nonzero(noise[0]) == 4
    assert np.count_nonzero(noise[1]) == 9


def test_a_dark_channel_does_not_rule_and_black_images_need_nothing():
    np.testing.assert_array_equal(brightness(np.array([1.0, 0.5, 0.01])), [1.0, 0.5, DARK])
    black = np.zeros((1, 2, 3, 3, 3))
    assert not share_out(other_noise(black, black), 16, 64, 1.0).any()


def test_cheap_samples_are_many():
    """Of two kinds that are as noisy, one of a hundredth of the cost: ten times as many, for as much work as asked."""
    noise, spp, cost = np.full((2, 2, 6, 8), 0.01), np.array([4.0, 16.0]), np.array([0.01, 1.0])
    count = share_out(noise, [8, 8], spp, cost) / 4 + 2
    assert count[0].mean() == pytest.approx(10.0 * count[1].mean(), rel=0.02)
    assert count.mean((1, 2, 3)) @ cost == pytest.approx(spp @ cost, rel=0.02)


# --------------------------------------------------------------------------------------------------------- an image


def plate(name, half, z, material):
    corners = np.array([[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]])
    return Part(name, corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material)


@pytest.fixture(scope="module")
def bright_spot():
    """A dark floor with a small white plate under a lamp, with the field: most noise is in a few tiles."""
    view = {"resolution": [64, 48], "rotation_euler_deg": [-90, 0, 0]}
    lamps = [VAROS_LAMPS[0] | {"position": [0.3, 0.0, 0.0], "direction": [0, 0, -1]}]
    water = VAROS_WATER | {"phase": {"g": 0.8}}
    scene = Scene(
        water={"coefficients": water},
        vehicle={"lights": lamps, "cameras": [view]},
        trajectory={"poses": [{"position": [0, 0, 0]}]},
        render={"denoise": "none", "integrator": "field"},
    )

    return FrameRenderer(
        scene,
        "cpu",
        parts=[
            plate("floor", 9.0, -2.0, Diffuse(reflectance=[0.05] * 3)),
            plate("plate", 0.11, -1.4, Diffuse(reflectance=[0.9] * 3)),
        ],
    )


@pytest.fixture(scope="module")
def shared(bright_spot):
    """12 images whose samples are where the noise is."""
    return [bright_spot.render(np.eye(4), outputs="A", spp=12, seed=k).A for k in range(12)]


def test_the_field_takes_as_many_samples_as_asked_with_less_error_than_an_even_share(bright_spot, shared, monkeypatch):
    """And the same mean as 8 images with an even share: 4 standard errors of what they differ by."""
    assert all(image.spp == pytest.approx(12.0, abs=0.5) for image in shared)
    monkeypatch.setattr(radiance, "share_out", evenly)
    even = [bright_spot.render(np.eye(4), outputs="A", spp=12, seed=100 + k).A for k in range(8)]
    shared, even = (np.array([image.radiance for image in kind], float) for kind in (shared, even))
    assert shared.var(axis=0, ddof=1).mean() < 0.6 * even.var(axis=0, ddof=1).mean()
    means = [kind.mean((1, 2)) for kind in (shared, even)]
    error = np.sqrt(sum(mean.var(axis=0, ddof=1) / len(mean) for mean in means))
    assert np.all(np.abs(means[0].mean(0) - means[1].mean(0)) < 4.0 * error)


@pytest.mark.parametrize("resolution", [(1, 1), (2, 1), (9, 3)])
def test_images_smaller_than_a_tile_have_samples_too(bright_spot, resolution):
    camera = bright_spot.scene.vehicle.cameras[0].model_copy(update={"resolution": resolution})
    image = bright_spot.render(np.eye(4), camera, "A", spp=16).A
    assert np.isfinite(image.radiance).all()
    assert image.spp >= (16 if resolution == (1, 1) else 2)


def test_the_standard_error_is_that_of_the_spread_between_images(shared):
    """Mean square over pixels and 12 images; its own spread with heavy tails is about 10 %."""
    found = np.mean([np.square(image.stderr, dtype=float) for image in shared])
    assert np.mean(np.var([image.radiance.astype(float) for image in shared], axis=0, ddof=1)) == pytest.approx(
        found, rel=0.3
    )
