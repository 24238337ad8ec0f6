"""Sums of radiance samples in float64, and what they say of mean and standard error.

In float32 a running mean stalls: after 100 000 samples it is off by a hundred standard errors, and does not show it.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TILE = wp.constant(8)
"""Width of a tile [pixels]: its pixels get equally many samples, or those of each of its two sides do."""
TELLING_SAMPLES = wp.constant(4)
"""So many samples tell a variance well enough."""


SUMS = 5
"""Sums of a pixel: those of `Sums`, but for ``lost``."""


@wp.struct
class Sums:
    """Sums over samples of one pixel."""

    direct: wp.vec3d
    single: wp.vec3d
    glow: wp.vec3d
    veil: wp.vec3d
    """Radiance of each layer [W/sr/m^2]. The rest is ``glow``, off the surface at the end of the camera's ray, and
    ``veil``, scattered on its way from there or before; both are the public layer ``multiple``."""
    squares: wp.vec3d
    """Squares of the total radiance."""
    lost: int
    """How many samples were infinite or not a number."""


@wp.struct
class PixelPart:
    """Samples ``begin`` to ``end`` of a pixel, which one thread takes."""

    row: int
    col: int
    begin: int
    end: int


@wp.struct
class Film:
    """Sums over the samples of one image.

    Pixels belong to one side, or to two that alternate like the fields of a chessboard and may take different numbers
    of samples (render/adapt.py). They are taken in parts, of no more than a few samples each, or a GPU would wait for
    the threads of noisy pixels in the end; the sums of parts are added up in a fixed order.
    """

    wanted: wp.array3d(dtype=int)
    """Samples that pixels are to take next [side, tile row, tile column]."""
    count: wp.array3d(dtype=int)
    """Samples that they have, alike."""
    parts: wp.array(dtype=PixelPart)
    part_sums: wp.array2d(dtype=wp.vec3d)
    """What threads take, and their sums [SUMS, parts]."""
    sums: wp.array3d(dtype=wp.vec3d)
    """Those of all samples [SUMS, height, width]."""
    residual: wp.array2d(dtype=wp.vec3d)
    residual_squares: wp.array2d(dtype=wp.vec3d)
    residual_count: wp.array2d(dtype=int)
    """What is added to ``glow`` with samples of its own (see kernels/glow.py), its squares, and the number of those
    samples, [height, width]; empty without them."""
    metal: wp.array2d(dtype=int)
    """1 where a sample of the pixel met metal, else 0, [height, width]; empty without the residual."""
    lost: wp.array(dtype=int)
    """One number: how many samples were infinite or not a number. They count as black, and the renderer says so."""


@wp.func
def is_finite(L: wp.vec3):
    """Whether all channels are numbers."""
    return wp.isfinite(L[0]) and wp.isfinite(L[1]) and wp.isfinite(L[2])


@wp.func
def add_sample(sums: Sums, direct: wp.vec3, single: wp.vec3, glow: wp.vec3, veil: wp.vec3):
    """Sums with the radiance of one more sample, layer by layer."""
    after = sums
    if not is_finite(direct + single + glow + veil):
        after.lost += 1
        return after
    d = wp.vec3d(direct)
    s = wp.vec3d(single)
    g = wp.vec3d(glow)
    v = wp.vec3d(veil)
    total = d + s + g + v
    after.direct += d
    after.single += s
    after.glow += g
    after.veil += v
    after.squares += wp.cw_mul(total, total)
    return after


@wp.func
def first_sample(part: int, parts: int, spp: int):
    """Number of the first of a part's samples; 64 bits, for their product may be large."""
    return int(wp.int64(part) * wp.int64(spp) / wp.int64(parts))


@wp.func
def side_of(sides: int, row: int, col: int):
    """The side that a pixel belongs to."""
    return (row + col) % sides


@wp.func
def of_tile(numbers: wp.array3d(dtype=int), row: int, col: int):
    """A pixel's entry of ``numbers`` [side, tile row, tile column]."""
    return numbers[side_of(numbers.shape[0], row, col), row / TILE, col / TILE]


@wp.func
def weight_of(film: Film, metal_samples: int, row: int, col: int):
    """Samples of the residual that a pixel takes for one of its tile."""
    return wp.where(film.metal[row, col] == 1, metal_samples, 1)


@wp.func
def variance_of_mean(squares: wp.float64, total: wp.float64, count: int):
    """Variance of the mean of ``count`` samples with a given sum and sum of squares; infinite for one."""
    if count < 2:
        return wp.float64(wp.inf)
    n = wp.float64(count)
    return wp.max((squares - total * total / n) / (n - wp.float64(1.0)), wp.float64(0.0)) / n


@wp.func
def tile_pixel(tile_cols: int, i: int):
    """Row and column of the ``i``-th pixel, tile by tile: threads side by side then trace rays side by side."""
    tile = i / (TILE * TILE)
    within = i % (TILE * TILE)
    return tile / tile_cols * TILE + within / TILE, tile % tile_cols * TILE + within % TILE


@wp.kernel(enable_backward=False)
def count_parts(
    film: Film,
    most: int,  # samples of a part
    # out
    counts: wp.array(dtype=int),  # per pixel, tile by tile
):
    """How many parts the samples that are wanted of each pixel make."""
    i = wp.tid()
    row, col = tile_pixel(film.count.shape[2], i)
    counts[i] = 0
    if row < film.sums.shape[1] and col < film.sums.shape[2]:
        counts[i] = (of_tile(film.wanted, row, col) + most - 1) / most


