"""Subpaths: paths beyond the camera's own segment, from vertex to vertex in the water and on surfaces.

At a vertex a subpath samples a direction (`sample_direction`) and advances along the new segment to the next vertex
(`advance`). next_event.py and path.py gather the light that it finds on its segments.

Weights stay bounded on average, so that second moments are finite. The fraction of directions around the lights falls
as the inverse of the number of vertices (`light_share`), so the weights of all other directions grow at most as a power
of that number; the survival probability of `roulette` approaches 1 as quickly.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampling import joint_pdf, sample_joint
from varos_warp.kernels.world.bsdf import bsdf_albedo, bsdf_eval, bsdf_pdf, bsdf_sample, lobe_alpha
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.lights.choice import choose_by_importance, nearest_light
from varos_warp.kernels.world.lights.light import get_light, light_count, light_direction, light_importance
from varos_warp.kernels.world.medium import (
    Medium,
    near_pdf,
    sample_near,
    sample_truncated_exponential,
    transmittance,
    truncated_exponential_pdf,
)
from varos_warp.kernels.world.phase import phase_eval, phase_sample
from varos_warp.kernels.world.surface import SurfacePoint
from varos_warp.kernels.world.texture import Bsdf

wp.set_module_options({"enable_backward": False})


@wp.struct
class Vertex:
    """A vertex of a subpath: in the water, or on a surface with its normals and scattering function."""

    on_surface: int
    p: wp.vec3
    d: wp.vec3
    """Direction of the ray that arrived; after `sample_direction`, of the one that leaves."""
    n_geometric: wp.vec3
    n: wp.vec3
    bsdf: Bsdf
    shadowed: int
    """1 where a light was found to be blocked."""


@wp.func
def is_metal(vertex: Vertex):
    """Whether the vertex lies on a surface with a metal's lobe."""
    return vertex.on_surface == 1 and vertex.bsdf.metal > 0.0


@wp.func
def water_vertex(p: wp.vec3, d: wp.vec3):
    """Vertex in the water."""
    vertex = Vertex()
    vertex.on_surface = 0
    vertex.p = p
    vertex.d = d
    return vertex


@wp.func
def surface_vertex(point: SurfacePoint, d: wp.vec3):
    """Vertex on the surface that a ray along ``d`` hit."""
    vertex = Vertex()
    vertex.on_surface = 1
    vertex.p = point.start
    vertex.d = d
    vertex.n_geometric = point.n_geometric
    vertex.n = point.n
    vertex.bsdf = point.bsdf
    return vertex


# ------------------------------------------------------------------------------------- directions: three lobes, one pdf


GLOW = wp.constant(2.0)
"""Angle about a light in which directions from metal are drawn, in RMS slopes of its microfacets. Farther away the
metal's own lobe finds the light, if it reaches there at all (docs/transport.md)."""

MOST_FROM_METAL = wp.constant(0.35)
"""Most of the directions from metal that are drawn around lights: what its own lobe finds on surfaces is as noisy."""


@wp.struct
class LightLobes:
    """How directions around lights are drawn: by the phase function, or by `joint_pdf` up to an angle [rad]."""

    phase_share: float
    most: float


@wp.func
def light_lobes(vertex: Vertex):
    """Half of each; from metal, which mirrors a narrow part of the water's glow, by the second up to a small angle."""
    lobes = LightLobes()
    lobes.phase_share = 0.5
    lobes.most = wp.pi
    if is_metal(vertex):
        lobes.phase_share = 0.0
        lobes.most = wp.min(GLOW * lobe_alpha(vertex.bsdf.roughness), wp.pi)
    return lobes


