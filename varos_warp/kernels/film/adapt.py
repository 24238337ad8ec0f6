"""What the samples so far say of a film's tiles, for the decision how many more each needs (render/adapt.py)."""

import warp as wp

from varos_warp.kernels.film.film import TILE, Film, of_tile, side_of, sums_of, variance_of_mean

wp.set_module_options({"enable_backward": False})


@wp.kernel(enable_backward=False)
def pixel_statistics(
    film: Film,
    # out
    mean: wp.array2d(dtype=wp.vec3d),
    variance: wp.array2d(dtype=wp.vec3d),  # of one sample
):
    """Mean and variance of a pixel's samples; without the residual."""
    row, col = wp.tid()
    sums = sums_of(film, row, col)
    count = of_tile(film.count, row, col)
    light = sums.direct + sums.single + sums.glow + sums.veil
    spread = wp.vec3d(wp.float64(0.0))
    for c in range(3):
        spread[c] = variance_of_mean(sums.squares[c], light[c], count) * wp.float64(count)
    mean[row, col] = light / wp.float64(count)
    variance[row, col] = spread


@wp.kernel(enable_backward=False)
def metal_pixels(film: Film, metal: wp.array2d(dtype=wp.vec3d)):
    """1 for pixels with metal, else 0, in every channel."""
    row, col = wp.tid()
    metal[row, col] = wp.vec3d(wp.float64(film.metal[row, col]))


@wp.kernel(enable_backward=False)
def residual_mean_squares(
    film: Film,
    metal_samples: int,
    denoised: float,
    # out
    squares: wp.array2d(dtype=wp.vec3d),
):
    """Mean square of what a pixel takes for one sample of its tile: about its variance, for it is mostly noise.

    A denoiser takes away all but one part in ``denoised`` of it where there is no metal.
    """
    row, col = wp.tid()
    square = film.residual_squares[row, col] / wp.float64(film.residual_count[row, col])
    if film.metal[row, col] == 1:
        squares[row, col] = square / wp.float64(metal_samples)
    else:
        squares[row, col] = square / wp.float64(denoised)


@wp.kernel(enable_backward=False)
def average_tiles(
    pixels: wp.array2d(dtype=wp.vec3d),
    # out
    tiles: wp.array3d(dtype=wp.vec3d),  # [side, tile row, tile column]
):
    """Mean over the pixels of each side of a tile; 0 where there are none."""
    side, tile_row, tile_col = wp.tid()
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    for row in range(tile_row * TILE, wp.min((tile_row + 1) * TILE, pixels.shape[0])):
        for col in range(tile_col * TILE, wp.min((tile_col + 1) * TILE, pixels.shape[1])):
            if side_of(tiles.shape[0], row, col) == side:
                total += pixels[row, col]
                count += wp.float64(1.0)
    tiles[side, tile_row, tile_col] = total / wp.max(count, wp.float64(1.0))
