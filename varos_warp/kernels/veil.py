"""The veil: light that surfaces send and water scatters towards the camera, less what they block, for one frame.

It is smooth, for it comes from everywhere around a place in the water. So it is not drawn pixel by pixel but on a grid
of rays that covers the image, slab by slab of their length, and summed up from the camera (Wronski 2014, "Volumetric
fog"). A pixel looks it up at the length of its own ray. Two parts are as sharp as the image, and not on the grid: what
scatters once from a lamp, with its shafts of light and shadow, and the halo of bright surfaces, which is lamp light
off those that the camera sees less than a few cells beside the ray. It is drawn with the pixels (kernels/glow.py).
"""

from functools import cache

import warp as wp

from varos_warp.kernels.film.film import is_finite
from varos_warp.kernels.residual import draw
from varos_warp.kernels.transport.subpath import Walk, walk_from_water
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import SceneData, make_rays
from varos_warp.kernels.world.medium import transmittance

wp.set_module_options({"enable_backward": False})


@wp.struct
class VeilGrid:
    """Radiance that is scattered into a ray before the end of each slab, through nodes that span the image."""

    radiance: wp.array3d(dtype=wp.vec3)
    """[slab, row, column]."""
    scale: float
    log_step: float
    """Slab k ends at scale (exp((k + 1) log_step) - 1) [m]."""


@wp.func
def slab_end(grid: VeilGrid, k: int):
    """Where slab ``k`` ends [m]; slab -1 at 0."""
    return grid.scale * (wp.exp(float(k + 1) * grid.log_step) - 1.0)


@wp.func
def veil_at(grid: VeilGrid, k: int, x: float, y: float):
    """Radiance up to the end of slab ``k``, between the nodes, at a place (x, y) in [0, 1]^2 of the image."""
    if k < 0:
        return wp.vec3(0.0)
    u = wp.clamp(x, 0.0, 1.0) * float(grid.radiance.shape[2] - 1)
    v = wp.clamp(y, 0.0, 1.0) * float(grid.radiance.shape[1] - 1)
    i = wp.min(int(v), grid.radiance.shape[1] - 2)
    j = wp.min(int(u), grid.radiance.shape[2] - 2)
    above = wp.lerp(grid.radiance[k, i, j], grid.radiance[k, i, j + 1], u - float(j))
    below = wp.lerp(grid.radiance[k, i + 1, j], grid.radiance[k, i + 1, j + 1], u - float(j))
    return wp.lerp(above, below, v - float(i))


@wp.func
def frame_veil(grid: VeilGrid, x: float, y: float, t: float):
    """The veil of a ray of length ``t`` through a place (x, y) in [0, 1]^2 of the image."""
    last = grid.radiance.shape[0] - 1
    k = wp.clamp(int(wp.log(1.0 + t / grid.scale) / grid.log_step), 0, last)
    start = slab_end(grid, k - 1)
    share = wp.clamp((t - start) / (slab_end(grid, k) - start), 0.0, 1.0)
    return wp.lerp(veil_at(grid, k - 1, x, y), veil_at(grid, k, x, y), share)


@cache
def make_start_veil_kernel(instances: bool) -> wp.Kernel:
    """Starts of walks in the water: a ray near each node, with a place in each of its slabs."""
    first_hit, _ = make_rays(instances)

    @wp.kernel(module="unique", enable_backward=False)
    def start_veil(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        grid: VeilGrid,
        size: wp.vec2,
        key: wp.uint32,
        # out
        starts: wp.array4d(dtype=Walk),  # [sample, row, column, slab]; without a scattering behind a surface
        places: wp.array4d(dtype=int),  # which random numbers they get: the node's sequence,
        points: wp.array4d(dtype=int),  # and the number in it
    ):
        tile_row, col, sample = wp.tid()
        row = first_row + tile_row
        rows, cols, slabs = starts.shape[1], starts.shape[2], starts.shape[3]
        node = row * cols + col
        u = draw(key, node, sample, 0)
        x = size[0] * (float(col) + u[0] - 0.5) / float(cols - 1)
        y = size[1] * (float(row) + u[1] - 0.5) / float(rows - 1)
        ray = camera_ray(camera, x, y, wp.vec2(0.0, 0.0))
        hit = first_hit(scene, ray.o, ray.d)
        for k in range(slabs):
            near = slab_end(grid, k - 1)
            width = slab_end(grid, k) - near
            t = near + width * draw(key, node, sample * slabs + k, 1)[0]
            start = Walk()
            if t < hit.t:
                start = walk_from_water(scene, ray.o, ray.d, t, 1.0 / width)
            starts[sample, row, col, k] = start
            places[sample, row, col, k] = node
            points[sample, row, col, k] = sample * slabs + k

    return start_veil


@wp.kernel(enable_backward=False)
def average_slabs(
    starts: wp.array4d(dtype=Walk),  # [sample, row, column, slab]
    light: wp.array4d(dtype=wp.vec3),
    # out
    slabs: wp.array3d(dtype=wp.vec4),  # radiance, and 1 or, without a sample in the water, 0; [slab, row, column]
    lost: wp.array(dtype=int),  # counts samples that are not numbers, as of a film
):
    """Mean of the samples in the water."""
    k, row, col = wp.tid()
    found = int(0)
    L = wp.vec3(0.0)
    for sample in range(light.shape[0]):
        if starts[sample, row, col, k].scatterings > 0:
            found += 1
            if is_finite(light[sample, row, col, k]):
                L += light[sample, row, col, k]
            else:
                wp.atomic_add(lost, 0, 1)
    slabs[k, row, col] = wp.vec4(0.0)
    if found > 0:
        L /= float(found)
        slabs[k, row, col] = wp.vec4(L[0], L[1], L[2], 1.0)


@wp.func
def around(slabs: wp.array3d(dtype=wp.vec4), k: int, row: int, col: int):
    """Sum and number of the neighbours of a node that lie in the water."""
    total = wp.vec4(0.0)
    for i in range(wp.max(row - 1, 0), wp.min(row + 2, slabs.shape[1])):
        for j in range(wp.max(col - 1, 0), wp.min(col + 2, slabs.shape[2])):
            total += slabs[k, i, j]
    return total


@wp.kernel(enable_backward=False)
def sum_slabs(
    scene: SceneData,
    slabs: wp.array3d(dtype=wp.vec4),
    # out
    grid: VeilGrid,
):
    """Sum up the slabs along each node's rays.

    Slabs behind what a node sees are for rays that pass beside it: they are as around it, or else as the one before.
    """
    row, col = wp.tid()
    total = wp.vec3(0.0)
    inside = wp.vec3(0.0)
    for k in range(slabs.shape[0]):
        found = slabs[k, row, col]
        if found[3] <= 0.0:
            found = around(slabs, k, row, col)
        if found[3] > 0.0:
            inside = wp.vec3(found[0], found[1], found[2]) / found[3]
        else:
            near = slab_end(grid, k - 1)
            far = slab_end(grid, k)
            before = wp.max(near - slab_end(grid, k - 2), 1.0e-6)
            inside = wp.cw_mul(inside, transmittance(scene.medium, 0.5 * (far - near + before)))
            inside *= (far - near) / before
        total += inside
        grid.radiance[k, row, col] = total
