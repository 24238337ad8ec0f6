"""Pixels from splats: each pixel adds up what its tile shows, in one order, so that bytes do not depend on threads."""

import warp as wp

from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.particles.bodies import Grain
from varos_warp.kernels.particles.splat import TILE, Splat, share_of

wp.set_module_options({"enable_backward": False})


@wp.kernel
def find_tiles(tiles: wp.array(dtype=int), count: int, starts: wp.array(dtype=int)):
    """Find where the splats of each tile begin in a sorted list of ``count`` tiles, int32 [tiles + 1]."""
    i = wp.tid()
    # wp.lower_bound ends at the last of them, even where that is below i
    starts[i] = wp.where(tiles[count - 1] < i, count, wp.lower_bound(tiles, 0, count, i))


@wp.kernel
def take_mean(
    share: wp.array2d(dtype=wp.float64),  # of the light that reaches each pixel; empty: all
    expected: wp.array2d(dtype=wp.vec3),
    passed: wp.array2d(dtype=float),
    light: wp.array2d(dtype=wp.vec3),
    # out
    added: wp.array2d(dtype=wp.vec3),
):
    """What bodies add to an image; ``light`` becomes what of it reaches the sensor."""
    row, col = wp.tid()
    reaches = float(1.0)
    if share.shape[0] > 0:
        reaches = float(share[row, col])
    light[row, col] = reaches * light[row, col]
    added[row, col] = light[row, col] - reaches * passed[row, col] * expected[row, col]


@wp.func
def share_before(hits: wp.array3d(dtype=float), row: int, col: int, t: float):
    """Share of a pixel's rays on which nothing lies before a distance."""
    free = int(0)
    for k in range(hits.shape[0]):
        if hits[k, row, col] > t:
            free += 1
    return float(free) / float(hits.shape[0])


@wp.kernel
def gather_splats(
    splats: wp.array(dtype=Splat),
    grains: wp.array2d(dtype=Grain),
    order: wp.array(dtype=int),  # of the splats, by tiles
    starts: wp.array(dtype=int),
    hits: wp.array3d(dtype=float),  # where rays of the pixels end, [ray, height, width]
    first_row: int,
    # out
    light: wp.array2d(dtype=wp.vec3),
    passed: wp.array2d(dtype=float),
    coverage: wp.array2d(dtype=float),
    flow: wp.array2d(dtype=wp.vec2),
):
    """Radiance of the bodies, what they let pass, the share that they cover, and the flow of the brightest."""
    tile_row, col = wp.tid()
    row = first_row + tile_row
    tile = (row / TILE) * ((light.shape[1] + TILE - 1) / TILE) + col / TILE
    L = light[row, col]
    free = passed[row, col]
    covered = coverage[row, col]
    most = float(0.0)
    for i in range(starts[tile], starts[tile + 1]):
        splat = splats[order[i]]
        share = share_of(splat, grains, col, row)
        if share > 0.0:
            share *= share_before(hits, row, col, splat.t)
            L += share * splat.flux
            free *= 1.0 - wp.min(share * splat.cover, 1.0)
            covered += share * splat.cover
            if share * brightest(splat.flux) > most:
                most = share * brightest(splat.flux)
                flow[row, col] = splat.flow
    light[row, col] = L
    passed[row, col] = free
    coverage[row, col] = covered
