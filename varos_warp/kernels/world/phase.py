"""The phase function of Henyey and Greenstein (1941), normalised to 1 over the sphere."""

import warp as wp

from varos_warp.kernels.transport.sampling import from_polar

wp.set_module_options({"enable_backward": False})


@wp.func
def hg_eval(one_minus_cos: float, g: float):
    """Density [1/sr] = pdf of hg_sample; takes 1 - cos(theta), which cancels no digits for g near 1."""
    x = (1.0 - g) * (1.0 - g) + 2.0 * g * one_minus_cos
    return (1.0 - g * g) / (4.0 * wp.pi * x * wp.sqrt(x))


@wp.func
def hg_sample_one_minus_cos(g: float, u: float):
    """1 - cos(theta) by inversion of the distribution, factored so that neither g = 0 nor g near 1 needs a branch."""
    b = 1.0 - g + 2.0 * g * u
    return 2.0 * (1.0 - u) * (1.0 + g * u) * (1.0 - g) * (1.0 - g) / (b * b)


@wp.func
def hg_sample(d: wp.vec3, g: float, u: float, v: float):
    """Direction after scattering of a ray that travels along ``d``."""
    x = wp.clamp(hg_sample_one_minus_cos(g, u), 0.0, 2.0)
    return from_polar(d, 1.0 - x, wp.sqrt(x * (2.0 - x)), wp.tau * v)
