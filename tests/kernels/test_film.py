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
    spp = samples.shape[1]
    strata = film.squares.shape[0]
    sums = kernel.Sums()
    for i in range(kernel.first_sample(stratum, strata, spp), kernel.first_sample(stratum + 1, strata, spp)):
        direct, single = samples[0, i, row, col], samples[1, i, row, col]
        sums = kernel.add_sample(sums, direct, single, samples[2, i, row, col], samples[3, i, row, col])
    kernel.store(film, stratum, row, col, sums)


def develop(samples, strata):
    """direct, single, multiple, residual, radiance, stderr [H, W, 3] of samples [layer, sample, H, W, 3]."""
    spp, shape = samples.shape[1], samples.shape[2:4]
    film = kernel.Film()
    for name in (*LAYERS, "squares"):
        setattr(film, name, wp.zeros((strata, *shape), dtype=wp.vec3d, device="cpu"))
    device_samples = wp.array(samples.astype(np.float32), dtype=wp.vec3, device="cpu")
    wp.launch(expose, dim=(strata, *shape), inputs=[device_samples, film], device="cpu")
    out = [wp.empty(shape, dtype=wp.vec3, device="cpu") for _ in range(6)]
    wp.launch(kernel.develop, dim=shape, inputs=[film, spp, 0], outputs=out, device="cpu")
    return [image.numpy() for image in out]


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
