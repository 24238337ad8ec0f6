"""Where in its pixel a sample of the camera lies: evenly, and more densely around lights that the camera sees.

Light scattered once goes as 1/h where a ray passes a point light at a distance h. With even samples of the pixel that
a light is seen in, the tail of that falls with the inverse square: rare samples decide the image. So some are drawn
with a density in proportion to 1/r on the pixel's row, r from the light's image. What is left goes as the logarithm
of r, of which all moments are finite.
"""

import warp as wp

from varos_warp.kernels.sampling import asinh
from varos_warp.kernels.world.camera import Camera, image_point
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import light_centre

wp.set_module_options({"enable_backward": False})

BESIDE = wp.constant(4.0)
"""Distance [pixels] between a light's image and a pixel's centre up to which it counts: beyond, 1/r hardly varies."""
CLOSEST = wp.constant(1.0e-6)
"""Least distance of a row from a light's image that is told apart from zero [pixels]."""


@wp.func
def seen_beside(scene: SceneData, camera: Camera, light: int, centre: wp.vec2, lens: wp.vec2):
    """Image point of a light from a point of the lens, and 1 if that is beside the pixel's ``centre``, else 0."""
    at = image_point(camera, light_centre(scene.lights[light]), lens)
    offset = wp.vec2(at[0], at[1]) - centre
    return wp.vec3(at[0], at[1], wp.where(at[2] > 0.0 and wp.length(offset) < BESIDE, 1.0, 0.0))


@wp.func
def row_angles(at: wp.vec3, left: float, y: float):
    """Ends of the pixel's row at ``y`` as asinh(x / h), and h: even steps between them are in proportion to 1/r."""
    h = wp.max(wp.abs(y - at[1]), CLOSEST)
    return wp.vec3(asinh((left - at[0]) / h), asinh((left + 1.0 - at[0]) / h), h)


@wp.func
def sample_pixel(scene: SceneData, camera: Camera, row: int, col: int, u: wp.vec4):
    """Place (x, y) in a pixel [pixels] and the weight of what is seen there.

    One of the even density and those of the lights is drawn; the weight is the inverse of their mean (balance
    heuristic, Veach and Guibas 1995). ``u``: two numbers for the pixel and two for the lens.
    """
    left = float(col)
    y = float(row) + u[1]
    centre = wp.vec2(left + 0.5, float(row) + 0.5)
    lens = wp.vec2(u[2], u[3])
    count = int(0)
    for i in range(scene.lights.shape[0]):
        count += int(seen_beside(scene, camera, i, centre, lens)[2])
    if count == 0:
        return wp.vec3(left + u[0], y, 1.0)
    stretched = u[0] * float(count + 1)
    chosen = wp.min(int(stretched), count)
    share = stretched - float(chosen)
    x = left + share
    number = int(0)
    for i in range(scene.lights.shape[0]):
        at = seen_beside(scene, camera, i, centre, lens)
        number += int(at[2])
        if at[2] > 0.0 and number == chosen:
            ends = row_angles(at, left, y)
            x = wp.clamp(at[0] + ends[2] * wp.sinh(wp.lerp(ends[0], ends[1], share)), left, left + 1.0)
    density = float(1.0)
    for i in range(scene.lights.shape[0]):
        at = seen_beside(scene, camera, i, centre, lens)
        if at[2] > 0.0:
            ends = row_angles(at, left, y)
            r = wp.sqrt((x - at[0]) * (x - at[0]) + ends[2] * ends[2])
            density += 1.0 / ((ends[1] - ends[0]) * r)
    return wp.vec3(x, y, float(count + 1) / density)