@wp.func
def light_lobes_pdf(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Density of sample_light_lobes."""
    lobes = light_lobes(vertex)
    total = float(0.0)
    weights = float(1.0e-30)
    for i in range(light_count(scene.lights)):
        light = get_light(scene.lights, i)
        weight = light_importance(light, vertex.p)
        chord = wp.length(light_direction(light, vertex.p) - d)
        # chord^2 / 2 = 1 - cos without cancellation
        by_phase = lobes.phase_share * phase_eval(scene.medium.phase, 0.5 * chord * chord)
        total += weight * (by_phase + (1.0 - lobes.phase_share) * joint_pdf(chord, lobes.most))
        weights += weight
    return total / weights


@wp.func
def sample_light_lobes(scene: SceneData, vertex: Vertex, u: wp.vec4):
    """Direction from a vertex towards the bright water near a light."""
    lobes = light_lobes(vertex)
    light = get_light(scene.lights, choose_by_importance(scene.lights, vertex.p, u[0]))
    to_light = light_direction(light, vertex.p)
    if u[1] < lobes.phase_share:
        return phase_sample(scene.medium.phase, to_light, u[2], u[3])
    return sample_joint(to_light, lobes.most, u[2], u[3])


@wp.func
def sample_own_lobe(scene: SceneData, vertex: Vertex, u: float, v: float, w: float):
    """Direction from the phase function or the surface's scattering function."""
    if vertex.on_surface == 1:
        return bsdf_sample(vertex.bsdf, vertex.n, -vertex.d, u, v, w)
    return phase_sample(scene.medium.phase, vertex.d, u, v)


@wp.func
def own_lobe_pdf(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Density of sample_own_lobe."""
    if vertex.on_surface == 1:
        return bsdf_pdf(vertex.bsdf, vertex.n, -vertex.d, d)
    apart = vertex.d - d
    return phase_eval(scene.medium.phase, 0.5 * wp.dot(apart, apart))


@wp.func
def vertex_albedo(vertex: Vertex):
    """Albedo of the surface on which a vertex lies, per channel."""
    return bsdf_albedo(vertex.bsdf, vertex.n, -vertex.d)


@wp.func
def vertex_eval(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Phase function, or the surface's scattering function times the cosine [1/sr]."""
    if vertex.on_surface == 1:
        if wp.dot(d, vertex.n_geometric) <= 0.0:
            return wp.vec3(0.0)
        return bsdf_eval(scene.lobe_albedo, vertex.bsdf, vertex.n, -vertex.d, d)
    return wp.vec3(own_lobe_pdf(scene, vertex, d))


# ----------------------------------------------------------------------------------------------- distances in the water


@wp.struct
class Flight:
    """How far a subpath goes along a segment, into the water or to its end, and the weight."""

    t: float
    weight: wp.vec3


@wp.func
def pick_channel(throughput: wp.vec3, u: float):
    """Channel with probability proportional to its throughput."""
    total = throughput[0] + throughput[1] + throughput[2]
    if u * total < throughput[0]:
        return 0
    if u * total < throughput[0] + throughput[1]:
        return 1
    return 2


@wp.func
def sample_flight(medium: Medium, throughput: wp.vec3, t_max: float, u: float, v: float):
    """Free flight of one channel, weighted by the balance over all three (Wilkie et al. 2014)."""
    flight = Flight()
    share = throughput / (throughput[0] + throughput[1] + throughput[2])
    sigma = medium.sigma_t[pick_channel(throughput, u)]
    flight.t = wp.where(sigma > 0.0, -wp.log(1.0 - v) / wp.max(sigma, 1.0e-30), FAR)
    if flight.t < t_max:
        T = transmittance(medium, flight.t)
        flight.weight = wp.cw_mul(medium.sigma_s, T) / wp.dot(share, wp.cw_mul(medium.sigma_t, T))
        return flight
    flight.t = t_max
    T = transmittance(medium, t_max)
    flight.weight = T / wp.dot(share, T)
    return flight


@wp.func
def light_distance(scene: SceneData, p: wp.vec3):
    """Distance to the nearest light [m], but at least a centimetre."""
    return wp.max(nearest_light(scene.lights, p), 0.01)


@wp.func
def first_scattering_pdf(medium: Medium, near: float, near_share: float, t_max: float, t: float):
    """Density of sample_first_scattering: a fraction ``near_share`` near the lights, the rest by free flight."""
    reach = wp.min(t_max, 1.0e4)
    pdf = float(0.0)
    if t <= reach:
        pdf = near_share * near_pdf(near, reach, t)
    for c in range(3):
        pdf += (1.0 - near_share) / 3.0 * truncated_exponential_pdf(medium.sigma_t[c], t_max, t)
    return pdf


@wp.func
def sample_first_scattering(medium: Medium, near: float, near_share: float, t_max: float, u: float, v: float):
    """Distance of the scattering that starts a subpath on the camera's own segment."""
    if u < near_share:
        return sample_near(near, wp.min(t_max, 1.0e4), v)
    c = wp.min(int(3.0 * (u - near_share) / (1.0 - near_share)), 2)
    return sample_truncated_exponential(medium.sigma_t[c], t_max, v)


# ----------------------------------------------------------------------------------------------------------- subpaths


@wp.struct
class Subpath:
    """A path beyond the camera's own segment: its last vertex, and the weight of light from there."""

    alive: int
    vertex: Vertex
    throughput: wp.vec3
    scatterings: int
    bounces: int
    viewer: wp.vec3
    """Direction from the vertex to where its ray came from, once `sample_direction` drew the next."""
    lobe_pdf: float
    """Density of the vertex's own lobe in the direction that `sample_direction` drew."""
    expected_at_start: float
    """`expected_light` at the first vertex, for roulette."""
    reach: float
    """Distance from the lights up to which roulette ignores the distance [m]."""


@wp.func
def events(path: Subpath):
    """Number of scatterings and reflections."""
    return path.scatterings + path.bounces


@wp.func
def light_reach(scene: SceneData, hit: Hit):
    """Distance from the lights up to which roulette ignores the distance [m]; ``hit`` ends the camera's ray.

    Three mean free paths of the clearest channel, but between one and three times the hit's distance from the lights,
    within which surfaces pass light back and forth. No length is a constant, so the scale of a scene does not matter.
    """
    sigma = scene.medium.sigma_t
    free = 3.0 / wp.max(wp.min(sigma[0], wp.min(sigma[1], sigma[2])), 1.0 / FAR)
    if hit.face < 0:
        return free
    end = light_distance(scene, hit.p)
    return wp.clamp(free, end, 3.0 * end)


@wp.func
def expected_light(scene: SceneData, path: Subpath):
    """Estimate of the light that a subpath may still find, for roulette: its throughput times its vertex's albedo.

    Within reach of the lights, the light at the vertex itself is no guide: a subpath that leaves a light for the walls
    finds more there than on the way. Far outside there is hardly any light, so the estimate falls with the fourth power
    of the distance; with the throughput alone, subpaths would continue for kilometres in water that absorbs little.
    (With the square, the paper's water takes half as much time again, and no scene has noticeably less noise.)
    """
    albedo = wp.where(path.vertex.on_surface == 1, brightest(vertex_albedo(path.vertex)), 1.0)
    near = wp.min(path.reach / light_distance(scene, path.vertex.p), 1.0)
    near *= near
    return albedo * brightest(path.throughput) * near * near


@wp.func
def subpath_from_surface(scene: SceneData, vertex: Vertex, t: float, reach: float):
    """Subpath that starts with a reflection at the end of the camera's ray of length ``t``."""
    path = Subpath()
    path.vertex = vertex
    path.bounces = 1
    path.throughput = transmittance(scene.medium, t)
    reflected = wp.cw_mul(path.throughput, vertex_albedo(vertex))
    path.alive = wp.where(brightest(reflected) > 0.0, 1, 0)
    path.reach = reach
    path.expected_at_start = expected_light(scene, path)
    return path


@wp.func
def subpath_from_water(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float, pdf: float, reach: float):
    """Subpath that starts with a scattering at ``t`` on the camera's ray."""
    path = Subpath()
    path.vertex = water_vertex(o + t * d, d)
    path.scatterings = 1
    path.throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t)) / pdf
    path.alive = wp.where(brightest(path.throughput) > 0.0, 1, 0)
    path.reach = reach
    path.expected_at_start = expected_light(scene, path)
    return path


