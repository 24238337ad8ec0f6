"""What is wrong with an image, by independent estimates of it: the sums behind render/planner/errors.py."""

import warp as wp


@wp.func
def in_double(value: wp.vec3):
    """A vector in double precision."""
    return wp.vec3d(wp.float64(value[0]), wp.float64(value[1]), wp.float64(value[2]))


@wp.kernel(enable_backward=False)
def compare_rows(
    image: wp.array2d(dtype=wp.vec3),
    around: wp.array2d(dtype=wp.vec3),  # means of what is around each pixel
    estimates: wp.array3d(dtype=wp.vec3),  # of the right image, [estimate, row, column]
    weights: wp.array(dtype=wp.float64),  # of the estimates; their sum is 1
    firefly: wp.float64,
    dark: wp.vec3d,
    first_row: int,
    # in and out, 0 at first
    squares: wp.array2d(dtype=wp.vec3d),  # [2, row]: sum of the squares of what is wrong, and of their squares
    sane: wp.array2d(dtype=wp.vec3d),  # [estimate, row]: its sum without fireflies
):
    """Add up over a row what is wrong with an image, by estimates that are cut to what is sane there.

    That is a ``firefly`` times the image there and around, and ``dark`` at least. The square of what is wrong is the
    mean of the products of two estimates' differences, over all pairs of estimates.
    """
    row = first_row + wp.tid()
    count = estimates.shape[0]
    pairs = wp.float64(1.0)  # weight of all pairs
    for k in range(count):
        pairs -= weights[k] * weights[k]
    for col in range(image.shape[1]):
        here = in_double(image[row, col])
        limit = firefly * wp.max(wp.max(here, in_double(around[row, col])), dark)
        total = wp.vec3d()
        own = wp.vec3d()
        for k in range(count):
            known = wp.min(wp.max(in_double(estimates[k, row, col]), -limit), limit)
            off = weights[k] * (here - known)
            total += off
            own += wp.cw_mul(off, off)
            sane[k, row] += known
        square = (wp.cw_mul(total, total) - own) / pairs
        squares[0, row] += square
        squares[1, row] += wp.cw_mul(square, square)
