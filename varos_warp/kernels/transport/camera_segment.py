"""The camera's own segments: direct light, single scattering, and what the field of open water adds along them.

Where a segment ends on metal, the next one counts too, with all light of one more event: what a metal mirrors is as
sharp as what is seen directly. Other light of more events comes by subpaths (path.py). Both are sums of samples of
their own: a segment takes a tenth of the time of a subpath, and decides what edges, textures, metals and a lens's blur
look like.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR, in_step, in_step_kernel
from varos_warp.kernels.field.along_camera import radiance_along
from varos_warp.kernels.field.lookup import reflected_field, sample_field
from varos_warp.kernels.field.open_water import Field
from varos_warp.kernels.field.single_scattering import scattered_by_lights
from varos_warp.kernels.film.film import Film, Sums, add_sample, pixel_of, sample_of, store
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampler import Sampler, draw, make_sampler, next_vertex
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, instant_of, place_of, with_points
from varos_warp.kernels.transport.segment import PATH, PathBounds, make_segment
from varos_warp.kernels.transport.subpath import (
    Subpath,
    Vertex,
    is_metal,
    sample_direction,
    share_from_metal,
    subpath_from_surface,
)
from varos_warp.kernels.world.camera import Camera, make_sample_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import SUBPATH_ANGLE

wp.set_module_options({"enable_backward": False})

FILM = wp.constant(0)
"""Random numbers for the place in the pixel and on the lens."""
END, FIELD = wp.constant(0), wp.constant(1)
"""Random numbers for the light of one more event on a segment, and for that of the field."""
LEAVE = wp.constant(0)
"""Random numbers for the direction from a metal: two groups, before those of its segment."""


@specialised(*PATH)
def make_mirrored(spec: SceneSpec) -> wp.Function:
    """The function ``mirrored`` of a metal's vertex, specialised to ``spec``."""
    segment = make_segment(spec)
    first_hit, end_vertex = segment.first_hit, segment.end_vertex
    scattered_once, reflected_once = segment.scattered_once, segment.reflected_once

    @wp.func
    def leave_metal(scene: SceneData, bounds: PathBounds, metal: Vertex, t: float, u: wp.vec4, v: wp.vec4):
        """A subpath from the metal at the end of a segment of length ``t``."""
        share = float(0.0)
        if wp.static(spec.medium):
            if bounds.scatterings > 0:
                share = share_from_metal(scene, metal)
        return sample_direction(scene, subpath_from_surface(scene, metal, t, FAR), share, u, v)

    @wp.func
    def light_of_one_event(scene: SceneData, field: Field, path: Subpath, bounds: PathBounds, u: wp.vec4, v: wp.vec4):
        """Light of one more event on the segment that leaves a metal."""
        L = wp.vec3(0.0)
        o, d = path.vertex.p, path.vertex.d
        hit = first_hit(scene, o, d)
        if wp.static(spec.medium):
            if bounds.scatterings > 0:
                once = scattered_once(scene, o, d, hit.t, u[0], u[1])
                L += (1.0 - float(once.blocked)) * once.L
                if wp.static(spec.field):
                    L += sample_field(scene, field, o, d, hit.t, v[0], v[1]).L
        if hit.face >= 0 and bounds.bounces > 1:
            end = end_vertex(scene, hit, d, SUBPATH_ANGLE)
            L_end = reflected_once(scene, hit, end, u[2]).L
            if wp.static(spec.field):
                L_end += reflected_field(scene, field, end.bsdf, end.p, end.n, -end.d)
            L += wp.cw_mul(transmittance(scene.medium, hit.t), L_end)
        return wp.cw_mul(path.throughput, L)

    @wp.func
    def mirrored(scene: SceneData, field: Field, bounds: PathBounds, metal: Vertex, t: float, sampler: Sampler):
        """What the metal at the end of a segment of length ``t`` mirrors into it, of one more event."""
        path = leave_metal(scene, bounds, metal, t, draw(sampler, LEAVE), draw(sampler, LEAVE + 1))
        if path.alive == 0:
            return wp.vec3(0.0)
        sampler = next_vertex(sampler, 2)
        return light_of_one_event(scene, field, path, bounds, draw(sampler, END), draw(sampler, FIELD))

    return mirrored


