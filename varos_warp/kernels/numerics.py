"""Numerical tools: interpolation between the nodes of tables, and Gauss-Legendre quadrature.

All tables of the package are read by the functions here, except images, whose texels are packed (world/tiling.py), and
the cumulative table of world/phase.py, which stores its slopes. Positions are counted in nodes, from 0 to their number
minus one.
"""

from functools import cache
from typing import Any

import numpy as np
import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func
def brightest(c: wp.vec3):
    """Largest channel."""
    return wp.max(c[0], wp.max(c[1], c[2]))


@wp.func
def linear(values: wp.array(dtype=Any), x: float):
    """Value at ``x`` between the nodes of a table."""
    i = wp.min(int(x), values.shape[0] - 2)
    return wp.lerp(values[i], values[i + 1], x - float(i))


@wp.func
def bilinear(values: wp.array2d(dtype=Any), x: float, y: float):
    """Value at (x, y) between the nodes of a table."""
    i = wp.min(int(x), values.shape[0] - 2)
    return wp.lerp(linear(values[i], y), linear(values[i + 1], y), x - float(i))


@wp.func
def node_weight(x: float, i: int, after: int):
    """Weight at ``x`` of node ``i``, or of the next one if ``after`` is 1."""
    return wp.where(after == 1, x - float(i), 1.0 - x + float(i))


@wp.func
def trilinear(values: wp.array3d(dtype=wp.vec3), x: float, y: float, z: float):
    """Value at (x, y, z) between the nodes of a table."""
    i = wp.min(int(x), values.shape[0] - 2)
    j = wp.min(int(y), values.shape[1] - 2)
    k = wp.min(int(z), values.shape[2] - 2)
    total = wp.vec3(0.0)
    for corner in range(8):
        di = corner >> 2
        dj = (corner >> 1) & 1
        dk = corner & 1
        weight = node_weight(x, i, di) * node_weight(y, j, dj) * node_weight(z, k, dk)
        total += weight * values[i + di, j + dj, k + dk]
    return total


@wp.func
def quadrilinear(values: wp.array4d(dtype=wp.vec3), x: float, y: float, z: float, w: float):
    """Value at (x, y, z, w) between the nodes of a table."""
    i = wp.min(int(x), values.shape[0] - 2)
    j = wp.min(int(y), values.shape[1] - 2)
    total = wp.vec3(0.0)
    for corner in range(4):
        di = corner >> 1
        dj = corner & 1
        weight = node_weight(x, i, di) * node_weight(y, j, dj)
        total += weight * bilinear(values[i + di, j + dj], z, w)
    return total


@cache
def make_gauss_legendre(count: int):
    """The function ``node(k)``: node ``k`` in [0, 1] and weight of the quadrature with ``count`` nodes, an even number.

    The nodes are constants in the code, because a GPU would wait for a table in memory. Not by `wp.static` of a loop's
    index: that is evaluated only when the code is made, and kernels on disk would then be found by some processes only.
    """
    half = wp.types.vector(count // 2, float)
    x, w = np.polynomial.legendre.leggauss(count)
    nodes, weights = (half(*(0.5 * values[: count // 2]).tolist()) for values in (1.0 + x, w))

    @wp.func
    def node(k: int):
        m = wp.min(k, wp.static(count - 1) - k)
        found = wp.vec2(0.0)
        for i in range(wp.static(count // 2)):
            if m == i:
                found = wp.vec2(nodes[i], weights[i])
        return wp.vec2(wp.where(k > m, 1.0 - found[0], found[0]), found[1])

    return node
