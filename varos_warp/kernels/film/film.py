"""Sums of radiance samples in float64, and the means and standard errors that follow from them.

In float32 a running mean stalls: after 100 000 samples it is silently off by a hundred standard errors.
"""

import warp as wp

from varos_warp.kernels.sampling import uniforms

wp.set_module_options({"enable_backward": False})

TILE = wp.constant(8)
"""Width of a tile [pixels]. All blocks of a tile, or of each of its two sides, get equally many samples."""

BLOCK, IN_BLOCK = wp.constant(2), wp.constant(4)
"""Width of a block [pixels] and number of its pixels: samples are counted by block, so that fewer than one a pixel are
whole numbers, too. Either IN_BLOCK samples or fewer, or a multiple of IN_BLOCK."""
PLACE = wp.constant(1 << 20)
"""Group of the random number that tells which pixels of a block are sampled first; no path gets there."""

SHARE_AROUND = wp.constant(0.1)
"""Weight of the surrounding tiles in a tile's variance. If rare samples light a dark image, whole tiles miss them: the
squared errors there are 1.5 to 1.8 times the variance without this weight, 0.9 to 1.1 times with a tenth."""

SUMS, CORRECTION_SUMS = wp.constant(6), wp.constant(2)
"""Sums per pixel: those of `Sums` except ``lost``; two of them if all light is the correction, in `multiple`."""


@wp.struct
class Sums:
    """Sums of radiance [W/sr/m^2] over samples of one pixel."""

    direct: wp.vec3d
    single: wp.vec3d
    multiple: wp.vec3d
    """The layers."""
    correction: wp.vec3d
    """The part of their sum that subpaths carry, and blocked single scattering: all noise except that of edges."""
    odd: wp.vec3d
    odd_correction: wp.vec3d
    """Total and correction of every second sample. The two halves have their own random numbers, so they are
    independent images, and their difference shows the error, however evenly the samples are spread within each."""
    lost: int
    """Number of samples that were infinite or not a number."""


@wp.struct
class Batch:
    """Samples ``begin`` to ``end`` of a pixel, taken by one thread."""

    row: int
    col: int
    begin: int
    end: int


@wp.struct
class Film:
    """Sums over the samples of one image.

    Blocks of 2 x 2 pixels form one side, or two that alternate like the squares of a chessboard and may take different
    numbers of samples (render/image/adapt.py). Fewer samples than pixels go to as many pixels of a block, drawn by
    chance, and the others are black: what is seen of a sample is divided by its chance to be taken, so each pixel is
    right in the mean, and a block misses nothing but noise. Blocks that the edge cuts have one sample in each pixel at
    least. Samples are taken in batches of a few each, since otherwise a GPU would finally
    wait for the threads of noisy pixels; the sums of batches are added up in a fixed order.
    """

    key: wp.uint32
    """Key of the random numbers that tell which pixels of a block are sampled first."""
    wanted: wp.array3d(dtype=int)
    """Samples that each block is to take next [side, tile row, tile column]."""
    count: wp.array3d(dtype=int)
    """Samples that each block has, in the same layout."""
    batches: wp.array(dtype=Batch)
    batch_sums: wp.array2d(dtype=wp.vec3d)
    """The batches, and their sums [SUMS or CORRECTION_SUMS, batches]."""
    next: wp.array(dtype=int)
    """One number: the first batch that no thread has started; empty if each thread takes one batch."""
    sums: wp.array3d(dtype=wp.vec3d)
    """Sums over all samples [SUMS or CORRECTION_SUMS, height, width]."""
    lost: wp.array(dtype=int)
    """One number: samples that were infinite or not a number. They count as black, and the renderer reports them."""


@wp.func
def is_finite(L: wp.vec3):
    """Whether all channels are finite."""
    return wp.isfinite(L[0]) and wp.isfinite(L[1]) and wp.isfinite(L[2])


