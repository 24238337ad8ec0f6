"""Light scattered once along a camera's rays: from a table wherever that is right, else by quadrature.

Lamps and camera stay with the vehicle, so what open water scatters into a ray once, up to any distance, is known
beforehand, as the veil is (kernels/field/open_water.py). But it is less smooth: cones have edges, and lamps may be
in view. So cells of the table whose nodes bend too much are not used.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.field.open_water import single_scattering
from varos_warp.kernels.world.camera import Camera, Ray, node_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import Light
from varos_warp.kernels.world.medium import Medium, transmittance

wp.set_module_options({"enable_backward": False})

TOLERANCE = wp.constant(1.0e-3)
"""Cells are used where interpolation is off by less than this, as a share of the radiance."""


@wp.struct
class SingleTable:
    """Radiance along the rays of one camera, as of a pinhole; owned by the host's render/field/open_water.py."""

    radiance: wp.array3d(dtype=wp.vec3)
    """Up to each distance [distance, row, column]; empty where there is no table."""
    smooth: wp.array3d(dtype=wp.uint8)
    """1 for cells between the nodes that may be interpolated, else 0."""
    scale: float
    """The distance t [m] of nodes is even in t / (t + scale), from nothing to no end."""


@wp.func
def node_t(table: SingleTable, k: int):
    """Distance [m] of a node; of the last, FAR."""
    share = float(k) / float(table.radiance.shape[0] - 1)
    return wp.min(table.scale * share / wp.max(1.0 - share, 1.0e-9), FAR)


@wp.func(inline=False)
def scattered_by_lamps(medium: Medium, lights: wp.array(dtype=Light), o: wp.vec3, d: wp.vec3, t: float):
    """Radiance that all lamps' light adds to a ray up to ``t`` by scattering once, by quadrature."""
    L = wp.vec3(0.0)
    for i in range(lights.shape[0]):
        L += single_scattering(medium, lights[i], o, d, t)
    return L


@wp.func
def scattered_once(scene: SceneData, table: SingleTable, o: wp.vec3, d: wp.vec3, x: float, y: float, t: float):
    """As scattered_by_lamps, of a camera's ray through a place (x, y) in [0, 1]^2."""
    if table.radiance.shape[0] == 0:
        return scattered_by_lamps(scene.medium, scene.lights, o, d, t)
    w = wp.min(t / (t + table.scale), 1.0) * (float(table.radiance.shape[0] - 1) - 1.0e-3)
    v = wp.clamp(y, 0.0, 1.0) * (float(table.radiance.shape[1] - 1) - 1.0e-3)
    u = wp.clamp(x, 0.0, 1.0) * (float(table.radiance.shape[2] - 1) - 1.0e-3)
    i = int(w)
    j = int(v)
    k = int(u)
    if table.smooth[i, j, k] == wp.uint8(0):
        return scattered_by_lamps(scene.medium, scene.lights, o, d, t)
    L = wp.vec3(0.0)
    for corner in range(4):
        di = corner >> 1
        dj = corner & 1
        weight = wp.where(di == 1, w - float(i), 1.0 - w + float(i))
        weight *= wp.where(dj == 1, v - float(j), 1.0 - v + float(j))
        L += weight * wp.lerp(table.radiance[i + di, j + dj, k], table.radiance[i + di, j + dj, k + 1], u - float(k))
    return L


# ------------------------------------------------------------------------------------------------------- making it


@wp.kernel(enable_backward=False)
def fill_single(
    scene: SceneData,
    camera: Camera,
    size: wp.vec2,
    first_row: int,
    # out
    table: SingleTable,
):
    """The radiance of the nodes, from one to the next along a ray."""
    tile_row, col = wp.tid()
    row = first_row + tile_row
    ray = node_ray(camera, size, float(row), float(col), table.radiance.shape[1], table.radiance.shape[2])
    L = wp.vec3(0.0)
    start = float(0.0)
    for k in range(table.radiance.shape[0]):
        end = node_t(table, k)
        piece = scattered_by_lamps(scene.medium, scene.lights, ray.o + start * ray.d, ray.d, end - start)
        L += wp.cw_mul(transmittance(scene.medium, start), piece)
        table.radiance[k, row, col] = L
        start = end


@wp.func
def bend(before: wp.vec3, here: wp.vec3, after: wp.vec3):
    """How far three nodes are from a line, twice."""
    return wp.abs(before - 2.0 * here + after)


@wp.func
def hides_beam(light: Light, ray: Ray, spread: float):
    """Whether a lamp's cone ahead may be so narrow where it crosses a ray that rays at an angle ``spread`` miss it.

    The ray meets the cone no nearer to the lamp than it passes it.
    """
    to_light = light.position - ray.o
    foot = wp.dot(to_light, ray.d)
    passes_at = wp.length(to_light - foot * ray.d)
    tan_half = wp.where(light.cos_half < 0.7, 1.0, wp.sqrt(1.0 - light.cos_half * light.cos_half) / light.cos_half)
    return foot > 0.0 and passes_at * tan_half < 2.0 * spread * foot


@wp.func
def bends_by(values: wp.array3d(dtype=wp.vec3), a: int, b: int, c: int):
    """How far interpolation around a node may be off, as a share of its radiance.

    Between nodes of a smooth curve an eighth of the second difference is the error; at a kink up to a half. A quarter,
    summed over the three directions, is taken: smooth light has room to spare, and kinks are far beyond.
    """
    # at the rim the nearest place with neighbours on both sides
    i = wp.clamp(a, 1, values.shape[0] - 2)
    j = wp.clamp(b, 1, values.shape[1] - 2)
    m = wp.clamp(c, 1, values.shape[2] - 2)
    off = bend(values[i - 1, b, c], values[i, b, c], values[i + 1, b, c])
    off += bend(values[a, j - 1, c], values[a, j, c], values[a, j + 1, c])
    off += bend(values[a, b, m - 1], values[a, b, m], values[a, b, m + 1])
    worst = float(0.0)
    for channel in range(3):
        if off[channel] > 0.0:
            worst = wp.max(worst, 0.25 * off[channel] / wp.max(values[a, b, c][channel], 1.0e-30))
    return worst


@wp.kernel(enable_backward=False)
def find_smooth(
    scene: SceneData,
    camera: Camera,
    size: wp.vec2,
    first_row: int,
    # out
    table: SingleTable,
):
    """Judge the cells along a ray by their corners; and by the lamps, for nodes do not tell of a beam between them."""
    tile_row, col = wp.tid()
    row = first_row + tile_row
    rows, cols = table.radiance.shape[1], table.radiance.shape[2]
    near = node_ray(camera, size, float(row), float(col), rows, cols)
    far = node_ray(camera, size, float(row) + 1.0, float(col) + 1.0, rows, cols)
    middle = node_ray(camera, size, float(row) + 0.5, float(col) + 0.5, rows, cols)
    hidden = float(0.0)
    for i in range(scene.lights.shape[0]):
        if hides_beam(scene.lights[i], middle, wp.length(far.d - near.d)):
            hidden = wp.inf
    for k in range(table.smooth.shape[0]):
        worst = hidden
        for corner in range(8):
            off = bends_by(table.radiance, k + (corner >> 2), row + ((corner >> 1) & 1), col + (corner & 1))
            worst = wp.max(worst, off)
        table.smooth[k, row, col] = wp.uint8(wp.where(worst <= TOLERANCE, 1, 0))
