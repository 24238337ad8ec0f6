"""Single scattering of a light along an unobstructed ray, by quadrature."""

import warp as wp

from varos_warp.kernels.numerics import brightest, make_gauss_legendre
from varos_warp.kernels.sampling import equiangular_angle, equiangular_point, one_minus_cos_at
from varos_warp.kernels.world.light import Light, LitInterval, light_beam, light_core, light_towards
from varos_warp.kernels.world.medium import Medium, transmittance
from varos_warp.kernels.world.phase import Phase, phase_eval

wp.set_module_options({"enable_backward": False})

NODES, SHORT_NODES, SLIVER_NODES = wp.constant(10), wp.constant(6), wp.constant(4)
SHORT_DEPTH, SLIVER_DEPTH, SLIVER_RAD = wp.constant(0.2), wp.constant(0.1), wp.constant(0.2)
"""Nodes of the quadrature: the error is at most 0.1 % over rays of any length in the paper's water (measured). On
optically short intervals, and on slivers such as a soft edge, fewer suffice."""
GROWTH, CORE, BACKWARD = wp.constant(4.0), wp.constant(5.0), wp.constant(64.0)
"""Where the phase function is sharp, the tangent of half the scattering angle grows by at most GROWTH within an
interval. Henyey and Greenstein's is smooth where the tangent is below CORE (1 - g); for g < 0 intervals are divided up
to BACKWARD times the light's distance from the ray."""

node, short_node, sliver_node = (make_gauss_legendre(count) for count in (NODES, SHORT_NODES, SLIVER_NODES))


@wp.func
def smooth_below(phase: Phase):
    """Tangent of half the angle up to which a phase function is smooth; beyond, it is a power of the angle."""
    if phase.log_p.shape[0] > 0:
        return wp.exp(0.5 * phase.log_first)
    return CORE * (1.0 - wp.abs(phase.g))


@wp.func
def peak_break(phase: Phase, h: float, y: float):
    """Where to divide an interval that starts at ``y`` from a light's foot, because the phase function is sharp.

    The tangent of half the scattering angle is exp(asinh(y/h)); a backward peak is a forward peak seen from behind.
    """
    core = smooth_below(phase)
    far = 1.0e30
    distance = wp.sqrt(h * h + y * y)
    if phase.log_p.shape[0] == 0 and phase.g < 0.0:
        q = GROWTH * (distance + y) / h
        if y < 0.0 or q > BACKWARD:
            return far
        return 0.5 * h * (q - 1.0 / q)
    q = wp.max(GROWTH * h / (distance - wp.min(y, 0.0)), core)
    if y >= 0.0 or q > 0.4:
        return far
    return 0.5 * h * (q - 1.0 / q)


@wp.func
def segment_nodes(medium: Medium, h: float, ya: float, yb: float, angle: float):
    """Number of nodes that an interval needs."""
    depth = brightest(medium.sigma_t) * (yb - ya + wp.sqrt(h * h + yb * yb) - wp.sqrt(h * h + ya * ya))
    q = h / (wp.sqrt(h * h + ya * ya) - wp.min(ya, 0.0))
    if depth < SLIVER_DEPTH and angle * h < SLIVER_RAD * wp.min(wp.max(q, smooth_below(medium.phase)), 1.0):
        return SLIVER_NODES
    if depth < SHORT_DEPTH and (ya >= 0.0 or angle * h < 6.5 * q):
        return SHORT_NODES
    return NODES


@wp.func
def segment_node(k: int, count: int):
    """Node ``k`` in [0, 1] and weight of the Gauss-Legendre quadrature of ``count`` nodes."""
    if count == SLIVER_NODES:
        return sliver_node(k)
    if count == SHORT_NODES:
        return short_node(k)
    return node(k)


@wp.func
def scattered_between(medium: Medium, light: Light, o: wp.vec3, d: wp.vec3, lit: LitInterval, ya: float, yb: float):
    """Radiance that single scattering between ya and yb adds to a ray, by quadrature in the equiangular angle.

    In that angle the inverse square of the distance is constant, and the rest is smooth.
    """
    L = wp.vec3(0.0)
    angle = equiangular_angle(lit.h, ya, yb)
    count = segment_nodes(medium, lit.h, ya, yb, angle)
    k = int(0)
    while k < count:
        node = segment_node(k, count)
        y = equiangular_point(lit.h, ya, yb, angle, node[0])
        distance = wp.sqrt(lit.h * lit.h + y * y)
        t = wp.max(lit.foot + y, 0.0)
        weight = node[1] * phase_eval(medium.phase, one_minus_cos_at(y, lit.h, distance))
        L += weight * wp.cw_mul(light_towards(light, o + t * d, distance), transmittance(medium, t + distance))
        k += 1
    return angle * wp.cw_mul(medium.sigma_s, L)


@wp.func
def next_break(y: float, candidate: float, so_far: float):
    """The nearer of two points beyond ``y`` where an interval may be divided."""
    return wp.where(candidate > y and candidate < so_far, candidate, so_far)


@wp.func
def single_scattering(medium: Medium, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """Radiance that single scattering of a light adds to an unobstructed ray up to ``t_max``.

    The lit interval is divided at the light's foot, before which the phase function peaks; as often as that peak
    requires; and where the soft edge begins, which is a kink.
    """
    L = wp.vec3(0.0)
    lit = light_beam(light, o, d, t_max)
    if lit.angle <= 0.0:
        return L
    inner = light_core(light, o, d, t_max)
    y = lit.ya
    while y < lit.yb:
        end = next_break(y, 0.0, lit.yb)
        end = next_break(y, peak_break(medium.phase, lit.h, y), end)
        if inner.angle > 0.0:
            end = next_break(y, inner.ya, end)
            end = next_break(y, inner.yb, end)
        L += scattered_between(medium, light, o, d, lit, y, end)
        y = end
    return L
