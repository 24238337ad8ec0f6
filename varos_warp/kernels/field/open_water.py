"""Light in water without end: tables of what lamps send anywhere by scattering, and single scattering by quadrature.

Nothing here knows of surfaces. What they take away is subtracted by paths (kernels/transport/path.py).

The field of light around a lamp has the symmetry of its cone. What is known of it at a point depends on the distance
from the lamp, the angle to its axis, and a direction: gamma, its angle to the direction to the lamp, and phi, which
goes around that from the plane of the axis and has the same field on both sides.
"""

import warp as wp

from varos_warp.kernels.conventions import NEAR
from varos_warp.kernels.sampling import equiangular_angle, equiangular_point, one_minus_cos_at
from varos_warp.kernels.world.light import (
    Light,
    LitInterval,
    brightest,
    light_axis,
    light_beam,
    light_centre,
    light_core,
    light_intensity,
    light_towards,
)
from varos_warp.kernels.world.medium import Medium, transmittance
from varos_warp.kernels.world.phase import Phase, phase_eval

wp.set_module_options({"enable_backward": False})

SEGMENT_NODES, SHORT_NODES, SLIVER_NODES = wp.constant(10), wp.constant(6), wp.constant(4)
SHORT_DEPTH, SLIVER_DEPTH, SLIVER_RAD = wp.constant(0.2), wp.constant(0.1), wp.constant(0.2)
"""Nodes of the quadrature of single scattering, at most 0.1 % off over rays of any length in the paper's water
(measured); on optically short intervals and on slivers such as a soft edge fewer are no worse."""
GROWTH, CORE, BACKWARD = wp.constant(4.0), wp.constant(5.0), wp.constant(64.0)
"""Where the phase function is sharp, pieces in which the tangent of half the scattering angle grows at most so many
times. That of Henyey and Greenstein is smooth where the tangent is less than CORE (1 - g); for g < 0 pieces go on to
BACKWARD times the lamp's distance from the ray."""


@wp.struct
class NodeGrid:
    """Places around a lamp, in a half plane through its axis, where tables have their nodes."""

    distances: int
    nearest: float
    """Distance of the first node [m]; their logarithms are evenly spaced."""
    log_step: float
    half_angle: float
    """Of the cone [rad]; pi for lamps that shine everywhere."""
    inside: int
    """Steps of the angle to the axis inside the cone, and outside of it; they narrow towards its edge."""
    outside: int
    decay: wp.vec3
    """What the light falls off with about, beside the inverse distance [1/m]."""


@wp.struct
class LampTable:
    """Scattered light around lamps of one kind, of intensity 1. Values are divided by ``scale_at``."""

    grid: NodeGrid
    irradiance: wp.array4d(dtype=wp.vec3)
    """Of planes: [distance, angle, gamma of the normal in even steps, phi in even steps]."""
    source: wp.array4d(dtype=wp.vec3)
    """What a metre of a ray receives by another scattering: [distance, angle, gamma with an even root, phi]."""


@wp.struct
class Tables:
    """Everything that is known of the light in open water; owned by the host's render/field/open_water.py."""

    lamp: wp.array(dtype=LampTable)
    """Per lamp."""
    veil: wp.array3d(dtype=wp.vec3)
    """Radiance of light scattered twice or more on its way, [distance, row, column] of a camera's image."""
    veil_nearest: float
    veil_log_step: float
    """Distances along the camera's rays [m], their logarithms evenly spaced."""


# ---------------------------------------------------------------------------------------------------------- the nodes


@wp.func
def scale_at(grid: NodeGrid, d: float):
    """About how the scattered light falls off with the distance, without its constants."""
    x = d * grid.decay
    return wp.vec3(wp.exp(-wp.min(x[0], 60.0)), wp.exp(-wp.min(x[1], 60.0)), wp.exp(-wp.min(x[2], 60.0))) / d


@wp.func
def node_distance(grid: NodeGrid, node: int):
    """The distance [m] of a node."""
    return grid.nearest * wp.exp(float(node) * grid.log_step)


@wp.func
def node_angle(grid: NodeGrid, node: int):
    """The angle to the axis [rad] of a node: quadratic on both sides of the cone's edge."""
    if node <= grid.inside:
        rest = 1.0 - float(node) / float(grid.inside)
        return grid.half_angle * (1.0 - rest * rest)
    share = float(node - grid.inside) / float(grid.outside)
    return grid.half_angle + (wp.pi - grid.half_angle) * share * share


@wp.func
def grid_place(grid: NodeGrid, d: float, theta: float):
    """Row and column, with fractions, of a place among the nodes; inverse of node_distance and node_angle."""
    row = wp.clamp(wp.log(d / grid.nearest) / grid.log_step, 0.0, float(grid.distances - 1) - 1.0e-3)
    col = float(grid.inside)
    if theta < grid.half_angle:
        col *= 1.0 - wp.sqrt(1.0 - theta / grid.half_angle)
    else:
        col += float(grid.outside) * wp.sqrt((theta - grid.half_angle) / wp.max(wp.pi - grid.half_angle, 1.0e-6))
    return wp.vec2(row, wp.clamp(col, 0.0, float(grid.inside + grid.outside) - 1.0e-3))


