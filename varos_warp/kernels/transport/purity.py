"""Image U: the share of a pixel that shows the object which its centre shows, by rays spread over the pixel."""

import warp as wp

from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampler import make_sampler
from varos_warp.kernels.sobol import sobol4
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.first_hits import Rows, make_centre_hit
from varos_warp.kernels.transport.moments import Moments, instant_of
from varos_warp.kernels.world.camera import GREEN, Camera, make_ray
from varos_warp.kernels.world.intersect import SceneData, make_rays

wp.set_module_options({"enable_backward": False})

PURITY_RAYS = wp.constant(32)
"""Rays of a pixel: a power of 2, for which the points of a (0,2)-sequence are stratified in every way."""


@specialised("instances", "masks", "optics", "varies", "rolling")
def make_purity_kernel(spec: SceneSpec) -> wp.Kernel:
    """Image U, for scenes with or without instances, through a lens, a port and a shutter."""
    centre_hit = make_centre_hit(spec)
    first_hit = make_rays(spec).first_hit
    ray_of = make_ray(spec.optics)

    @wp.func
    def object_seen(
        scene: SceneData, numbers: wp.array(dtype=wp.int32), camera: Camera, x: float, y: float, lens: wp.vec2
    ):
        """Number in S of what a ray of the camera hits first; 0 if it hits nothing."""
        ray, seen = ray_of(camera, x, y, lens, GREEN)
        found = int(0)
        if brightest(seen) > 0.0:
            hit = first_hit(scene, ray.o, ray.d)
            if hit.face >= 0:
                found = numbers[hit.part + 1]
        return found

    @wp.kernel(module="unique", enable_backward=False)
    def trace_purity(
        scene: SceneData,
        camera: Camera,
        pinhole: Camera,  # the same without depth of field, whose centres C, D and S show
        of_rows: Rows,
        moments: Moments,
        numbers: wp.array(dtype=wp.int32),  # in S, by the numbers of parts from 1
        key: wp.uint32,
        first_row: int,
        # out
        purity: wp.array2d(dtype=float),
    ):
        """Share of the rays of a pixel, spread as samples of A, that hit the object of its centre, [height, width]."""
        tile_row, col = wp.tid()
        row = first_row + tile_row
        pixel = row * purity.shape[1] + col
        here = scene
        at_centre = pinhole
        if wp.static(spec.rolling):
            at_centre = of_rows.cameras[row]
            here.moving = of_rows.moving[row]
        _ray, hit = centre_hit(here, at_centre, row, col)
        centre = int(0)
        if hit.face >= 0:
            centre = numbers[hit.part + 1]
        same = int(0)
        for sample in range(PURITY_RAYS):
            u = sobol4(key, pixel, sample, 0)
            if wp.static(spec.varies):
                instant = instant_of(moments, row, make_sampler(key, pixel, sample))
                camera = moments.cameras[instant]
                scene.moving = moments.moving[instant]
            x, y = float(col) + u[0], float(row) + u[1]
            if object_seen(scene, numbers, camera, x, y, wp.vec2(u[2], u[3])) == centre:
                same += 1
        purity[row, col] = float(same) / float(PURITY_RAYS)

    return trace_purity
