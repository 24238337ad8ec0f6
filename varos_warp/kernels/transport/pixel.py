"""Where in its pixel a camera sample lies: uniformly distributed, or densely around lights that the camera sees.

Light scattered once goes as 1/h where a ray passes a point light at a distance h. If a pixel that shows a light were
sampled uniformly, the values would have a tail of inverse square, and rare samples would dominate the image. So most
samples are drawn nearly in proportion to 1/r, with r the distance from the light's image: the row y with density
|y|^-1/4, and x on it with density 1/r. What is left of 1/r goes as |y|^1/4 log(1/|y|), which is bounded.
"""

import warp as wp

from varos_warp.kernels.sampling import LARGEST, asinh, inverse_distance_area, inverse_distance_point
from varos_warp.kernels.world.camera import Camera, image_point
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import get_light, light_centre, light_count

wp.set_module_options({"enable_backward": False})

BESIDE = wp.constant(1.5)
"""Distance [pixels] between a light's image and a pixel's centre beyond which 1/r hardly varies, and is ignored."""
EVEN = wp.constant(0.125)
"""Fraction of uniform samples beside a light."""
PEAK = wp.constant(0.25)
"""Exponent of the density of rows."""
CLOSEST = wp.constant(1.0e-6)
"""Distances from a light's image below this count as this [pixels]."""


@wp.func
def seen_beside(scene: SceneData, camera: Camera, light: int, centre: wp.vec2, lens: wp.vec2):
    """Image point of a light from a point of the lens, and 1 if that is near the pixel's ``centre``, else 0."""
    at = image_point(camera, light_centre(get_light(scene.lights, light)), lens)
    offset = wp.vec2(at[0], at[1]) - centre
    return wp.vec3(at[0], at[1], wp.where(at[2] > 0.0 and wp.length(offset) < BESIDE, 1.0, 0.0))


@wp.func
def row_measure(y: float):
    """Integral of |y|^-PEAK up to a constant factor; odd."""
    return wp.sign(y) * wp.pow(wp.abs(y), 1.0 - PEAK)


@wp.func
def sample_around(left: float, top: float, u: float, v: float):
    """Point (x, y) of the pixel at (left, top), relative to a light's image, with density `pdf_around`."""
    m = wp.lerp(row_measure(top), row_measure(top + 1.0), v)
    y = wp.sign(m) * wp.pow(wp.abs(m), 1.0 / (1.0 - PEAK))
    h = wp.max(wp.abs(y), CLOSEST)
    return wp.vec2(inverse_distance_point(h, asinh(left / h), asinh((left + 1.0) / h), u), y)


@wp.func
def pdf_around(left: float, top: float, x: float, y: float):
    """Density [1/pixel^2] of `sample_around`."""
    h = wp.max(wp.abs(y), CLOSEST)
    of_row = (1.0 - PEAK) * wp.pow(h, -PEAK) / (row_measure(top + 1.0) - row_measure(top))
    return of_row / inverse_distance_area(h, asinh(left / h), asinh((left + 1.0) / h), x)


@wp.func
def sample_pixel(scene: SceneData, camera: Camera, row: int, col: int, u: wp.vec4):
    """Image point (x, y) [pixels] in a pixel and its weight, the inverse density.

    Several lights get equal numbers of samples (balance heuristic, Veach and Guibas 1995). ``u``: two numbers for the
    pixel and two for the lens.
    """
    left = float(col)
    top = float(row)
    centre = wp.vec2(left + 0.5, top + 0.5)
    lens = wp.vec2(u[2], u[3])
    count = int(0)
    for i in range(light_count(scene.lights)):
        count += int(seen_beside(scene, camera, i, centre, lens)[2])
    if count == 0:
        return wp.vec3(left + u[0], top + u[1], 1.0)
    place = wp.vec2(left + wp.min(u[0] / EVEN, 1.0), top + u[1])
    if u[0] >= EVEN:
        which = (u[0] - EVEN) / (1.0 - EVEN) * float(count)
        chosen = wp.min(int(which), count - 1)
        number = int(0)
        for i in range(light_count(scene.lights)):
            at = seen_beside(scene, camera, i, centre, lens)
            if at[2] > 0.0:
                if number == chosen:
                    share = wp.min(which - float(chosen), LARGEST)
                    off = sample_around(left - at[0], top - at[1], share, u[1])
                    place = wp.vec2(wp.clamp(at[0] + off[0], left, left + 1.0),
                                    wp.clamp(at[1] + off[1], top, top + 1.0))
                number += 1
    density = float(0.0)
    for i in range(light_count(scene.lights)):
        at = seen_beside(scene, camera, i, centre, lens)
        if at[2] > 0.0:
            density += pdf_around(left - at[0], top - at[1], place[0] - at[0], place[1] - at[1])
    return wp.vec3(place[0], place[1], 1.0 / (EVEN + (1.0 - EVEN) * density / float(count)))
