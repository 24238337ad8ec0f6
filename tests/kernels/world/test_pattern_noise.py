"""Gradient noise: its slopes at the corners of cells, its variance, and that seeds and places are unlike."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, run, two_sided
from numpy.polynomial import Polynomial
from scipy import stats

from varos_warp.kernels.world.pattern_noise import gradient_noise

pytestmark = pytest.mark.subject("surfaces and lights")

EDGES = np.array([(a, b, 0) for a in (-1, 1) for b in (-1, 1)])
TWELVE = np.concatenate([np.roll(EDGES, axis, axis=1) for axis in range(3)])
FADE = Polynomial([0, 0, 0, 10, -15, 6])


@wp.kernel(enable_backward=False)
def evaluate(seed: wp.uint32, p: wp.array(dtype=wp.vec3), noise: wp.array(dtype=float)):
    i = wp.tid()
    noise[i] = gradient_noise(seed, p[i])


def noise(p, seed=5):
    return run(evaluate, [wp.uint32(seed), np.asarray(p, np.float32)], [float]).astype(float)


def corners(count, seed=1):
    """Corners of cells, no two alike."""
    side = int(np.ceil(count ** (1 / 3)))
    numbers = np.random.default_rng(seed).permutation(side**3)[:count]
    return np.stack(np.unravel_index(numbers, (side,) * 3), -1) - side // 2


def slopes(seed, at):
    """Gradients [N, 3] at corners, by differences so small that the next corners' shares are rounding."""
    step = 2.0**-9
    return np.stack([(noise(at + step * axis, seed) - noise(at - step * axis, seed)) / (2 * step)
                     for axis in np.eye(3)], -1)


def test_corners_are_zero_with_one_of_twelve_slopes_each_alike_often():
    at = corners(6000)
    assert not noise(at).any()
    found = np.sqrt(2.0) * slopes(5, at)
    nearest = np.round(found)
    np.testing.assert_allclose(found, nearest, atol=1e-4)  # 10 step^2, and rounding over the step
    counts = [np.all(nearest == edge, axis=1).sum() for edge in TWELVE]
    assert sum(counts) == len(at)
    assert_plausible(stats.chisquare(counts).pvalue)


def test_the_variance_is_that_of_independent_gradients(truth):
    """At x from a corner, the sum over corners of (weight times distance)^2 / 3; points so far apart that none share.

    A gradient of length 1 in a random direction, as another program's noise has, gives the same.
    """
    square, x = (1 - FADE) ** 2, Polynomial([0, 1])
    weight, moment = (part.integ()(1.0) for part in (square, square * x**2))
    rng = np.random.default_rng(2)
    p = 2 * corners(200_000) + rng.uniform(size=(200_000, 3))
    values = noise(p)
    squares = values**2
    truth("variance of gradient noise", source="8 A^2 B, with A, B of (1 - fade)^2 and (1 - fade)^2 x^2 over [0, 1]",
          expected=8 * weight**2 * moment, got=squares.mean(), stderr=squares.std() / np.sqrt(len(p)))
    assert_plausible(two_sided(values.mean() / values.std() * np.sqrt(len(p))))


@pytest.mark.parametrize("other", [6, 5 + 101])
def test_seeds_are_unlike(other):
    """Products of independent values are as often positive as negative."""
    p = 2 * corners(100_000) + 0.37
    product = noise(p) * noise(p, other)
    assert_plausible(two_sided(product.mean() / product.std() * np.sqrt(len(p))))


def test_neighbours_are_unlike():
    at = corners(100_000)
    here, there = (slopes(5, at + offset) for offset in ((0, 0, 0), (1, 0, 0)))
    product = (here * there).sum(1)
    assert_plausible(two_sided(product.mean() / product.std() * np.sqrt(len(at))))
