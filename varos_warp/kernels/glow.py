"""The residual of a pixel: what surfaces block of the scattered light that the tables send to the one it sees, and add.

It has samples of its own, for it needs fewer than the edges and shadows of a pixel do. With them goes the halo of
bright surfaces: lamp light of those that the camera sees close by, which the water bends into the pixel's ray.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.film import Film, is_finite
from varos_warp.kernels.gather import gather_reflected
from varos_warp.kernels.intersect import SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.light import brightest
from varos_warp.kernels.medium import sample_truncated_exponential, transmittance, truncated_exponential_pdf
from varos_warp.kernels.phase import hg_sample
from varos_warp.kernels.residual import draw, halo_share
from varos_warp.kernels.texture import WALK_ANGLE, footprint_width
from varos_warp.kernels.walk import Walk, surface_vertex, walk_from_surface

wp.set_module_options({"enable_backward": False})


@cache
def make_start_glow_kernel(instances: bool, textures: bool) -> wp.Kernel:
    """Starts of walks on what the pixels see, and their halo."""
    first_hit, visible = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.kernel(module="unique", enable_backward=False)
    def start_glow(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        first_sample: int,
        halo: float,
        key: wp.uint32,
        # out
        starts: wp.array3d(dtype=Walk),  # [sample, row, column]
        light: wp.array3d(dtype=wp.vec3),
    ):
        tile_row, col, k = wp.tid()
        row = first_row + tile_row
        pixel = row * starts.shape[2] + col
        u = draw(key, pixel, first_sample + k, 0)
        v = draw(key, pixel, first_sample + k, 1)
        w = draw(key + wp.uint32(1), pixel, first_sample + k, 0)
        ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
        o = ray.o
        d = ray.d
        angle = camera.pixel_angle
        start = Walk()
        throughput = wp.vec3(1.0)
        L = wp.vec3(0.0)
        # first along the pixel's ray, then along one that is bent at a place before its end
        leg = int(0)
        while leg < 2:
            hit = first_hit(scene, o, d)
            if hit.face >= 0:
                n = shading_normal(scene, hit)
                surface = hit_surface(scene, hit, n, footprint_width(angle, hit.t, d, hit.n))
                vertex = surface_vertex(hit, d, n, surface)
                if leg == 0:
                    start = walk_from_surface(scene, vertex, hit.t)
                share = halo_share(ray.o, ray.d, hit.p, halo)
                if leg == 1 and share > 0.0:
                    reflected = gather_reflected(scene, hit, vertex, w[2])
                    if brightest(reflected.L) > 0.0:
                        if visible(scene, reflected.p, scene.lights[reflected.lamp].position):
                            throughput = wp.cw_mul(throughput, transmittance(scene.medium, hit.t))
                            L = share * wp.cw_mul(throughput, reflected.L)
            if leg == 0:
                c = wp.min(int(3.0 * w[0]), 2)
                t = sample_truncated_exponential(scene.medium.sigma_t[c], hit.t, w[1])
                pdf = float(0.0)
                for channel in range(3):
                    pdf += truncated_exponential_pdf(scene.medium.sigma_t[channel], hit.t, t) / 3.0
                throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t)) / pdf
                o = o + t * d
                d = hg_sample(d, scene.medium.g, v[0], v[1])
                angle = WALK_ANGLE
            leg += 1
        starts[k, row, col] = start
        light[k, row, col] = L

    return start_glow


@wp.kernel(enable_backward=False)
def add_residual(
    light: wp.array3d(dtype=wp.vec3),  # [sample, row, column]
    # out
    film: Film,
):
    """Add samples of the residual to the film."""
    row, col = wp.tid()
    for k in range(light.shape[0]):
        if is_finite(light[k, row, col]):
            L = wp.vec3d(light[k, row, col])
            film.residual[0, row, col] += L
            film.residual_squares[0, row, col] += wp.cw_mul(L, L)
        else:
            wp.atomic_add(film.lost, 0, 1)
