"""Bodies laid over the image of the water, where it lies."""

import warp as wp

# a product and a sum, each rounded, as the host has them (products/images/snow.py)
wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel(enable_backward=False)
def lay_over(
    image: wp.array2d(dtype=wp.vec3),
    passed: wp.array2d(dtype=float),
    added: wp.array2d(dtype=wp.vec3),
    # out
    shown: wp.array2d(dtype=wp.vec3),
):
    """An image with bodies: what they let pass of it, and what they add."""
    row, col = wp.tid()
    shown[row, col] = image[row, col] * passed[row, col] + added[row, col]
