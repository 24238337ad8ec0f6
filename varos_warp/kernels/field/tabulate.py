"""Kernels that compute the field of kernels/field/open_water.py, order by order of scattering.

Light that arrives at a node is stored by direction (gamma, phi), as explained there. Scattering between directions is a
matrix that all nodes share and the host applies (render/field/solver.py); the kernels here carry light from one
scattering to the next.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.field.open_water import (
    LightField,
    NodeGrid,
    node_angle,
    node_distance,
    scale_at,
    source_function,
)
from varos_warp.kernels.field.single_scattering import single_scattering
from varos_warp.kernels.numerics import make_gauss_legendre
from varos_warp.kernels.sampling import asinh
from varos_warp.kernels.world.camera import Camera, node_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import Light, get_light, light_centre, light_count
from varos_warp.kernels.world.medium import Medium, transmittance

wp.set_module_options({"enable_backward": False})

PANEL = wp.constant(3.0)
"""Longest stretch of a ray with eight nodes, in the logarithm of the distance from the light."""

legendre_node = make_gauss_legendre(8)


@wp.func
def node_point(grid: NodeGrid, row: int, col: int):
    """Position of a node; the light is at the origin and its axis along z."""
    theta = node_angle(grid, col)
    return node_distance(grid, row) * wp.vec3(wp.sin(theta), 0.0, wp.cos(theta))


@wp.func
def towards(grid: NodeGrid, row: int, col: int, direction: wp.vec2):
    """Unit vector of a direction (gamma, phi) at a node."""
    theta = node_angle(grid, col)
    to_light = wp.vec3(-wp.sin(theta), 0.0, -wp.cos(theta))
    across = wp.vec3(-wp.cos(theta), 0.0, wp.sin(theta))
    sideways = wp.vec3(0.0, 1.0, 0.0)
    gamma, phi = direction[0], direction[1]
    return wp.cos(gamma) * to_light + wp.sin(gamma) * (wp.cos(phi) * across + wp.sin(phi) * sideways)


@wp.kernel(enable_backward=False)
def tabulate_single_scattering(
    scene: SceneData,
    grid: NodeGrid,
    directions: wp.array(dtype=wp.vec2),
    first_row: int,
    # out
    radiance: wp.array3d(dtype=wp.vec3),  # [distance, angle, direction], divided by scale_at
):
    """Radiance of light scattered once that arrives at the nodes."""
    tile_row, col, i = wp.tid()
    row = first_row + tile_row
    d = towards(grid, row, col, directions[i])
    L = single_scattering(scene.medium, get_light(scene.lights, 0), node_point(grid, row, col), d, FAR)
    radiance[row, col, i] = wp.cw_div(L, scale_at(grid, node_distance(grid, row)))


@wp.func
def next_order(medium: Medium, field: LightField, light: Light, p: wp.vec3, d: wp.vec3):
    """Radiance that the source function of a field adds to an infinite ray.

    The source falls off roughly as the inverse distance from the light, so it is nearly constant in asinh(y/h). The ray
    is divided at the light's foot, where the light passes from ahead to behind.
    """
    to_light = light_centre(light) - p
    foot = wp.dot(to_light, d)
    h = wp.max(wp.length(to_light - foot * d), 1.0e-3 * wp.length(to_light))
    reach = node_distance(field.grid, field.grid.distances - 1)
    start = asinh(-foot / h)
    L = wp.vec3(0.0)
    for side in range(2):
        low = wp.where(side == 0, start, wp.max(start, 0.0))
        high = wp.where(side == 0, 0.0, asinh((reach - foot) / h))
        panels = int(wp.ceil(wp.max(high - low, 0.0) / PANEL))
        width = (high - low) / float(wp.max(panels, 1))
        for k in range(8 * panels):
            node = legendre_node(k & 7)
            x = low + width * (float(k >> 3) + node[0])
            t = wp.max(foot + 0.5 * h * (wp.exp(x) - wp.exp(-x)), 0.0)
            weight = node[1] * width * 0.5 * h * (wp.exp(x) + wp.exp(-x))
            L += weight * wp.cw_mul(transmittance(medium, t), source_function(field, light, p + t * d, d))
    return L


@wp.kernel(enable_backward=False)
def tabulate_next_order(
    scene: SceneData,
    field: LightField,
    grid: NodeGrid,
    directions: wp.array(dtype=wp.vec2),
    first_row: int,
    # out
    radiance: wp.array3d(dtype=wp.vec3),  # [distance, angle, direction], divided by scale_at
):
    """Radiance that arrives at the nodes of ``grid`` after light of the ``field`` has scattered once more."""
    tile_row, col, i = wp.tid()
    row = first_row + tile_row
    d = towards(grid, row, col, directions[i])
    L = next_order(scene.medium, field, get_light(scene.lights, 0), node_point(grid, row, col), d)
    radiance[row, col, i] = wp.cw_div(L, scale_at(grid, node_distance(grid, row)))


@wp.kernel(enable_backward=False)
def tabulate_in_scattering(
    scene: SceneData,
    lights: wp.array(dtype=LightField),
    camera: Camera,
    size: wp.vec2,
    nearest: float,
    log_step: float,
    first_row: int,
    # out
    in_scattering: wp.array3d(dtype=wp.vec3),  # [distance, row, col]
):
    """Radiance that multiple in-scattering adds to a camera's rays up to each distance."""
    tile_row, col = wp.tid()
    row = first_row + tile_row
    ray = node_ray(camera, size, float(row), float(col), in_scattering.shape[1], in_scattering.shape[2])
    L = wp.vec3(0.0)
    start = float(0.0)
    for k in range(in_scattering.shape[0]):
        end = nearest * wp.exp(float(k) * log_step)
        for i in range(8):
            node = legendre_node(i)
            t = wp.lerp(start, end, node[0])
            S = wp.vec3(0.0)
            for light in range(light_count(scene.lights)):
                S += source_function(lights[light], get_light(scene.lights, light), ray.o + t * ray.d, ray.d)
            L += node[1] * (end - start) * wp.cw_mul(transmittance(scene.medium, t), S)
        in_scattering[k, row, col] = L
        start = end