@wp.func
def start_of(ends: wp.array(dtype=int), i: int):
    """Where the entries of the ``i``-th start in a list of those of all, by the running sum of their numbers."""
    if i == 0:
        return 0
    return ends[i - 1]


@wp.kernel(enable_backward=False)
def list_parts(
    ends: wp.array(dtype=int),  # running sum of the parts over the pixels, tile by tile
    first: int,
    begin: int,
    # out
    film: Film,  # the parts from ``begin`` on, as many as there is room for
):
    """Write down the parts of each pixel, evenly many samples in each."""
    i = first + wp.tid()
    row, col = tile_pixel(film.count.shape[2], i)
    start = start_of(ends, i)
    for k in range(wp.max(start, begin), wp.min(ends[i], begin + film.parts.shape[0])):
        part = PixelPart()
        part.row = row
        part.col = col
        wanted = of_tile(film.wanted, row, col)
        taken = of_tile(film.count, row, col)
        part.begin = taken + first_sample(k - start, ends[i] - start, wanted)
        part.end = taken + first_sample(k - start + 1, ends[i] - start, wanted)
        film.parts[k - begin] = part


@wp.func
def store(film: Film, part: int, sums: Sums):
    """Keep the sums of a part."""
    film.part_sums[0, part] = sums.direct
    film.part_sums[1, part] = sums.single
    film.part_sums[2, part] = sums.glow
    film.part_sums[3, part] = sums.veil
    film.part_sums[4, part] = sums.squares
    if sums.lost > 0:
        wp.atomic_add(film.lost, 0, sums.lost)


@wp.func
def sums_of(film: Film, row: int, col: int):
    """Sums over all samples of a pixel."""
    sums = Sums()
    sums.direct = film.sums[0, row, col]
    sums.single = film.sums[1, row, col]
    sums.glow = film.sums[2, row, col]
    sums.veil = film.sums[3, row, col]
    sums.squares = film.sums[4, row, col]
    return sums


@wp.kernel(enable_backward=False)
def add_parts(
    ends: wp.array(dtype=int),
    first: int,
    begin: int,
    # out
    film: Film,
):
    """Add the sums of the parts from ``begin`` on to those of their pixels."""
    tile_sum, i = wp.tid()
    which = first + tile_sum
    row, col = tile_pixel(film.count.shape[2], i)
    start = wp.max(start_of(ends, i), begin)
    end = wp.min(ends[i], begin + film.parts.shape[0])
    if start < end:
        total = film.sums[which, row, col]
        for k in range(start, end):
            total += film.part_sums[which, k - begin]
        film.sums[which, row, col] = total


@wp.kernel(enable_backward=False)
def note_samples(film: Film):
    """Count the samples that were wanted as taken."""
    side, tile_row, tile_col = wp.tid()
    film.count[side, tile_row, tile_col] += film.wanted[side, tile_row, tile_col]


@wp.kernel(enable_backward=False)
def develop(
    film: Film,
    # out
    direct: wp.array2d(dtype=wp.vec3),
    single: wp.array2d(dtype=wp.vec3),
    multiple: wp.array2d(dtype=wp.vec3),
    residual: wp.array2d(dtype=wp.vec3),
    metal_variance: wp.array2d(dtype=wp.vec3),
    radiance: wp.array2d(dtype=wp.vec3),
    stderr: wp.array2d(dtype=wp.vec3),
):
    """Mean of each layer (``residual`` is part of multiple), their sum and its standard error, all [height, width].

    ``metal_variance`` is that of the residual where there is metal and enough samples to tell, and else negative.
    """
    row, col = wp.tid()
    sums = sums_of(film, row, col)
    count = of_tile(film.count, row, col)
    n = wp.float64(wp.max(count, 1))
    added = wp.vec3d(wp.float64(0.0))
    added_squares = wp.vec3d(wp.float64(0.0))
    extra = int(0)
    if film.residual.shape[0] > 0:
        added = film.residual[row, col]
        added_squares = film.residual_squares[row, col]
        extra = film.residual_count[row, col]
    m = wp.float64(wp.max(extra, 1))
    direct[row, col] = wp.vec3(sums.direct / n)
    single[row, col] = wp.vec3(sums.single / n)
    multiple[row, col] = wp.vec3((sums.glow + sums.veil) / n + added / m)
    residual[row, col] = wp.vec3(added / m)
    # the sum of the layers as written, so that they add up to it to the last bit
    radiance[row, col] = direct[row, col] + single[row, col] + multiple[row, col]
    total = sums.direct + sums.single + sums.glow + sums.veil
    sharp = wp.vec3(-1.0)
    if extra >= TELLING_SAMPLES:
        if film.metal[row, col] == 1:
            for c in range(3):
                sharp[c] = float(variance_of_mean(added_squares[c], added[c], extra))
    metal_variance[row, col] = sharp
    error = wp.vec3(0.0)
    for c in range(3):
        variance = variance_of_mean(sums.squares[c], total[c], count)
        if extra == 1:  # its second moment is all that is known, and no less than the variance
            variance += added_squares[c]
        elif extra > 1:
            variance += variance_of_mean(added_squares[c], added[c], extra)
        error[c] = float(wp.sqrt(variance))
    stderr[row, col] = error
