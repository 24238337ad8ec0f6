"""Kernels that compute the field of kernels/field/open_water.py, order by order of scattering.

Light that arrives at a node is stored by direction (gamma, phi), as explained there. Scattering between directions is a
matrix that all nodes share and the host applies (render/field/solver.py); the kernels here carry light from one
scattering to the next.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.field.along_camera import AlongCamera, distance_along, radiance_along
from varos_warp.kernels.field.open_water import (
    LightField,
    NodeGrid,
    direction_place,
    gamma_phi,
    grid_place,
    light_frame,
    node_angle,
    node_distance,
    scale_at,
    scale_exponent,
    source_function,
)
from varos_warp.kernels.field.single_scattering import scattered_by_lights, single_scattering
from varos_warp.kernels.numerics import make_gauss_legendre, quadrilinear
from varos_warp.kernels.sampling import asinh
from varos_warp.kernels.world.camera import Camera, node_ray
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.lights.light import get_light, light_centre, light_count
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import Medium, exp3, transmittance

wp.set_module_options({"enable_backward": False})

PANEL, PANEL_NODES = wp.constant(3.0), wp.constant(12)
"""Longest stretch of a ray with twelve nodes, in the logarithm of the distance from the light. With eight, water that
scatters 99 % loses 0.36 % of its light, with twelve 0.07 %."""

legendre_node = make_gauss_legendre(PANEL_NODES)


@wp.func
def node_point(grid: NodeGrid, d: float, col: int):
    """Position at distance d at the angle of a node; the light is at the origin and its axis along z."""
    theta = node_angle(grid, col)
    return d * wp.vec3(wp.sin(theta), 0.0, wp.cos(theta))


@wp.func
def towards(grid: NodeGrid, col: int, direction: wp.vec2):
    """Unit vector of a direction (gamma, phi) there."""
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
    radiance: wp.array3d(dtype=wp.vec3),  # [angle, direction, distance], divided by scale_at
):
    """Radiance of light scattered once that arrives at the nodes."""
    tile_col, i = wp.tid()
    col = first_row + tile_col
    d = towards(grid, col, directions[i])
    for row in range(grid.distances):
        distance = node_distance(grid, row)
        L = single_scattering(scene.medium, get_light(scene.lights, 0), node_point(grid, distance, col), d, FAR)
        radiance[col, i, row] = wp.cw_div(L, scale_at(grid, distance))


# ------------------------------------------------------------------------------------- from one scattering to the next


@wp.struct
class RayNode:
    """What a ray that ends at distance 1 from the light meets, as a node of the quadrature of what arrives there."""

    t: float
    """Distance from the end of the ray."""
    weight: float
    """Weight in the quadrature over the distance from the light."""
    distance: float
    """Distance from the light."""
    col: float
    """Place among the angles of the table, and of the direction among its gammas and phis."""
    x: float
    y: float


@wp.func
def ray_node(field: LightField, light: Light, end: wp.vec3, d: wp.vec3, t: float, weight: float):
    """The node at ``t`` of the ray that comes to ``end`` along -d."""
    frame = light_frame(light, end + t * d)
    direction = gamma_phi(frame, d)
    node = RayNode()
    node.t = t
    node.distance = frame.distance
    node.weight = weight / frame.distance
    node.col = grid_place(field.grid, frame.distance, frame.theta)[1]
    node.x = direction_place(field.source.shape[1], wp.sqrt(direction[0]))
    node.y = direction_place(field.source.shape[2], direction[1])
    return node


@wp.func
def add_next_order(
    medium: Medium, field: LightField, grid: NodeGrid, node: RayNode, rows: int, radiance: wp.array(dtype=wp.vec3)
):
    """Add what a node contributes to the ``radiance`` at the first ``rows`` distances, divided by scale_at."""
    last = float(field.grid.distances - 1) - 1.0e-3
    place = wp.log(grid.nearest * node.distance / field.grid.nearest) / field.grid.log_step
    d = float(grid.nearest)
    for row in range(rows):
        S = quadrilinear(field.source, node.col, node.x, node.y, wp.clamp(place, 0.0, last))
        falls = scale_exponent(field.grid, d * node.distance) - scale_exponent(field.grid, d)
        radiance[row] += d * node.weight * wp.cw_mul(exp3(-d * node.t * medium.sigma_t - falls), S)
        place += grid.log_step / field.grid.log_step
        d *= wp.exp(grid.log_step)


@wp.kernel(enable_backward=False)
def tabulate_next_order(
    scene: SceneData,
    field: LightField,
    grid: NodeGrid,
    directions: wp.array(dtype=wp.vec2),
    first_row: int,
    # out
    radiance: wp.array3d(dtype=wp.vec3),  # [angle, direction, distance], divided by scale_at; 0 before
):
    """Radiance that arrives at the nodes of ``grid`` after light of the ``field`` has scattered once more.

    Rays that end at the same angle, in the same direction, differ in scale only. Along them the source falls off
    roughly as the inverse distance from the light, so it is nearly constant in x = asinh(y/h), y from the light's foot.
    The ray is divided there, where the light passes from ahead to behind, and goes on until it leaves the field.
    """
    tile_col, i = wp.tid()
    col = first_row + tile_col
    light = get_light(scene.lights, 0)
    end = node_point(grid, 1.0, col)
    d = towards(grid, col, directions[i])
    foot = wp.dot(light_centre(light) - end, d)
    h = wp.max(wp.sqrt(wp.max(1.0 - foot * foot, 0.0)), 1.0e-3)
    farthest = node_distance(field.grid, field.grid.distances - 1) / grid.nearest
    x = asinh(-foot / h)
    before = int(wp.ceil(wp.max(-x, 0.0) / PANEL))
    width = wp.where(before > 0, -x / float(wp.max(before, 1)), PANEL)
    rows = grid.distances
    nodes = int(PANEL_NODES)  # a variable, so that the loop is not unrolled: that takes a GPU's compiler half a minute
    while rows > 0:
        for k in range(nodes):
            gauss = legendre_node(k)
            at = x + width * gauss[0]
            t = wp.max(foot + h * wp.sinh(at), 0.0)
            node = ray_node(field, light, end, d, t, gauss[1] * width * h * wp.cosh(at))
            add_next_order(scene.medium, field, grid, node, rows, radiance[col, i])
        x += width
        before -= 1
        if before <= 0:
            width = PANEL
            rows = wp.min(int(wp.ceil(wp.log(farthest / (h * wp.cosh(x))) / grid.log_step)), grid.distances)


@wp.kernel(enable_backward=False)
def tabulate_multiple_along_camera(
    scene: SceneData,
    lights: wp.array(dtype=LightField),
    camera: Camera,
    size: wp.vec2,
    first_row: int,
    # out
    table: AlongCamera,
):
    """Radiance that multiple scattering adds to a camera's rays up to each distance."""
    tile_row, col = wp.tid()
    row = first_row + tile_row
    ray = node_ray(camera, size, float(row), float(col), table.radiance.shape[1], table.radiance.shape[2])
    L = wp.vec3(0.0)
    start = float(0.0)
    nodes = int(PANEL_NODES)
    for k in range(table.radiance.shape[0]):
        end = distance_along(table, k)
        for i in range(nodes):
            node = legendre_node(i)
            t = wp.lerp(start, end, node[0])
            S = wp.vec3(0.0)
            for light in range(light_count(scene.lights)):
                S += source_function(lights[light], get_light(scene.lights, light), ray.o + t * ray.d, ray.d)
            L += node[1] * (end - start) * wp.cw_mul(transmittance(scene.medium, t), S)
        table.radiance[k, row, col] = L
        start = end


