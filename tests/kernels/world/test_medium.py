"""Homogeneous water: Beer-Lambert and the distances at which light scatters."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, rng_array, run, uniform_p

from varos_warp.kernels.world import medium

pytestmark = pytest.mark.subject("single scattering")

N = 1 << 16


@wp.kernel(enable_backward=False)
def transmit(water: medium.Medium, t: wp.array(dtype=float), T: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    T[i] = medium.transmittance(water, t[i])


@wp.kernel(enable_backward=False)
def free_flights(
    sigma: float,
    t_max: float,
    u: wp.array(dtype=float),
    at: wp.array(dtype=float),
    t: wp.array(dtype=float),
    pdf: wp.array(dtype=float),
):
    i = wp.tid()
    t[i] = medium.sample_truncated_exponential(sigma, t_max, u[i])
    pdf[i] = medium.truncated_exponential_pdf(sigma, t_max, at[i])


@wp.kernel(enable_backward=False)
def near_lamps(
    a: float,
    t_max: float,
    u: wp.array(dtype=float),
    at: wp.array(dtype=float),
    t: wp.array(dtype=float),
    pdf: wp.array(dtype=float),
):
    i = wp.tid()
    t[i] = medium.sample_near(a, t_max, u[i])
    pdf[i] = medium.near_pdf(a, t_max, at[i])


def quadrature(f, *parameters, t_max, scale):
    """Integral over [0, t_max] of a density of the device, by Gauss-Legendre in log(1 + t/scale)."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    s = 0.5 * (nodes + 1) * np.log1p(t_max / scale)
    at = scale * np.expm1(s)
    pdf = run(f, [*parameters, t_max, np.zeros(64), at], [float, float])[1].astype(float)
    return (pdf * (at + scale) * weights).sum() * 0.5 * np.log1p(t_max / scale)


def test_transmittance_obeys_beer_lambert(truth):
    water = medium.Medium()
    water.sigma_t = wp.vec3(0.125, 0.057989, 0.0)
    t = np.array([0.0, 1e-6, 1.0, 10.0, 1e4, 1e9])
    expected = np.exp(-t[:, None] * np.float32([0.125, 0.057989, 0.0]).astype(float))
    truth(
        "transmittance, sigma_t = 0.125, 0.057989, 0; 0 to 1e9 m",
        source="exp(-sigma_t t)",
        expected=expected,
        got=run(transmit, [water, t], [wp.vec3]),
        tolerance=2e-6 * expected + 1e-38,
        reason="float32 rounding",
    )


DEPTHS = [0.0, 1e-9, 1e-7, 9e-5, 1.1e-4, 3e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 80.0]
"""Optical thicknesses sigma * t_max."""


@pytest.mark.parametrize("x", DEPTHS)
def test_the_density_of_a_truncated_flight_integrates_to_one(truth, x):
    """However thin the water: 1 - exp(-x) must not cancel."""
    truth(
        f"integral of the density, optical thickness {x:g}",
        source="a density",
        expected=1.0,
        got=quadrature(free_flights, x / 5.0, t_max=5.0, scale=0.1),
        tolerance=3e-6,
        reason="float32 rounding",
    )


@pytest.mark.parametrize("x", DEPTHS)
def test_truncated_flights_follow_their_density(x):
    t_max = 5.0
    t = run(free_flights, [x / t_max, t_max, rng_array(1, N), np.zeros(N)], [float, float])[0].astype(float)
    assert t.min() >= 0.0
    assert t.max() <= t_max
    assert_plausible(uniform_p(t / t_max if x == 0 else np.expm1(-x * t / t_max) / np.expm1(-x)))


@pytest.mark.parametrize(("sigma", "t_max"), [(0.0, 1e9), (1e-7, 1e9), (0.043125, 1e9), (20.0, 1e9), (20.0, 1e-4)])
def test_truncated_flights_survive_open_water_and_extremes(sigma, t_max):
    t, pdf = run(free_flights, [sigma, t_max, rng_array(2, N), rng_array(3, N) * t_max], [float, float])
    assert np.all(np.isfinite(t))
    assert np.all(np.isfinite(pdf))
    assert np.all((t >= 0) & (t <= np.float32(t_max)))


@pytest.mark.parametrize(("a", "t_max"), [(0.18, 5.0), (0.01, 1e4), (0.18, 1e-4), (50.0, 0.05), (50.0, 20.0)])
def test_distances_near_the_lamps_follow_a_density_that_integrates_to_one(a, t_max):
    """Also where the lamps are much farther than the water is deep: log(1 + x) must not cancel."""
    assert abs(quadrature(near_lamps, a, t_max=t_max, scale=a) - 1) < 1e-5
    t = run(near_lamps, [a, t_max, rng_array(4, N), np.zeros(N)], [float, float])[0].astype(float)
    assert t.min() >= 0.0
    assert t.max() <= np.float32(t_max)
    assert_plausible(uniform_p(np.clip(np.log1p(t / a) / np.log1p(t_max / a), 0, 1)))
