"""Statistics of the samples so far, from which render/image/adapt.py decides how many more each tile needs."""

import warp as wp

from varos_warp.kernels.film.develop import deviation
from varos_warp.kernels.film.film import TILE, Film, expected_count, side_of, sums_of, total_radiance

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def pixel_statistics(
    film: Film,
    denoised: float,
    # out
    mean: wp.array2d(dtype=wp.vec3d),
    variance: wp.array2d(dtype=wp.vec3d),  # of one sample
):
    """Mean of a pixel's samples, and an estimate of the variance of one sample.

    Denoising is assumed to divide the variance of the correction by ``denoised``.
    """
    row, col = wp.tid()
    sums = sums_of(film, row, col)
    off = deviation(film, sums, wp.float64(denoised), row, col)
    mean[row, col] = total_radiance(sums) / expected_count(film, row, col)
    variance[row, col] = wp.cw_mul(off, off)


@wp.kernel(enable_backward=False)
def average_tiles(
    pixels: wp.array2d(dtype=wp.vec3d),
    # out
    tiles: wp.array3d(dtype=wp.vec3d),  # [side, tile row, tile column]
):
    """Mean over the pixels of each side of a tile; 0 if there are none."""
    side, tile_row, tile_col = wp.tid()
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    for row in range(tile_row * TILE, wp.min((tile_row + 1) * TILE, pixels.shape[0])):
        for col in range(tile_col * TILE, wp.min((tile_col + 1) * TILE, pixels.shape[1])):
            if side_of(tiles.shape[0], row, col) == side:
                total += pixels[row, col]
                count += wp.float64(1.0)
    tiles[side, tile_row, tile_col] = total / wp.max(count, wp.float64(1.0))
