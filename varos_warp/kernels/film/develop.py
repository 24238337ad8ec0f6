"""Images from the sums of a film: means, standard errors, and guides for a denoiser."""

import warp as wp

from varos_warp.kernels.film.film import (
    BLOCK,
    CORRECTION_SUMS,
    IN_BLOCK,
    TILE,
    Film,
    Sums,
    expected_count,
    of_tile,
    pixel_count,
    side_of,
    sums_of,
    total_radiance,
)

wp.set_module_options({"enable_backward": False})

SHARE_AROUND = wp.constant(0.1)
"""Weight of the surrounding tiles in a tile's variance. If rare samples light a dark image, whole tiles miss them: the
squared errors there are 1.5 to 1.8 times the variance without this weight, 0.9 to 1.1 times with a tenth."""


@wp.func
def is_sparse(film: Film, side: int, tile_row: int, tile_col: int):
    """Return whether pixels of a side have no two samples, whose halves would tell the noise; then other blocks do."""
    if film.count.shape[0] == 1:
        return False
    return film.count[side, tile_row, tile_col] <= IN_BLOCK


@wp.func
def half_difference(total: wp.vec3d, odd: wp.vec3d, count: int, side: int):
    """Difference of the means of odd and even samples; its square estimates the variance of the mean.

    Infinite for one sample. Pixels of side 1 begin with the odd ones (`sample_of`).
    """
    if count < 2:
        return wp.vec3d(wp.float64(wp.inf))
    evens = wp.float64((count + 1 - side) / 2)
    odds = wp.float64(count) - evens
    return ((total - odd) / evens - odd / odds) * (wp.sqrt(evens * odds) / (evens + odds))


@wp.func
def base_difference(film: Film, sums: Sums, row: int, col: int):
    """`half_difference` of all but the correction."""
    if film.sums.shape[0] == CORRECTION_SUMS:
        return wp.vec3d(wp.float64(0.0))
    count = pixel_count(film, row, col)
    base = total_radiance(sums) - sums.correction
    return half_difference(base, sums.odd - sums.odd_correction, count, side_of(film.count.shape[0], row, col))


@wp.func
def correction_difference(film: Film, sums: Sums, row: int, col: int):
    """`half_difference` of the correction; infinite for one sample."""
    side = side_of(film.count.shape[0], row, col)
    return half_difference(sums.correction, sums.odd_correction, pixel_count(film, row, col), side)


@wp.func
def deviation(film: Film, sums: Sums, denoised: wp.float64, row: int, col: int):
    """What one sample is off by: its square estimates the variance of a sample, of the correction divided by that.

    One difference for both: base and correction share the image point and the surface's reflectance.
    """
    if is_sparse(film, side_of(film.count.shape[0], row, col), row / TILE, col / TILE):
        return block_difference(film, row, col) / wp.sqrt(denoised)  # of a film that is all correction
    off = base_difference(film, sums, row, col) + correction_difference(film, sums, row, col) / wp.sqrt(denoised)
    return off * wp.sqrt(wp.float64(wp.max(pixel_count(film, row, col), 1)))


@wp.struct
class BlockMean:
    """Mean of the correction over the samples of a block."""

    light: wp.vec3d
    count: wp.float64
    """Number of the samples."""


@wp.func
def block_mean(film: Film, block_row: int, block_col: int):
    """The correction of a block."""
    mean = BlockMean()
    for row in range(BLOCK * block_row, wp.min(BLOCK * (block_row + 1), film.sums.shape[1])):
        for col in range(BLOCK * block_col, wp.min(BLOCK * (block_col + 1), film.sums.shape[2])):
            mean.light += sums_of(film, row, col).correction
            mean.count += wp.float64(pixel_count(film, row, col))
    mean.light /= mean.count
    return mean


@wp.func
def across(film: Film, row: int, col: int):
    """Mean of the block across the corner from that of a pixel, which is of the same side."""
    rows, cols = (film.sums.shape[1] + 1) / BLOCK, (film.sums.shape[2] + 1) / BLOCK
    return block_mean(film, paired(row / BLOCK, rows), paired(col / BLOCK, cols))


@wp.func
def block_difference(film: Film, row: int, col: int):
    """Difference of a pixel's block to the one across the corner; its square estimates the variance of one sample.

    The correction is smooth, so most of that difference is noise.
    """
    here, there = block_mean(film, row / BLOCK, col / BLOCK), across(film, row, col)
    return (here.light - there.light) / wp.sqrt(wp.float64(1.0) / here.count + wp.float64(1.0) / there.count)


