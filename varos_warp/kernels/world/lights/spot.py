"""Spots: an even cone with a soft edge, or all directions."""

import warp as wp

from varos_warp.kernels.sampling import from_polar
from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})


@wp.func
def spot_falloff(light: Light, cos_angle: float):
    """Fraction of the intensity at an angle to the axis: smoothstep in the cosine (as in Cycles, to 1e-4)."""
    if light.cos_half <= -1.0:
        return 1.0
    x = cos_angle - light.cos_half
    if x < 0.0:
        return 0.0
    width = light.blend * (1.0 - light.cos_half)
    if x >= width:
        return 1.0
    s = x / width
    return s * s * (3.0 - 2.0 * s)


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
def sample_cone(light: Light, u: float, v: float):
    """Direction in the cone, uniform in solid angle."""
    x = u * (1.0 - light.cos_half)
    return from_polar(light.axis, 1.0 - x, wp.sqrt(x * (2.0 - x)), wp.tau * v)


@wp.func
def cone_solid_angle(light: Light):
    """Solid angle of the cone [sr], the inverse density of `sample_cone`."""
    return wp.tau * (1.0 - light.cos_half)
