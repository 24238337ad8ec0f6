"""Statistics of the samples so far, and how many more each tile needs: render/image/adapt.py says why.

What is summed over all tiles is so by one block of threads, each of which takes the same tiles in the same order.
"""

import warp as wp

from varos_warp.kernels.film.develop import deviation
from varos_warp.kernels.film.film import IN_BLOCK, TILE, Film, expected_count, side_of, sums_of, total_radiance

wp.set_module_options({"enable_backward": False})

BY_BLOCKS = {"enable_backward": False, "launch_bounds": (512, 1), "module": "unique"}
"""Options of kernels of which a block of threads sums over tiles; the number of threads is part of a module."""
DARK = 0.1
"""A channel darker than this share of the brightest counts as if it had it: its error hardly shows."""
DARK_SHARE = wp.constant(wp.float64(DARK))
"""`DARK` as a constant of kernels."""
FEWEST_FIRST, PAIR = wp.constant(2), wp.constant(8)
"""Samples of a pixel whose difference shows its noise, and those of its block; where there are more they come in pairs,
for of low-discrepancy samples halves of unlike number would claim too large an error."""
HALVINGS = wp.constant(24)
"""How often the bounds of the numbers of samples are brought together."""
GOLDEN = wp.constant(wp.float64(0.6180339887))
"""Golden ratio less 1: its multiples, less their whole parts, fill [0, 1) evenly, however many there are."""


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
    mean: wp.array2d(dtype=wp.vec3d),
    variance: wp.array2d(dtype=wp.vec3d),
    # out, [side, tile row, tile column]
    mean_of_tiles: wp.array3d(dtype=wp.vec3d),
    variance_of_tiles: wp.array3d(dtype=wp.vec3d),
):
    """Means over the pixels of each side of a tile; 0 if there are none."""
    side, tile_row, tile_col = wp.tid()
    mean_sum = wp.vec3d(wp.float64(0.0))
    variance_sum = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    for row in range(tile_row * TILE, wp.min((tile_row + 1) * TILE, mean.shape[0])):
        for col in range(tile_col * TILE, wp.min((tile_col + 1) * TILE, mean.shape[1])):
            if side_of(mean_of_tiles.shape[0], row, col) == side:
                mean_sum += mean[row, col]
                variance_sum += variance[row, col]
                count += wp.float64(1.0)
    mean_of_tiles[side, tile_row, tile_col] = mean_sum / wp.max(count, wp.float64(1.0))
    variance_of_tiles[side, tile_row, tile_col] = variance_sum / wp.max(count, wp.float64(1.0))


@wp.func
def sum_of_threads(value: wp.float64):
    """Sum over a block of threads."""
    return wp.tile_extract(wp.tile_sum(wp.tile(value)), 0)


@wp.func
def max_of_threads(value: wp.float64):
    """Maximum over a block of threads."""
    return wp.tile_extract(wp.tile_max(wp.tile(value)), 0)


@wp.kernel(**BY_BLOCKS)
def find_levels(
    mean: wp.array4d(dtype=wp.vec3d),  # of the tiles of each kind, whose sum is the image, [kind, side, row, column]
    # out
    scale: wp.array(dtype=wp.vec3d),
):
    """What makes a variance relative, by side: one over the square of its mean, or of `DARK` of its brightest channel.

    Zero where the image is black.
    """
    side, thread = wp.tid()
    tiles = mean.shape[2] * mean.shape[3]
    total = wp.vec3d(wp.float64(0.0))
    for i in range(thread, tiles, wp.block_dim()):
        for kind in range(mean.shape[0]):
            total += mean[kind, side, i / mean.shape[3], i % mean.shape[3]]
    level = wp.vec3d(sum_of_threads(total[0]), sum_of_threads(total[1]), sum_of_threads(total[2]))
    level /= wp.float64(tiles)
    least = DARK_SHARE * wp.max(level)
    of_side = wp.vec3d(wp.float64(0.0))
    for c in range(3):
        one = wp.max(level[c], least)
        if one * one > wp.float64(0.0):
            of_side[c] = wp.float64(1.0) / (one * one)
    if thread == 0:
        scale[side] = of_side


@wp.func
def relative_noise(variance: wp.array4d(dtype=wp.vec3d), scale: wp.vec3d, kind: int, side: int, row: int, col: int):
    """Relative variance of one sample in its worst channel."""
    return wp.max(wp.cw_mul(variance[kind, side, row, col], scale))


