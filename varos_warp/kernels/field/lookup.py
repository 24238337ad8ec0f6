"""What paths ask of the precomputed field of open water: irradiance at a point, and in-scattering along a ray."""

import warp as wp

from varos_warp.kernels.field.open_water import LampTable, Tables, node_distance, scattered_again, scattered_irradiance
from varos_warp.kernels.sampling import Pick, asinh, reservoir
from varos_warp.kernels.transport.subpath import Vertex
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import Light, light_centre, light_strength
from varos_warp.kernels.world.medium import transmittance

wp.set_module_options({"enable_backward": False})

STRAIGHT_SHARE = wp.constant(0.5)
"""Share of places on a ray that are even on the way to the light."""


@wp.func
def reflected_field(scene: SceneData, field: Tables, vertex: Vertex):
    """Radiance that a matte surface reflects of light scattered in open water; none of a metal."""
    E = wp.vec3(0.0)
    if vertex.surface.metal > 0.0:
        return E
    for i in range(scene.lights.shape[0]):
        E += scattered_irradiance(field.lamp[i], scene.lights[i], vertex.p, vertex.n)
    return wp.cw_mul(vertex.surface.reflectance, E) / wp.pi


@wp.struct
class NearLight:
    """A ray in a measure that is even in the inverse of the distance from a light: asinh(y/h), y from its foot."""

    foot: float
    h: float
    low: float
    """Where the ray begins and where the field ends; ``high`` - ``low`` is the integral of the inverse distance."""
    high: float


@wp.func
def near_light(table: LampTable, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """A ray from ``o`` up to ``t_max`` as a light sees it."""
    ray = NearLight()
    to_light = light_centre(light) - o
    ray.foot = wp.dot(to_light, d)
    ray.h = wp.max(wp.length(to_light - ray.foot * d), 1.0e-3 * wp.length(to_light) + 1.0e-6)
    reach = wp.min(t_max, wp.max(ray.foot, 0.0) + node_distance(table.grid, table.grid.distances - 1))
    ray.low = asinh(-ray.foot / ray.h)
    ray.high = asinh((reach - ray.foot) / ray.h)
    return ray


@wp.func
def sample_near_light(ray: NearLight, t_max: float, u: float, v: float):
    """A place on the ray and the inverse of its density: even in `NearLight`'s measure, or on the way to the light.

    Light that is scattered little comes straight from the light, and falls off in no other way there.
    """
    ahead = wp.min(ray.foot, t_max)
    share = wp.where(ahead > 0.0, STRAIGHT_SHARE, 0.0)
    x = wp.lerp(ray.low, ray.high, v)
    t = wp.max(ray.foot + 0.5 * ray.h * (wp.exp(x) - wp.exp(-x)), 0.0)
    if u < share:
        t = v * ahead
    y = t - ray.foot
    pdf = (1.0 - share) / ((ray.high - ray.low) * wp.sqrt(ray.h * ray.h + y * y))
    if t < ahead:
        pdf += share / ahead
    return wp.vec2(t, 1.0 / pdf)


@wp.func
def sample_field(scene: SceneData, field: Tables, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """Estimate of the radiance of light scattered twice or more that open water adds to a ray up to ``t_max``.

    One light is taken by its intensity over the distance, and one place on the ray as the field falls off or on the
    way to the light; so the weights are bounded.
    """
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    ray = NearLight()
    for i in range(scene.lights.shape[0]):
        candidate = near_light(field.lamp[i], scene.lights[i], o, d, t_max)
        weight = light_strength(scene.lights[i]) * (candidate.high - candidate.low)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            ray = candidate
    if pick.index < 0:
        return wp.vec3(0.0)
    place = sample_near_light(ray, t_max, pick.u, v)
    weight = place[1] * total / pick.weight
    t = place[0]
    S = scattered_again(field.lamp[pick.index], scene.lights[pick.index], o + t * d, d)
    return weight * wp.cw_mul(transmittance(scene.medium, t), S)
