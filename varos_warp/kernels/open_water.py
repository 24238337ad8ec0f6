"""Light in water without end: tables of what lamps send anywhere by scattering, and single scattering by quadrature.

Nothing here knows of surfaces. What they take away is subtracted by kernels/tables.py, so that the sum is right.

The field of light around a lamp has the symmetry of its cone. At a point at a distance ``d`` from it, at an angle
``theta`` to its axis, the radiance that arrives scattered is kept as its moments in real spherical harmonics about the
direction to the lamp, those of orders 0, 1, 2 and 4 that make up the irradiance of a plane of any normal
(Ramamoorthi and Hanrahan 2001), and a part that comes straight from the lamp, such that the moment of order 6 is
right too (the delta-M method of Wiscombe 1977): without it forward-scattered light would be cut off at grazing angles.
"""

import warp as wp

from varos_warp.kernels.conventions import NEAR
from varos_warp.kernels.intersect import SceneData
from varos_warp.kernels.light import Light, LitInterval, falloff, lit_interval
from varos_warp.kernels.medium import transmittance
from varos_warp.kernels.phase import hg_eval
from varos_warp.kernels.sampling import equiangular_angle, sample_equiangular
from varos_warp.kernels.single_scatter import one_minus_cos_at

wp.set_module_options({"enable_backward": False})

MOMENTS = 12
"""Numbers kept per point: 11 moments and the part straight from the lamp."""
vec_moments = wp.types.vector(length=MOMENTS, dtype=float)

SEGMENT_NODES = wp.constant(8)
"""Of the quadrature of single scattering: at most 0.1 % off up to 25 m in the paper's water (measured)."""


@wp.struct
class LampTable:
    """Scattered light around lamps of one kind, of intensity 1."""

    moments: wp.array3d(dtype=wp.vec3)
    """[distance, angle, MOMENTS], times ``irradiance_scale``."""
    nearest: float
    """Distance of the first node [m]; their logarithms are evenly spaced."""
    log_step: float
    half_angle: float
    """Of the cone [rad]; pi for lamps that shine everywhere."""
    inside: int
    """Steps of the angle inside the cone; they narrow towards its edge from either side."""
    decay: wp.vec3
    """What the light falls off with about, beside the inverse distance [1/m]."""


@wp.struct
class Tables:
    """Everything that is known of the light in open water; owned by the host's render/tables.py."""

    lamp: wp.array(dtype=LampTable)
    """Per lamp."""
    veil: wp.array3d(dtype=wp.vec3)
    """Radiance of light scattered twice or more on its way, [distance, row, column] of a camera's image."""
    veil_nearest: float
    veil_log_step: float
    """Distances along the camera's rays [m], their logarithms evenly spaced."""


# ----------------------------------------------------------------------------------------------- the field of a lamp


@wp.func
def irradiance_basis(x: float, z: float):
    """What each moment adds to the irradiance of a plane with normal (x, y, z), z towards the lamp.

    y occurs only squared, for the field is symmetric about the plane of the lamp's axis. Moments are kept with the
    factors pi, 2 pi/3, pi/4 and -pi/24 of a cosine.
    """
    x2 = x * x
    z2 = z * z
    y2 = wp.max(1.0 - x2 - z2, 0.0)
    basis = vec_moments()
    basis[0] = 0.282095
    basis[1] = 0.488603 * z
    basis[2] = 0.488603 * x
    basis[3] = 0.315392 * (3.0 * z2 - 1.0)
    basis[4] = 1.092548 * x * z
    basis[5] = 0.546274 * (x2 - y2)
    basis[6] = 0.105786 * ((35.0 * z2 - 30.0) * z2 + 3.0)
    basis[7] = 0.669047 * x * z * (7.0 * z2 - 3.0)
    basis[8] = 0.473087 * (x2 - y2) * (7.0 * z2 - 1.0)
    basis[9] = 1.770131 * x * z * (x2 - 3.0 * y2)
    basis[10] = 0.625836 * (x2 * x2 - 6.0 * x2 * y2 + y2 * y2)
    basis[11] = wp.max(z, 0.0)
    return basis


@wp.func
def radiance_moments(x: float, z: float):
    """Moments of radiance that comes from the direction (x, y, z), z towards the lamp; see irradiance_basis."""
    m = irradiance_basis(x, z)
    z2 = z * z
    straight = (((231.0 * z2 - 315.0) * z2 + 105.0) * z2 - 5.0) / 16.0
    m[0] = wp.pi * (m[0] - 0.282095 * straight)
    m[1] = wp.tau / 3.0 * (m[1] - 0.488603 * straight)
    m[2] = wp.tau / 3.0 * m[2]
    m[3] = wp.pi / 4.0 * (m[3] - 0.630783 * straight)
    m[4] = wp.pi / 4.0 * m[4]
    m[5] = wp.pi / 4.0 * m[5]
    m[6] = -wp.pi / 24.0 * (m[6] - 0.846284 * straight)
    m[7] = -wp.pi / 24.0 * m[7]
    m[8] = -wp.pi / 24.0 * m[8]
    m[9] = -wp.pi / 24.0 * m[9]
    m[10] = -wp.pi / 24.0 * m[10]
    m[11] = straight
    return m