@wp.func
def squared_light(film: Film, row: int, col: int):
    """Estimate of the squared correction around a pixel: noise of two blocks does not add up to more."""
    return wp.cw_mul(block_mean(film, row / BLOCK, col / BLOCK).light, across(film, row, col).light)


@wp.func
def paired(i: int, size: int):
    """The other one of the two indices 2k and 2k + 1; of the last, if it is alone, the one before."""
    if i == size - 1 and i % 2 == 0:
        return i - 1
    return i ^ 1


@wp.struct
class Window:
    """Rows ``top`` to ``bottom`` - 1 and columns ``left`` to ``right`` - 1."""

    top: int
    left: int
    bottom: int
    right: int


@wp.func
def borrowed(film: Film, tile_row: int, tile_col: int):
    """The pixels of a tile; one that the image's edge cuts borrows blocks before it, for a few tell next to nothing."""
    window = Window()
    window.bottom = wp.min((tile_row + 1) * TILE, film.sums.shape[1])
    window.right = wp.min((tile_col + 1) * TILE, film.sums.shape[2])
    window.top = wp.max(window.bottom + window.bottom % BLOCK - TILE, 0)
    window.left = wp.max(window.right + window.right % BLOCK - TILE, 0)
    return window


@wp.kernel(enable_backward=False)
def side_variances(
    film: Film,
    # out, [side, tile row, tile column]
    variance: wp.array3d(dtype=wp.vec3d),  # of one sample
    squares: wp.array3d(dtype=wp.vec3d),  # of the light, where pixels may have no sample
):
    """Estimates of the variance of one sample; without sides infinite for one sample.

    Each side's is of its own samples: how many they are follows from the other's, so what they claim knows nothing of
    that, and is right in the mean.
    """
    side, tile_row, tile_col = wp.tid()
    tile = borrowed(film, tile_row, tile_col)
    noise = wp.vec3d(wp.float64(0.0))
    light = wp.vec3d(wp.float64(0.0))
    pixels = wp.float64(0.0)
    sparse = wp.float64(0.0)
    for row in range(tile.top, tile.bottom):
        for col in range(tile.left, tile.right):
            if side_of(film.count.shape[0], row, col) == side:
                one = deviation(film, sums_of(film, row, col), wp.float64(1.0), row, col)
                noise += wp.cw_mul(one, one)
                pixels += wp.float64(1.0)
                if of_tile(film.count, row, col) < IN_BLOCK:
                    light += squared_light(film, row, col)
                    sparse += wp.float64(1.0)
    variance[side, tile_row, tile_col] = noise / wp.max(pixels, wp.float64(1.0))
    squares[side, tile_row, tile_col] = wp.max(light / wp.max(sparse, wp.float64(1.0)), wp.vec3d(wp.float64(0.0)))


@wp.kernel(enable_backward=False)
def tile_variances(
    film: Film,
    # out, [tile row, tile column]
    blocks: wp.array2d(dtype=wp.vec3d),  # added
):
    """Estimates of the variance of the mean of a tile's pixels; without sides infinite for one sample.

    A single value is a poor estimate; average them. Half the difference of the two halves of a pixel's samples is
    distributed like the error of their mean. The error that all pixels of a tile share remains in the mean over it.
    """
    tile_row, tile_col = wp.tid()
    around = borrowed(film, tile_row, tile_col)
    off = wp.vec3d(wp.float64(0.0))
    for row in range(tile_row * TILE, around.bottom):
        for col in range(tile_col * TILE, around.right):
            if not is_sparse(film, side_of(film.count.shape[0], row, col), tile_row, tile_col):
                sums = sums_of(film, row, col)
                off += base_difference(film, sums, row, col) + correction_difference(film, sums, row, col)
    pixels = wp.float64((around.bottom - tile_row * TILE) * (around.right - tile_col * TILE))
    mean = off / pixels
    if is_sparse(film, 0, tile_row, tile_col) or is_sparse(film, 1, tile_row, tile_col):
        more = wp.float64((around.bottom - around.top) * (around.right - around.left)) / pixels
        mean += wp.sqrt(more) * half_of_sides_apart(film, around)
    blocks[tile_row, tile_col] += wp.cw_mul(mean, mean)


@wp.func
def half_of_sides_apart(film: Film, tile: Window):
    """Half the difference of the means of a tile's sides, of which slopes of the light leave nothing."""
    first = wp.vec3d(wp.float64(0.0))
    second = wp.vec3d(wp.float64(0.0))
    firsts = wp.float64(0.0)
    seconds = wp.float64(0.0)
    for row in range(tile.top, tile.bottom):
        for col in range(tile.left, tile.right):
            light = total_radiance(sums_of(film, row, col)) / expected_count(film, row, col)
            if side_of(2, row, col) == 0:
                first += light
                firsts += wp.float64(1.0)
            else:
                second += light
                seconds += wp.float64(1.0)
    return wp.float64(0.5) * (first / firsts - second / wp.max(seconds, wp.float64(1.0)))