@wp.func
def light_share(path: Subpath, most: float):
    """Fraction of directions around the lights: at most ``most``, and at most 1/(n + 1) after n vertices.

    If some directions are drawn around a light at every vertex, segments pass it with a density in proportion to the
    inverse of their distance. The weight of all other directions grows by 1 / (1 - fraction), and the product of those
    factors over n vertices is at most n + 1.
    """
    return wp.min(most, 1.0 / float(events(path) + 1))


@wp.func
def share_from_metal(scene: SceneData, vertex: Vertex):
    """Fraction of directions around the lights from metal, 0.35 x / (1 + x).

    With x the density of its own lobe towards the lights, relative to a uniform one: the water is brightest around the
    lights, but a metal whose lobe hardly points there does not reflect that light.
    """
    total = float(0.0)
    lobe = float(0.0)
    for i in range(light_count(scene.lights)):
        light = get_light(scene.lights, i)
        weight = light_importance(light, vertex.p)
        total += weight
        lobe += weight * own_lobe_pdf(scene, vertex, light_direction(light, vertex.p))
    x = 4.0 * wp.pi * lobe / wp.max(total, 1.0e-30)
    return MOST_FROM_METAL * x / (1.0 + x)


@wp.func
def sample_direction(scene: SceneData, path: Subpath, share: float, u: wp.vec4, v: wp.vec4):
    """Sample the next direction of a subpath, in ``vertex.d``: from the vertex's own lobe or those around the lights.

    The weight is that of the one-sample balance heuristic.
    """
    after = path
    if v[0] < share:
        d = sample_light_lobes(scene, path.vertex, u)
    else:
        d = sample_own_lobe(scene, path.vertex, u[2], u[3], v[1])
    f = vertex_eval(scene, path.vertex, d)
    after.viewer = -path.vertex.d
    after.vertex.d = d
    after.alive = wp.where(brightest(f) > 0.0, 1, 0)
    if after.alive == 1:
        after.lobe_pdf = own_lobe_pdf(scene, path.vertex, d)
        pdf = (1.0 - share) * after.lobe_pdf
        if share > 0.0:
            pdf += share * light_lobes_pdf(scene, path.vertex, d)
        after.throughput = wp.cw_mul(after.throughput, f) / pdf
    return after


