"""Conjugate gradients for diffusion on a mesh, a thread for each tile of vertices.

They solve (diagonal - neighbours) q = mass values, with the diagonal as preconditioner. A thread goes through its
vertices in their order and adds in double precision, so that sums do not depend on how many threads there are, and all
that a step changes is read and written once.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

SMALLEST = wp.constant(wp.float64(1e-300))
"""Least divisor."""


@wp.struct
class Search:
    """A mesh of N vertices in T tiles, and a search on it."""

    rows: wp.array(dtype=wp.int32)
    """[T + 1]: where tiles begin, and the last one ends."""
    starts: wp.array(dtype=wp.int32)
    """[N + 1]: where the neighbours of a vertex begin in ``joined``, and those of the last one end."""
    joined: wp.array(dtype=wp.int32)
    mass: wp.array(dtype=wp.float32)
    diagonal: wp.array(dtype=wp.float32)
    values: wp.array(dtype=wp.vec3)
    q: wp.array(dtype=wp.vec3)
    residual: wp.array(dtype=wp.vec3)
    direction: wp.array(dtype=wp.vec3)
    image: wp.array(dtype=wp.vec3)
    """The matrix times the direction."""


@wp.func
def image_at(search: Search, q: wp.array(dtype=wp.vec3), i: int):
    """Row of a vertex of the matrix times q."""
    near = wp.vec3(0.0)
    for k in range(search.starts[i], search.starts[i + 1]):
        near += q[search.joined[k]]
    return search.diagonal[i] * q[i] - near


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
def begun(search: Search, q: wp.array(dtype=wp.vec3), first: int, last: int):
    """Write residuals of a guess and the first direction of some vertices; returns the power of the residuals."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(first, last):
        left = search.mass[i] * search.values[i] - image_at(search, q, i)
        search.residual[i] = left
        search.direction[i] = left / search.diagonal[i]
        total += products(left, left / search.diagonal[i])
    return total


@wp.func
def projected(search: Search, first: int, last: int):
    """Write the matrix times the direction for some vertices; returns what that has along the direction."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(first, last):
        there = image_at(search, search.direction, i)
        search.image[i] = there
        total += products(search.direction[i], there)
    return total


@wp.func
def stepped(search: Search, by: wp.vec3, first: int, last: int):
    """Go so far along the direction at some vertices, for each column; returns the power of what residuals are left."""
    total = wp.vec3d(wp.float64(0.0))
    for i in range(first, last):
        search.q[i] = search.q[i] + wp.cw_mul(search.direction[i], by)
        left = search.residual[i] - wp.cw_mul(search.image[i], by)
        search.residual[i] = left
        total += products(left, left / search.diagonal[i])
    return total


@wp.func
def turned(search: Search, by: wp.vec3, first: int, last: int):
    """Take the next direction at some vertices, which has so much of the last one, for each column."""
    for i in range(first, last):
        search.direction[i] = search.residual[i] / search.diagonal[i] + wp.cw_mul(search.direction[i], by)


@wp.func
def is_within(power: wp.vec3d, goal: wp.vec3d):
    """Return whether no column has more power than its goal."""
    return power[0] <= goal[0] and power[1] <= goal[1] and power[2] <= goal[2]


@wp.kernel
def begin(first_row: int, search: Search, q: wp.array(dtype=wp.vec3), sums: wp.array(dtype=wp.vec3d)):
    """Residuals of a first guess, their power [T], and the first direction."""
    tile = first_row + wp.tid()
    sums[tile] = begun(search, q, search.rows[tile], search.rows[tile + 1])


@wp.kernel
def project(first_row: int, search: Search, sums: wp.array(dtype=wp.vec3d)):
    """The matrix times the direction, and what that has along it [T]."""
    tile = first_row + wp.tid()
    sums[tile] = projected(search, search.rows[tile], search.rows[tile + 1])


@wp.kernel
def step(first_row: int, search: Search, by: wp.vec3, sums: wp.array(dtype=wp.vec3d)):
    """Go so far along the direction; the power of what residuals are left [T]."""
    tile = first_row + wp.tid()
    sums[tile] = stepped(search, by, search.rows[tile], search.rows[tile + 1])


@wp.kernel
def turn(first_row: int, search: Search, by: wp.vec3):
    """The next direction, which has so much of the last one."""
    tile = first_row + wp.tid()
    turned(search, by, search.rows[tile], search.rows[tile + 1])


@wp.kernel
def solve(first_row: int, search: Search, iterations: int, tolerance: wp.float64):  # of the power
    """All steps for the one tile of a small mesh, where launches would take longer than they."""
    n = search.rows[first_row + wp.tid() + 1]
    goal = tolerance * begun(search, search.values, 0, n)
    power = begun(search, search.q, 0, n)
    for _iteration in range(iterations):
        if is_within(power, goal):
            return
        along = projected(search, 0, n)
        left = stepped(search, ratio(power, along), 0, n)
        turned(search, ratio(left, power), 0, n)
        power = left
