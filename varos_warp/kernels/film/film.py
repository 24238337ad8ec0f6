"""Sums of radiance samples in float64.

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

SUMS, CORRECTION_SUMS = wp.constant(6), wp.constant(2)
"""Sums per pixel: those of `Sums` except ``lost``; two of them if all light is the correction, in `multiple`."""


@wp.struct
class Sums:
    """Sums of radiance [W/sr/m^2] over samples of one pixel."""

    direct: wp.vec3d
    single: wp.vec3d
    multiple: wp.vec3d
    """Sums of the three layers, which make up all light."""
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
    """Return whether all channels are finite."""
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
    """Return whether the edge of the image cuts a pixel's block."""
    return (row ^ 1) >= film.sums.shape[1] or (col ^ 1) >= film.sums.shape[2]


@wp.func
def rank_in_block(film: Film, row: int, col: int):
    """Turn of a pixel among those of its block, 0 to 3; two turns in a row are across the corner."""
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