@wp.func
def roulette(scene: SceneData, path: Subpath, u: float):
    """Let a subpath survive with a probability that follows `expected_light`, and weigh it by the inverse.

    It is unbiased and ends every subpath. Within its bounds it keeps the expected light of survivors at the value of
    the first vertex. The probability is at least 0.3, so that no survivor gains much weight at once, and at most 0.9 or
    1 - 4/n after n vertices. It approaches 1, so that weights grow only as a power of n, yet slowly enough that few
    subpaths are long: the threads of a GPU's warp wait for the longest.
    """
    after = path
    most = wp.max(0.9, 1.0 - 4.0 / float(events(path)))
    survival = wp.clamp(expected_light(scene, path) / path.expected_at_start, 0.3, most)
    after.alive = wp.where(u < survival, 1, 0)
    after.throughput /= survival
    return after


@wp.func
def advance(scene: SceneData, path: Subpath, hit: Hit, end: Vertex, max_scatterings: int, max_bounces: int, u: wp.vec4):
    """Move a subpath along its segment to the next vertex, in the water or at ``end``; roulette may end it."""
    moved = path
    moved.alive = 0
    if brightest(path.throughput) <= 0.0:
        return moved
    in_water = False
    if path.scatterings < max_scatterings:
        flight = sample_flight(scene.medium, path.throughput, hit.t, u[0], u[1])
        in_water = flight.t < hit.t
        moved.throughput = wp.cw_mul(path.throughput, flight.weight)
        if in_water:
            moved.vertex = water_vertex(path.vertex.p + flight.t * path.vertex.d, path.vertex.d)
            moved.vertex.shadowed = end.shadowed
            moved.scatterings += 1
    else:
        moved.throughput = wp.cw_mul(path.throughput, transmittance(scene.medium, hit.t))
    if not in_water:
        if hit.face < 0 or path.bounces >= max_bounces:
            return moved
        moved.vertex = end
        moved.bounces += 1
    return roulette(scene, moved, u[2])
