"""The camera's own segments: direct light, single scattering, and what the field of open water adds along them.

Light of more events comes by subpaths (path.py). Both are sums of samples of their own: a segment takes a tenth of the
time of a subpath, and decides what edges, textures and a lens's blur look like.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.conventions import LONG_KERNEL
from varos_warp.kernels.field.lookup import reflected_field, sample_field
from varos_warp.kernels.field.open_water import Field, multiple_in_scattering
from varos_warp.kernels.field.single_scattering import single_scattering
from varos_warp.kernels.film.film import Film, Sums, add_sample, pixel_of, store
from varos_warp.kernels.transport.segment import PathBounds, PathSpec, draw, make_segment
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import get_light, light_count
from varos_warp.kernels.world.medium import transmittance

wp.set_module_options({"enable_backward": False})


@wp.func(inline=False)
def scattered_by_lights(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float):
    """Single scattering of all lights along an unobstructed ray up to ``t``, by quadrature."""
    L = wp.vec3(0.0)
    for i in range(light_count(scene.lights)):
        L += single_scattering(scene.medium, get_light(scene.lights, i), o, d, t)
    return L


@cache
def make_camera_kernel(spec: PathSpec) -> wp.Kernel:
    """The camera's segments of a film's parts from ``first`` on, specialised to ``spec``."""
    first_hit, _, end_vertex, scattered_once, reflected_once, image_place = make_segment(spec)

    @wp.kernel(**LONG_KERNEL)
    def trace_camera_segments(
        scene: SceneData,
        camera: Camera,
        first: int,
        field: Field,
        bounds: PathBounds,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first + wp.tid()
        part = film.parts[i]
        height, width = film.sums.shape[1], film.sums.shape[2]
        pixel = pixel_of(film, part)
        sums = Sums()
        for sample in range(part.begin, part.end):
            u = draw(key, pixel, sample, 0)
            place = image_place(scene, camera, part.row, part.col, u)
            ray = camera_ray(camera, place[0], place[1], wp.vec2(u[2], u[3]))
            hit = first_hit(scene, ray.o, ray.d)
            u = draw(key, pixel, sample, 1)
            v = draw(key, pixel, sample, 2)
            L_direct = wp.vec3(0.0)
            L_single = wp.vec3(0.0)
            L_field = wp.vec3(0.0)
            correction = wp.vec3(0.0)
            if wp.static(spec.medium and spec.single):
                if bounds.scatterings > 0:
                    L_single = scattered_once(scene, ray.o, ray.d, hit.t, wp.static(not spec.field), u[0], u[1])
                    if wp.static(spec.field):
                        correction = L_single
                        L_single += scattered_by_lights(scene, ray.o, ray.d, hit.t)
            if wp.static(spec.multiple and spec.camera_field):
                L_field = multiple_in_scattering(field, place[0] / float(width), place[1] / float(height), hit.t)
            if wp.static(spec.multiple and not spec.camera_field):
                L_field = sample_field(scene, field, ray.o, ray.d, hit.t, v[0], v[1])
                correction += L_field
            if hit.face >= 0 and bounds.bounces > 0:
                end = end_vertex(scene, hit, ray.d, camera.pixel_angle)
                T = transmittance(scene.medium, hit.t)
                if wp.static(spec.direct):
                    L_direct = wp.cw_mul(T, reflected_once(scene, hit, end, u[2], wp.vec2(u[3], v[3])).L)
                if wp.static(spec.multiple):
                    L_field += wp.cw_mul(T, reflected_field(scene, field, end.surface, end.p, end.n))
            sums = add_sample(sums, sample, place[2] * L_direct, place[2] * L_single, place[2] * L_field,
                              place[2] * correction)
        store(film, i, sums)

    return trace_camera_segments
