"""Film: sums in parts, and the mean and standard error that they develop to, against numpy."""

import numpy as np
import pytest
import warp as wp
from chance import run

from varos_warp.kernels import film as kernel

LAYERS = ("direct", "single", "glow", "veil")


@wp.kernel(enable_backward=False)
def expose(samples: wp.array4d(dtype=wp.vec3), film: kernel.Film):
    """Sums as the path tracers keep them; samples [layer, sample, height, width]."""
    stratum, row, col = wp.tid()
    sums = kernel.Sums()
    for i in range(kernel.first_of(film, stratum, row, col), kernel.end_of(film, stratum, row, col)):
        direct, single = samples[0, i, row, col], samples[1, i, row, col]
        sums = kernel.add_sample(sums, direct, single, samples[2, i, row, col], samples[3, i, row, col])
    kernel.store(film, stratum, row, col, sums)


def exposed(samples, strata, takes, sides=1):
    """Film of samples [layer, sample, H, W, 3], of which each side's tiles take so many more, take by take."""
    shape, tiles = samples.shape[2:4], tuple(-(-side // int(kernel.TILE)) for side in samples.shape[2:4])
    film = kernel.Film()
    for name in (*LAYERS, "squares"):
        setattr(film, name, wp.zeros((strata, *shape), dtype=wp.vec3d, device="cpu"))
    film.count, film.wanted = (wp.zeros((sides, *tiles), dtype=int, device="cpu") for _ in "cw")
    film.begin, film.end = (wp.zeros((strata, sides, *tiles), dtype=int, device="cpu") for _ in range(2))
    film.lost = wp.zeros(1, dtype=int, device="cpu")
    device_samples = wp.array(samples.astype(np.float32), dtype=wp.vec3, device="cpu")
    for k, take in enumerate(takes):
        film.wanted.assign(np.broadcast_to(np.int32(take), film.count.shape))
        used = strata if k == 0 else max(1, strata // 2)  # a launch may leave some strata out
        wp.launch(kernel.share_samples, dim=film.count.shape, inputs=[used, film], device="cpu")
        wp.launch(expose, dim=(used, *shape), inputs=[device_samples, film], device="cpu")
    return film


def developed(film):
    """direct, single, multiple, residual, radiance, stderr [H, W, 3]; without metal no variance of it is known."""
    shape = film.squares.shape[1:]
    out = [wp.empty(shape, dtype=wp.vec3, device="cpu") for _ in range(7)]
    wp.launch(kernel.develop, dim=shape, inputs=[film], outputs=out, device="cpu")
    *layers, metal_variance, radiance, stderr = (image.numpy() for image in out)
    assert (metal_variance < 0.0).all()
    return [*layers, radiance, stderr]


def develop(samples, strata):
    """Of samples [layer, sample, H, W, 3], all taken at once."""
    return developed(exposed(samples, strata, [samples.shape[1]]))


def samples_of(kind, spp, seed=1):
    rng = np.random.default_rng(seed)
    shape = (4, spp, 3, 4, 3)
    if kind == "heavy tail":
        return rng.pareto(1.5, shape)
    if kind == "small spread on a large mean":
        return 1e4 + rng.normal(size=shape)
    if kind == "faint":
        return 1e-12 * rng.random(shape)
    return rng.random(shape)


@pytest.mark.parametrize("kind", ["uniform", "heavy tail", "small spread on a large mean", "faint"])
@pytest.mark.parametrize(("spp", "strata"), [(1000, 1), (1000, 7), (1000, 1000), (37, 5), (13, 12), (2, 2), (2, 1)])
def test_mean_and_standard_error_are_those_of_all_samples(kind, spp, strata):
    """In parts of uneven size, too: against numpy in float64."""
    samples = np.float32(samples_of(kind, spp)).astype(float)
    direct, single, multiple, residual, radiance, stderr = develop(samples, strata)
    total, means = samples.sum(axis=0), samples.mean(axis=1)
    for layer, truth in zip((direct, single, multiple), (means[0], means[1], means[2] + means[3]), strict=True):
        np.testing.assert_allclose(layer, truth, rtol=1e-7, atol=1e-7 * multiple.max())
    assert not residual.any()
    np.testing.assert_allclose(radiance, total.mean(axis=0), rtol=3e-7)
    np.testing.assert_allclose(stderr, total.std(axis=0, ddof=1) / np.sqrt(spp), rtol=1e-6)


def test_the_mean_does_not_stall_however_many_samples_there_are():
    """A million samples of which few are bright: in float32 the many dark ones would no longer move a running mean."""
    rng = np.random.default_rng(2)
    samples = np.zeros((4, 1_000_000, 1, 1, 3), np.float32)
    samples[0] = 1e-3 * rng.pareto(1.8, samples.shape[1:])
    radiance, stderr = develop(samples, 1)[4:]
    total = samples[0].astype(float)
    np.testing.assert_allclose(radiance[0, 0], total.mean(axis=(0, 1, 2)), rtol=1e-6)
    np.testing.assert_allclose(stderr[0, 0], total.std(axis=(0, 1, 2), ddof=1) / 1e3, rtol=1e-6)


@wp.kernel(enable_backward=False)
def start(stratum: wp.array(dtype=int), strata: int, spp: int, first: wp.array(dtype=int)):
    i = wp.tid()
    first[i] = kernel.first_sample(stratum[i], strata, spp)


@pytest.mark.parametrize(("strata", "spp"), [(7, 1000), (1000, 1000), (524_288, 2_000_000), (3, 2**31 - 2)])
def test_strata_share_the_samples_evenly_and_without_gaps(strata, spp):
    first = run(start, [np.arange(strata + 1, dtype=np.int32), strata, spp], [int])
    assert np.array_equal(first, np.arange(strata + 1, dtype=np.int64) * spp // strata)


def test_layers_sum_to_the_radiance():
    direct, single, multiple, _, radiance, _ = develop(samples_of("heavy tail", 50), 3)
    assert np.array_equal(direct + single + multiple, radiance)


def test_equal_samples_have_no_error():
    radiance, stderr = develop(np.full((4, 64, 2, 2, 3), 0.25), 5)[4:]
    assert np.all(radiance == 1.0)
    assert np.all(stderr == 0.0)


def test_one_sample_has_an_unknown_error_not_a_small_one():
    radiance, stderr = develop(samples_of("uniform", 1), 1)[4:]
    assert np.isfinite(radiance).all()
    assert np.all(np.isinf(stderr))


def test_the_two_sides_of_tiles_may_take_unlike_numbers_of_samples():
    """3 x 4 pixels are one tile, 9 x 17 six; three takes in a row, different in every tile and side."""
    rng = np.random.default_rng(3)
    samples = rng.pareto(1.5, (4, 60, 9, 17, 3))
    takes = [np.full((2, 2, 3), 8), rng.integers(0, 20, (2, 2, 3)), rng.integers(0, 20, (2, 2, 3))]
    *_, radiance, stderr = developed(exposed(samples, 6, takes, sides=2))
    counts = np.sum(takes, axis=0)
    light = np.float32(samples).astype(float).sum(axis=0)
    for row, col in ((0, 0), (7, 8), (8, 7), (8, 16), (0, 1)):
        taken = light[:counts[(row + col) % 2, row // 8, col // 8], row, col]
        np.testing.assert_allclose(radiance[row, col], taken.mean(0), rtol=1e-6)
        np.testing.assert_allclose(stderr[row, col], taken.std(axis=0, ddof=1) / np.sqrt(len(taken)), rtol=1e-6)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_numbers_are_counted_and_black(bad):
    samples = samples_of("uniform", 10)
    samples[1, 3, 0, 2, 1] = bad
    samples[2, 7, 2, 0, 0] = bad
    film = exposed(samples, 2, [10])
    samples[:, 3, 0, 2] = samples[:, 7, 2, 0] = 0.0
    radiance = developed(film)[4]
    assert film.lost.numpy()[0] == 2
    np.testing.assert_allclose(radiance, samples.sum(axis=0).mean(axis=0), rtol=1e-6)
