"""Disks: a sample of an image sees one point of each, and there a point light."""

import warp as wp

from varos_warp.kernels.sampling import concentric_disk
from varos_warp.kernels.world.lights.record import Light

wp.set_module_options({"enable_backward": False})


@wp.func
def sample_point(light: Light, u: wp.vec2):
    """The point light that a sample sees of a light: of a disk one of its points, even over the area; else itself."""
    drawn = light
    place = light.radius * concentric_disk(u)
    drawn.position += place[0] * light.right + place[1] * light.up
    drawn.radius = 0.0
    return drawn