@wp.func
def add_sample(sums: Sums, sample: int, direct: wp.vec3, single: wp.vec3, multiple: wp.vec3, correction: wp.vec3):
    """Sums with the radiance of one more sample, layer by layer; ``correction`` is contained in the layers."""
    after = sums
    total = direct + single + multiple
    if not is_finite(total):
        after.lost += 1
        return after
    after.direct += wp.vec3d(direct)
    after.single += wp.vec3d(single)
    after.multiple += wp.vec3d(multiple)
    after.correction += wp.vec3d(correction)
    if sample % 2 == 1:
        after.odd += wp.vec3d(direct) + wp.vec3d(single) + wp.vec3d(multiple)
        after.odd_correction += wp.vec3d(correction)
    return after


@wp.func
def add_correction(sums: Sums, sample: int, L: wp.vec3):
    """`add_sample` of a radiance that is all ``multiple`` and all correction, for a film with CORRECTION_SUMS."""
    after = sums
    if not is_finite(L):
        after.lost += 1
        return after
    after.multiple += wp.vec3d(L)
    if sample % 2 == 1:
        after.odd += wp.vec3d(L)
    return after


@wp.func
def first_sample(batch: int, batches: int, spp: int):
    """Index of a batch's first sample; in 64 bits, as the product may be large."""
    return int(wp.int64(batch) * wp.int64(spp) / wp.int64(batches))


@wp.func
def side_of(sides: int, row: int, col: int):
    """The side that a pixel belongs to, as its block does."""
    return (row / BLOCK + col / BLOCK) % sides


@wp.func
def sample_of(film: Film, batch: Batch, i: int):
    """Number of the ``i``-th sample of a batch's pixel: pixels of side 1 take each even one after the odd one.

    So even where all pixels have one sample only, both halves are there, at neighbours.
    """
    return i ^ side_of(film.count.shape[0], batch.row, batch.col)


@wp.func
def of_tile(numbers: wp.array3d(dtype=int), row: int, col: int):
    """A pixel's entry of ``numbers`` [side, tile row, tile column]."""
    return numbers[side_of(numbers.shape[0], row, col), row / TILE, col / TILE]


@wp.func
def is_cut(film: Film, row: int, col: int):
    """Whether the edge of the image cuts a pixel's block."""
    return (row ^ 1) >= film.sums.shape[1] or (col ^ 1) >= film.sums.shape[2]


@wp.func
def rank_in_block(film: Film, row: int, col: int):
    """When a pixel's turn comes among those of its block, 0 to 3: two in a row are across the corner."""
    if is_cut(film, row, col):
        return 0
    block = row / BLOCK * film.sums.shape[2] + col / BLOCK
    drawn = int(float(IN_BLOCK) * uniforms(film.key, block, 0, PLACE)[0])
    return (2 * ((row ^ col) & 1) + (col & 1)) ^ drawn


@wp.func
def of_pixel(film: Film, of_block: int, row: int, col: int):
    """Number of a pixel's samples, from that of its block."""
    if of_block % IN_BLOCK == 0:
        return of_block / IN_BLOCK
    return (of_block + IN_BLOCK - 1 - rank_in_block(film, row, col)) / IN_BLOCK


@wp.func
def pixel_count(film: Film, row: int, col: int):
    """Number of samples that a pixel has."""
    return of_pixel(film, of_tile(film.count, row, col), row, col)


@wp.func
def expected_count(film: Film, row: int, col: int):
    """Number of samples that a pixel may expect, of which its sum is divided: less than one where chance decides."""
    of_block = of_tile(film.count, row, col)
    if of_block < IN_BLOCK and not is_cut(film, row, col):
        return wp.float64(of_block) / wp.float64(IN_BLOCK)
    return wp.float64(of_pixel(film, of_block, row, col))


