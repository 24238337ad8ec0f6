"""Single scattering of a light along an unobstructed ray, by quadrature."""

import warp as wp

from varos_warp.kernels.numerics import brightest, make_gauss_legendre
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.light import (
    get_light,
    light_at,
    light_axis,
    light_centre,
    light_core,
    light_count,
    lit_part,
)
from varos_warp.kernels.world.lights.record import Light, LitInterval
from varos_warp.kernels.world.medium import Medium, transmittance
from varos_warp.kernels.world.phase import Phase, phase_eval

wp.set_module_options({"enable_backward": False})

NODES, SHORT_NODES, SLIVER_NODES = wp.constant(10), wp.constant(6), wp.constant(4)
SHORT_DEPTH, SLIVER_DEPTH, SLIVER_RAD = wp.constant(0.2), wp.constant(0.1), wp.constant(0.2)
"""Nodes of the quadrature: the error is at most 0.1 % over rays of any length in the paper's water (measured). On
optically short intervals, and on slivers such as a soft edge, fewer suffice."""
GROWTH, CORE, BACKWARD = wp.constant(4.0), wp.constant(5.0), wp.constant(64.0)
"""Bounds for dividing intervals where the phase function is sharp: the tangent of half the scattering angle grows by at
most GROWTH within an interval. Henyey and Greenstein's is smooth where the tangent is below CORE (1 - g); for g < 0
intervals are divided up to BACKWARD times the light's distance from the ray."""

node, short_node, sliver_node = (make_gauss_legendre(count) for count in (NODES, SHORT_NODES, SLIVER_NODES))


@wp.func
def smooth_below(phase: Phase):
    """Tangent of half the angle up to which a phase function is smooth; beyond, it is a power of the angle."""
    if phase.log_p.shape[0] > 0:
        return wp.exp(0.5 * phase.log_first)
    return CORE * (1.0 - wp.abs(phase.g))


@wp.func
def peak_break(phase: Phase, h: float, y: float):
    """Place, from a light's foot, at which to divide an interval that starts at ``y``: the phase function is sharp.

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


@wp.struct
class Stretch:
    """A part of a lit interval on one side of the light's foot, by the angle to the ray under which it sees the light.

    With theta the scattering angle, y = -h / tan(theta).
    """

    before: bool
    """True if it is before the foot, where that angle is theta; False if it is after it, where it is pi - theta."""
    start: float
    """Half of that angle [rad] at the start; at most pi/4."""
    turn: float
    """How half of that angle changes from start to end [rad]."""
    angle: float
    """Integral of 1/distance^2 to the light; stays finite as h -> 0."""
    depth: float
    """Optical depth from end to end, of the light's way to the ray and along it."""


@wp.func
def make_stretch(medium: Medium, h: float, ya: float, yb: float):
    """The part from ya to yb."""
    part = Stretch()
    part.before = yb <= 0.0
    da = wp.sqrt(h * h + ya * ya)
    db = wp.sqrt(h * h + yb * yb)
    near = wp.abs(ya) + da
    far = wp.abs(yb) + db
    # the difference of their inverses, without cancellation, over one and the product of h / near and h / far
    change = (yb - ya) * (1.0 + wp.abs(ya + yb) / (da + db)) / (near * far + h * h)
    part.start = wp.atan(h / near)
    part.turn = wp.atan(wp.where(part.before, change, -change) * h)
    part.angle = 2.0 * wp.abs(part.turn) / h
    part.depth = brightest(medium.sigma_t) * (yb - ya + db - da)
    return part


@wp.func
def stretch_nodes(phase: Phase, part: Stretch):
    """Number of nodes that a part needs."""
    angle = 2.0 * wp.abs(part.turn)
    # over which the phase function changes: half the scattering angle before the foot, what it lacks to pi after it
    peak = wp.where(part.before, part.start, 2.0 * part.start)
    if part.depth < SLIVER_DEPTH and angle < SLIVER_RAD * wp.min(wp.max(peak, smooth_below(phase)), 1.0):
        return SLIVER_NODES
    if part.depth < SHORT_DEPTH and (not part.before or angle < 6.5 * peak):
        return SHORT_NODES
    return NODES


@wp.func
def sine_and_cosine(x: float):
    """Sine and cosine of an angle of at most pi/4, up to a common factor.

    Their ratio is a convergent of Lambert's continued fraction for the tangent, 2e-8 off, in a fraction of its time.
    """
    x2 = x * x
    return wp.vec2(x * (945.0 + x2 * (x2 - 105.0)), 945.0 + x2 * (15.0 * x2 - 420.0))


@wp.func
def segment_node(k: int, count: int):
    """Node ``k`` in [0, 1] and weight of the Gauss-Legendre quadrature of ``count`` nodes."""
    if count == SLIVER_NODES:
        return sliver_node(k)
    if count == SHORT_NODES:
        return short_node(k)
    return node(k)


@wp.func
def scattered_between(medium: Medium, light: Light, lit: LitInterval, along: float, across: float, part: Stretch):
    """Radiance that single scattering in a part of a lit interval adds to a ray, by quadrature in the scattering angle.

    In that angle the inverse square of the distance is constant, and the rest is smooth. With q the tangent of half of
    it, y = (q - 1/q) h/2, the distance from the light is (q + 1/q) h/2, and their sum is q h. ``along`` and ``across``
    are the components of the light's axis along the ray, and along the way from the light to its foot.
    """
    L = wp.vec3(0.0)
    count = stretch_nodes(medium.phase, part)
    k = int(0)
    while k < count:
        node = segment_node(k, count)
        of_half = sine_and_cosine(part.start + node[0] * part.turn)
        s = wp.where(part.before, of_half[0], of_half[1])
        c = wp.where(part.before, of_half[1], of_half[0])
        r = 1.0 / (s * s + c * c)
        weight = node[1] * phase_eval(medium.phase, 2.0 * s * s * r)
        intensity = light_at(light, r * (2.0 * s * c * across + (s * s - c * c) * along))
        L += weight * wp.cw_mul(intensity, transmittance(medium, wp.max(lit.foot + lit.h * s / c, 0.0)))
        k += 1
    return part.angle * wp.cw_mul(medium.sigma_s, L)


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
    lit = lit_part(light, o, d, t_max)
    inner = light_core(light, o, d, t_max)
    along = wp.dot(light_axis(light), d)
    across = wp.dot(light_axis(light), lit.foot * d - (light_centre(light) - o)) / lit.h
    y = lit.ya
    while y < lit.yb:
        end = next_break(y, 0.0, lit.yb)
        end = next_break(y, peak_break(medium.phase, lit.h, y), end)
        if inner.yb > inner.ya:
            end = next_break(y, inner.ya, end)
            end = next_break(y, inner.yb, end)
        L += scattered_between(medium, light, lit, along, across, make_stretch(medium, lit.h, y, end))
        y = end
    return L


@wp.func(inline=False)
def scattered_by_lights(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float):
    """Radiance that single scattering of all lights adds to an unobstructed ray up to ``t``."""
    L = wp.vec3(0.0)
    for i in range(light_count(scene.lights)):
        L += single_scattering(scene.medium, get_light(scene.lights, i), o, d, t)
    return L
