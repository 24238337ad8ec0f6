"""A segment of a path, as the kernels of path.py and camera_segment.py trace it, and the light of one more event on it.

Light of one more event is scattered on the segment, or reflected at its end, straight from the lights.
"""

from typing import NamedTuple

import warp as wp

from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.spec import FIELDS, SceneSpec, specialised
from varos_warp.kernels.transport.next_event import (
    LightConnection,
    reflected_from,
    sample_in_scattered,
    sample_reflected,
)
from varos_warp.kernels.transport.pixel import FilmPoint, sample_pixel
from varos_warp.kernels.transport.subpath import Vertex, surface_vertex
from varos_warp.kernels.world.camera import Camera
from varos_warp.kernels.world.intersect import Hit, SceneData, make_rays
from varos_warp.kernels.world.lights.light import light_count
from varos_warp.kernels.world.surface import make_surface_at

wp.set_module_options({"enable_backward": False})

PATH = tuple(name for name in FIELDS if name != "rolling")
"""What kernels of paths are compiled for: rows that see other instants are samples of them, too."""


@wp.struct
class PathBounds:
    """Bounds on paths."""

    scatterings: int
    bounces: int
    """The largest number of each."""


class Segment(NamedTuple):
    """Device functions of a segment."""

    first_hit: wp.Function
    visible: wp.Function
    end_vertex: wp.Function
    scattered_once: wp.Function
    reflected_once: wp.Function
    reflected_directly: wp.Function
    film_point: wp.Function


@specialised(*PATH)
def make_segment(spec: SceneSpec) -> Segment:
    """The functions of a segment, specialised to ``spec``."""
    first_hit, visible = make_rays(spec)
    surface_at = make_surface_at(spec)
    # where a light is seen is known of straight rays only
    straight = not spec.optics.bends
    peaks_at_lights = straight and spec.medium and (spec.single or spec.multiple) and not spec.camera_field

    @wp.func
    def end_vertex(scene: SceneData, hit: Hit, d: wp.vec3, angle: float):
        """The vertex at the end of a segment along ``d``, whose ray stands for a cone of ``angle``."""
        return surface_vertex(surface_at(scene, hit, d, angle), d)

    @wp.func
    def scattered_once(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float, u: float, v: float):
        """Light scattered once into a segment in open water, and whether it is blocked."""
        scattered = sample_in_scattered(scene, o, d, t, u, v)
        if brightest(scattered.L) > 0.0:
            if not visible(scene, scattered.p, scattered.q):
                scattered.blocked = 1
        return scattered

    @wp.func
    def tested(scene: SceneData, reflected: LightConnection):
        """The connection, without its light if something blocks it."""
        if brightest(reflected.L) > 0.0:
            if not visible(scene, reflected.p, reflected.q):
                reflected.L = wp.vec3(0.0)
                reflected.blocked = 1
        return reflected

    @wp.func
    def reflected_once(scene: SceneData, hit: Hit, end: Vertex, u: float):
        """Direct light of one light that the surface at the end of a segment reflects into it, at that end."""
        return tested(scene, sample_reflected(scene, hit, end, u))

    @wp.func
    def reflected_directly(scene: SceneData, hit: Hit, end: Vertex, u: float):
        """Direct light that the end of the camera's segment reflects into it: of every light, where they are few."""
        if wp.static(not spec.few_lights):
            return reflected_once(scene, hit, end, u).L
        L = wp.vec3(0.0)
        for i in range(light_count(scene.lights)):
            L += tested(scene, reflected_from(scene, hit, end, i)).L
        return L

    @wp.func
    def film_point(scene: SceneData, camera: Camera, row: int, col: int, u: wp.vec4):
        """Image point of a sample."""
        if wp.static(peaks_at_lights):
            return sample_pixel(scene, camera, row, col, u)
        point = FilmPoint()
        point.x = float(col) + u[0]
        point.y = float(row) + u[1]
        point.weight = 1.0
        return point

    return Segment(first_hit, visible, end_vertex, scattered_once, reflected_once, reflected_directly, film_point)
