"""Diffuse reflection off a rough surface: the energy-preserving Oren-Nayar model (EON).

A surface whose facets are finer than a pixel does not darken towards its rim as a Lambertian one does when the light
comes from beside the viewer, for it then shows its lit facets. Portsmouth, Kutz and Hill (2025), "EON: A practical
energy-preserving rough diffuse BRDF", JCGT 14(1): what facets reflect once is Fujii's form of Oren and Nayar (1994),
what they reflect among each other follows from its albedo, so that a white surface loses no light. Reciprocal.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

ONCE = wp.constant(0.5 - 2.0 / (3.0 * 3.141592653589793))
ONCE_MEAN = wp.constant(2.0 / 3.0 - 28.0 / (15.0 * 3.141592653589793))
"""Constants of the albedo of light reflected once, and of its mean over all directions."""


@wp.func
def slant_gain(cosine: float):
    """How much of the albedo for light that facets reflect once depends on the angle: of roughness 1, over 1 / pi.

    A polynomial within 0.1 % of the albedo of the closed form, which has no digits at grazing angles (the paper,
    listing 1).
    """
    x = 1.0 - cosine
    return x * (0.0571085289 + x * (0.491881867 + x * (-0.332181442 + x * 0.0714429953)))


@wp.func
def single_albedo(roughness: float, cosine: float):
    """Albedo of a white surface for light that its facets reflect once, at a cosine of the light or viewer."""
    return (1.0 + roughness * slant_gain(cosine)) / (1.0 + ONCE * roughness)


@wp.func
def multiple_reflectance(reflectance: wp.vec3, roughness: float):
    """Reflectance of the light that facets reflect among each other."""
    mean = (1.0 + ONCE_MEAN * roughness) / (1.0 + ONCE * roughness)
    return wp.cw_div(mean * wp.cw_mul(reflectance, reflectance), wp.vec3(1.0) - (1.0 - mean) * reflectance)


@wp.func
def rough_diffuse_albedo(reflectance: wp.vec3, roughness: float, cosine: float):
    """Albedo per channel, at a cosine of the light or viewer."""
    once = single_albedo(roughness, cosine)
    return once * reflectance + (1.0 - once) * multiple_reflectance(reflectance, roughness)


@wp.func
def rough_diffuse(reflectance: wp.vec3, roughness: float, n: wp.vec3, v: wp.vec3, l: wp.vec3):
    """Pi times the scattering function; both directions above the surface.

    It is the reflectance of a Lambertian surface that looks the same from ``v`` in light from ``l``.
    """
    n_v = wp.dot(n, v)
    n_l = wp.dot(n, l)
    s = wp.dot(v, l) - n_v * n_l
    if s > 0.0:
        s /= wp.max(n_v, n_l)
    once = (1.0 + roughness * s) / (1.0 + ONCE * roughness)
    # (1 - albedo at v)(1 - albedo at l) / (1 - mean), whose last factor has no digits where roughness is small
    left = wp.max(ONCE - slant_gain(n_v), 0.0) * wp.max(ONCE - slant_gain(n_l), 0.0)
    again = roughness * left / ((1.0 + ONCE * roughness) * (ONCE - ONCE_MEAN))
    return once * reflectance + again * multiple_reflectance(reflectance, roughness)
