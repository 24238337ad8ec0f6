"""Sheets: light between four planes through the light, even on a plane across the axis."""

import warp as wp

from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})


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
    """Return whether a sheet of light holds the point ``x``, from the light."""
    across = wp.max(wp.abs(wp.dot(x, light.right)), wp.abs(wp.dot(x, light.up)))
    return across <= wp.dot(x, light.axis)


@wp.func
def sample_sheet(light: Light, u: float, v: float):
    """Direction in a sheet, uniform on a plane across the axis."""
    right = (2.0 * u - 1.0) / wp.dot(light.right, light.right) * light.right
    return wp.normalize(light.axis + right + (2.0 * v - 1.0) / wp.dot(light.up, light.up) * light.up)


@wp.func
def sheet_solid_angle(light: Light, cos_angle: float):
    """Inverse density of `sample_sheet` [sr] at an angle to the axis."""
    return 4.0 / (wp.length(light.right) * wp.length(light.up)) * cos_angle * cos_angle * cos_angle
