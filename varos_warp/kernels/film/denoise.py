"""Kernels that prepare images for an external denoiser and finish what it returns."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def unit_scale(total: wp.vec3, pixels: int):
    """The power of two that scales an image with the sum ``total`` to a mean near 1; 0 for a black image."""
    mean = (total[0] + total[1] + total[2]) / (3.0 * float(pixels))
    if mean <= 0.0:
        return 0.0
    return wp.pow(2.0, -wp.round(wp.log2(mean)))


@wp.kernel(enable_backward=False)
def positive_part(
    image: wp.array2d(dtype=wp.vec3),
    sign: float,
    # out
    part: wp.array2d(dtype=wp.vec3),
):
    """The positive part of ``sign`` times an image."""
    row, col = wp.tid()
    part[row, col] = wp.max(sign * image[row, col], wp.vec3(0.0))


@wp.kernel(enable_backward=False)
def scale_to_unit(
    total: wp.array(dtype=wp.vec3),
    # in and out
    image: wp.array2d(dtype=wp.vec3),
):
    """Multiply an image by its `unit_scale`; ``total`` is its sum."""
    row, col = wp.tid()
    image[row, col] = unit_scale(total[0], image.shape[0] * image.shape[1]) * image[row, col]


LEAST_ALBEDO = wp.constant(1.0e-4)
"""Surfaces of less count as having this: nothing is divided by zero."""


@wp.func
def divisor(albedo: wp.vec3):
    """What an image is divided by, and multiplied again."""
    return wp.max(albedo, wp.vec3(LEAST_ALBEDO))


@wp.kernel(enable_backward=False)
def demodulate(
    image: wp.array2d(dtype=wp.vec3),
    albedo: wp.array2d(dtype=wp.vec3),
    # out
    light: wp.array2d(dtype=wp.vec3),
):
    """Divide an image by the albedo of what it shows: what is left is the light that falls on it."""
    row, col = wp.tid()
    light[row, col] = wp.cw_div(image[row, col], divisor(albedo[row, col]))


@wp.kernel(enable_backward=False)
def modulate(
    albedo: wp.array2d(dtype=wp.vec3),
    # in and out
    image: wp.array2d(dtype=wp.vec3),
):
    """Multiply by what `demodulate` divided by."""
    row, col = wp.tid()
    image[row, col] = wp.cw_mul(image[row, col], divisor(albedo[row, col]))


@wp.kernel(enable_backward=False)
def subtract(
    image: wp.array2d(dtype=wp.vec3),
    part: wp.array2d(dtype=wp.vec3),
    # out
    rest: wp.array2d(dtype=wp.vec3),
):
    """Subtract a part of an image from it."""
    row, col = wp.tid()
    rest[row, col] = image[row, col] - part[row, col]


@wp.kernel(enable_backward=False)
def add_scaled(
    part: wp.array2d(dtype=wp.vec3),
    total: wp.array(dtype=wp.vec3),
    sign: float,
    # in and out
    image: wp.array2d(dtype=wp.vec3),
):
    """Add ``sign`` times an image that `scale_to_unit` scaled, with its scale undone; nothing if it was black."""
    row, col = wp.tid()
    scale = unit_scale(total[0], image.shape[0] * image.shape[1])
    if scale > 0.0:
        image[row, col] += (sign / scale) * part[row, col]


@wp.func
def mean_around(image: wp.array2d(dtype=wp.vec3), side: int, row: int, col: int):
    """Mean over a square."""
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    reach = side / 2
    for i in range(wp.max(row - reach, 0), wp.min(row + reach + 1, image.shape[0])):
        for j in range(wp.max(col - reach, 0), wp.min(col + reach + 1, image.shape[1])):
            total += wp.vec3d(image[i, j])
            count += wp.float64(1.0)
    return total / count


@wp.func
def square_around(smooth: wp.array2d(dtype=wp.vec3), noisy: wp.array2d(dtype=wp.vec3), side: int, row: int, col: int):
    """Mean over a square of the squared difference of two images."""
    total = wp.vec3d(wp.float64(0.0))
    count = wp.float64(0.0)
    reach = side / 2
    for i in range(wp.max(row - reach, 0), wp.min(row + reach + 1, smooth.shape[0])):
        for j in range(wp.max(col - reach, 0), wp.min(col + reach + 1, smooth.shape[1])):
            difference = wp.vec3d(noisy[i, j] - smooth[i, j])
            total += wp.cw_mul(difference, difference)
            count += wp.float64(1.0)
    return total / count


@wp.kernel(enable_backward=False)
def add_mixed(
    first_row: int,
    smooth: wp.array2d(dtype=wp.vec3),
    noisy: wp.array2d(dtype=wp.vec3),
    variance: wp.array2d(dtype=wp.vec3),
    near: int,
    far: int,
    # in and out
    image: wp.array2d(dtype=wp.vec3),
):
    """Add a denoised image and the noisy one, mixed for the least error where the ``variance`` of the noise is known.

    The mean square of what is between the two is noise, which is known, and what the denoiser has taken away: B in all
    that noise does not explain. The share of the noisy image is B / (B + variance). So what a denoiser takes for noise
    and is not comes back, the more the better it is known (a shrinkage estimate, as of James and Stein 1961).

    Means are over squares with sides ``near`` and ``far`` [pixels]. The variance may be infinite.
    """
    row, col = wp.tid()
    row += first_row
    apart = square_around(smooth, noisy, near, row, col)
    noise = wp.max(mean_around(variance, near, row, col), mean_around(variance, far, row, col))
    mixed = smooth[row, col]
    for c in range(3):
        if apart[c] > noise[c]:
            share = wp.float64(1.0) - noise[c] / apart[c]
            mixed[c] += float(share) * (noisy[row, col][c] - smooth[row, col][c])
    image[row, col] += mixed


@wp.kernel(enable_backward=False)
def mix_guide(
    base: wp.array2d(dtype=wp.vec3),
    total: wp.array(dtype=wp.vec3),
    # in and out
    albedo: wp.array2d(dtype=wp.vec3),
):
    """Mix the albedo that guides a correction with what its base shows; ``total`` sums what is positive of the base."""
    row, col = wp.tid()
    mean = total[0] / float(base.shape[0] * base.shape[1])
    for c in range(3):
        light = wp.max(base[row, col][c], 0.0)
        shown = float(0.0)
        if light > 0.0:
            shown = light / (light + mean[c])
        albedo[row, col][c] = 0.5 * (albedo[row, col][c] + shown)


@wp.kernel(enable_backward=False)
def halve(
    image: wp.array2d(dtype=wp.vec3),
    # out
    small: wp.array2d(dtype=wp.vec3),
):
    """Means over blocks of 2 x 2 pixels, of which the last ones may be cut by the edge."""
    row, col = wp.tid()
    total = wp.vec3(0.0)
    count = float(0.0)
    for i in range(2 * row, wp.min(2 * row + 2, image.shape[0])):
        for j in range(2 * col, wp.min(2 * col + 2, image.shape[1])):
            total += image[i, j]
            count += 1.0
    small[row, col] = total / count


@wp.func
def blocks_beside(i: int, size: int):
    """The block of pixel ``i`` and the other one that it is nearest to, of ``size`` blocks in a row."""
    return i / 2, wp.clamp(i / 2 + 2 * (i % 2) - 1, 0, size - 1)


@wp.kernel(enable_backward=False)
def add_enlarged(
    small: wp.array2d(dtype=wp.vec3),
    # in and out
    image: wp.array2d(dtype=wp.vec3),
):
    """Add an image that `halve` made, interpolated: a pixel is a quarter of a block off the centre of its own."""
    row, col = wp.tid()
    own_row, near_row = blocks_beside(row, small.shape[0])
    own_col, near_col = blocks_beside(col, small.shape[1])
    own = wp.lerp(small[own_row, own_col], small[own_row, near_col], 0.25)
    near = wp.lerp(small[near_row, own_col], small[near_row, near_col], 0.25)
    image[row, col] += wp.lerp(own, near, 0.25)


@wp.kernel(enable_backward=False)
def clip_negative(
    # in and out
    image: wp.array2d(dtype=wp.vec3),
):
    """Set negative values to zero."""
    row, col = wp.tid()
    image[row, col] = wp.max(image[row, col], wp.vec3(0.0))
