"""Conjugate gradients for diffusion on a mesh, a thread for each tile of vertices.

They solve (diagonal - neighbours) q = mass values, with the diagonal as preconditioner. ``starts`` [N + 1] tells where
the neighbours of a vertex begin in ``joined``, ``rows`` [T + 1] where tiles begin and the last one ends. A thread goes
through its vertices in their order and adds in double precision, so that sums do not depend on how many threads there
are, and all that a step changes is read and written once.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

SMALLEST = wp.constant(wp.float64(1e-300))
"""Least divisor."""


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


@wp.func
def ratio(a: wp.vec3d, b: wp.vec3d):
    """One over the other, for each column; the way to go, or the share of the last direction."""
    return wp.vec3(
        float(a[0] / wp.max(b[0], SMALLEST)), float(a[1] / wp.max(b[1], SMALLEST)), float(a[2] / wp.max(b[2], SMALLEST))
    )


@wp.func
def begun(
    first: int,
    last: int,
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    mass: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    values: wp.array(dtype=wp.vec3),
    q: wp.array(dtype=wp.vec3),
    residual: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
):
    """Write residuals of a guess and the first direction of some vertices; returns the power of the residuals."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(first, last):
        left = mass[i] * values[i] - image_at(starts, joined, diagonal, q, i)
        residual[i] = left
        direction[i] = left / diagonal[i]
        total += products(left, left / diagonal[i])
    return total


@wp.func
def projected(
    first: int,
    last: int,
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    diagonal: wp.array(dtype=wp.float32),
    direction: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
):
    """Write the matrix times the direction for some vertices; returns what that has along the direction."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(first, last):
        there = image_at(starts, joined, diagonal, direction, i)
        image[i] = there
        total += products(direction[i], there)
    return total


@wp.func
def stepped(
    first: int,
    last: int,
    diagonal: wp.array(dtype=wp.float32),
    by: wp.vec3,
    direction: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    q: wp.array(dtype=wp.vec3),
    residual: wp.array(dtype=wp.vec3),
):
    """Go so far along the direction at some vertices, for each column; returns the power of what residuals are left."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(first, last):
        q[i] = q[i] + wp.cw_mul(direction[i], by)
        left = residual[i] - wp.cw_mul(image[i], by)
        residual[i] = left
        total += products(left, left / diagonal[i])
    return total


@wp.func
def turn(
    first: int,
    last: int,
    diagonal: wp.array(dtype=wp.float32),
    by: wp.vec3,
    residual: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
):
    """Take the next direction at some vertices, which has so much of the last one, for each column."""
    for i in range(first, last):
        direction[i] = residual[i] / diagonal[i] + wp.cw_mul(direction[i], by)


@wp.func
def is_within(power: wp.vec3d, goal: wp.vec3d):
    """Return whether no column has more power than its goal."""
    return power[0] <= goal[0] and power[1] <= goal[1] and power[2] <= goal[2]


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
    power[tile] = begun(rows[tile], rows[tile + 1], starts, joined, mass, diagonal, values, q, residual, direction)


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
    along[tile] = projected(rows[tile], rows[tile + 1], starts, joined, diagonal, direction, image)


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
    power[tile] = stepped(rows[tile], rows[tile + 1], diagonal, by, direction, image, q, residual)


@wp.kernel
def turn_tiles(
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
    turn(rows[tile], rows[tile + 1], diagonal, by, residual, direction)


@wp.kernel
def solve(
    first_row: int,
    rows: wp.array(dtype=wp.int32),
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    mass: wp.array(dtype=wp.float32),
    diagonal: wp.array(dtype=wp.float32),
    iterations: int,
    tolerance: wp.float64,  # of the power
    values: wp.array(dtype=wp.vec3),
    # out
    q: wp.array(dtype=wp.vec3),
    residual: wp.array(dtype=wp.vec3),
    direction: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
):
    """All steps for the one tile of a small mesh, where launches would take longer than they."""
    n = rows[first_row + wp.tid() + 1]
    goal = tolerance * begun(0, n, starts, joined, mass, diagonal, values, values, residual, direction)
    power = begun(0, n, starts, joined, mass, diagonal, values, q, residual, direction)
    for _iteration in range(iterations):
        if is_within(power, goal):
            return
        along = projected(0, n, starts, joined, diagonal, direction, image)
        left = stepped(0, n, diagonal, ratio(power, along), direction, image, q, residual)
        turn(0, n, diagonal, ratio(left, power), residual, direction)
        power = left
