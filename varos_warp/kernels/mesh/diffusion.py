"""Conjugate gradients for diffusion on a mesh, a thread for each tile of vertices.

They solve (diagonal - neighbours) q = mass values, with the diagonal as preconditioner. ``starts`` [N + 1] tells where
the neighbours of a vertex begin in ``joined``, ``rows`` [T + 1] where tiles begin and the last one ends. A thread goes
through its vertices in their order and adds in double precision, so that sums do not depend on how many threads there
are, and all that a step changes is read and written once.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def image_at(
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    diagonal: wp.array(dtype=wp.float32),
    q: wp.array(dtype=wp.vec3),
    i: int,
):
    """Row of a vertex of the matrix times q."""
    near = wp.vec3(0.0)
    for k in range(starts[i], starts[i + 1]):
        near += q[joined[k]]
    return diagonal[i] * q[i] - near


@wp.func
def products(a: wp.vec3, b: wp.vec3):
    """Products of the parts of two vectors, which are exact in double precision."""
    return wp.vec3d(
        wp.float64(a[0]) * wp.float64(b[0]), wp.float64(a[1]) * wp.float64(b[1]), wp.float64(a[2]) * wp.float64(b[2])
    )


@wp.kernel
def begin(
    first_row: int,
    rows: wp.array(dtype=wp.int32),
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    mass: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    values: wp.array(dtype=wp.vec3),
    q: wp.array(dtype=wp.vec3),
    # out
    residual: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    power: wp.array(dtype=wp.vec3d),  # of the residual, for each column; shape [T]
):
    """Residuals of a first guess, and the first direction."""
    tile = first_row + wp.tid()
    total = wp.vec3d(wp.float64(0.0))
    for i in range(rows[tile], rows[tile + 1]):
        left = mass[i] * values[i] - image_at(starts, joined, diagonal, q, i)
        residual[i] = left
        direction[i] = left / diagonal[i]
        total += products(left, left / diagonal[i])
    power[tile] = total


@wp.kernel
def project(
    first_row: int,
    rows: wp.array(dtype=wp.int32),
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    diagonal: wp.array(dtype=wp.float32),
    direction: wp.array(dtype=wp.vec3),
    # out
    image: wp.array(dtype=wp.vec3),
    along: wp.array(dtype=wp.vec3d),  # what the image has along the direction, for each column; shape [T]
):
    """The matrix times the direction."""
    tile = first_row + wp.tid()
    total = wp.vec3d(wp.float64(0.0))
    for i in range(rows[tile], rows[tile + 1]):
        there = image_at(starts, joined, diagonal, direction, i)
        image[i] = there
        total += products(direction[i], there)
    along[tile] = total


@wp.kernel
def step(
    first_row: int,
    rows: wp.array(dtype=wp.int32),
    diagonal: wp.array(dtype=wp.float32),
    by: wp.vec3,
    direction: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    # out
    q: wp.array(dtype=wp.vec3),
    residual: wp.array(dtype=wp.vec3),
    power: wp.array(dtype=wp.vec3d),
):
    """Go so far along the direction, for each column."""
    tile = first_row + wp.tid()
    total = wp.vec3d(wp.float64(0.0))
    for i in range(rows[tile], rows[tile + 1]):
        q[i] = q[i] + wp.cw_mul(direction[i], by)
        left = residual[i] - wp.cw_mul(image[i], by)
        residual[i] = left
        total += products(left, left / diagonal[i])
    power[tile] = total


@wp.kernel
def turn(
    first_row: int,
    rows: wp.array(dtype=wp.int32),
    diagonal: wp.array(dtype=wp.float32),
    by: wp.vec3,
    residual: wp.array(dtype=wp.vec3),
    # out
    direction: wp.array(dtype=wp.vec3),
):
    """The next direction, which has so much of the last one, for each column."""
    tile = first_row + wp.tid()
    for i in range(rows[tile], rows[tile + 1]):
        direction[i] = residual[i] / diagonal[i] + wp.cw_mul(direction[i], by)