@wp.kernel(enable_backward=False)
def noise_around(
    variance: wp.array4d(dtype=wp.vec3d),  # of one sample, [kind, side, row, column]
    scale: wp.array(dtype=wp.vec3d),  # of `find_levels`
    # out
    noise: wp.array4d(dtype=wp.float64),
):
    """Relative variance of one sample as the other side of a tile saw it, or as those of the tiles around on average.

    The variance of a few samples may have missed the bright ones.
    """
    kind, side, row, col = wp.tid()
    other = 1 - side
    total = wp.float64(0.0)
    for i in range(row - 1, row + 2):
        for j in range(col - 1, col + 2):
            near_row = wp.clamp(i, 0, variance.shape[2] - 1)
            near_col = wp.clamp(j, 0, variance.shape[3] - 1)
            total += relative_noise(variance, scale[other], kind, other, near_row, near_col)
    own = relative_noise(variance, scale[other], kind, other, row, col)
    noise[kind, side, row, col] = wp.max(own, total / wp.float64(9.0))


@wp.struct
class Sharing:
    """How the samples of one kind are shared out."""

    taken: wp.float64
    """Samples that every pixel has."""
    most: wp.float64
    """Most samples that a pixel may have."""
    cost: wp.float64
    """Relative time of one sample."""


@wp.func
def samples_at(kind: Sharing, scale: wp.float64, weight: wp.float64):
    """Samples of a pixel, within their bounds in proportion to its weight."""
    return wp.clamp(scale * weight, kind.taken, kind.most)


@wp.func
def whole_samples(of_pixel: wp.float64, place: int):
    """Whole samples of a block: 1 to 4, or pairs for each pixel, with the same mean: parts go to the tiles in turn."""
    wanted = wp.float64(IN_BLOCK) * of_pixel
    step = wp.float64(1.0)
    if wanted >= wp.float64(PAIR):
        step = wp.float64(PAIR)
    elif wanted >= wp.float64(IN_BLOCK):
        step = wp.float64(IN_BLOCK)
    return step * wp.floor(wanted / step + wp.mod(GOLDEN * wp.float64(place), wp.float64(1.0)))


@wp.kernel(**BY_BLOCKS)
def share_samples(
    noise: wp.array4d(dtype=wp.float64),  # relative variance of one sample, [kind, side, tile row, tile column]
    kinds: wp.array(dtype=Sharing),
    asked: wp.float64,  # cost of the mean pixel
    # out
    weight: wp.array4d(dtype=wp.float64),  # deviation of one sample over the root of its cost
    wanted: wp.array4d(dtype=int),
):
    """Further samples of each block of pixels; the numbers of each side are found by itself."""
    side, thread = wp.tid()
    cols = noise.shape[3]
    tiles = noise.shape[2] * cols
    # scales of the weight at which none gets more, and at which all have the most that they may
    heaviest = wp.float64(0.0)
    lightest = wp.float64(-wp.inf)  # less it
    fewest = kinds[0].taken
    most = kinds[0].most
    for k in range(noise.shape[0]):
        fewest = wp.min(fewest, kinds[k].taken)
        most = wp.max(most, kinds[k].most)
        for i in range(thread, tiles, wp.block_dim()):
            one = wp.sqrt(noise[k, side, i / cols, i % cols] / kinds[k].cost)
            weight[k, side, i / cols, i % cols] = one
            heaviest = wp.max(heaviest, one)
            if one > wp.float64(0.0):
                lightest = wp.max(lightest, -one)
    heaviest = max_of_threads(heaviest)
    lightest = -max_of_threads(lightest)
    low = fewest / heaviest
    high = most / lightest
    for _n in range(HALVINGS):
        middle = wp.sqrt(low * high)
        spent = wp.float64(0.0)
        for k in range(noise.shape[0]):
            for i in range(thread, tiles, wp.block_dim()):
                spent += kinds[k].cost * samples_at(kinds[k], middle, weight[k, side, i / cols, i % cols])
        if sum_of_threads(spent) / wp.float64(tiles) <= asked:
            low = middle
        else:
            high = middle
    for k in range(noise.shape[0]):
        for i in range(thread, tiles, wp.block_dim()):
            more = int(0)
            if heaviest > wp.float64(0.0):
                of_block = whole_samples(samples_at(kinds[k], low, weight[k, side, i / cols, i % cols]), i)
                more = int(of_block - wp.float64(IN_BLOCK) * kinds[k].taken)
            wanted[k, side, i / cols, i % cols] = more
