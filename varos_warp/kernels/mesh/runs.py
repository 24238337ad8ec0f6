"""Which way water comes down the edges of a mesh."""

import warp as wp

from varos_warp.kernels.world.pattern_noise import cell_hash, low_half

wp.set_module_options({"enable_backward": False})

AHEAD = wp.constant(0.3)
"""Cosine of how far an edge may lie off the steepest way."""
FLAT = wp.constant(0.12)
"""Sine of the slope below which water does not run."""


@wp.kernel
def find_uphill(
    first_row: int,
    seed: wp.uint32,
    points: wp.array(dtype=wp.vec3),
    normals: wp.array(dtype=wp.vec3),
    starts: wp.array(dtype=wp.int32),
    joined: wp.array(dtype=wp.int32),
    # out
    above: wp.array(dtype=wp.int32),
    way: wp.array(dtype=wp.float32),
):
    """The neighbour from which water comes to a vertex: of the two edges beside the steepest way up one by chance.

    The chance is such that on average water runs straight down, whatever the directions of the edges are.

    Args:
        first_row: Number of the first thread.
        seed: Random bits.
        points: Vertices [m], shape [N].
        normals: Unit normals there, shape [N].
        starts: Where the neighbours of a vertex begin in ``joined``, shape [N + 1].
        joined: Numbers of neighbours.
        above: The vertex above, or the vertex itself where none is, shape [N].
        way: How far it is, over the sine of the slope [m]; infinite where none is, shape [N].
    """
    v = first_row + wp.tid()
    n = normals[v]
    up = wp.vec3(0.0, 0.0, 1.0) - n[2] * n
    steep = wp.length(up)
    above[v] = v
    way[v] = wp.inf
    if steep < FLAT:
        return
    up /= steep
    side = wp.cross(n, up)
    left = int(-1)
    right = int(-1)
    left_slope = float(99.0)
    right_slope = float(99.0)
    left_off = float(0.0)
    right_off = float(0.0)
    for k in range(starts[v], starts[v + 1]):
        edge = points[joined[k]] - points[v]
        length = wp.length(edge)
        ahead = wp.dot(edge, up)
        if length > 0.0 and ahead > AHEAD * length:
            off = wp.dot(edge, side)
            slope = wp.abs(off) / ahead
            if off >= 0.0 and slope < left_slope:
                left = joined[k]
                left_slope = slope
                left_off = off
            if off < 0.0 and slope < right_slope:
                right = joined[k]
                right_slope = slope
                right_off = -off
    chosen = wp.max(left, right)
    if left >= 0 and right >= 0:
        chosen = right
        if low_half(cell_hash(seed, v, 0)) * (left_off + right_off) <= right_off:
            chosen = left
    if chosen >= 0:
        above[v] = chosen
        way[v] = wp.length(points[chosen] - points[v]) / steep
