"""Images C, D and S, what hides in F, guides for a denoiser: the first hit of the ray through each pixel's centre."""

import warp as wp

from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, instant_of_row
from varos_warp.kernels.world.bsdf import bsdf_albedo
from varos_warp.kernels.world.camera import GREEN, Camera, make_ray
from varos_warp.kernels.world.intersect import Instance, SceneData, make_rays, moves, to_instance
from varos_warp.kernels.world.surface import MATERIALS, corner_normal, make_surface_at

wp.set_module_options({"enable_backward": False})


@wp.struct
class Rows:
    """Cameras and moving objects of each row, for a rolling shutter; empty for others."""

    cameras: wp.array(dtype=Camera)
    moving: wp.array2d(dtype=Instance)
    """[row, object that moves]"""


@specialised("instances", "masks", "optics")
def make_centre_hit(spec: SceneSpec) -> wp.Function:
    """The function ``centre_hit``: the ray through a pixel's centre, and what it hits."""
    first_hit = make_rays(spec).first_hit
    ray_of = make_ray(spec.optics)

    @wp.func
    def centre_hit(scene: SceneData, camera: Camera, row: int, col: int):
        # the centre of the lens, whatever the aperture
        ray, seen = ray_of(camera, float(col) + 0.5, float(row) + 0.5, wp.vec2(0.0, 0.0), GREEN)
        hit = first_hit(scene, ray.o, ray.d)
        if brightest(seen) <= 0.0:
            hit.face = -1
        return ray, hit

    return centre_hit


@specialised("instances", "masks", "optics", "rolling")
def make_first_hits_kernel(spec: SceneSpec) -> wp.Kernel:
    """Images C, D and S, for scenes with or without instances, through a lens, a port and a shutter."""
    centre_hit = make_centre_hit(spec)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_first_hits(
        scene: SceneData,
        camera: Camera,
        of_rows: Rows,
        first_row: int,
        # out
        normal: wp.array2d(dtype=wp.vec3),
        depth: wp.array2d(dtype=float),
        distance: wp.array2d(dtype=float),
        instance: wp.array2d(dtype=wp.int32),
    ):
        """World normal, planar depth z and distance along the ray [m], part number from 1 on, all [height, width].

        Depth is from the lens, distance from where the ray enters the water. Where nothing is hit: zeros, inf, inf, 0.
        """
        tile_row, col = wp.tid()
        row = first_row + tile_row
        if wp.static(spec.rolling):
            camera = of_rows.cameras[row]
            scene.moving = of_rows.moving[row]
        ray, hit = centre_hit(scene, camera, row, col)
        if hit.face < 0:
            normal[row, col] = wp.vec3(0.0)
            depth[row, col] = wp.inf
            distance[row, col] = wp.inf
            instance[row, col] = 0
            return
        normal[row, col] = corner_normal(scene, scene.smooth_normals, hit)
        depth[row, col] = hit.t * wp.dot(ray.d, camera.forward)
        if wp.static(spec.optics.port != "none"):
            depth[row, col] += wp.dot(ray.o - camera.position, camera.forward)
        distance[row, col] = hit.t
        instance[row, col] = hit.part + 1

    return trace_first_hits


@specialised("instances", "masks", "optics", "rolling")
def make_hidden_kernel(spec: SceneSpec) -> wp.Kernel:
    """What hides from another place, for scenes with or without instances, through a lens, a port and a shutter."""
    centre_hit = make_centre_hit(spec)
    visible = make_rays(spec).visible

    @wp.kernel(module="unique", enable_backward=False)
    def find_hidden(
        scene: SceneData,
        camera: Camera,
        of_rows: Rows,
        next_scene: SceneData,
        next_moving: wp.array2d(dtype=Instance),  # what moves, in the next frame: of each row, or once
        eyes: wp.array2d(dtype=wp.vec3),  # where the point is looked for from [m], NaN: nowhere; shape [height, width]
        next_row: wp.array2d(dtype=wp.int32),  # of next_moving, when it is looked for; shape [height, width]
        first_row: int,
        # out
        hidden: wp.array2d(dtype=wp.uint8),
    ):
        """1 where something hides the pixel's first hit from its eye, [height, width]; 0 where nothing is hit.

        Both are where they are in the next frame.
        """
        tile_row, col = wp.tid()
        row = first_row + tile_row
        hidden[row, col] = wp.uint8(0)
        eye = eyes[row, col]
        if wp.static(spec.rolling):
            camera = of_rows.cameras[row]
            scene.moving = of_rows.moving[row]
        _ray, hit = centre_hit(scene, camera, row, col)
        if hit.face >= 0 and wp.isfinite(eye):
            start = hit.start
            if wp.static(spec.instances):
                next_scene.moving = next_moving[next_row[row, col]]
                if moves(scene, hit):
                    now = scene.moving[hit.instance]
                    then = next_scene.moving[hit.instance]
                    start = then.R * to_instance(now, hit.start - now.p) + then.p
            if not visible(next_scene, start, eye):
                hidden[row, col] = wp.uint8(1)

    return find_hidden


INSTANTS = wp.constant(16)
"""Number of instants of an exposure over which guides are averaged."""


@wp.struct
class Guides:
    """What a pixel's centre shows a denoiser; zeros where nothing is hit."""

    albedo: wp.vec3
    normal: wp.vec3


@specialised("instances", *MATERIALS, "masks", "optics", "varies")
def make_guides_kernel(spec: SceneSpec) -> wp.Kernel:
    """Guides for a denoiser, for scenes with or without instances and textures, through a lens, a port, a shutter."""
    centre_hit = make_centre_hit(spec)
    surface_at = make_surface_at(spec)

    @wp.func
    def centre_guides(scene: SceneData, camera: Camera, row: int, col: int):
        guides = Guides()
        ray, hit = centre_hit(scene, camera, row, col)
        if hit.face >= 0:
            point = surface_at(scene, hit, ray.d, camera.pixel_angle)
            guides.albedo = wp.min(bsdf_albedo(point.bsdf, point.n, -ray.d), wp.vec3(1.0))
            guides.normal = corner_normal(scene, scene.smooth_normals, hit)
        return guides

    @wp.kernel(module="unique", enable_backward=False)
    def trace_guides(
        scene: SceneData,
        camera: Camera,
        moments: Moments,
        first_row: int,
        # out
        albedo: wp.array2d(dtype=wp.vec3),
        normal: wp.array2d(dtype=wp.vec3),
    ):
        """Albedo of the surface in [0, 1], and normal as in image C, both [height, width]; 0 where nothing is hit."""
        tile_row, col = wp.tid()
        row = first_row + tile_row
        if wp.static(spec.varies):
            # blurred as the image is
            sums = Guides()
            for k in range(INSTANTS):
                instant = instant_of_row(moments, row, (float(k) + 0.5) / float(INSTANTS))
                scene.moving = moments.moving[instant]
                seen = centre_guides(scene, moments.cameras[instant], row, col)
                sums.albedo += seen.albedo / float(INSTANTS)
                sums.normal += seen.normal / float(INSTANTS)
        else:
            sums = centre_guides(scene, camera, row, col)
        albedo[row, col] = sums.albedo
        normal[row, col] = sums.normal

    return trace_guides
