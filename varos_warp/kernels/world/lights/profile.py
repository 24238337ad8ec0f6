"""Measured profiles: the same all around the axis, or plane by plane."""

import warp as wp

from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})


@wp.func
def profile_at(light: Light, cos_angle: float):
    """The profile's value at an angle to the axis within the cone."""
    steps = light.profile.shape[0] - 1
    sine = wp.sqrt(wp.clamp((1.0 - cos_angle) / (1.0 - light.cos_half), 0.0, 1.0))
    place = float(steps) * sine
    k = wp.min(int(place), steps - 1)
    return wp.lerp(light.profile[k], light.profile[k + 1], place - float(k))


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
def profile_towards(light: Light, cos_angle: float, x: wp.vec3):
    """Fraction of the intensity towards ``x``, from a light with planes, which is at an angle to the axis."""
    if cos_angle < light.cos_half:
        return 0.0
    sine = wp.sqrt(wp.clamp((1.0 - cos_angle) / (1.0 - light.cos_half), 0.0, 1.0))
    turn = wp.atan2(-wp.dot(x, light.right), -wp.dot(x, light.up))
    return profile_around(light.profile, light.planes, sine, turn)