@wp.func
def is_sparse(film: Film, side: int, tile_row: int, tile_col: int):
    """Whether pixels of a side have no two samples, whose halves would tell the noise; then other blocks do."""
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
def tile_pixel(tile_cols: int, i: int):
    """Row and column of the ``i``-th pixel, tile by tile, so that neighbouring threads trace neighbouring rays."""
    tile = i / (TILE * TILE)
    within = i % (TILE * TILE)
    return tile / tile_cols * TILE + within / TILE, tile % tile_cols * TILE + within % TILE


@wp.func
def pixel_of(film: Film, batch: Batch):
    """Number of a batch's pixel, row by row."""
    return batch.row * film.sums.shape[2] + batch.col


@wp.kernel(enable_backward=False)
def count_batches(
    film: Film,
    most: int,  # samples of a batch
    # out
    counts: wp.array(dtype=int),  # per pixel, tile by tile
):
    """Number of batches that each pixel's wanted samples are divided into."""
    i = wp.tid()
    row, col = tile_pixel(film.count.shape[2], i)
    counts[i] = 0
    if row < film.sums.shape[1] and col < film.sums.shape[2]:
        counts[i] = (wanted_count(film, row, col) + most - 1) / most


@wp.func
def wanted_count(film: Film, row: int, col: int):
    """Number of samples that a pixel is to take next."""
    after = of_tile(film.count, row, col) + of_tile(film.wanted, row, col)
    return of_pixel(film, after, row, col) - pixel_count(film, row, col)


@wp.func
def start_of(ends: wp.array(dtype=int), i: int):
    """Index of the first entry of pixel ``i`` in the list of all, from the running sum of their counts."""
    if i == 0:
        return 0
    return ends[i - 1]


@wp.kernel(enable_backward=False)
def list_batches(
    ends: wp.array(dtype=int),  # running sum of the batches over the pixels, tile by tile
    first_row: int,
    begin: int,
    # out
    film: Film,  # the batches from ``begin`` on, as many as there is room for
):
    """List the batches of each pixel, which divide its samples evenly."""
    i = first_row + wp.tid()
    row, col = tile_pixel(film.count.shape[2], i)
    start = start_of(ends, i)
    for k in range(wp.max(start, begin), wp.min(ends[i], begin + film.batches.shape[0])):
        batch = Batch()
        batch.row = row
        batch.col = col
        wanted = wanted_count(film, row, col)
        taken = pixel_count(film, row, col)
        batch.begin = taken + first_sample(k - start, ends[i] - start, wanted)
        batch.end = taken + first_sample(k - start + 1, ends[i] - start, wanted)
        film.batches[k - begin] = batch


@wp.func
def store(film: Film, batch: int, sums: Sums):
    """Keep the sums of a batch."""
    film.batch_sums[0, batch] = sums.multiple
    film.batch_sums[1, batch] = sums.odd
    if film.batch_sums.shape[0] == SUMS:
        film.batch_sums[2, batch] = sums.direct
        film.batch_sums[3, batch] = sums.single
        film.batch_sums[4, batch] = sums.correction
        film.batch_sums[5, batch] = sums.odd_correction
    if sums.lost > 0:
        wp.atomic_add(film.lost, 0, sums.lost)


@wp.func
def next_batch(film: Film):
    """The next batch for a thread that has finished one; the number of batches if none is left.

    Paths differ in length, and the threads of a GPU's warp wait for the longest. Threads that continue with another
    batch wait only once, at the end.
    """
    if film.next.shape[0] == 0:
        return film.batches.shape[0]
    return wp.atomic_add(film.next, 0, 1)


@wp.func
def sums_of(film: Film, row: int, col: int):
    """Sums over all samples of a pixel."""
    sums = Sums()
    sums.multiple = film.sums[0, row, col]
    sums.odd = film.sums[1, row, col]
    if film.sums.shape[0] == SUMS:
        sums.direct = film.sums[2, row, col]
        sums.single = film.sums[3, row, col]
        sums.correction = film.sums[4, row, col]
        sums.odd_correction = film.sums[5, row, col]
    else:
        sums.correction = sums.multiple
        sums.odd_correction = sums.odd
    return sums


