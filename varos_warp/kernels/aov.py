"""Images C, D and S: what the ray through each pixel's centre hits first."""

from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.intersect import SceneData, corner_normal, make_rays

wp.set_module_options({"enable_backward": False})


@cache
def make_first_hits_kernel(instances: bool) -> wp.Kernel:
    """Images C, D and S, for scenes with or without instances."""
    first_hit, _ = make_rays(instances)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_first_hits(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        # out
        normal: wp.array2d(dtype=wp.vec3),
        depth: wp.array2d(dtype=float),
        distance: wp.array2d(dtype=float),
        instance: wp.array2d(dtype=wp.int32),
    ):
        """World normal, planar depth z and distance along the ray [m], number of the part from 1, all [height, width].

        Where nothing is hit: zeros, inf, inf, 0.
        """
        tile_row, col = wp.tid()
        row = first_row + tile_row
        # the centre of the lens, whatever the aperture
        ray = camera_ray(camera, float(col) + 0.5, float(row) + 0.5, wp.vec2(0.0, 0.0))
        hit = first_hit(scene, ray.o, ray.d)
        if hit.face < 0:
            normal[row, col] = wp.vec3(0.0)
            depth[row, col] = wp.inf
            distance[row, col] = wp.inf
            instance[row, col] = 0
            return
        normal[row, col] = corner_normal(scene, scene.smooth_normals, hit)
        depth[row, col] = hit.t * wp.dot(ray.d, camera.forward)
        distance[row, col] = hit.t
        instance[row, col] = hit.part + 1

    return trace_first_hits
