"""Sums of radiance samples in float64, and what they say of mean and standard error.

In float32 a running mean stalls: after 100 000 samples it is off by a hundred standard errors, and does not show it.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TILE = wp.constant(8)
"""Width of a tile [pixels]: its pixels get equally many samples, or those of each of its two sides do."""
TELLING_SAMPLES = wp.constant(4)
"""So many samples tell a variance well enough."""


@wp.struct
class Film:
    """Sums over the samples of one image, in ``strata`` parts that are added up in a fixed order.

    Pixels belong to one side, or to two that alternate like the fields of a chessboard and may take different numbers
    of samples (render/adapt.py). All arrays are [strata, height, width] but for those of samples.
    """

    wanted: wp.array3d(dtype=int)
    """Samples that pixels are to take next [side, tile row, tile column]."""
    rows: wp.array(dtype=int)
    """Rows of tiles in the order in which they are rendered: those with the most samples a pixel first, or a GPU would
    wait for a few threads in the end."""
    count: wp.array3d(dtype=int)
    """Samples of a pixel [side, tile row, tile column], once those of the launch to come are in."""
    begin: wp.array4d(dtype=int)
    end: wp.array4d(dtype=int)
    """First sample of the next launch, and one past its last [stratum, side, tile row, tile column]."""

    direct: wp.array3d(dtype=wp.vec3d)
    single: wp.array3d(dtype=wp.vec3d)
    glow: wp.array3d(dtype=wp.vec3d)
    veil: wp.array3d(dtype=wp.vec3d)
    """Radiance of each layer [W/sr/m^2]. The rest is ``glow``, off the surface at the end of the camera's ray, and
    ``veil``, scattered on its way from there or before; both are the public layer ``multiple``."""
    squares: wp.array3d(dtype=wp.vec3d)
    """Squares of the total radiance."""
    residual: wp.array2d(dtype=wp.vec3d)
    residual_squares: wp.array2d(dtype=wp.vec3d)
    residual_count: wp.array2d(dtype=int)
    """What is added to ``glow`` with samples of its own (see kernels/glow.py), its squares, and the number of those
    samples, [height, width]; empty without them."""
    metal: wp.array2d(dtype=int)
    """1 where a sample of the pixel met metal, else 0, [height, width]; empty without the residual."""
    lost: wp.array(dtype=int)
    """One number: how many samples were infinite or not a number. They count as black, and the renderer says so."""


@wp.struct
class Sums:
    """The film's entries of one pixel while a thread adds samples to them."""

    direct: wp.vec3d
    single: wp.vec3d
    glow: wp.vec3d
    veil: wp.vec3d
    squares: wp.vec3d
    lost: int


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
def first_sample(stratum: int, strata: int, spp: int):
    """Number of the first of a stratum's samples; 64 bits, for their product may be large."""
    return int(wp.int64(stratum) * wp.int64(spp) / wp.int64(strata))


@wp.func
def side_of(sides: int, row: int, col: int):
    """The side that a pixel belongs to."""
    return (row + col) % sides


@wp.func
def row_of(film: Film, i: int):
    """The row of pixels that is rendered as the ``i``-th; may lie beyond the image, in its last row of tiles."""
    return film.rows[i / TILE] * TILE + i % TILE


@wp.func
def of_tile(numbers: wp.array3d(dtype=int), row: int, col: int):
    """A pixel's entry of ``numbers`` [side, tile row, tile column]."""
    return numbers[side_of(numbers.shape[0], row, col), row / TILE, col / TILE]


@wp.func
def weight_of(film: Film, metal_samples: int, row: int, col: int):
    """Samples of the residual that a pixel takes for one of its tile."""
    return wp.where(film.metal[row, col] == 1, metal_samples, 1)


@wp.func
def first_of(film: Film, stratum: int, row: int, col: int):
    """The first sample of a pixel in the launch."""
    return of_tile(film.begin[stratum], row, col)


@wp.func
def end_of(film: Film, stratum: int, row: int, col: int):
    """One past the last sample of a pixel in the launch."""
    return of_tile(film.end[stratum], row, col)


@wp.func
def store(film: Film, stratum: int, row: int, col: int, sums: Sums):
    """Add the sums of one pixel to what the film has."""
    film.direct[stratum, row, col] += sums.direct
    film.single[stratum, row, col] += sums.single
    film.glow[stratum, row, col] += sums.glow
    film.veil[stratum, row, col] += sums.veil
    film.squares[stratum, row, col] += sums.squares
    if sums.lost > 0:
        wp.atomic_add(film.lost, 0, sums.lost)


@wp.func
def variance_of_mean(squares: wp.float64, total: wp.float64, count: int):
    """Variance of the mean of ``count`` samples with a given sum and sum of squares; infinite for one."""
    if count < 2:
        return wp.float64(wp.inf)
    n = wp.float64(count)
    return wp.max((squares - total * total / n) / (n - wp.float64(1.0)), wp.float64(0.0)) / n


@wp.kernel(enable_backward=False)
def share_samples(strata: int, film: Film):
    """Share the samples that are wanted among the first ``strata``."""
    side, tile_row, tile_col = wp.tid()
    more = film.wanted[side, tile_row, tile_col]
    taken = film.count[side, tile_row, tile_col]
    for k in range(strata):
        film.begin[k, side, tile_row, tile_col] = taken + first_sample(k, strata, more)
        film.end[k, side, tile_row, tile_col] = taken + first_sample(k + 1, strata, more)
    film.count[side, tile_row, tile_col] = taken + more


@wp.func
def sums_of(film: Film, row: int, col: int):
    """Sums of one pixel over the strata."""
    sums = Sums()
    for k in range(film.squares.shape[0]):
        sums.direct += film.direct[k, row, col]
        sums.single += film.single[k, row, col]
        sums.glow += film.glow[k, row, col]
        sums.veil += film.veil[k, row, col]
        sums.squares += film.squares[k, row, col]
    return sums


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
