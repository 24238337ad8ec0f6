"""Lights: points that shine in a cone, by a profile or in a sheet. Other kernels use them only through this file.

`light_count` and `get_light` give the lights of a scene; of a disk, that is one of its points (transport/moments.py).
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
from varos_warp.kernels.sampling import equiangular_angle, from_polar, make_reservoir, offer
from varos_warp.kernels.world.camera import Ray

wp.set_module_options({"enable_backward": False})


@wp.struct
class Light:
    """A point with a cone: ``intensity`` [W/sr] inside, falling to 0 over the soft edge ``blend`` (Blender's spot).

    With a ``profile`` the soft edge is only where quadratures along rays are divided.
    """

    position: wp.vec3
    axis: wp.vec3
    cos_half: float
    """Cosine of the half angle of the cone; -1 for all directions."""
    blend: float
    intensity: wp.vec3
    profile: wp.array(dtype=float)
    """Relative intensity in its place, at even steps of the sine of half the angle to the axis; may be empty."""
    planes: int
    """Over 1: how many such profiles there are, one after the other, in even steps around the axis."""
    sheet: int
    """1 if it shines only between four planes: those of x dot (axis +- right) = 0 and x dot (axis +- up) = 0, with x
    from the light."""
    right: wp.vec3
    up: wp.vec3
    """Perpendicular to the axis and to each other, and of a sheet as long as the cotangents of its half angles. Of a
    light with planes, unit; the first plane holds -up, and the next is a turn about -axis away: seen from behind the
    light, counter-clockwise. (``up`` is the axis y of the light's own, which are those of a camera.)"""


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
    """Where the light is."""
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
def profile_at(light: Light, cos_angle: float):
    """The profile's value at an angle to the axis within the cone."""
    steps = light.profile.shape[0] - 1
    sine = wp.sqrt(wp.clamp((1.0 - cos_angle) / (1.0 - light.cos_half), 0.0, 1.0))
    place = float(steps) * sine
    k = wp.min(int(place), steps - 1)
    return wp.lerp(light.profile[k], light.profile[k + 1], place - float(k))


@wp.func
def falloff(light: Light, cos_angle: float):
    """Fraction of the intensity at an angle to the axis: smoothstep in the cosine (as in Cycles, to 1e-4)."""
    x = cos_angle - light.cos_half
    if light.profile.shape[0] > 0:
        return wp.where(x < 0.0, 0.0, profile_at(light, cos_angle))
    if light.cos_half <= -1.0:
        return 1.0
    if x < 0.0:
        return 0.0
    width = light.blend * (1.0 - light.cos_half)
    if x >= width:
        return 1.0
    s = x / width
    return s * s * (3.0 - 2.0 * s)


@wp.func(inline=False)  # few scenes have such a light, and code that all would carry is not free
def profile_around(profile: wp.array(dtype=float), planes: int, sine: float, turn: float):
    """Value at a share of the sine of half the edge's angle, at most 1, and a turn about the axis [rad]."""
    steps = profile.shape[0] / planes - 1
    place = float(steps) * sine
    k = wp.min(int(place), steps - 1)
    share = turn / wp.tau
    around = (share - wp.floor(share)) * float(planes)
    plane = wp.min(int(around), planes - 1)
    after = wp.where(plane + 1 < planes, plane + 1, 0)
    row = plane * (steps + 1) + k
    next_row = after * (steps + 1) + k
    u = place - float(k)
    v = around - float(plane)
    return wp.lerp(wp.lerp(profile[row], profile[row + 1], u), wp.lerp(profile[next_row], profile[next_row + 1], u), v)


@wp.func
def falloff_towards(light: Light, cos_angle: float, x: wp.vec3):
    """Fraction of the intensity towards ``x``, from the light, which is at an angle to the axis."""
    if light.planes > 1:
        if cos_angle < light.cos_half:
            return 0.0
        sine = wp.sqrt(wp.clamp((1.0 - cos_angle) / (1.0 - light.cos_half), 0.0, 1.0))
        turn = wp.atan2(-wp.dot(x, light.right), -wp.dot(x, light.up))
        return profile_around(light.profile, light.planes, sine, turn)
    return falloff(light, cos_angle)


@wp.struct
class LitInterval:
    """The part [ya, yb] of a ray inside a light's cone, measured from the light's foot on the ray.

    ``h`` is the light's distance from the line of the ray, ``foot`` the distance of the foot along the ray, ``angle``
    the integral of 1/d^2 to the light over the interval; 0 if nothing is lit, and where only `lit_part` was asked for.
    """

    foot: float
    h: float
    ya: float
    yb: float
    angle: float


@wp.func
def clip_to_cone(light: Light, v: wp.vec3, d: wp.vec3, ya: float, yb: float):
    """Interval of points v + y d (from the light's position, v perpendicular to d) inside a cone narrower than 180 deg.

    The squared cone equation is A y^2 + 2 B y + C >= 0; a convex nappe is left in one interval.
    """
    c2 = light.cos_half * light.cos_half
    da = wp.dot(d, light.axis)
    va = wp.dot(v, light.axis)
    h2 = wp.dot(v, v)
    A = (da - light.cos_half) * (da + light.cos_half)
    if wp.abs(A) < 1.0e-12:
        A = 1.0e-12
    B = da * va
    C = va * va - c2 * h2
    root2 = c2 * (A * h2 + va * va)
    if root2 < 0.0:
        return wp.vec2(0.0, 0.0)
    q = -(B + wp.where(B < 0.0, -1.0, 1.0) * wp.sqrt(root2))
    y1 = q / A
    y2 = wp.where(q == 0.0, 0.0, C / q)
    low = wp.min(y1, y2)
    high = wp.max(y1, y2)
    if A > 0.0:
        if da > 0.0:
            return wp.vec2(wp.max(ya, high), yb)
        return wp.vec2(ya, wp.min(yb, low))
    if va + 0.5 * (low + high) * da < 0.0:
        return wp.vec2(0.0, 0.0)
    return wp.vec2(wp.max(ya, low), wp.min(yb, high))


@wp.func
def clip_to_side(m: wp.vec3, v: wp.vec3, d: wp.vec3, interval: wp.vec2):
    """The part of an interval of points v + y d on the side of a plane through the origin to which ``m`` points."""
    a = wp.dot(m, v)
    b = wp.dot(m, d)
    if b == 0.0:
        return wp.where(a >= 0.0, interval, wp.vec2(0.0, 0.0))
    y = -a / b
    if b > 0.0:
        return wp.vec2(wp.max(interval[0], y), interval[1])
    return wp.vec2(interval[0], wp.min(interval[1], y))


@wp.func(inline=False)  # few scenes have a sheet, and code that all would carry is not free
def clip_to_sheet(axis: wp.vec3, right: wp.vec3, up: wp.vec3, v: wp.vec3, d: wp.vec3, interval: wp.vec2):
    """The part of an interval of points v + y d, from a light's position, inside its sheet."""
    interval = clip_to_side(axis - right, v, d, interval)
    interval = clip_to_side(axis + right, v, d, interval)
    interval = clip_to_side(axis - up, v, d, interval)
    return clip_to_side(axis + up, v, d, interval)


@wp.func
def in_sheet(light: Light, x: wp.vec3):
    """Whether a sheet of light holds the point ``x``, from the light."""
    across = wp.max(wp.abs(wp.dot(x, light.right)), wp.abs(wp.dot(x, light.up)))
    return across <= wp.dot(x, light.axis)


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


@wp.struct
class LightSample:
    """A light as seen from a point."""

    p: wp.vec3
    """Where the light is."""
    d: wp.vec3
    """Unit direction and distance [m] to it, at least NEAR."""
    distance: float
    intensity: wp.vec3
    """Radiant intensity towards the point [W/sr]."""


@wp.func
def light_sample(light: Light, p: wp.vec3):
    """The light as seen from ``p``."""
    sample = LightSample()
    sample.p = light.position
    offset = light.position - p
    sample.distance = wp.max(wp.length(offset), NEAR)
    sample.d = wp.normalize(offset)
    sample.intensity = falloff_towards(light, -wp.dot(sample.d, light.axis), -offset) * light.intensity
    if light.sheet == 1:
        if not in_sheet(light, -offset):
            sample.intensity = wp.vec3(0.0)
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
    """Inverse density of `light_emit` [sr] at an angle to the axis: the solid angle of a light's cone."""
    if light.sheet == 1:
        # uniform on a plane across the axis
        return 4.0 / (wp.length(light.right) * wp.length(light.up)) * cos_angle * cos_angle * cos_angle
    return wp.tau * (1.0 - light.cos_half)


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
        right = (2.0 * u - 1.0) / wp.dot(light.right, light.right) * light.right
        ray.d = wp.normalize(light.axis + right + (2.0 * v - 1.0) / wp.dot(light.up, light.up) * light.up)
        return ray
    x = u * (1.0 - light.cos_half)
    ray.d = from_polar(light.axis, 1.0 - x, wp.sqrt(x * (2.0 - x)), wp.tau * v)
    return ray


# --------------------------------------------------------------------------------------------- all lights of a scene


@wp.func
def nearest_light(lights: wp.array(dtype=Light), p: wp.vec3):
    """Distance to the nearest light [m]."""
    nearest = FAR
    for i in range(light_count(lights)):
        nearest = wp.min(nearest, light_sample(get_light(lights, i), p).distance)
    return nearest


@wp.func
def total_flux(lights: wp.array(dtype=Light)):
    """Sum of `light_flux` [W]."""
    total = float(0.0)
    for i in range(light_count(lights)):
        total += light_flux(get_light(lights, i))
    return total


@wp.func
def choose_by_flux(lights: wp.array(dtype=Light), u: float):
    """Index of a light, drawn in proportion to its flux; 0 if all are dark."""
    chosen = make_reservoir(u)
    for i in range(light_count(lights)):
        chosen = offer(chosen, i, light_flux(get_light(lights, i)))
    return wp.max(chosen.index, 0)


@wp.func
def choose_by_importance(lights: wp.array(dtype=Light), p: wp.vec3, u: float):
    """Index of a light, drawn in proportion to `light_importance` at ``p``."""
    chosen = make_reservoir(u)
    for i in range(light_count(lights)):
        chosen = offer(chosen, i, light_importance(get_light(lights, i), p))
    return chosen.index
