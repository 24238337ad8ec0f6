"""What paths ask of the precomputed field of open water: irradiance at a point, and in-scattering along a ray."""

import warp as wp

from varos_warp.kernels.field.open_water import Tables, node_distance, scattered_again, scattered_irradiance
from varos_warp.kernels.sampling import Pick, asinh, reservoir
from varos_warp.kernels.transport.subpath import Vertex
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import brightest, light_sample
from varos_warp.kernels.world.medium import transmittance

wp.set_module_options({"enable_backward": False})


@wp.func
def reflected_field(scene: SceneData, field: Tables, vertex: Vertex):
    """Radiance that a matte surface reflects of light scattered in open water; none of a metal."""
    E = wp.vec3(0.0)
    if vertex.surface.metal > 0.0:
        return E
    for i in range(scene.lights.shape[0]):
        E += scattered_irradiance(field.lamp[i], scene.lights[i], vertex.p, vertex.n)
    return wp.cw_mul(vertex.surface.reflectance, E) / wp.pi


@wp.func
def sample_field(scene: SceneData, field: Tables, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """Estimate of the radiance of light scattered twice or more that open water adds to a ray up to ``t_max``.

    One light is taken by its intensity over its distance, and one place on the ray with a density in proportion to the
    inverse distance from the light, as the field falls off; so the weights are bounded.
    """
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    for i in range(scene.lights.shape[0]):
        weight = brightest(scene.lights[i].intensity) / light_sample(scene.lights[i], o, wp.vec2(0.5)).distance
        total += weight
        pick = reservoir(pick, i, weight, total)
    if pick.index < 0:
        return wp.vec3(0.0)
    light = scene.lights[pick.index]
    table = field.lamp[pick.index]
    to_light = light.position - o
    foot = wp.dot(to_light, d)
    h = wp.max(wp.length(to_light - foot * d), 1.0e-3 * wp.length(to_light) + 1.0e-6)
    reach = wp.min(t_max, wp.max(foot, 0.0) + node_distance(table.grid, table.grid.distances - 1))
    low = asinh(-foot / h)
    high = asinh((reach - foot) / h)
    x = wp.lerp(low, high, v)
    y = 0.5 * h * (wp.exp(x) - wp.exp(-x))
    t = wp.clamp(foot + y, 0.0, reach)
    weight = (high - low) * wp.sqrt(h * h + y * y) * total / pick.weight
    return weight * wp.cw_mul(transmittance(scene.medium, t), scattered_again(table, light, o + t * d, d))
