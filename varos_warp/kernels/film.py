"""Sums of radiance samples in float64, and what they say of mean and standard error.

In float32 a running mean stalls: after 100 000 samples it is off by a hundred standard errors, and does not show it.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TILE = wp.constant(8)
"""Side of a tile [pixels]: its pixels get equally many samples."""
SECOND_HALF = wp.constant(wp.uint32(0x9E3779B9))
"""Added to the key of random numbers for the second half of a film."""


@wp.struct
class Film:
    """Sums over the samples of one image, in ``strata`` parts that are added up in a fixed order.

    The strata belong to one or two halves of the film, in a row, which have independent samples and may have different
    numbers of them. All arrays are [strata, height, width] but for those of samples.
    """

    count: wp.array3d(dtype=int)
    """Samples that a half has [half, tile row, tile column], once those of the launch to come are in."""
    begin: wp.array3d(dtype=int)
    end: wp.array3d(dtype=int)
    """First sample of the next launch, and one past its last [stratum, tile row, tile column]."""

    direct: wp.array3d(dtype=wp.vec3d)
    single: wp.array3d(dtype=wp.vec3d)
    glow: wp.array3d(dtype=wp.vec3d)
    veil: wp.array3d(dtype=wp.vec3d)
    """Radiance of each layer [W/sr/m^2]. The rest is ``glow``, off the surface at the end of the camera's ray, and
    ``veil``, scattered on its way from there or before; both are the public layer ``multiple``."""
    squares: wp.array3d(dtype=wp.vec3d)
    """Squares of the total radiance."""
    residual: wp.array3d(dtype=wp.vec3d)
    residual_squares: wp.array3d(dtype=wp.vec3d)
    """What is added to ``glow`` with samples of its own (see kernels/glow.py), and its squares; empty without them."""
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
def half_of(film: Film, stratum: int):
    """The half of the film that a stratum belongs to."""
    return stratum / (film.squares.shape[0] / film.count.shape[0])


@wp.func
def half_key(film: Film, key: wp.uint32, stratum: int):
    """Key of a stratum's random numbers: halves are independent."""
    return key + wp.uint32(half_of(film, stratum)) * SECOND_HALF


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
def share_samples(samples: wp.array3d(dtype=int), film: Film):
    """Share ``samples`` more per pixel [half, tile row, tile column] among the strata of each half."""
    half, tile_row, tile_col = wp.tid()
    strata = film.begin.shape[0] / film.count.shape[0]
    more = samples[half, tile_row, tile_col]
    taken = film.count[half, tile_row, tile_col]
    for k in range(strata):
        film.begin[half * strata + k, tile_row, tile_col] = taken + first_sample(k, strata, more)
        film.end[half * strata + k, tile_row, tile_col] = taken + first_sample(k + 1, strata, more)
    film.count[half, tile_row, tile_col] = taken + more


@wp.func
def sums_of_half(film: Film, half: int, row: int, col: int):
    """Sums of one pixel over the strata of a half."""
    strata = film.squares.shape[0] / film.count.shape[0]
    sums = Sums()
    for k in range(half * strata, (half + 1) * strata):
        sums.direct += film.direct[k, row, col]
        sums.single += film.single[k, row, col]
        sums.glow += film.glow[k, row, col]
        sums.veil += film.veil[k, row, col]
        sums.squares += film.squares[k, row, col]
    return sums


@wp.kernel(enable_backward=False)
def develop(
    film: Film,
    spp_residual: int,
    # out
    direct: wp.array2d(dtype=wp.vec3),
    single: wp.array2d(dtype=wp.vec3),
    multiple: wp.array2d(dtype=wp.vec3),
    residual: wp.array2d(dtype=wp.vec3),
    radiance: wp.array2d(dtype=wp.vec3),
    stderr: wp.array2d(dtype=wp.vec3),
):
    """Mean of each layer (``residual`` is part of multiple), their sum and its standard error, all [height, width]."""
    row, col = wp.tid()
    # the halves weigh the same however many samples each has: their numbers follow from each other's samples, never
    # from their own (render/adapt.py), so the mean of each is unbiased
    mean = Sums()
    variance = wp.vec3d(wp.float64(0.0))
    halves = film.count.shape[0]
    for half in range(halves):
        sums = sums_of_half(film, half, row, col)
        count = film.count[half, row / TILE, col / TILE]
        n = wp.float64(count) * wp.float64(halves)
        mean.direct += sums.direct / n
        mean.single += sums.single / n
        mean.glow += (sums.glow + sums.veil) / n
        total = sums.direct + sums.single + sums.glow + sums.veil
        for c in range(3):
            variance[c] += variance_of_mean(sums.squares[c], total[c], count) / wp.float64(halves * halves)
    added = wp.vec3d(wp.float64(0.0))
    added_squares = wp.vec3d(wp.float64(0.0))
    for k in range(film.residual.shape[0]):
        added += film.residual[k, row, col]
        added_squares += film.residual_squares[k, row, col]
    m = wp.float64(wp.max(spp_residual, 1))
    direct[row, col] = wp.vec3(mean.direct)
    single[row, col] = wp.vec3(mean.single)
    multiple[row, col] = wp.vec3(mean.glow + added / m)
    residual[row, col] = wp.vec3(added / m)
    # the sum of the layers as written, so that they add up to it to the last bit
    radiance[row, col] = direct[row, col] + single[row, col] + multiple[row, col]
    error = wp.vec3(0.0)
    for c in range(3):
        if film.residual.shape[0] > 0:
            if spp_residual == 1:  # its second moment is all that is known, and no less than the variance
                variance[c] += added_squares[c]
            else:
                variance[c] += variance_of_mean(added_squares[c], added[c], spp_residual)
        error[c] = float(wp.sqrt(variance[c]))
    stderr[row, col] = error