# ----------------------------------------------------------------------------------------------- the field of a lamp


@wp.struct
class Seen:
    """A lamp as it is seen from a point: what the tables are looked up by."""

    distance: float
    theta: float
    """Angle of the point to the lamp's axis [rad]."""
    to_light: wp.vec3
    across: wp.vec3
    """Of the lamp's axis, the part at right angles to ``to_light``, of length 1."""


@wp.func
def see_lamp(light: Light, p: wp.vec3):
    """The lamp as it is seen from ``p``."""
    seen = Seen()
    offset = light_centre(light) - p
    seen.distance = wp.max(wp.length(offset), NEAR)
    seen.to_light = offset / seen.distance
    axis = light_axis(light)
    along = wp.dot(seen.to_light, axis)
    seen.theta = wp.acos(wp.clamp(-along, -1.0, 1.0))
    seen.across = (axis - along * seen.to_light) / wp.sqrt(wp.max(1.0 - along * along, 1.0e-12))
    return seen


@wp.func
def gamma_phi(seen: Seen, d: wp.vec3):
    """Angles (gamma, phi) of a direction, as shares of pi; from the chord, for small angles have no digits."""
    gamma = 2.0 * wp.asin(wp.min(0.5 * wp.length(d - seen.to_light), 1.0))
    cos_phi = wp.dot(d, seen.across) / wp.max(wp.sin(gamma), 1.0e-6)
    return wp.vec2(gamma, wp.acos(wp.clamp(cos_phi, -1.0, 1.0))) / wp.pi


@wp.func
def interpolate(values: wp.array4d(dtype=wp.vec3), place: wp.vec2, u: float, v: float):
    """Values between the nodes, at a place on the grid and shares (u, v) of the steps of the direction."""
    across = wp.clamp(u, 0.0, 1.0) * (float(values.shape[2] - 1) - 1.0e-3)
    around = wp.clamp(v, 0.0, 1.0) * (float(values.shape[3] - 1) - 1.0e-3)
    i = int(place[0])
    j = int(place[1])
    k = int(across)
    m = int(around)
    b = around - float(m)
    total = wp.vec3(0.0)
    for corner in range(4):
        di = corner >> 1
        dj = corner & 1
        weight = wp.where(di == 1, place[0] - float(i), 1.0 - place[0] + float(i))
        weight *= wp.where(dj == 1, place[1] - float(j), 1.0 - place[1] + float(j))
        near = wp.lerp(values[i + di, j + dj, k, m], values[i + di, j + dj, k, m + 1], b)
        far = wp.lerp(values[i + di, j + dj, k + 1, m], values[i + di, j + dj, k + 1, m + 1], b)
        total += weight * wp.lerp(near, far, across - float(k))
    return total


@wp.func
def scattered_irradiance(table: LampTable, light: Light, p: wp.vec3, n: wp.vec3):
    """Irradiance [W/m^2] of a plane at ``p`` with normal ``n`` by light of a lamp that was scattered on its way."""
    seen = see_lamp(light, p)
    normal = gamma_phi(seen, n)
    E = interpolate(table.irradiance, grid_place(table.grid, seen.distance, seen.theta), normal[0], normal[1])
    E = wp.cw_mul(wp.cw_mul(E, scale_at(table.grid, seen.distance)), light_intensity(light))
    return wp.max(E, wp.vec3(0.0))


@wp.func
def scattered_again(table: LampTable, light: Light, p: wp.vec3, d: wp.vec3):
    """Radiance per metre [W/sr/m^3] that a ray along ``d`` receives at ``p`` by another scattering.

    That is of light of a lamp which was scattered before.
    """
    seen = see_lamp(light, p)
    ray = gamma_phi(seen, d)
    S = interpolate(table.source, grid_place(table.grid, seen.distance, seen.theta), wp.sqrt(ray[0]), ray[1])
    return wp.cw_mul(wp.cw_mul(S, scale_at(table.grid, seen.distance)), light_intensity(light))


# ------------------------------------------------------------------------------------------------ along a camera's ray


