"""All lights of a scene: the nearest, and choices among them."""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.sampling import make_reservoir, offer
from varos_warp.kernels.world.lights.light import get_light, light_count, light_flux, light_importance, light_sample
from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})


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
