"""Film: running and merged means and variances are those of all samples together."""

import numpy as np
import pytest
import warp as wp

from varos_warp.kernels import film as kernel

LAYERS = ("direct", "single", "multiple")


@wp.kernel(enable_backward=False)
def expose(samples: wp.array4d(dtype=wp.vec3), film: kernel.Film):
    """A running mean as the path tracers keep it; samples [layer, sample, height, width]."""
    stratum, row, col = wp.tid()
    spp = samples.shape[1]
    strata = film.m2.shape[0]
    direct = wp.vec3(0.0)
    single = wp.vec3(0.0)
    multiple = wp.vec3(0.0)
    m2 = wp.vec3(0.0)
    count = float(0.0)
    for i in range(stratum * spp / strata, (stratum + 1) * spp / strata):
        count += 1.0
        before = direct + single + multiple
        direct += (samples[0, i, row, col] - direct) / count
        single += (samples[1, i, row, col] - single) / count
        multiple += (samples[2, i, row, col] - multiple) / count
        total = samples[0, i, row, col] + samples[1, i, row, col] + samples[2, i, row, col]
        m2 += kernel.deviation_product(total, before, direct + single + multiple)
    film.direct[stratum, row, col] = direct
    film.single[stratum, row, col] = single
    film.multiple[stratum, row, col] = multiple
    film.m2[stratum, row, col] = m2


def develop(samples, strata):
    """direct, single, multiple, radiance, stderr [H, W, 3] of samples [layer, sample, H, W, 3]."""
    spp, shape = samples.shape[1], samples.shape[2:4]
    film = kernel.Film()
    for name in (*LAYERS, "m2"):
        setattr(film, name, wp.zeros((strata, *shape), dtype=wp.vec3, device="cpu"))
    device_samples = wp.array(samples.astype(np.float32), dtype=wp.vec3, device="cpu")
    wp.launch(expose, dim=(strata, *shape), inputs=[device_samples, film], device="cpu")
    out = [wp.empty(shape, dtype=wp.vec3, device="cpu") for _ in range(5)]
    wp.launch(kernel.merge_strata, dim=shape, inputs=[film, spp], outputs=out, device="cpu")
    return [image.numpy() for image in out]


def samples_of(kind, spp, seed=1):
    rng = np.random.default_rng(seed)
    shape = (3, spp, 3, 4, 3)
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
    direct, single, multiple, radiance, stderr = develop(samples, strata)
    total = samples.sum(axis=0)
    for layer, truth in zip((direct, single, multiple), samples.mean(axis=1), strict=True):
        np.testing.assert_allclose(layer, truth, rtol=3e-6)
    np.testing.assert_allclose(radiance, total.mean(axis=0), rtol=3e-6)
    # a deviation is known to the rounding of the mean: 6e-8 of it and a few roundings of adding
    spread = total.std(axis=0, ddof=1)
    rounding = (1.2e-7 * 4 * total.mean(axis=0) / spread).max()
    np.testing.assert_allclose(stderr, spread / np.sqrt(spp), rtol=1e-5 + 4 * rounding)


def test_layers_sum_to_the_radiance():
    direct, single, multiple, radiance, _ = develop(samples_of("heavy tail", 50), 3)
    assert np.array_equal(direct + single + multiple, radiance)


def test_equal_samples_have_no_error():
    radiance, stderr = develop(np.full((3, 64, 2, 2, 3), 0.25), 5)[3:]
    assert np.all(radiance == 0.75)
    assert np.all(stderr == 0.0)


def test_one_sample_has_an_unknown_error_not_a_small_one():
    radiance, stderr = develop(samples_of("uniform", 1), 1)[3:]
    assert np.isfinite(radiance).all()
    assert np.all(np.isinf(stderr))
