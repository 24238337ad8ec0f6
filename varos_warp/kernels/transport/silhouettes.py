"""Silhouettes: all instances on the ray through each pixel's centre, whatever stands before them."""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.first_hits import Rows
from varos_warp.kernels.world.camera import GREEN, Camera, make_ray
from varos_warp.kernels.world.intersect import SceneData, first_solid, get_instance, to_instance

wp.set_module_options({"enable_backward": False})


@specialised("masks", "optics", "rolling")
def make_silhouettes_kernel(spec: SceneSpec) -> wp.Kernel:
    """What each pixel's ray meets, of scenes all of whose surfaces are instances."""
    ray_of = make_ray(spec.optics)

    @wp.func
    def meets(scene: SceneData, k: int, o: wp.vec3, d: wp.vec3):
        copy = get_instance(scene, k)
        at, along = to_instance(copy, o - copy.p), to_instance(copy, d)
        if wp.static(spec.masks):
            solid = first_solid(scene.masks, copy.mesh, copy.whole, copy.first_face, copy.part, at, along, FAR)
            return solid.face >= 0
        else:
            found = wp.mesh_query_ray(copy.mesh, at, along, FAR)
            return found.result

    @wp.kernel(module="unique", enable_backward=False)
    def trace_silhouettes(
        scene: SceneData,
        camera: Camera,
        of_rows: Rows,
        margin: wp.vec2i,  # rows and columns of pixels around the image that are looked at, too
        first_row: int,
        starts: wp.array2d(dtype=wp.int64),  # where a pixel's parts begin in ``parts``; empty: they are counted only
        # out
        counts: wp.array2d(dtype=wp.int32),
        parts: wp.array(dtype=wp.int32),
    ):
        """How many instances the ray of each pixel meets, [height, width], and their parts."""
        tile_row, col = wp.tid()
        row = first_row + tile_row
        if wp.static(spec.rolling):
            at_row = wp.clamp(row - margin[0], 0, of_rows.cameras.shape[0] - 1)
            camera = of_rows.cameras[at_row]
            scene.moving = of_rows.moving[at_row]
        ray, seen = ray_of(camera, float(col - margin[1]) + 0.5, float(row - margin[0]) + 0.5, wp.vec2(0.0, 0.0), GREEN)
        count = int(0)
        if brightest(seen) > 0.0:
            query = wp.bvh_query_ray(scene.instance_bvh, ray.o, ray.d)
            k = int(0)
            while wp.bvh_query_next(query, k, FAR):
                if meets(scene, k, ray.o, ray.d):
                    if starts.shape[0] > 0:
                        parts[starts[row, col] + wp.int64(count)] = get_instance(scene, k).part
                    count += 1
        counts[row, col] = count

    return trace_silhouettes