@wp.func
def with_tiles_around(variance: wp.array3d(dtype=wp.vec3d), side: int, tile_row: int, tile_col: int):
    """A side's variance with `SHARE_AROUND` of its mean over the tile and those around."""
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    for row in range(wp.max(tile_row - 1, 0), wp.min(tile_row + 2, variance.shape[1])):
        for col in range(wp.max(tile_col - 1, 0), wp.min(tile_col + 2, variance.shape[2])):
            total += variance[side, row, col]
            count += wp.float64(1.0)
    share = wp.float64(SHARE_AROUND)
    return (wp.float64(1.0) - share) * variance[side, tile_row, tile_col] + share * total / count


@wp.kernel(enable_backward=False)
def weigh_guides(
    direct: wp.array2d(dtype=wp.vec3),
    radiance: wp.array2d(dtype=wp.vec3),
    correction: wp.array2d(dtype=wp.vec3),
    surface_albedo: wp.array2d(dtype=wp.vec3),
    surface_normal: wp.array2d(dtype=wp.vec3),
    # out
    albedo: wp.array2d(dtype=wp.vec3),
    normal: wp.array2d(dtype=wp.vec3),
):
    """Guides for a denoiser of light that comes from surfaces and water: their mean, weighted by the light of each.

    Surfaces count as much as direct light does in all but the correction. Water has the albedo 1 and no normal.
    """
    row, col = wp.tid()
    base = radiance[row, col] - correction[row, col]
    share = wp.vec3(0.0)
    for c in range(3):
        if base[c] > 0.0:
            share[c] = wp.clamp(direct[row, col][c] / base[c], 0.0, 1.0)
    albedo[row, col] = wp.vec3(1.0) + wp.cw_mul(share, surface_albedo[row, col] - wp.vec3(1.0))
    normal[row, col] = (share[0] + share[1] + share[2]) / 3.0 * surface_normal[row, col]


@wp.kernel(enable_backward=False)
def develop(
    film: Film,
    variance: wp.array3d(dtype=wp.vec3d),  # of one sample, of side_variances
    squares: wp.array3d(dtype=wp.vec3d),  # of the light, likewise
    # out
    direct: wp.array2d(dtype=wp.vec3),
    single: wp.array2d(dtype=wp.vec3),
    multiple: wp.array2d(dtype=wp.vec3),
    correction: wp.array2d(dtype=wp.vec3),
    base_variance: wp.array2d(dtype=wp.vec3),
    radiance: wp.array2d(dtype=wp.vec3),
    stderr: wp.array2d(dtype=wp.vec3),
):
    """Add a film to an image that is the sum of several: mean of each layer, their sum and its standard error.

    All are [height, width] and 0 before the first film; ``correction`` is contained in the layers. The standard error
    comes from the samples of all pixels of a side of a tile, and a little from the tiles around, because pixels that
    missed rare bright samples would claim too small an error. Where only some pixels of a block have a sample, the
    chance to have one counts too. ``base_variance`` is the pixel's own variance of everything but the correction:
    mostly edges, textures and the blur of a lens.
    """
    row, col = wp.tid()
    sums = sums_of(film, row, col)
    n = expected_count(film, row, col)
    direct[row, col] += wp.vec3(sums.direct / n)
    single[row, col] += wp.vec3(sums.single / n)
    multiple[row, col] += wp.vec3(sums.multiple / n)
    correction[row, col] += wp.vec3(sums.correction / n)
    # the sum of the layers as stored, so that they add up to it exactly
    radiance[row, col] = direct[row, col] + single[row, col] + multiple[row, col]
    off = base_difference(film, sums, row, col)
    base_variance[row, col] += wp.vec3(wp.cw_mul(off, off))
    before = stderr[row, col]
    side = side_of(variance.shape[0], row, col)
    variance_here = with_tiles_around(variance, side, row / TILE, col / TILE) / n
    if n < wp.float64(1.0):  # whether a pixel has a sample is chance, too
        variance_here += (wp.float64(1.0) / n - wp.float64(1.0)) * squares[side, row / TILE, col / TILE]
    for c in range(3):
        stderr[row, col][c] = wp.sqrt(before[c] * before[c] + float(variance_here[c]))
