"""Position of a camera sample in its pixel: uniformly distributed, or dense around lights that the camera sees.

Light scattered once goes as 1/h where a ray passes a point light at a distance h. If a pixel that shows a light were
sampled uniformly, the values would have a tail of inverse square, and rare samples would dominate the image. So most
samples are drawn nearly in proportion to 1/r, with r the distance from the light's image: the row y with density
|y|^-1/4, and x on it with density 1/r. What is left of 1/r goes as |y|^1/4 log(1/|y|), which is bounded.
"""

import warp as wp

from varos_warp.kernels.sampling import LARGEST, asinh, inverse_distance_area, inverse_distance_point
from varos_warp.kernels.world.camera import Camera, image_point
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.light import get_light, light_centre, light_count

wp.set_module_options({"enable_backward": False})

BESIDE = wp.constant(1.5)
"""Distance [pixels] between a light's image and a pixel's centre beyond which 1/r hardly varies, and is ignored."""
EVEN = wp.constant(0.125)
"""Fraction of uniform samples beside a light."""
PEAK = wp.constant(0.25)
"""Exponent of the density of rows."""
CLOSEST = wp.constant(1.0e-6)
"""Distances from a light's image below this count as this [pixels]."""


@wp.struct
class FilmPoint:
    """Image point of a sample [pixels] and its weight, the inverse density."""

    x: float
    y: float
    weight: float


@wp.struct
class LightImage:
    """Image point of a light [pixels], and whether it is near a pixel."""

    x: float
    y: float
    near: bool


@wp.func
def image_of_light(scene: SceneData, camera: Camera, light: int, centre: wp.vec2, lens: wp.vec2):
    """Image of a light from a point of the lens, near or not the pixel's ``centre``."""
    at = image_point(camera, light_centre(get_light(scene.lights, light)), lens)
    image = LightImage()
    image.x = at[0]
    image.y = at[1]
    image.near = at[2] > 0.0 and wp.length(wp.vec2(at[0], at[1]) - centre) < BESIDE
    return image


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
    """Image point of a sample in a pixel.

    Several lights get equal numbers of samples (balance heuristic, Veach and Guibas 1995). ``u``: two numbers for the
    pixel and two for the lens.
    """
    left = float(col)
    top = float(row)
    centre = wp.vec2(left + 0.5, top + 0.5)
    lens = wp.vec2(u[2], u[3])
    count = int(0)
    for i in range(light_count(scene.lights)):
        count += int(image_of_light(scene, camera, i, centre, lens).near)
    point = FilmPoint()
    if count == 0:
        point.x = left + u[0]
        point.y = top + u[1]
        point.weight = 1.0
        return point
    point.x = left + wp.min(u[0] / EVEN, 1.0)
    point.y = top + u[1]
    if u[0] >= EVEN:
        which = (u[0] - EVEN) / (1.0 - EVEN) * float(count)
        chosen = wp.min(int(which), count - 1)
        number = int(0)
        for i in range(light_count(scene.lights)):
            light = image_of_light(scene, camera, i, centre, lens)
            if light.near:
                if number == chosen:
                    share = wp.min(which - float(chosen), LARGEST)
                    off = sample_around(left - light.x, top - light.y, share, u[1])
                    point.x = wp.clamp(light.x + off[0], left, left + 1.0)
                    point.y = wp.clamp(light.y + off[1], top, top + 1.0)
                number += 1
    density = float(0.0)
    for i in range(light_count(scene.lights)):
        light = image_of_light(scene, camera, i, centre, lens)
        if light.near:
            density += pdf_around(left - light.x, top - light.y, point.x - light.x, point.y - light.y)
    point.weight = 1.0 / (EVEN + (1.0 - EVEN) * density / float(count))
    return point
