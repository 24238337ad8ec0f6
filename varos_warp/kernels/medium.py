"""Homogeneous water, one coefficient per colour channel."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Medium:
    """Scattering and extinction coefficients [1/m] per channel and the mean cosine of the phase function."""

    sigma_s: wp.vec3
    sigma_t: wp.vec3
    g: float


@wp.func
def exp3(x: wp.vec3):
    """Exponential of each component."""
    return wp.vec3(wp.exp(x[0]), wp.exp(x[1]), wp.exp(x[2]))


@wp.func
def transmittance(medium: Medium, t: float):
    """Share of radiance left after ``t`` metres (Beer-Lambert)."""
    return exp3(-t * medium.sigma_t)


@wp.func
def truncated_exponential_pdf(sigma: float, t_max: float, t: float):
    """Density of a free flight that is known to end before ``t_max``; uniform as sigma -> 0."""
    x = sigma * t_max
    if x < 1.0e-4:
        return (1.0 + 0.5 * x) * wp.exp(-sigma * t) / t_max
    return sigma * wp.exp(-sigma * t) / (1.0 - wp.exp(-x))


@wp.func
def sample_truncated_exponential(sigma: float, t_max: float, u: float):
    """Free flight [m] that ends before ``t_max``."""
    x = sigma * t_max
    if x < 1.0e-4:
        return t_max * u * (1.0 - 0.5 * x * (1.0 - u))
    return wp.min(-wp.log(1.0 - u * (1.0 - wp.exp(-x))) / sigma, t_max)


@wp.func
def near_pdf(a: float, t_max: float, t: float):
    """Density proportional to 1/(t + a) on [0, t_max]: where light scattered once near lamps at distance a is found."""
    return 1.0 / ((t + a) * wp.log(1.0 + t_max / a))


@wp.func
def sample_near(a: float, t_max: float, u: float):
    """Distance with density near_pdf."""
    return a * (wp.exp(u * wp.log(1.0 + t_max / a)) - 1.0)
