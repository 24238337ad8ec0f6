"""Phase functions, normalised to 1 over the sphere: Henyey and Greenstein's (1941) directly, all others by tables.

The table holds the logarithm of the density at nodes even in log s, with s = (1 - cos theta)/2 = sin^2(theta/2), the
measure in which solid angle is uniform (4 pi ds). Between nodes the density is a power of s, so its integral can be
inverted in closed form: samples have exactly the density that `phase_eval` returns.
"""

import warp as wp

from varos_warp.kernels.numerics import linear
from varos_warp.kernels.sampling import from_polar

wp.set_module_options({"enable_backward": False})


@wp.struct
class Phase:
    """A phase function; the host's scene/water makes it."""

    g: float
    """Mean cosine; the only parameter of Henyey and Greenstein."""
    log_p: wp.array(dtype=float)
    """Logarithm of the density [1/sr] at the nodes, the last one at s = 1; empty for Henyey and Greenstein."""
    cdf: wp.array(dtype=float)
    """Fraction of light scattered by at most the angle of each node, from 0 (ahead, to lose no digits) to 1."""
    log_first: float
    """log s of the first node; the density is constant below."""
    log_step: float
    angle: wp.array(dtype=float)
    """Scattering angles [rad]: 0, then evenly spaced in the logarithm, up to pi."""
    angle_log_step: float
    angle_integral: wp.array(dtype=float)
    """Minus the integral of the density over the angles beyond these."""
    angle_density: wp.array(dtype=float)
    """Mean density [1/sr] from each angle to the next; differences of ``angle_integral`` would be inaccurate."""


@wp.func
def hg_eval(one_minus_cos: float, g: float):
    """Density [1/sr] = pdf of hg_sample_one_minus_cos; 1 - cos(theta) avoids cancellation for g near 1."""
    x = (1.0 - g) * (1.0 - g) + 2.0 * g * one_minus_cos
    return (1.0 - g * g) / (4.0 * wp.pi * x * wp.sqrt(x))


@wp.func
def hg_sample_one_minus_cos(g: float, u: float):
    """1 - cos(theta) by inversion of the distribution, factored so that neither g = 0 nor g near 1 needs a branch."""
    b = 1.0 - g + 2.0 * g * u
    return 2.0 * (1.0 - u) * (1.0 + g * u) * (1.0 - g) * (1.0 - g) / (b * b)


@wp.func
def table_eval(phase: Phase, s: float):
    """Density [1/sr] at s = (1 - cos theta)/2: a power of s between two nodes."""
    at = (wp.log(wp.max(s, 1.0e-30)) - phase.log_first) / phase.log_step
    return wp.exp(linear(phase.log_p, wp.clamp(at, 0.0, float(phase.log_p.shape[0] - 1))))


@wp.func
def table_sample(phase: Phase, u: float):
    """The s = (1 - cos theta)/2 below which a fraction ``u`` of the light is scattered."""
    if u <= phase.cdf[0]:
        return wp.exp(phase.log_first) * u / phase.cdf[0]
    i = wp.clamp(wp.lower_bound(phase.cdf, u) - 1, 0, phase.cdf.shape[0] - 2)
    share = wp.clamp((u - phase.cdf[i]) / wp.max(phase.cdf[i + 1] - phase.cdf[i], 1.0e-30), 0.0, 1.0)
    # d(cdf)/d(log s) is proportional to s p, so to exp(m x) with x the steps from the node
    m = phase.log_p[i + 1] - phase.log_p[i] + phase.log_step
    x = share
    if wp.abs(m) > 1.0e-3:
        x = wp.log(1.0 + share * (wp.exp(m) - 1.0)) / m
    return wp.exp(phase.log_first + (float(i) + x) * phase.log_step)


@wp.func
def phase_eval(phase: Phase, one_minus_cos: float):
    """Density [1/sr] = pdf of phase_sample; 1 - cos(theta) avoids cancellation ahead."""
    if phase.log_p.shape[0] == 0:
        return hg_eval(one_minus_cos, phase.g)
    return table_eval(phase, 0.5 * one_minus_cos)


@wp.func
def phase_sample_one_minus_cos(phase: Phase, u: float):
    """1 - cos(theta) by inversion of the distribution."""
    if phase.log_p.shape[0] == 0:
        return hg_sample_one_minus_cos(phase.g, u)
    return 2.0 * table_sample(phase, u)


@wp.func
def phase_sample(phase: Phase, d: wp.vec3, u: float, v: float):
    """Direction after scattering of a ray that travels along ``d``."""
    x = wp.clamp(phase_sample_one_minus_cos(phase, u), 0.0, 2.0)
    return from_polar(d, 1.0 - x, wp.sqrt(x * (2.0 - x)), wp.tau * v)


# -------------------------------------------------------------- scattering angles along a ray that passes a light


@wp.func
def angle_integral_at(phase: Phase, theta: float):
    """``phase.angle_integral`` at any angle, linear in between, and the mean density there."""
    i = int(0)
    if theta >= phase.angle[1]:
        i = 1 + int(wp.log(theta / phase.angle[1]) / phase.angle_log_step)
    i = wp.min(i, phase.angle.shape[0] - 2)
    density = phase.angle_density[i]
    return wp.vec2(phase.angle_integral[i] + density * (theta - phase.angle[i]), density)


@wp.func
def sample_angle(phase: Phase, low: float, high: float, u: float):
    """Angle and its density, in proportion to the phase function, between two angles of these `angle_integral_at`.

    Along a ray at distance h from a light, dy/distance^2 = d(theta)/h (Kulla and Fajardo 2012), so over theta the light
    scattered into the ray varies only with the phase function.
    """
    at = wp.lerp(low, high, u)
    i = wp.clamp(wp.lower_bound(phase.angle_integral, at) - 1, 0, phase.angle_integral.shape[0] - 2)
    density = phase.angle_density[i]
    theta = wp.min(phase.angle[i] + (at - phase.angle_integral[i]) / density, phase.angle[i + 1])
    return wp.vec2(theta, density / (high - low))