@wp.kernel(enable_backward=False)
def tabulate_single_along_camera(
    scene: SceneData,
    camera: Camera,
    size: wp.vec2,
    first_row: int,
    # out
    table: AlongCamera,
):
    """Radiance that single scattering adds to a camera's rays up to each distance; the first axis is the row here."""
    tile_row, row, col = wp.tid()
    k = first_row + tile_row
    ray = node_ray(camera, size, float(row), float(col), table.radiance.shape[1], table.radiance.shape[2])
    table.radiance[k, row, col] = scattered_by_lights(scene, ray.o, ray.d, distance_along(table, k))


@wp.kernel(enable_backward=False)
def compare_single_along_camera(
    scene: SceneData,
    camera: Camera,
    size: wp.vec2,
    table: AlongCamera,
    points: wp.array(dtype=wp.vec3),  # (x, y) in [0, 1]^2, distance [m]
    first_row: int,
    # out
    known: wp.array(dtype=wp.vec3),
    tabulated: wp.array(dtype=wp.vec3),
):
    """Radiance of single scattering along a camera's rays at some points, by quadrature and by look-up."""
    i = first_row + wp.tid()
    point = points[i]
    ray = node_ray(camera, size, point[1], point[0], 2, 2)
    known[i] = scattered_by_lights(scene, ray.o, ray.d, point[2])
    tabulated[i] = radiance_along(table, point[0], point[1], point[2])