@wp.func
def total_radiance(sums: Sums):
    """Sum of the layers."""
    return sums.direct + sums.single + sums.multiple


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
    base = base_difference(film, sums, row, col)
    if is_sparse(film, side_of(film.count.shape[0], row, col), row / TILE, col / TILE):
        return base + block_difference(film, row, col) / wp.sqrt(denoised)
    off = base + correction_difference(film, sums, row, col) / wp.sqrt(denoised)
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


@wp.kernel(enable_backward=False)
def weigh_batches(
    share: wp.array2d(dtype=wp.float64),  # of each pixel
    first_row: int,
    # out
    film: Film,
):
    """Multiply the sums of batches by what counts of them, before they are added to those of their pixels."""
    sum_row, i = wp.tid()
    batch = film.batches[i]
    film.batch_sums[first_row + sum_row, i] = share[batch.row, batch.col] * film.batch_sums[first_row + sum_row, i]


@wp.kernel(enable_backward=False)
def add_batches(
    ends: wp.array(dtype=int),
    first_row: int,
    begin: int,
    # out
    film: Film,
):
    """Add the sums of the batches from ``begin`` on to those of their pixels."""
    tile_sum, i = wp.tid()
    which = first_row + tile_sum
    row, col = tile_pixel(film.count.shape[2], i)
    start = wp.max(start_of(ends, i), begin)
    end = wp.min(ends[i], begin + film.batches.shape[0])
    if start < end:
        total = film.sums[which, row, col]
        for k in range(start, end):
            total += film.batch_sums[which, k - begin]
        film.sums[which, row, col] = total


@wp.kernel(enable_backward=False)
def note_samples(film: Film):
    """Count the wanted samples as taken."""
    side, tile_row, tile_col = wp.tid()
    film.count[side, tile_row, tile_col] += film.wanted[side, tile_row, tile_col]


@wp.kernel(enable_backward=False)
def tile_variances(
    film: Film,
    # out, [tile row, tile column]
    samples: wp.array2d(dtype=wp.vec3d),  # of one sample
    squares: wp.array2d(dtype=wp.vec3d),  # of the light, where pixels may have no sample
    blocks: wp.array2d(dtype=wp.vec3d),  # of the mean of all pixels, added
):
    """Estimates of variances; without sides infinite for one sample.

    A single value of ``blocks`` is a poor estimate; average them. Half the difference of the two halves of a pixel's
    samples is distributed like the error of their mean. The error that all pixels of a tile share remains in the mean
    over the tile.
    """
    tile_row, tile_col = wp.tid()
    height, width = film.sums.shape[1], film.sums.shape[2]
    # for the variance of samples, a tile cut by the image's edge borrows pixels before it
    top = wp.max(wp.min(tile_row * TILE, height - TILE), 0)
    left = wp.max(wp.min(tile_col * TILE, width - TILE), 0)
    noise = wp.vec3d(wp.float64(0.0))
    light = wp.vec3d(wp.float64(0.0))
    around = wp.float64(0.0)
    sparse = wp.float64(0.0)
    off = wp.vec3d(wp.float64(0.0))
    pixels = wp.float64(0.0)
    for row in range(top, wp.min((tile_row + 1) * TILE, height)):
        for col in range(left, wp.min((tile_col + 1) * TILE, width)):
            sums = sums_of(film, row, col)
            side = side_of(film.count.shape[0], row, col)
            one = deviation(film, sums, wp.float64(1.0), row, col)
            noise += wp.cw_mul(one, one)
            around += wp.float64(1.0)
            if of_tile(film.count, row, col) < IN_BLOCK:
                light += squared_light(film, row, col)
                sparse += wp.float64(1.0)
            if row >= tile_row * TILE and col >= tile_col * TILE:
                pixels += wp.float64(1.0)
                if not is_sparse(film, side, tile_row, tile_col):
                    off += one / wp.sqrt(wp.float64(wp.max(pixel_count(film, row, col), 1)))
    mean = off / pixels
    if is_sparse(film, 0, tile_row, tile_col) or is_sparse(film, 1, tile_row, tile_col):
        mean += half_of_sides_apart(film, tile_row, tile_col)
    samples[tile_row, tile_col] = noise / around
    squares[tile_row, tile_col] = wp.max(light / wp.max(sparse, wp.float64(1.0)), wp.vec3d(wp.float64(0.0)))
    blocks[tile_row, tile_col] += wp.cw_mul(mean, mean)


