"""One light, whatever its kind: a point that shines in a cone, by a profile or in a sheet.

`light_count` and `get_light` give the lights of a scene; of a disk, that is the point of it that a sample sees
(disk.py, transport/moments.py).
`light_sample` evaluates what a light sends to a given point, `light_towards` to one in its beam, and `light_at` at an
angle to the axis of one that is the same all around. `lit_part`, `light_beam` and `light_core` give the lit part of a
ray, `light_importance` and `light_strength` its importance near a point and overall. `light_emit` draws a ray that
leaves it, with density 1 / `light_solid_angle`. `light_centre` is for sampling pixels that show a light, and, with
`light_axis` and `light_intensity`, for what is computed for lights that are the same all around an axis: quadratures,
and the field of open water.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR, NEAR
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampling import equiangular_angle
from varos_warp.kernels.world.camera import Ray
from varos_warp.kernels.world.lights.profile import profile_at, profile_towards
from varos_warp.kernels.world.lights.record import Light, LightSample, LitInterval
from varos_warp.kernels.world.lights.sheet import clip_to_sheet, in_sheet, sample_sheet, sheet_solid_angle
from varos_warp.kernels.world.lights.spot import clip_to_cone, cone_solid_angle, sample_cone, spot_falloff

wp.set_module_options({"enable_backward": False})


@wp.func
def light_count(lights: wp.array(dtype=Light)):
    """Number of lights of a scene."""
    return lights.shape[0]


@wp.func
def get_light(lights: wp.array(dtype=Light), i: int):
    """One of the lights of a scene."""
    return lights[i]


@wp.func
def light_centre(light: Light):
    """Position of the light."""
    return light.position


@wp.func
def light_axis(light: Light):
    """Unit direction about which its light is symmetric."""
    return light.axis


@wp.func
def light_intensity(light: Light):
    """Radiant intensity on its axis [W/sr]."""
    return light.intensity


@wp.func
def falloff(light: Light, cos_angle: float):
    """Fraction of the intensity at an angle to the axis of a light that is the same all around."""
    if light.profile.shape[0] > 0:
        return wp.where(cos_angle < light.cos_half, 0.0, profile_at(light, cos_angle))
    return spot_falloff(light, cos_angle)


@wp.func
def falloff_towards(light: Light, cos_angle: float, x: wp.vec3):
    """Fraction of the intensity towards ``x``, from the light, which is at an angle to the axis."""
    if light.planes > 1:
        return profile_towards(light, cos_angle, x)
    return falloff(light, cos_angle)


@wp.func
def lit_part(light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """The part of the ray from ``o`` along ``d`` to ``t_max`` inside the light's cone or sheet, without its ``angle``.

    Nothing is lit where ``yb`` is not above ``ya``.
    """
    part = LitInterval()
    to_light = light.position - o
    part.foot = wp.dot(to_light, d)
    v = part.foot * d - to_light
    part.h = wp.max(wp.length(v), NEAR)
    part.ya = -part.foot
    part.yb = wp.min(t_max, FAR) - part.foot
    # near 180 deg the quadratic has no digits left; there, as for wider cones, the falloff alone decides
    if light.cos_half > 1.0e-4:
        clipped = clip_to_cone(light, v, d, part.ya, part.yb)
        part.ya = clipped[0]
        part.yb = clipped[1]
    if light.sheet == 1:
        clipped = clip_to_sheet(light.axis, light.right, light.up, v, d, wp.vec2(part.ya, part.yb))
        part.ya = clipped[0]
        part.yb = clipped[1]
    return part


@wp.func
def light_beam(light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """The part of a ray inside the light's cone or sheet: `lit_part` with its ``angle``."""
    part = lit_part(light, o, d, t_max)
    if part.yb > part.ya:
        part.angle = equiangular_angle(part.h, part.ya, part.yb)
    return part


@wp.func
def light_core(light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """The `lit_part` inside the soft edge, where the intensity has a kink; empty without a soft edge."""
    part = LitInterval()
    if light.blend > 0.0 and light.cos_half > -1.0:
        core = light
        core.cos_half = light.cos_half + light.blend * (1.0 - light.cos_half)
        part = lit_part(core, o, d, t_max)
    return part


@wp.func
def light_sample(light: Light, p: wp.vec3):
    """The light as seen from ``p``."""
    sample = LightSample()
    sample.p = light.position
    offset = light.position - p
    sample.distance = wp.max(wp.length(offset), NEAR)
    sample.d = wp.normalize(offset)
    sample.pdf = sample.distance * sample.distance
    sample.L = falloff_towards(light, -wp.dot(sample.d, light.axis), -offset) * light.intensity
    if light.sheet == 1:
        if not in_sheet(light, -offset):
            sample.L = wp.vec3(0.0)
    return sample


@wp.func
def light_at(light: Light, cos_angle: float):
    """Radiant intensity [W/sr] at an angle to the axis of a light without planes, in its `light_beam`."""
    return falloff(light, cos_angle) * light.intensity


@wp.func
def light_towards(light: Light, p: wp.vec3, distance: float):
    """Radiant intensity [W/sr] towards a point of `light_beam` at an accurately known ``distance``."""
    x = p - light.position
    return falloff_towards(light, wp.dot(x, light.axis) / distance, x) * light.intensity


@wp.func
def light_direction(light: Light, p: wp.vec3):
    """Unit direction from ``p`` to the centre of the light."""
    return light_sample(light, p).d


@wp.func
def light_strength(light: Light):
    """Brightest channel of its intensity [W/sr]."""
    return brightest(light.intensity)


@wp.func
def light_importance(light: Light, p: wp.vec3):
    """Importance of a light near ``p``, wherever its cone points: intensity over squared distance."""
    offset = light.position - p
    return (light_strength(light) + 1.0e-30) / wp.max(wp.dot(offset, offset), NEAR)


@wp.func
def light_solid_angle(light: Light, cos_angle: float):
    """Inverse density of `light_emit` [sr] at an angle to the axis."""
    if light.sheet == 1:
        return sheet_solid_angle(light, cos_angle)
    return cone_solid_angle(light)


@wp.func
def light_flux(light: Light):
    """Brightest channel of the radiant flux [W], with the edges counted in full."""
    return light_strength(light) * light_solid_angle(light, 1.0)


@wp.func
def light_emit(light: Light, u: float, v: float):
    """A ray that leaves the light with density 1 / light_solid_angle."""
    ray = Ray()
    ray.o = light.position
    if light.sheet == 1:
        ray.d = sample_sheet(light, u, v)
    else:
        ray.d = sample_cone(light, u, v)
    return ray