@wp.func
def veil_radiance(tables: Tables, x: float, y: float, t: float):
    """Radiance of light scattered twice or more before ``t`` along the ray through a place (x, y) in [0, 1]^2."""
    last = tables.veil.shape[0] - 1
    at = wp.log(wp.max(t, 1.0e-9) / tables.veil_nearest) / tables.veil_log_step
    share = float(1.0)
    if at < 0.0:
        share = wp.exp(at * tables.veil_log_step)
    at = wp.clamp(at, 0.0, float(last) - 1.0e-3)
    u = wp.clamp(x, 0.0, 1.0) * float(tables.veil.shape[2] - 1)
    v = wp.clamp(y, 0.0, 1.0) * float(tables.veil.shape[1] - 1)
    i = int(at)
    j = wp.min(int(v), tables.veil.shape[1] - 2)
    k = wp.min(int(u), tables.veil.shape[2] - 2)
    L = wp.vec3(0.0)
    for corner in range(8):
        di = corner >> 2
        dj = (corner >> 1) & 1
        dk = corner & 1
        weight = wp.where(di == 1, at - float(i), 1.0 - at + float(i))
        weight *= wp.where(dj == 1, v - float(j), 1.0 - v + float(j))
        weight *= wp.where(dk == 1, u - float(k), 1.0 - u + float(k))
        L += weight * tables.veil[i + di, j + dj, k + dk]
    return share * L


# ------------------------------------------------------------------------------------------------- single scattering


@wp.func
def legendre_node(k: int):
    """Node in [0, 1] and weight of the Gauss-Legendre quadrature of eight nodes."""
    m = k
    if k > 3:
        m = 7 - k
    x = float(0.0198550717512319)
    w = float(0.0506142681451881)
    if m == 1:
        x = float(0.101666761293187)
        w = float(0.111190517226687)
    if m == 2:
        x = float(0.237233795041835)
        w = float(0.156853322938944)
    if m == 3:
        x = float(0.408282678752175)
        w = float(0.181341891689181)
    if k > 3:
        x = 1.0 - x
    return wp.vec2(x, w)


@wp.func
def smooth_below(phase: Phase):
    """Tangent of half the angle to the peak of a phase function within which it is smooth, no power of the angle."""
    if phase.log_p.shape[0] > 0:
        return wp.exp(0.5 * phase.log_first)
    return CORE * (1.0 - wp.abs(phase.g))


@wp.func
def peak_break(phase: Phase, h: float, y: float):
    """Where an interval that begins ``y`` from a lamp's foot is divided, for the phase function is sharp beyond.

    The tangent of half the scattering angle is exp(asinh(y/h)); a backward peak is as a forward peak from behind.
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
    """How many nodes an interval takes."""
    depth = brightest(medium.sigma_t) * (yb - ya + wp.sqrt(h * h + yb * yb) - wp.sqrt(h * h + ya * ya))
    q = h / (wp.sqrt(h * h + ya * ya) - wp.min(ya, 0.0))
    if depth < SLIVER_DEPTH and angle * h < SLIVER_RAD * wp.min(wp.max(q, smooth_below(medium.phase)), 1.0):
        return SLIVER_NODES
    if depth < SHORT_DEPTH and (ya >= 0.0 or angle * h < 6.5 * q):
        return SHORT_NODES
    return SEGMENT_NODES


@wp.func
def segment_node(k: int, count: int):
    """Node in [0, 1] and weight of the Gauss-Legendre quadrature of ``count`` nodes."""
    m = wp.min(k, count - 1 - k)
    node = wp.vec2(0.0)
    if count == SLIVER_NODES:
        node = wp.where(m == 0, wp.vec2(0.0694318442029737, 0.1739274225687269),
                        wp.vec2(0.3300094782075719, 0.3260725774312731))
    elif count == SHORT_NODES:
        node = wp.vec2(0.0337652428984240, 0.0856622461895852)
        if m == 1:
            node = wp.vec2(0.1693953067668677, 0.1803807865240693)
        if m == 2:
            node = wp.vec2(0.3806904069584016, 0.2339569672863455)
    else:
        node = wp.vec2(0.0130467357414142, 0.0333356721543441)
        if m == 1:
            node = wp.vec2(0.0674683166555077, 0.0747256745752903)
        if m == 2:
            node = wp.vec2(0.1602952158504878, 0.1095431812579910)
        if m == 3:
            node = wp.vec2(0.2833023029353764, 0.1346333596549981)
        if m == 4:
            node = wp.vec2(0.4255628305091844, 0.1477621123573765)
    return wp.vec2(wp.where(k > m, 1.0 - node[0], node[0]), node[1])


@wp.func
def scattered_between(medium: Medium, light: Light, o: wp.vec3, d: wp.vec3, lit: LitInterval, ya: float, yb: float):
    """Radiance that scattering once between ya and yb adds to a ray, by quadrature in the equiangular angle.

    There the distance law is a constant, and what is left is smooth.
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
    """The nearer one of two places where an interval may be divided, beyond ``y``."""
    return wp.where(candidate > y and candidate < so_far, candidate, so_far)


@wp.func
def single_scattering(medium: Medium, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """Radiance that a lamp's light adds to a ray up to ``t_max`` by scattering once, without obstacles.

    The lit interval is divided at the lamp's foot, before which the phase function peaks, as often as the peak asks
    for, and where a soft edge begins, which is a kink.
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