@wp.func
def irradiance_scale(table: LampTable, d: float):
    """About how the scattered light falls off with the distance, without its constants."""
    x = d * table.decay
    return wp.vec3(wp.exp(-wp.min(x[0], 60.0)), wp.exp(-wp.min(x[1], 60.0)), wp.exp(-wp.min(x[2], 60.0))) / d


@wp.func
def angle_node(table: LampTable, theta: float):
    """Place of an angle among the nodes: quadratic on both sides of the cone's edge."""
    inside = float(table.inside)
    if theta < table.half_angle:
        return inside * (1.0 - wp.sqrt(1.0 - theta / table.half_angle))
    outside = float(table.moments.shape[1] - 1 - table.inside)
    return inside + outside * wp.sqrt((theta - table.half_angle) / wp.max(wp.pi - table.half_angle, 1.0e-6))


@wp.func
def node_angle(table: LampTable, node: int):
    """The angle [rad] of a node; inverse of angle_node."""
    if node <= table.inside:
        rest = 1.0 - float(node) / float(table.inside)
        return table.half_angle * (1.0 - rest * rest)
    share = float(node - table.inside) / float(table.moments.shape[1] - 1 - table.inside)
    return table.half_angle + (wp.pi - table.half_angle) * share * share


@wp.func
def node_distance(table: LampTable, node: int):
    """The distance [m] of a node."""
    return table.nearest * wp.exp(float(node) * table.log_step)


@wp.func
def scattered_irradiance(table: LampTable, light: Light, p: wp.vec3, n: wp.vec3):
    """Irradiance [W/m^2] of a plane at ``p`` with normal ``n`` by light of a lamp that was scattered on its way."""
    offset = light.position - p
    d = wp.max(wp.length(offset), NEAR)
    to_light = offset / d
    along = wp.dot(to_light, light.axis)
    z = wp.dot(n, to_light)
    sine = wp.sqrt(wp.max(1.0 - along * along, 1.0e-12))
    x = (wp.dot(n, light.axis) - along * z) / sine
    basis = irradiance_basis(wp.clamp(x, -1.0, 1.0), z)

    row = wp.clamp(wp.log(d / table.nearest) / table.log_step, 0.0, float(table.moments.shape[0] - 1) - 1.0e-3)
    col = angle_node(table, wp.acos(wp.clamp(-along, -1.0, 1.0)))
    i = int(row)
    j = wp.clamp(int(col), 0, table.moments.shape[1] - 2)
    a = row - float(i)
    b = col - float(j)
    E = wp.vec3(0.0)
    for k in range(MOMENTS):
        near = (1.0 - b) * table.moments[i, j, k] + b * table.moments[i, j + 1, k]
        far = (1.0 - b) * table.moments[i + 1, j, k] + b * table.moments[i + 1, j + 1, k]
        E += basis[k] * ((1.0 - a) * near + a * far)
    E = wp.cw_mul(wp.cw_mul(E, irradiance_scale(table, d)), light.intensity)
    return wp.max(E, wp.vec3(0.0))


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
    """Node in [0, 1] and weight of the Gauss-Legendre quadrature of SEGMENT_NODES nodes."""
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
def scattered_between(scene: SceneData, light: Light, o: wp.vec3, d: wp.vec3, lit: LitInterval, ya: float, yb: float):
    """Radiance that scattering once between ya and yb adds to a ray, by quadrature in the equiangular angle.

    There the distance law is a constant, and what is left is smooth.
    """
    L = wp.vec3(0.0)
    if yb <= ya:
        return L
    for k in range(SEGMENT_NODES):
        node = legendre_node(k)
        y = sample_equiangular(lit.h, ya, yb, node[0])
        distance = wp.sqrt(lit.h * lit.h + y * y)
        t = wp.max(lit.foot + y, 0.0)
        weight = node[1] * hg_eval(one_minus_cos_at(y, lit.h, distance), scene.medium.g)
        weight *= falloff(light, wp.dot(o + t * d - light.position, light.axis) / distance)
        L += weight * transmittance(scene.medium, t + distance)
    L *= equiangular_angle(lit.h, ya, yb)
    return wp.cw_mul(wp.cw_mul(scene.medium.sigma_s, light.intensity), L)


@wp.func
def single_scattering(scene: SceneData, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """Radiance that a lamp's light adds to a ray up to ``t_max`` by scattering once, without obstacles.

    A soft edge has kinks where it begins, so the part of the ray within it is taken apart.
    """
    lit = lit_interval(light, o, d, t_max)
    if lit.angle <= 0.0:
        return wp.vec3(0.0)
    inner = LitInterval()
    if light.blend > 0.0 and light.cos_half > -1.0:
        core = light
        core.cos_half = light.cos_half + light.blend * (1.0 - light.cos_half)
        inner = lit_interval(core, o, d, t_max)
    if inner.angle <= 0.0:
        return scattered_between(scene, light, o, d, lit, lit.ya, lit.yb)
    L = scattered_between(scene, light, o, d, lit, lit.ya, inner.ya)
    L += scattered_between(scene, light, o, d, lit, inner.ya, inner.yb)
    return L + scattered_between(scene, light, o, d, lit, inner.yb, lit.yb)
