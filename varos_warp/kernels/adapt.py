"""What the samples so far say of a film's tiles, for the decision how many more each needs (render/adapt.py)."""

import warp as wp

from varos_warp.kernels.film import TILE, Film, sums_of_half, variance_of_mean

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def pixel_statistics(
    film: Film,
    # out
    mean: wp.array3d(dtype=wp.vec3d),  # [half, row, column]
    variance: wp.array3d(dtype=wp.vec3d),  # of one sample
):
    """Mean and variance of a pixel's samples, of each half by itself."""
    half, row, col = wp.tid()
    sums = sums_of_half(film, half, row, col)
    count = film.count[half, row / TILE, col / TILE]
    light = sums.direct + sums.single + sums.glow + sums.veil
    spread = wp.vec3d(wp.float64(0.0))
    for c in range(3):
        spread[c] = variance_of_mean(sums.squares[c], light[c], count) * wp.float64(count)
    mean[half, row, col] = light / wp.float64(count)
    variance[half, row, col] = spread


@wp.kernel(enable_backward=False)
def average_tiles(
    pixels: wp.array3d(dtype=wp.vec3d),  # [half, row, column]
    # out
    tiles: wp.array3d(dtype=wp.vec3d),
):
    """Mean over the pixels of each tile."""
    half, tile_row, tile_col = wp.tid()
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    for row in range(tile_row * TILE, wp.min((tile_row + 1) * TILE, pixels.shape[1])):
        for col in range(tile_col * TILE, wp.min((tile_col + 1) * TILE, pixels.shape[2])):
            total += pixels[half, row, col]
            count += wp.float64(1.0)
    tiles[half, tile_row, tile_col] = total / count