@specialised(*PATH)
def make_camera_kernel(spec: SceneSpec) -> wp.Kernel:
    """The camera's segments of a film's batches from ``first_row`` on, specialised to ``spec``."""
    segment = make_segment(spec)
    first_hit, end_vertex, film_point = segment.first_hit, segment.end_vertex, segment.film_point
    scattered_once, reflected_directly = segment.scattered_once, segment.reflected_directly
    mirrored = make_mirrored(spec)
    field_layer = spec.multiple and spec.field
    sample_ray = make_sample_ray(spec.optics)

    @wp.kernel(**in_step_kernel(spec.instances))
    def trace_camera_segments(
        scene: SceneData,
        camera: Camera,
        moments: Moments,
        first_row: int,
        field: Field,
        bounds: PathBounds,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first_row + wp.tid()
        batch = film.batches[i]
        height, width = film.sums.shape[1], film.sums.shape[2]
        sums = Sums()
        if wp.static(spec.disks > 0):
            drawn = wp.zeros(shape=wp.static(spec.disks), dtype=Light)
            lights = scene.lights
        for taken in range(batch.begin, batch.end):
            sampler = make_sampler(key, pixel_of(film, batch), sample_of(film, batch, taken))
            in_step()
            if wp.static(spec.varies):
                instant = instant_of(moments, batch.row, sampler)
                scene.lights = moments.lights[instant]
                scene.moving = moments.moving[instant]
                camera = moments.cameras[instant]
            if wp.static(spec.disks > 0):
                if wp.static(spec.varies):
                    lights = scene.lights
                scene = with_points(scene, lights, place_of(sampler), drawn)
            u = draw(sampler, FILM)
            point = film_point(scene, camera, batch.row, batch.col, u)
            ray, weight = sample_ray(camera, point.x, point.y, wp.vec2(u[2], u[3]), sampler)
            if brightest(weight) <= 0.0:
                continue
            in_step()
            hit = first_hit(scene, ray.o, ray.d)
            in_step()
            sampler = next_vertex(sampler, 1)
            u = draw(sampler, END)
            v = draw(sampler, FIELD)
            L_direct = wp.vec3(0.0)
            L_single = wp.vec3(0.0)
            L_multiple = wp.vec3(0.0)
            correction = wp.vec3(0.0)
            if wp.static(spec.medium and spec.single):
                if bounds.scatterings > 0:
                    once = scattered_once(scene, ray.o, ray.d, hit.t, u[0], u[1])
                    L_single = (wp.static(0.0 if spec.field else 1.0) - float(once.blocked)) * once.L
                    if wp.static(spec.field):
                        correction = L_single
                        in_step()
                        if field.single.radiance.shape[0] > 0:
                            L_single += radiance_along(
                                field.single, point.x / float(width), point.y / float(height), hit.t
                            )
                        else:
                            L_single += scattered_by_lights(scene, ray.o, ray.d, hit.t)
            if wp.static(field_layer and spec.camera_field):
                L_multiple = radiance_along(field.multiple, point.x / float(width), point.y / float(height), hit.t)
            if wp.static(field_layer and not spec.camera_field):
                L_multiple = sample_field(scene, field, ray.o, ray.d, hit.t, v[0], v[1]).L
                correction += L_multiple
            in_step()
            reflects = hit.face >= 0 and bounds.bounces > 0
            end = Vertex()
            if reflects:
                end = end_vertex(scene, hit, ray.d, camera.pixel_angle)
            T = transmittance(scene.medium, hit.t)
            in_step()
            if wp.static(spec.direct):
                if reflects:
                    L_direct = wp.cw_mul(T, reflected_directly(scene, hit, end, u[2]))
            in_step()
            if wp.static(field_layer):
                if reflects:
                    L_multiple += wp.cw_mul(T, reflected_field(scene, field, end.bsdf, end.p, end.n, -end.d))
            in_step()
            if wp.static(spec.multiple and spec.mirrors):
                if reflects and is_metal(end):
                    L_multiple += mirrored(scene, field, bounds, end, hit.t, next_vertex(sampler, 2))
            weight *= point.weight
            sums = add_sample(
                sums,
                sampler.sample,
                wp.cw_mul(weight, L_direct),
                wp.cw_mul(weight, L_single),
                wp.cw_mul(weight, L_multiple),
                wp.cw_mul(weight, correction),
            )
        store(film, i, sums)

    return trace_camera_segments
