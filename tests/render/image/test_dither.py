"""Dither: the error of rounding has a mean of 0 and a variance of 1/4 step^2 whatever is rounded, and is reproducible.

The error of one value is below 3/2 steps and its variance 1/4, so a mean of N errors has a standard error of
1 / (2 sqrt N). E e^4 is largest where the value is whole, and the error 0, 1 or -1, twice with the chance 1/8: 1/4. So
the mean of the squares has a standard error of at most sqrt(3/16 / N).
"""

import numpy as np
import pytest

from varos_warp.dataset.write.develop import develop, dithered
from varos_warp.render.image.dither import Dither

DITHER = Dither(seed=3)
SIDE = 400
N = SIDE * SIDE


def error(level, frame=0):
    """Errors [N] of rounding one value, in steps."""
    levels = np.full((SIDE, SIDE, 1), level, np.float32)
    return DITHER.rounded(levels, "M0", "A", frame).astype(float).ravel() - level


@pytest.mark.parametrize("level", [0.5, 1.0, 7.125, 100.25, 100.5, 128.0, 200.75, 254.5])
def test_the_first_two_moments_of_the_error_do_not_depend_on_the_value(level):
    e = error(level)
    assert abs(e.mean()) < 5 * 0.5 / np.sqrt(N)
    assert abs(np.square(e).mean() - 0.25) < 5 * np.sqrt(3 / 16 / N)


@pytest.mark.parametrize("level", [0.0, 0.1, 0.4, 254.75, 255.0])
def test_at_the_ends_the_mean_is_that_of_the_value_and_black_and_white_stay(level):
    e = error(level)
    share = abs(level - np.rint(level))
    assert abs(e.mean()) <= 5 * np.sqrt(share * (1 - share) / N)


def test_over_a_ramp_the_error_has_no_mean_and_nothing_in_common_with_the_ramp():
    """Flat pieces of the whole range: less than 1/100 step in the mean, and no correlation."""
    levels = np.repeat(np.linspace(0.0, 255.0, 4000, dtype=np.float32), 300).reshape(4000, 300, 1)
    e = DITHER.rounded(levels, "M0", "A", 0).astype(float) - levels
    assert abs(e.mean()) < 0.01
    assert abs(e.mean()) < 5 * 0.5 / np.sqrt(e.size)
    assert abs(np.corrcoef(e.ravel(), levels.ravel())[0, 1]) < 5 / np.sqrt(e.size)


def test_errors_of_channels_pixels_and_frames_have_nothing_in_common():
    levels = np.full((SIDE, SIDE, 3), 99.5, np.float32)
    e = DITHER.rounded(levels, "M0", "A", 0) - 99.5
    other = DITHER.rounded(levels, "M0", "A", 1) - 99.5
    pairs = [(e[..., 0], e[..., 1]), (e[:, 1:], e[:, :-1]), (e[1:], e[:-1]), (e, other)]
    for one, two in pairs:
        assert abs((one * two).mean() / 0.25) < 5 / np.sqrt(one.size)


def test_it_follows_from_seed_camera_image_type_and_frame_alone():
    levels = np.full((9, 7, 3), 20.5, np.float32)
    made = DITHER.rounded(levels, "M0", "A", 4)
    np.testing.assert_array_equal(made, Dither(3).rounded(levels, "M0", "A", 4))
    for other in (
        Dither(4).rounded(levels, "M0", "A", 4),
        DITHER.rounded(levels, "R0", "A", 4),
        DITHER.rounded(levels, "M0", "B", 4),
        DITHER.rounded(levels, "M0", "A", 5),
    ):
        assert (other != made).any()


def test_an_image_is_that_without_dither_within_less_than_two_steps():
    half = np.random.default_rng(1).gamma(2.0, 0.1, (40, 60, 3)).astype(np.float16)
    with_dither = dithered(half, 1.5, DITHER, "M0", "A", 0).astype(int)
    difference = with_dither - develop(half, 1.5)
    assert set(np.unique(difference)) <= {-1, 0, 1}
    assert (difference != 0).any()
