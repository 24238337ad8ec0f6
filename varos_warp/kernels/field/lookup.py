"""How paths use the precomputed field of open water: light that surfaces reflect, and in-scattering along a ray."""

import warp as wp

from varos_warp.kernels.field.open_water import Field, LightField, node_distance, scattered_irradiance, source_function
from varos_warp.kernels.sampling import asinh, make_reservoir, offer
from varos_warp.kernels.transport.subpath import Vertex
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import Light, get_light, light_centre, light_count, light_strength
from varos_warp.kernels.world.medium import transmittance

wp.set_module_options({"enable_backward": False})

STRAIGHT_SHARE = wp.constant(0.5)
"""Share of points of a ray that are drawn evenly on the way to the light."""


@wp.func
def reflected_field(scene: SceneData, field: Field, vertex: Vertex):
    """Radiance that a matte surface reflects of the field, reflectance E_F / pi; none for a metal."""
    E = wp.vec3(0.0)
    if vertex.surface.metal > 0.0:
        return E
    for i in range(light_count(scene.lights)):
        E += scattered_irradiance(field.lights[i], get_light(scene.lights, i), vertex.p, vertex.n)
    return wp.cw_mul(vertex.surface.reflectance, E) / wp.pi


@wp.struct
class NearLight:
    """A ray in the measure asinh(y/h), y from the foot of a light, in which the inverse distance from it is even."""

    foot: float
    h: float
    low: float
    """Where the ray begins, and where it or the field ends; the difference is the integral of the inverse distance."""
    high: float


@wp.func
def near_light(field: LightField, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """The measure of a light along the ray from ``o`` up to ``t_max``."""
    ray = NearLight()
    to_light = light_centre(light) - o
    ray.foot = wp.dot(to_light, d)
    ray.h = wp.max(wp.length(to_light - ray.foot * d), 1.0e-3 * wp.length(to_light) + 1.0e-6)
    reach = wp.min(t_max, wp.max(ray.foot, 0.0) + node_distance(field.grid, field.grid.distances - 1))
    ray.low = asinh(-ray.foot / ray.h)
    ray.high = asinh((reach - ray.foot) / ray.h)
    return ray


@wp.func
def sample_near_light(ray: NearLight, t_max: float, u: float, v: float):
    """Distance on the ray and the inverse of its density: even in NearLight's measure, or on the way to the light.

    Light that is hardly deflected comes straight from the light and does not fall off on that way.
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
def sample_field(scene: SceneData, field: Field, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """Multiple in-scattering of open water along a ray up to ``t_max``, estimated by one sample.

    One light is chosen by its intensity over the distance, and one point of the ray as the field falls off or on the
    way to the light, so that the weights are bounded.
    """
    chosen = make_reservoir(u)
    ray = NearLight()
    for i in range(light_count(scene.lights)):
        light = get_light(scene.lights, i)
        candidate = near_light(field.lights[i], light, o, d, t_max)
        chosen = offer(chosen, i, light_strength(light) * (candidate.high - candidate.low))
        if chosen.index == i:
            ray = candidate
    if chosen.index < 0:
        return wp.vec3(0.0)
    place = sample_near_light(ray, t_max, chosen.u, v)
    weight = place[1] * chosen.total / chosen.weight
    t = place[0]
    S = source_function(field.lights[chosen.index], get_light(scene.lights, chosen.index), o + t * d, d)
    return weight * wp.cw_mul(transmittance(scene.medium, t), S)
