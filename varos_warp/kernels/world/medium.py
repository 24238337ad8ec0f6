"""Homogeneous water, one coefficient per colour channel."""

import warp as wp

from varos_warp.kernels.world.phase import Phase

wp.set_module_options({"enable_backward": False})


@wp.struct
class Medium:
    """Scattering and extinction coefficients [1/m] per channel, and the phase function."""

    sigma_s: wp.vec3
    sigma_t: wp.vec3
    phase: Phase


@wp.func
def exp3(x: wp.vec3):
    """Exponential of each component."""
    return wp.vec3(wp.exp(x[0]), wp.exp(x[1]), wp.exp(x[2]))


@wp.func
def transmittance(medium: Medium, t: float):
    """Fraction of radiance left after ``t`` metres (Beer-Lambert)."""
    return exp3(-t * medium.sigma_t)


@wp.func
def expm1(x: float):
    """exp(x) - 1 without cancellation; near 0 by a series, as a GPU's approximate exponential is inaccurate there."""
    if wp.abs(x) < 0.03:
        return x * (1.0 + x / 2.0 * (1.0 + x / 3.0 * (1.0 + x / 4.0)))
    return wp.exp(x) - 1.0


@wp.func
def log1p(x: float):
    """log(1 + x) without cancellation; near 0 by a series, as in `expm1`."""
    if wp.abs(x) < 0.03:
        return x * (1.0 - x * (0.5 - x * (1.0 / 3.0 - x * (0.25 - 0.2 * x))))
    return wp.log(1.0 + x)


@wp.func
def truncated_exponential_pdf(sigma: float, t_max: float, t: float):
    """Density of a free flight that is known to end before ``t_max``; uniform as sigma -> 0."""
    x = sigma * t_max
    if x < 1.0e-6:
        return 1.0 / t_max
    return -sigma * wp.exp(-sigma * t) / expm1(-x)


@wp.func
def sample_truncated_exponential(sigma: float, t_max: float, u: float):
    """Free flight [m] that ends before ``t_max``."""
    x = sigma * t_max
    if x < 1.0e-6:
        return t_max * u
    return wp.min(-log1p(u * expm1(-x)) / sigma, t_max)


@wp.func
def near_pdf(a: float, t_max: float, t: float):
    """Density proportional to 1/(t + a) on [0, t_max]: roughly that of single scattering near lights at distance a."""
    return 1.0 / ((t + a) * log1p(t_max / a))


@wp.func
def sample_near(a: float, t_max: float, u: float):
    """Distance with density near_pdf."""
    return wp.min(a * expm1(u * log1p(t_max / a)), t_max)
