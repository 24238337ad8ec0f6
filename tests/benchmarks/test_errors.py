"""Measures of error on arrays whose errors are known."""

import numpy as np
import pytest

from benchmarks.errors import (
    KNOWN,
    MEDIAN_OF_NORMAL,
    Reference,
    dissimilarity,
    measure,
    median_relative_error,
    relative_rmse,
)

SHAPE = (60, 80, 3)
TRUTH = 1.0 + np.linspace(0.0, 1.0, 60)[:, None, None] * np.array([1.0, 0.5, 0.25]) + np.zeros(SHAPE)


def exact(mean=TRUTH):
    return Reference(mean, np.zeros(SHAPE))


def noisy(stderr, seed=1):
    """A reference with normal noise of this standard error."""
    noise = stderr * np.random.default_rng(seed).standard_normal(SHAPE)
    return Reference(TRUTH + noise, np.full(SHAPE, stderr))


def rendering(error, seed=2, count=1):
    return TRUTH + error * np.random.default_rng(seed).standard_normal((count, *SHAPE))


def test_an_offset_is_its_own_rmse_relative_to_the_mean_of_its_channel():
    rmse, limit = relative_rmse([TRUTH + 0.1], exact())
    np.testing.assert_allclose(rmse, 0.1 / TRUTH.mean(axis=(0, 1)))
    np.testing.assert_allclose(limit, rmse)


def test_the_noise_of_the_reference_is_taken_off():
    """Three times as much noise as error; the mean of d^2 over n pixels is known to 2 (e^2 + s^2) / sqrt(2 n)."""
    error, stderr = 0.01, 0.03
    rmse, limit = relative_rmse(rendering(error), noisy(stderr))
    squares = (rmse * TRUTH.mean(axis=(0, 1))) ** 2
    np.testing.assert_allclose(squares, error**2, atol=4 * np.sqrt(2 / 4800) * (error**2 + stderr**2))
    assert (limit > rmse).all()


def test_an_error_below_the_noise_of_the_reference_is_not_claimed():
    row = measure([TRUTH], noisy(0.02))
    assert not row["rmse_resolved"]
    assert not row["median_resolved"]
    # 2 sigma of the mean of s^2 over 4800 pixels
    assert row["rmse_limit"] < 2.0 * 0.02 * np.sqrt(2.0 * np.sqrt(2.0 / 4800.0))


def test_the_limit_holds_for_nearly_every_reference():
    """Errors at the edge of what can be told: two standard errors, one-sided, fail once in 44."""
    error, below = 0.004, []
    for seed in range(100):
        _, limit = relative_rmse(np.full((1, *SHAPE), TRUTH + error), noisy(0.02, seed=seed))
        below.append(limit * TRUTH.mean(axis=(0, 1)) < error)
    assert np.mean(below) < 0.06


def test_the_median_is_relative_to_each_pixel():
    image = TRUTH * np.where(np.arange(80) < 50, 1.3, 1.0)[:, None]
    median, floor = median_relative_error([image], exact())
    np.testing.assert_allclose(median, 0.3)
    assert (floor == 0.0).all()


def test_normal_noise_has_its_known_median():
    median, _ = median_relative_error([TRUTH * (1 + 0.1 * np.random.default_rng(3).standard_normal(SHAPE))], exact())
    # standard error of a median of n: 1 / (2 f sqrt(n)), f the density of |x| there
    np.testing.assert_allclose(median, 0.1 * MEDIAN_OF_NORMAL, rtol=4 * 0.5 / 0.6356 / np.sqrt(4800) / MEDIAN_OF_NORMAL)


def test_pixels_that_the_reference_does_not_know_are_left_out():
    stderr = np.zeros(SHAPE)
    stderr[3, 5, 2] = 1.01 * KNOWN * TRUTH[3, 5, 2]
    image = TRUTH.copy()
    image[3, 5] += 100.0
    row = measure([image], Reference(TRUTH, stderr))
    assert row["rmse_limit"] == row["median"] == row["mean_off_r"] == 0.0
    assert row["pixels"] == 1.0 - 1.0 / 4800.0


def test_the_same_image_is_not_dissimilar_and_a_darker_or_noisier_one_is():
    structure = Reference(TRUTH + 0.3 * np.sin(np.arange(80))[:, None], np.zeros(SHAPE))
    same, floor = dissimilarity([structure.mean], structure)
    assert abs(same) < 1e-12
    assert abs(floor) < 1e-12
    darker, _ = dissimilarity([0.5 * structure.mean], structure)
    slightly, _ = dissimilarity([structure.mean + 0.02 * rendering(1.0)[0]], structure)
    clearly, _ = dissimilarity([structure.mean + 0.2 * rendering(1.0)[0]], structure)
    assert darker > 0.05
    assert 0.0 < slightly < clearly


def test_exposure_takes_out_the_unit_of_light():
    reference = noisy(0.01)
    bright = Reference(1e3 * reference.mean, 1e3 * reference.stderr)
    images = rendering(0.05)
    a, b = measure(images, reference), measure(1e3 * images, bright)
    for key in ("rmse", "rmse_limit", "median", "ssim"):
        assert a[key] == pytest.approx(b[key], rel=1e-6)


def test_a_row_names_the_worst_channel():
    image = TRUTH + np.array([0.01, 0.3, 0.02])
    row = measure([image], exact())
    assert row["rmse"] == row["rmse_g"] == pytest.approx(0.3 / TRUTH[..., 1].mean())
    assert row["median"] == row["median_g"]
    assert row["mean_off_b"] == pytest.approx(0.02 / TRUTH[..., 2].mean())
