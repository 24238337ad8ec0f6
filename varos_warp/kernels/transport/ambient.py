"""Image B: the scene without water in uniform ambient light of radiance 1."""

import warp as wp

from varos_warp.kernels.conventions import LONG_KERNEL
from varos_warp.kernels.film.film import Film, Sums, add_sample, pixel_of, store
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampler import Sampler, draw, make_sampler, next_vertex
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, instant_of
from varos_warp.kernels.world.bsdf import bsdf_sample, bsdf_weight, directional_albedo
from varos_warp.kernels.world.camera import GREEN, Camera, make_ray
from varos_warp.kernels.world.intersect import SceneData, make_rays
from varos_warp.kernels.world.surface import MATERIALS, make_surface_at
from varos_warp.kernels.world.texture import SUBPATH_ANGLE

wp.set_module_options({"enable_backward": False})


@wp.struct
class Ambient:
    """Radiance along a ray, and about what it would be if what the ray meets first lay open to the ambient light."""

    L: wp.vec3
    open: wp.vec3


@specialised("instances", *MATERIALS, "masks", "bands")
def make_ambient_radiance(spec: SceneSpec) -> wp.Function:
    """The function ``ambient_radiance``, for scenes with or without instances and textures."""
    first_hit = make_rays(spec).first_hit
    surface_at = make_surface_at(spec)

    @wp.func
    def ambient_radiance(scene: SceneData, o: wp.vec3, d: wp.vec3, pixel_angle: float, at_camera: Sampler):
        """Radiance along a ray: surfaces absorb light until the path escapes to the ambient light."""
        found = Ambient()
        found.open = wp.vec3(1.0)
        throughput = wp.vec3(1.0)
        origin = o
        direction = d
        bounces = int(0)
        sampler = at_camera
        while True:
            hit = first_hit(scene, origin, direction)
            if hit.face < 0:
                found.L = throughput
                return found
            point = surface_at(scene, hit, direction, wp.where(bounces == 0, pixel_angle, SUBPATH_ANGLE))
            if bounces == 0:
                found.open = directional_albedo(scene.lobe_albedo, point.bsdf, point.n, -direction)
            bounces += 1
            sampler = next_vertex(sampler, 1)
            u = draw(sampler, 0)
            v = -direction
            direction = bsdf_sample(point.bsdf, point.n, v, u[0], u[1], u[3])
            weight = bsdf_weight(scene.lobe_albedo, point.bsdf, point.n, v, direction)
            throughput = wp.cw_mul(throughput, weight)
            origin = point.start
            survival = wp.where(bounces < 3, 1.0, wp.min(brightest(throughput), 0.95))
            if u[2] >= survival:
                return found
            # around a smoothed normal some directions point into the surface; mirror them out, so that no light is lost
            below = wp.min(wp.dot(direction, point.n_geometric), 0.0)
            direction = direction - 2.0 * below * point.n_geometric
            throughput /= survival
        return found

    return ambient_radiance


@specialised("instances", *MATERIALS, "masks", "bands", "optics", "varies")
def make_ambient_kernel(spec: SceneSpec) -> wp.Kernel:
    """Image B, for scenes with or without instances and textures, through a lens, a port and moments."""
    ambient_radiance = make_ambient_radiance(spec)
    ray_of = make_ray(spec.optics)

    @wp.kernel(**LONG_KERNEL)
    def trace_ambient(
        scene: SceneData,
        camera: Camera,
        moments: Moments,
        first_row: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        """Radiance of each pixel through a pinhole; no port takes any of it.

        What open surfaces would show is the layer ``direct``, which guides a denoiser with all edges and textures as
        smooth as in the image; the rest is ``multiple``.
        """
        i = first_row + wp.tid()
        batch = film.batches[i]
        sums = Sums()
        for sample in range(batch.begin, batch.end):
            sampler = make_sampler(key, pixel_of(film, batch), sample)
            u = draw(sampler, 0)
            if wp.static(spec.varies):
                instant = instant_of(moments, batch.row, sampler)
                camera = moments.cameras[instant]
                scene.moving = moments.moving[instant]
            ray, seen = ray_of(camera, float(batch.col) + u[0], float(batch.row) + u[1], wp.vec2(0.0, 0.0), GREEN)
            if brightest(seen) <= 0.0:
                continue
            found = ambient_radiance(scene, ray.o, ray.d, camera.pixel_angle, sampler)
            rest = found.L - found.open
            sums = add_sample(sums, sample, found.open, wp.vec3(0.0), rest, wp.vec3(0.0))
        store(film, i, sums)

    return trace_ambient
