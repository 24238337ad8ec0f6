"""The phase function of Henyey and Greenstein: values, normalisation, moments, and samples that follow it."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, rng_array, run, two_sided, uniform_p

from varos_warp.kernels import phase

N = 1 << 17
ANISOTROPIES = [-0.99, -0.5, 0.0, 1e-4, 0.5, 0.8, 0.924, 0.99]


@wp.kernel(enable_backward=False)
def evaluate(g: float, one_minus_cos: wp.array(dtype=float), pdf: wp.array(dtype=float)):
    i = wp.tid()
    pdf[i] = phase.hg_eval(one_minus_cos[i], g)


@wp.kernel(enable_backward=False)
def sample(g: float, d: wp.vec3, u: wp.array(dtype=wp.vec2), one_minus_cos: wp.array(dtype=float),
           direction: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    one_minus_cos[i] = phase.hg_sample_one_minus_cos(g, u[i][0])
    direction[i] = phase.hg_sample(d, g, u[i][0], u[i][1])


def density(one_minus_cos, g):
    return run(evaluate, [float(g), np.asarray(one_minus_cos)], [float]).astype(float)


def samples(g, u, d=(0.0, 0.0, 1.0)):
    one_minus_cos, direction = run(sample, [float(g), wp.vec3(*d), u], [float, wp.vec3])
    return one_minus_cos.astype(float), direction.astype(float)


def distribution(x, g):
    """P(1 - cos(theta) <= x) in float64; the distribution below is 1 minus that of the notes."""
    x = np.asarray(x, float)
    if abs(g) < 1e-12:
        return x / 2
    return (1 + g) * (1 / (1 - g) - 1 / np.sqrt((1 - g) ** 2 + 2 * g * x)) * (1 - g) / (2 * g)


def test_the_density_has_the_known_values():
    known = [3.58098621957, 0.0136403924191, 0.0049121896016]
    np.testing.assert_allclose(density([0.0, 1.0, 2.0], 0.8), known, rtol=1e-6)


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_the_density_integrates_to_one_and_its_mean_cosine_is_g(g):
    """Quadrature over the logarithm of 1 - cos, or of 1 + cos for g < 0, where the peak is; second moment g^2."""
    edges, weights = np.polynomial.legendre.leggauss(100)
    s = 0.5 * (edges + 1) * np.log(2 / 1e-9) + np.log(1e-9)
    small = np.exp(s)
    x = small if g >= 0 else 2 - small
    # next to the peak of a negative g, 1 - cos = 2 is all that float32 sees: the integrand is known there
    p = np.where(small > 1e-5, density(x, g), (1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 2 * g * x) ** 1.5))
    w = 2 * np.pi * p * small * weights * 0.5 * np.log(2 / 1e-9)
    mu = 1 - x
    moments = [(w * f).sum() for f in (np.ones_like(mu), mu, 1.5 * mu**2 - 0.5)]
    # 1 - |g| is known to 6e-8/(1 - |g|); at g = -0.99 the peak is 5e-5 wide in a 1 - cos that is known to 1e-7
    np.testing.assert_allclose(moments, [1, g, g * g], atol=1e-3 if g < -0.9 else 2e-6 + 3 * 6e-8 / (1 - abs(g)))


def test_samples_are_the_inverse_of_the_distribution():
    """The notes count u from the back: cos(u) = -1 at 0."""
    u = np.array([0, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99])
    cosine = [-1, 0.4, 0.8, 0.944, 0.983673469388, 0.99488399762, 0.999549558608]
    x, _ = samples(0.8, np.column_stack([u, u * 0]))
    np.testing.assert_allclose(1 - x, cosine, rtol=0, atol=3e-7)
    np.testing.assert_allclose(x, 1 - np.array(cosine), rtol=1e-5)


@pytest.mark.parametrize(("cosine", "share"), [(-0.5, 0.0190414899245), (0.0, 0.0506954821247), (0.5, 0.120495126515),
                                               (0.9, 0.378115294937)])
def test_the_share_of_light_scattered_beyond_an_angle(cosine, share):
    x, _ = samples(0.8, rng_array(1, (N, 2)))
    hits = np.count_nonzero(1 - x <= cosine)
    assert_plausible(two_sided((hits / N - share) / np.sqrt(share * (1 - share) / N)))
    np.testing.assert_allclose(1 - distribution(1 - cosine, 0.8), share, rtol=1e-9)


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_samples_follow_the_density(g):
    """Polar angle by the exact distribution, azimuth uniform; mean cosine g."""
    axis = np.array([0.48, -0.6, -0.64])
    x, d = samples(g, rng_array(2, (N, 2)), axis)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, atol=5e-7)
    # the direction's own angle, from |d - axis|^2 / 2, which does not cancel
    np.testing.assert_allclose(0.5 * ((d - axis) ** 2).sum(axis=1), x, rtol=1e-3, atol=1e-6)
    e1 = np.cross(axis, [0, 0, 1]) / np.linalg.norm(np.cross(axis, [0, 0, 1]))
    azimuth = np.arctan2(d @ np.cross(axis, e1), d @ e1) / (2 * np.pi) % 1.0
    assert_plausible([uniform_p(np.clip(distribution(x, g), 0, 1)), uniform_p(azimuth)])
    assert_plausible(two_sided((1 - x.mean() - g) / x.std() * np.sqrt(N)))


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_samples_keep_their_digits_in_both_peaks(g):
    """Relative error of 1 - cos ahead, absolute error behind, against float64 for the same g and u."""
    u = rng_array(3, (N, 2))
    x, _ = samples(g, u)
    g32, v = float(np.float32(g)), u[:, 0].astype(float)
    b = 1 - g32 + 2 * g32 * v
    exact = 2 * (1 - v) * (1 + g32 * v) * (1 - g32) ** 2 / b**2
    # 1 - g is rounded once for all samples: 6e-8/(1 - |g|)
    np.testing.assert_allclose(x, exact, rtol=4e-7 + 4 * 6e-8 / (1 - abs(g)) * (abs(g) > 0.9))
    assert x.min() >= 0.0


def test_positive_g_scatters_forward():
    assert density([0.1], 0.8)[0] > 50 * density([1.9], 0.8)[0]
    assert samples(0.8, rng_array(4, (N, 2)), (0.0, 1.0, 0.0))[1].mean(axis=0)[1] > 0.79
    assert samples(-0.8, rng_array(4, (N, 2)), (0.0, 1.0, 0.0))[1].mean(axis=0)[1] < -0.79
