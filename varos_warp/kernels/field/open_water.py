"""The precomputed radiance field of open water: scattered light around each light, and its look-ups.

It ignores surfaces; paths subtract what they block (kernels/transport/path.py).

The field around a light has the symmetry of the light's cone. At a point it depends on the distance from the light, the
angle to its axis, and a direction: gamma, its angle to the direction to the light, and phi, its azimuth about that
direction, from the plane of the axis. The field is the same at phi and -phi.
"""

import warp as wp

from varos_warp.kernels.conventions import NEAR
from varos_warp.kernels.field.along_camera import AlongCamera
from varos_warp.kernels.numerics import quadrilinear
from varos_warp.kernels.world.lights.light import light_axis, light_centre, light_intensity
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import exp3

wp.set_module_options({"enable_backward": False})


@wp.struct
class NodeGrid:
    """Nodes of a table around a light, in a half plane through its axis."""

    distances: int
    nearest: float
    """Distance of the first node [m]; distances are evenly spaced in the logarithm."""
    log_step: float
    half_angle: float
    """Half angle of the cone [rad]; pi for lights that shine in all directions."""
    inside: int
    """Number of steps of the angle to the axis inside the cone, and outside; they narrow towards its edge."""
    outside: int
    decay: wp.vec3
    """Approximate rate at which the light falls off, apart from the inverse distance [1/m]."""


@wp.struct
class LightField:
    """Scattered light around one kind of light, for intensity 1. Values are divided by ``scale_at``."""

    grid: NodeGrid
    irradiance: wp.array4d(dtype=wp.vec3)
    """Irradiance of planes: [angle, gamma of the normal, phi, distance], gamma and phi in even steps."""
    source: wp.array4d(dtype=wp.vec3)
    """Source function of multiple scattering: [angle, gamma, phi, distance], gamma in even steps of its square root."""


@wp.struct
class Field:
    """The field of open water around all lights; the host's render/field/open_water.py owns it."""

    lights: wp.array(dtype=LightField)
    """Fields, one per light."""
    single: AlongCamera
    """Radiance along a camera's rays, of light that is scattered once; without values where a table is not right."""
    multiple: AlongCamera
    """Radiance along a camera's rays, of light that is scattered twice or more."""


# ---------------------------------------------------------------------------------------------------------- the nodes


@wp.func
def scale_exponent(grid: NodeGrid, d: float):
    """Optical depth by which the light falls off, about."""
    return wp.min(d * grid.decay, wp.vec3(60.0))


@wp.func
def scale_at(grid: NodeGrid, d: float):
    """Roughly how the scattered light falls off with the distance, without its constants."""
    return exp3(-scale_exponent(grid, d)) / d


@wp.func
def node_distance(grid: NodeGrid, node: int):
    """The distance [m] of a node."""
    return grid.nearest * wp.exp(float(node) * grid.log_step)


@wp.func
def node_angle(grid: NodeGrid, node: int):
    """The angle to the axis [rad] of a node: quadratic on both sides of the cone's edge."""
    if node <= grid.inside:
        rest = 1.0 - float(node) / float(grid.inside)
        return grid.half_angle * (1.0 - rest * rest)
    share = float(node - grid.inside) / float(grid.outside)
    return grid.half_angle + (wp.pi - grid.half_angle) * share * share


@wp.func
def grid_place(grid: NodeGrid, d: float, theta: float):
    """Fractional row and column of a point among the nodes; inverse of node_distance and node_angle."""
    row = wp.clamp(wp.log(d / grid.nearest) / grid.log_step, 0.0, float(grid.distances - 1) - 1.0e-3)
    col = float(grid.inside)
    if theta < grid.half_angle:
        col *= 1.0 - wp.sqrt(1.0 - theta / grid.half_angle)
    else:
        col += float(grid.outside) * wp.sqrt((theta - grid.half_angle) / wp.max(wp.pi - grid.half_angle, 1.0e-6))
    return wp.vec2(row, wp.clamp(col, 0.0, float(grid.inside + grid.outside) - 1.0e-3))


# ---------------------------------------------------------------------------------------------- the field of a light


@wp.struct
class LightFrame:
    """A point in a light's frame: the coordinates and axes in which the field is tabulated."""

    distance: float
    theta: float
    """Angle between the light's axis and the direction to the point [rad]."""
    to_light: wp.vec3
    across: wp.vec3
    """The component of the light's axis perpendicular to ``to_light``, normalised."""


@wp.func
def light_frame(light: Light, p: wp.vec3):
    """The frame of a light at ``p``."""
    frame = LightFrame()
    offset = light_centre(light) - p
    frame.distance = wp.max(wp.length(offset), NEAR)
    frame.to_light = offset / frame.distance
    axis = light_axis(light)
    along = wp.dot(frame.to_light, axis)
    frame.theta = wp.acos(wp.clamp(-along, -1.0, 1.0))
    frame.across = (axis - along * frame.to_light) / wp.sqrt(wp.max(1.0 - along * along, 1.0e-12))
    return frame


@wp.func
def gamma_phi(frame: LightFrame, d: wp.vec3):
    """Angles (gamma, phi) of a direction, as fractions of pi; by the chord, which is accurate for small angles."""
    gamma = 2.0 * wp.asin(wp.min(0.5 * wp.length(d - frame.to_light), 1.0))
    cos_phi = wp.dot(d, frame.across) / wp.max(wp.sin(gamma), 1.0e-6)
    return wp.vec2(gamma, wp.acos(wp.clamp(cos_phi, -1.0, 1.0))) / wp.pi


@wp.func
def direction_place(nodes: int, u: float):
    """Fractional place of u in [0, 1] among the nodes of an axis."""
    return wp.clamp(u, 0.0, 1.0) * (float(nodes - 1) - 1.0e-3)


@wp.func
def look_up(values: wp.array4d(dtype=wp.vec3), grid: NodeGrid, frame: LightFrame, u: float, v: float):
    """Value of a table at a point; (u, v) in [0, 1] are the places of the direction on its axes."""
    place = grid_place(grid, frame.distance, frame.theta)
    x = direction_place(values.shape[1], u)
    y = direction_place(values.shape[2], v)
    return wp.cw_mul(quadrilinear(values, place[1], x, y, place[0]), scale_at(grid, frame.distance))


@wp.func
def scattered_irradiance(field: LightField, light: Light, p: wp.vec3, n: wp.vec3):
    """Irradiance [W/m^2] from scattered light on a plane at ``p`` with normal ``n``."""
    frame = light_frame(light, p)
    normal = gamma_phi(frame, n)
    E = wp.cw_mul(look_up(field.irradiance, field.grid, frame, normal[0], normal[1]), light_intensity(light))
    return wp.max(E, wp.vec3(0.0))


@wp.func
def source_function(field: LightField, light: Light, p: wp.vec3, d: wp.vec3):
    """Radiance per metre [W/sr/m^3] that scattered light, scattered once more, adds at ``p`` to a ray along ``d``."""
    frame = light_frame(light, p)
    ray = gamma_phi(frame, d)
    return wp.cw_mul(look_up(field.source, field.grid, frame, wp.sqrt(ray[0]), ray[1]), light_intensity(light))