@wp.func
def half_of_sides_apart(film: Film, tile_row: int, tile_col: int):
    """Half the difference of the means of a tile's sides, of which slopes of the light leave nothing."""
    first = wp.vec3d(wp.float64(0.0))
    second = wp.vec3d(wp.float64(0.0))
    firsts = wp.float64(0.0)
    seconds = wp.float64(0.0)
    for row in range(tile_row * TILE, wp.min((tile_row + 1) * TILE, film.sums.shape[1])):
        for col in range(tile_col * TILE, wp.min((tile_col + 1) * TILE, film.sums.shape[2])):
            light = total_radiance(sums_of(film, row, col)) / expected_count(film, row, col)
            if side_of(2, row, col) == 0:
                first += light
                firsts += wp.float64(1.0)
            else:
                second += light
                seconds += wp.float64(1.0)
    return wp.float64(0.5) * (first / firsts - second / wp.max(seconds, wp.float64(1.0)))


@wp.func
def with_tiles_around(variance: wp.array2d(dtype=wp.vec3d), tile_row: int, tile_col: int):
    """A tile's variance with `SHARE_AROUND` of the mean over it and the tiles around."""
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    for row in range(wp.max(tile_row - 1, 0), wp.min(tile_row + 2, variance.shape[0])):
        for col in range(wp.max(tile_col - 1, 0), wp.min(tile_col + 2, variance.shape[1])):
            total += variance[row, col]
            count += wp.float64(1.0)
    share = wp.float64(SHARE_AROUND)
    return (wp.float64(1.0) - share) * variance[tile_row, tile_col] + share * total / count


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
    variance: wp.array2d(dtype=wp.vec3d),  # of samples, of tile_variances
    squares: wp.array2d(dtype=wp.vec3d),  # of the light, likewise
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
    comes from the samples of all pixels of a tile, and a little from the tiles around, because pixels that missed rare
    bright samples would claim too small an error. Where only some pixels of a block have a sample, the chance to have
    one counts too. ``base_variance`` is the pixel's own variance of everything but the correction: mostly edges,
    textures and the blur of a lens.
    """
    row, col = wp.tid()
    sums = sums_of(film, row, col)
    n = expected_count(film, row, col)
    if n == wp.float64(0.0):
        n = wp.float64(1.0)
    direct[row, col] += wp.vec3(sums.direct / n)
    single[row, col] += wp.vec3(sums.single / n)
    multiple[row, col] += wp.vec3(sums.multiple / n)
    correction[row, col] += wp.vec3(sums.correction / n)
    # the sum of the layers as stored, so that they add up to it exactly
    radiance[row, col] = direct[row, col] + single[row, col] + multiple[row, col]
    off = base_difference(film, sums, row, col)
    base_variance[row, col] += wp.vec3(wp.cw_mul(off, off))
    before = stderr[row, col]
    variance_here = with_tiles_around(variance, row / TILE, col / TILE) / n
    if n < wp.float64(1.0):  # whether a pixel has a sample is chance, too
        variance_here += (wp.float64(1.0) / n - wp.float64(1.0)) * squares[row / TILE, col / TILE]
    for c in range(3):
        stderr[row, col][c] = wp.sqrt(before[c] * before[c] + float(variance_here[c]))
