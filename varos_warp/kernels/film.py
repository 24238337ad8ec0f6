"""Running mean and variance of radiance samples (Welford 1962), and their merging (Chan et al. 1979)."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Film:
    """Sums of one image, in ``strata`` parts that are merged in a fixed order: arrays [strata, height, width]."""

    direct: wp.array3d(dtype=wp.vec3)
    single: wp.array3d(dtype=wp.vec3)
    multiple: wp.array3d(dtype=wp.vec3)
    """Mean radiance of each layer [W/sr/m^2]."""
    m2: wp.array3d(dtype=wp.vec3)
    """Sum of squared deviations of the total radiance from its mean."""


@wp.func
def deviation_product(value: wp.vec3, mean_before: wp.vec3, mean_after: wp.vec3):
    """What one more sample adds to the sum of squared deviations."""
    return wp.cw_mul(value - mean_before, value - mean_after)


@wp.kernel(enable_backward=False)
def merge_strata(
    film: Film,
    spp: int,
    # out
    direct: wp.array2d(dtype=wp.vec3),
    single: wp.array2d(dtype=wp.vec3),
    multiple: wp.array2d(dtype=wp.vec3),
    radiance: wp.array2d(dtype=wp.vec3),
    stderr: wp.array2d(dtype=wp.vec3),
):
    """Mean of each layer, their sum and the standard error of that sum, all [height, width]."""
    row, col = wp.tid()
    strata = film.m2.shape[0]
    mean_d = wp.vec3(0.0)
    mean_s = wp.vec3(0.0)
    mean_m = wp.vec3(0.0)
    mean = wp.vec3(0.0)
    m2 = wp.vec3(0.0)
    count = float(0.0)
    for k in range(strata):
        n = float((k + 1) * spp / strata - k * spp / strata)
        share = n / (count + n)
        part = film.direct[k, row, col] + film.single[k, row, col] + film.multiple[k, row, col]
        delta = part - mean
        m2 += film.m2[k, row, col] + (count * share) * wp.cw_mul(delta, delta)
        mean += share * delta
        mean_d += share * (film.direct[k, row, col] - mean_d)
        mean_s += share * (film.single[k, row, col] - mean_s)
        mean_m += share * (film.multiple[k, row, col] - mean_m)
        count += n
    direct[row, col] = mean_d
    single[row, col] = mean_s
    multiple[row, col] = mean_m
    radiance[row, col] = mean_d + mean_s + mean_m
    if spp > 1:
        variance = m2 / (count * (count - 1.0))
        stderr[row, col] = wp.vec3(wp.sqrt(variance[0]), wp.sqrt(variance[1]), wp.sqrt(variance[2]))
    else:
        stderr[row, col] = wp.vec3(wp.inf)
