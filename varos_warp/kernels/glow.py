"""The residual of the glow: what surfaces block of the scattered light that the tables send a pixel's surface, and add.

A kernel of its own, with samples of its own: its walks are long and scatter over a GPU's threads, and it needs fewer
samples than the edges and shadows of a pixel do.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.conventions import BLOCK_DIM, CPU_FLAGS
from varos_warp.kernels.film import Film, first_sample
from varos_warp.kernels.intersect import SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.lit_points import LitPoint
from varos_warp.kernels.open_water import Tables
from varos_warp.kernels.residual import draw, make_blocked_light, make_surface_light, walk_from_surface
from varos_warp.kernels.texture import footprint_width
from varos_warp.kernels.walk import surface_vertex

wp.set_module_options({"enable_backward": False})


@cache
def make_glow_kernel(instances: bool, textures: bool) -> wp.Kernel:
    """The residual of a range of rows."""
    first_hit, _ = make_rays(instances)
    hit_surface = make_hit_surface(textures)
    blocked_light = make_blocked_light(instances)
    surface_light = make_surface_light(instances, textures)

    @wp.kernel(
        module="unique",
        module_options={"cpu_compiler_flags": CPU_FLAGS},
        enable_backward=False,
        launch_bounds=(BLOCK_DIM, 6),
    )
    def sample_glow(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        tables: Tables,
        lit_points: wp.array(dtype=LitPoint),
        spp: int,
        max_bounces: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        tile_row, col, stratum = wp.tid()
        row = first_row + tile_row
        strata, width = film.residual.shape[0], film.residual.shape[2]
        pixel = row * width + col
        total = wp.vec3d(wp.float64(0.0))
        squares = wp.vec3d(wp.float64(0.0))
        for sample in range(first_sample(stratum, strata, spp), first_sample(stratum + 1, strata, spp)):
            u = draw(key, pixel, sample, 0)
            ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
            hit = first_hit(scene, ray.o, ray.d)
            if hit.face >= 0:
                n = shading_normal(scene, hit)
                surface = hit_surface(scene, hit, n, footprint_width(camera.pixel_angle, hit.t, ray.d, hit.n))
                walk = walk_from_surface(scene, surface_vertex(hit, ray.d, n, surface), hit.t)
                L = surface_light(scene, tables, lit_points, walk, max_bounces, key, pixel, sample, 1)
                if surface.metal <= 0.0:
                    L -= blocked_light(scene, walk, key, pixel, sample, 7)
                total += wp.vec3d(L)
                squares += wp.cw_mul(wp.vec3d(L), wp.vec3d(L))
        film.residual[stratum, row, col] = total
        film.residual_squares[stratum, row, col] = squares

    return sample_glow
