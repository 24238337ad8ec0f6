"""Image A: radiance of underwater pixels lit by lamps, by orders of scattering.

Every segment of a path gathers the light that lamps send into it with one more event: reflected off the surface at
its end, and scattered once on the way. On the camera's own segment these are the layers `direct` and `single`. Light
of more events is carried by a walk. It starts with a scattering on the camera's segment or with a reflection at its
end, and moves from vertex to vertex, in the water or on a surface, until roulette ends it. No sample is clamped or
dropped.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from varos_warp.kernels.conventions import LONG_KERNEL
from varos_warp.kernels.film.film import Film, Sums, add_sample, store
from varos_warp.kernels.sampling import uniforms
from varos_warp.kernels.transport.next_event import gather_in_scattered, gather_reflected
from varos_warp.kernels.transport.subpath import (
    Vertex,
    Walk,
    advance,
    first_scattering_pdf,
    lamp_distance,
    sample_first_scattering,
    surface_vertex,
    turn,
    walk_from_surface,
    walk_from_water,
    water_vertex,
)
from varos_warp.kernels.world.bsdf import surface_albedo
from varos_warp.kernels.world.camera import Camera, Ray, camera_ray
from varos_warp.kernels.world.intersect import Hit, SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import brightest
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import WALK_ANGLE, footprint_width

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class PathSpec:
    """What a path kernel is compiled for; what is absent costs nothing."""

    medium: bool = True
    """The water scatters."""
    direct: bool = True
    single: bool = True
    multiple: bool = True
    """Which layers are wanted."""
    instances: bool = False
    """Something stands in many places."""
    textures: bool = True
    """Some material is more than one constant reflectance."""


@wp.func
def camera_segment(ray: Ray):
    """The camera's own segment as the first of a path."""
    walk = Walk()
    walk.alive = 1
    walk.vertex = water_vertex(ray.o, ray.d)
    walk.throughput = wp.vec3(1.0)
    return walk


@wp.func
def start_walk(
    scene: SceneData,
    o: wp.vec3,
    d: wp.vec3,
    hit: Hit,
    end: Vertex,
    max_scatterings: int,
    max_bounces: int,
    u: wp.vec4,
):
    """Walk that turns first in the water on the camera's segment, or on the surface at its ``end``.

    Where both can be, either is taken half of the time.
    """
    walk = Walk()
    from_water = max_scatterings > 0
    from_surface = hit.face >= 0 and max_bounces > 0 and brightest(surface_albedo(end.surface)) > 0.0
    both = from_water and from_surface
    if from_water and (u[2] < 0.5 or not both):
        near = lamp_distance(scene, o)
        t = sample_first_scattering(scene.medium, near, hit.t, u[0], u[1])
        walk = walk_from_water(scene, o, d, t, first_scattering_pdf(scene.medium, near, hit.t, t))
    elif from_surface:
        walk = walk_from_surface(scene, end, hit.t)
    walk.dimension = 4
    if both:
        walk.throughput *= 2.0
        walk.expected_at_start *= 2.0
    return walk


@cache
def make_path_kernel(spec: PathSpec) -> wp.Kernel:
    """Path tracing of a film's parts from ``first`` on, specialised to ``spec``.

    One loop serves camera segments and walks, segment by segment, so that threads of a GPU's warp trace rays together
    whatever their paths are doing (path regeneration, Novak et al. 2010).
    """
    first_hit, visible = make_rays(spec.instances)
    hit_surface = make_hit_surface(spec.textures)

    @wp.kernel(**LONG_KERNEL)
    def trace_paths(
        scene: SceneData,
        camera: Camera,
        first: int,
        max_scatterings: int,
        max_bounces: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first + wp.tid()
        part = film.parts[i]
        row, col = part.row, part.col
        pixel = row * film.sums.shape[2] + col
        sample = part.begin
        sums = Sums()
        L_direct = wp.vec3(0.0)
        L_single = wp.vec3(0.0)
        L_multiple = wp.vec3(0.0)
        on_camera = bool(True)
        from_surface = bool(False)
        walk = Walk()
        while sample < part.end:
            # a ray: through the pixel, or on from the vertex where a walk turns
            if on_camera:
                u = uniforms(key, pixel, sample, 0)
                ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
                walk = camera_segment(ray)
            else:
                lamp_share = float(0.0)
                if wp.static(spec.medium):
                    lamp_share = wp.where(walk.scatterings < max_scatterings, 0.5, 0.0)
                u = uniforms(key, pixel, sample, walk.dimension)
                v = uniforms(key, pixel, sample, walk.dimension + 1)
                walk = turn(scene, walk, lamp_share, u, v)

            if walk.alive == 1:
                o = walk.vertex.p
                d = walk.vertex.d
                hit = first_hit(scene, o, d)
                u = uniforms(key, pixel, sample, walk.dimension + 2)
                v = uniforms(key, pixel, sample, walk.dimension + 3)
                walk.dimension += 4

                # light of one more event on the segment: scattered on the way, or reflected at its end
                L_water = wp.vec3(0.0)
                if wp.static(spec.medium and (spec.single or spec.multiple)):
                    if walk.scatterings < max_scatterings and (wp.static(spec.single) or not on_camera):
                        scattered = gather_in_scattered(scene, o, d, hit.t, u[0], u[1])
                        if brightest(scattered.L) > 0.0:
                            if visible(scene, scattered.p, scene.lights[scattered.lamp].position):
                                L_water = scattered.L
                L_surface = wp.vec3(0.0)
                end_vertex = Vertex()
                if hit.face >= 0:
                    n = shading_normal(scene, hit)
                    angle = wp.where(on_camera, camera.pixel_angle, WALK_ANGLE)
                    surface = hit_surface(scene, hit, n, footprint_width(angle, hit.t, d, hit.n))
                    end_vertex = surface_vertex(hit, d, n, surface)
                    if walk.bounces < max_bounces and (wp.static(spec.direct) or not on_camera):
                        reflected = gather_reflected(scene, hit, end_vertex, u[2])
                        if brightest(reflected.L) > 0.0:
                            if visible(scene, reflected.p, scene.lights[reflected.lamp].position):
                                L_surface = wp.cw_mul(transmittance(scene.medium, hit.t), reflected.L)

                # where the path goes on
                if on_camera:
                    L_single = L_water
                    L_direct = L_surface
                    on_camera = False
                    walk.alive = 0
                    if wp.static(spec.multiple):
                        walk = start_walk(scene, o, d, hit, end_vertex, max_scatterings, max_bounces, v)
                        from_surface = walk.bounces == 1
                else:
                    L_multiple += wp.cw_mul(walk.throughput, L_water + L_surface)
                    walk = advance(scene, walk, hit, end_vertex, max_scatterings, max_bounces, v)

            if walk.alive == 0:
                black = wp.vec3(0.0)
                glow = wp.where(from_surface, L_multiple, black)
                sums = add_sample(sums, L_direct, L_single, glow, wp.where(from_surface, black, L_multiple))
                L_multiple = wp.vec3(0.0)
                on_camera = True
                sample += 1
        store(film, i, sums)

    return trace_paths
