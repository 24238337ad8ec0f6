"""The residual of the glow: what surfaces block of the scattered light that the tables send a pixel's surface, and add.

It has samples of its own, for it needs fewer than the edges and shadows of a pixel do.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.film import Film
from varos_warp.kernels.intersect import SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.residual import draw, walk_from_surface
from varos_warp.kernels.texture import footprint_width
from varos_warp.kernels.walk import Walk, surface_vertex

wp.set_module_options({"enable_backward": False})


@cache
def make_start_glow_kernel(instances: bool, textures: bool) -> wp.Kernel:
    """Starts of walks on what the pixels see."""
    first_hit, _ = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.kernel(module="unique", enable_backward=False)
    def start_glow(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        first_sample: int,
        key: wp.uint32,
        # out
        starts: wp.array3d(dtype=Walk),  # [sample, row, column]
    ):
        tile_row, col, k = wp.tid()
        row = first_row + tile_row
        u = draw(key, row * starts.shape[2] + col, first_sample + k, 0)
        ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
        hit = first_hit(scene, ray.o, ray.d)
        start = Walk()
        if hit.face >= 0:
            n = shading_normal(scene, hit)
            surface = hit_surface(scene, hit, n, footprint_width(camera.pixel_angle, hit.t, ray.d, hit.n))
            start = walk_from_surface(scene, surface_vertex(hit, ray.d, n, surface), hit.t)
        starts[k, row, col] = start

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
        L = wp.vec3d(light[k, row, col])
        film.residual[0, row, col] += L
        film.residual_squares[0, row, col] += wp.cw_mul(L, L)
