"""Adding the images of the passes of a spectrum, each with the weights of its bands in a camera's channels."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def weighted(weights: wp.mat33d, values: wp.vec3d):
    """Product of a matrix and a vector; a channel without weight adds nothing, though it is infinite."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(3):
        for j in range(3):
            if weights[i, j] != wp.float64(0.0):
                total[i] += weights[i, j] * values[j]
    return total


@wp.kernel(enable_backward=False)
def add_weighted(
    image: wp.array2d(dtype=wp.vec3),
    weights: wp.mat33d,
    # out
    total: wp.array2d(dtype=wp.vec3),
):
    """Add an image whose channels have weights in those of a sum."""
    row, col = wp.tid()
    total[row, col] = wp.vec3(wp.vec3d(total[row, col]) + weighted(weights, wp.vec3d(image[row, col])))


@wp.kernel(enable_backward=False)
def add_weighted_variance(
    image: wp.array2d(dtype=wp.vec3),
    weights: wp.mat33d,
    # out
    total: wp.array2d(dtype=wp.vec3),
):
    """Add the variance of one more image to that of a sum, if it errs as all before."""
    row, col = wp.tid()
    before, own = wp.vec3d(total[row, col]), wp.vec3d(image[row, col])
    for c in range(3):
        before[c] = wp.sqrt(before[c])
        own[c] = wp.sqrt(own[c])
    deviation = before + weighted(weights, own)
    total[row, col] = wp.vec3(wp.cw_mul(deviation, deviation))


@wp.kernel(enable_backward=False)
def add_layers(
    direct: wp.array2d(dtype=wp.vec3),
    single: wp.array2d(dtype=wp.vec3),
    multiple: wp.array2d(dtype=wp.vec3),
    # out
    radiance: wp.array2d(dtype=wp.vec3),
):
    """Sum of the layers as stored, so that they add up to it exactly."""
    row, col = wp.tid()
    radiance[row, col] = direct[row, col] + single[row, col] + multiple[row, col]
