"""How paths use the precomputed field of open water: its light off surfaces, and its in-scattering along a ray."""

import warp as wp

from varos_warp.kernels.field.open_water import Field, LightField, node_distance, scattered_irradiance, source_function
from varos_warp.kernels.sampling import asinh, inverse_distance_area, inverse_distance_point, make_reservoir, offer
from varos_warp.kernels.world.bsdf import facing
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.light import get_light, light_centre, light_count, light_direction, light_strength
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.rough_diffuse import rough_diffuse
from varos_warp.kernels.world.texture import Bsdf

wp.set_module_options({"enable_backward": False})

STRAIGHT_SHARE = wp.constant(0.5)
"""Fraction of points on a ray that are drawn uniformly on the way to the light."""


LEAST_HEIGHT = wp.constant(0.2)
"""Least cosine at which the field of a light counts as coming from the light: it comes from all around it."""


@wp.func
def matte_reflectance(bsdf: Bsdf, n: wp.vec3, v: wp.vec3, to_light: wp.vec3):
    """Reflectance of the Lambertian surface that stands for a rough one under the field of a light.

    The field is brightest about the light, so it is that of the rough surface towards there, as seen from ``v``.
    """
    below = LEAST_HEIGHT - wp.dot(n, to_light)
    l = to_light
    if below > 0.0:
        l = wp.normalize(to_light + below * n)
    return rough_diffuse(bsdf.reflectance, bsdf.diffuse_roughness, n, facing(n, v), l)


@wp.func
def reflected_field(scene: SceneData, field: Field, bsdf: Bsdf, p: wp.vec3, n: wp.vec3, v: wp.vec3):
    """Radiance towards ``v`` of the field off a surface at ``p`` with normal ``n``, as of a Lambertian one.

    That is reflectance E_F / pi; for a rough one with `matte_reflectance`, from which paths carry the difference; for a
    metal 0.
    """
    total = wp.vec3(0.0)
    if bsdf.metal > 0.0:
        return total
    reflectance = bsdf.reflectance
    if bsdf.diffuse_roughness > 0.0:
        reflectance = wp.vec3(1.0)  # each light has its own
    for i in range(light_count(scene.lights)):
        light = get_light(scene.lights, i)
        E = scattered_irradiance(field.lights[i], light, p, n)
        if bsdf.diffuse_roughness > 0.0:
            E = wp.cw_mul(matte_reflectance(bsdf, n, v, light_direction(light, p)), E)
        total += E
    return wp.cw_mul(reflectance, total) / wp.pi


@wp.struct
class NearLight:
    """A ray in the measure asinh(y/h), y from a light's foot, whose density is the inverse distance from the light."""

    foot: float
    h: float
    low: float
    """Start of the ray, and end of it or of the field; their difference is the integral of the inverse distance."""
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
    """Distance on the ray and its inverse density: uniform in NearLight's measure, or on the way to the light.

    Light that is hardly deflected comes straight from the light and does not fall off on the way there.
    """
    ahead = wp.min(ray.foot, t_max)
    share = wp.where(ahead > 0.0, STRAIGHT_SHARE, 0.0)
    t = wp.max(ray.foot + inverse_distance_point(ray.h, ray.low, ray.high, v), 0.0)
    if u < share:
        t = v * ahead
    pdf = (1.0 - share) / inverse_distance_area(ray.h, ray.low, ray.high, t - ray.foot)
    if t < ahead:
        pdf += share / ahead
    return wp.vec2(t, 1.0 / pdf)


@wp.struct
class FieldSample:
    """Radiance of the field of one light, which stands for that of all."""

    L: wp.vec3
    light: int
    """Number of the light; -1 for none."""


@wp.func
def sample_field(scene: SceneData, field: Field, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """One-sample estimate of the multiple in-scattering of open water along a ray up to ``t_max``, and its light.

    One light is chosen in proportion to intensity over distance, and one point on the ray, in proportion to the field's
    fall-off or uniformly on the way to the light, so that the weights are bounded.
    """
    chosen = make_reservoir(u)
    ray = NearLight()
    for i in range(light_count(scene.lights)):
        light = get_light(scene.lights, i)
        candidate = near_light(field.lights[i], light, o, d, t_max)
        chosen = offer(chosen, i, light_strength(light) * (candidate.high - candidate.low))
        if chosen.index == i:
            ray = candidate
    scattered = FieldSample()
    scattered.light = chosen.index
    if chosen.index < 0:
        return scattered
    place = sample_near_light(ray, t_max, chosen.u, v)
    weight = place[1] * chosen.total / chosen.weight
    t = place[0]
    S = source_function(field.lights[chosen.index], get_light(scene.lights, chosen.index), o + t * d, d)
    scattered.L = weight * wp.cw_mul(transmittance(scene.medium, t), S)
    return scattered
