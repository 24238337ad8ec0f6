"""Walks: paths of light behind the camera's own segment, from vertex to vertex in the water and on surfaces.

A walk turns at a vertex (`turn`), looks along the new segment, and moves to the next vertex (`advance`; `drift` where
the water has no end). What light it gathers on its segments is the matter of
kernels/transport/next_event.py and of the integrators.
"""

import warp as wp

from varos_warp.kernels.conventions import FAR, NEAR
from varos_warp.kernels.sampling import Pick, joint_pdf, reservoir, sample_joint
from varos_warp.kernels.world.bsdf import sample_surface, surface_albedo, surface_eval, surface_pdf
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.light import brightest
from varos_warp.kernels.world.medium import (
    Medium,
    near_pdf,
    sample_near,
    sample_truncated_exponential,
    transmittance,
    truncated_exponential_pdf,
)
from varos_warp.kernels.world.phase import phase_eval, phase_sample
from varos_warp.kernels.world.texture import Surface

wp.set_module_options({"enable_backward": False})


@wp.struct
class Vertex:
    """Where a walk turns: in the water, or on a surface with its normals and what it does with light."""

    on_surface: int
    p: wp.vec3
    d: wp.vec3
    """Direction in which the ray came."""
    n_geometric: wp.vec3
    n: wp.vec3
    surface: Surface


@wp.func
def water_vertex(p: wp.vec3, d: wp.vec3):
    """Vertex in the water."""
    vertex = Vertex()
    vertex.on_surface = 0
    vertex.p = p
    vertex.d = d
    return vertex


@wp.func
def surface_vertex(hit: Hit, d: wp.vec3, n: wp.vec3, surface: Surface):
    """Vertex on the surface with normal ``n`` that a ray along ``d`` hit."""
    vertex = Vertex()
    vertex.on_surface = 1
    vertex.p = hit.start
    vertex.d = d
    vertex.n_geometric = hit.n
    vertex.n = n
    vertex.surface = surface
    return vertex


# ------------------------------------------------------------------------------------- directions: three lobes, one pdf


@wp.func
def lamp_weight(scene: SceneData, i: int, p: wp.vec3):
    """How much lamp ``i`` matters near ``p``: intensity over squared distance."""
    offset = scene.lights[i].position - p
    return (brightest(scene.lights[i].intensity) + 1.0e-30) / wp.max(wp.dot(offset, offset), NEAR)


@wp.func
def lamp_lobes_pdf(scene: SceneData, p: wp.vec3, d: wp.vec3):
    """Density of sample_lamp_lobes: for each lamp half a phase function and half a joint lobe around its direction."""
    total = float(0.0)
    weights = float(1.0e-30)
    for i in range(scene.lights.shape[0]):
        weight = lamp_weight(scene, i, p)
        chord = wp.length(wp.normalize(scene.lights[i].position - p) - d)
        # chord^2 / 2 = 1 - cos without cancellation
        lobe = 0.5 * phase_eval(scene.medium.phase, 0.5 * chord * chord) + 0.5 * joint_pdf(chord)
        total += weight * lobe
        weights += weight
    return total / weights


@wp.func
def sample_lamp_lobes(scene: SceneData, p: wp.vec3, u: wp.vec4):
    """Direction from ``p`` into light that lamps scatter: around a lamp, by the phase function or the joint lobe."""
    total = float(0.0)
    pick = Pick()
    pick.u = u[0]
    pick.index = -1
    for i in range(scene.lights.shape[0]):
        weight = lamp_weight(scene, i, p)
        total += weight
        pick = reservoir(pick, i, weight, total)
    to_light = wp.normalize(scene.lights[pick.index].position - p)
    if u[1] < 0.5:
        return phase_sample(scene.medium.phase, to_light, u[2], u[3])
    return sample_joint(to_light, u[2], u[3])


@wp.func
def sample_own_lobe(scene: SceneData, vertex: Vertex, u: float, v: float, w: float):
    """Direction from the phase function or from what the surface does with light."""
    if vertex.on_surface == 1:
        return sample_surface(vertex.surface, vertex.n, -vertex.d, u, v, w)
    return phase_sample(scene.medium.phase, vertex.d, u, v)


@wp.func
def own_lobe_pdf(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Density of sample_own_lobe."""
    if vertex.on_surface == 1:
        return surface_pdf(vertex.surface, vertex.n, -vertex.d, d)
    apart = vertex.d - d
    return phase_eval(scene.medium.phase, 0.5 * wp.dot(apart, apart))


@wp.func
def vertex_eval(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Phase function, or the surface's scattering function times the cosine [1/sr]."""
    if vertex.on_surface == 1:
        if wp.dot(d, vertex.n_geometric) <= 0.0:
            return wp.vec3(0.0)
        return surface_eval(scene.lobe_albedo, vertex.surface, vertex.n, -vertex.d, d)
    return wp.vec3(own_lobe_pdf(scene, vertex, d))


# ----------------------------------------------------------------------------------------------- distances in the water


@wp.struct
class Flight:
    """How far a walk goes along a segment, in the water or to its end, and the weight of that."""

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
def strongest_lamp(scene: SceneData, p: wp.vec3):
    """The lamp that matters most near ``p``."""
    strongest = int(0)
    most = float(0.0)
    for i in range(scene.lights.shape[0]):
        weight = lamp_weight(scene, i, p)
        if weight > most:
            strongest = i
            most = weight
    return strongest


@wp.func
def asinh(x: float):
    """Area hyperbolic sine, odd and without cancellation for negative x."""
    a = wp.abs(x)
    return wp.sign(x) * wp.log(a + wp.sqrt(1.0 + a * a))


@wp.func
def sample_open_flight(
    scene: SceneData, p: wp.vec3, d: wp.vec3, throughput: wp.vec3, lamp_share: float, u: float, v: float
):
    """Distance to the next scattering in water without end, and its weight.

    A free flight of one channel, or with ``lamp_share`` near a lamp, with a density in proportion to the inverse
    distance from it, as the light that it scatters: most free flights leave the lit water.
    """
    flight = Flight()
    to_lamp = scene.lights[strongest_lamp(scene, p)].position - p
    foot = wp.dot(to_lamp, d)
    h = wp.max(wp.length(to_lamp - foot * d), 0.02)
    low = asinh(-foot / h)
    reach = 4.0 * wp.length(to_lamp) + 0.1
    high = asinh((reach - foot) / h)
    sigma = scene.medium.sigma_t
    share = throughput / (throughput[0] + throughput[1] + throughput[2])
    if u < lamp_share:
        x = wp.lerp(low, high, v)
        flight.t = wp.clamp(foot + 0.5 * h * (wp.exp(x) - wp.exp(-x)), 0.0, reach)
    else:
        s = sigma[pick_channel(throughput, (u - lamp_share) / (1.0 - lamp_share))]
        flight.t = wp.where(s > 0.0, -wp.log(1.0 - v) / wp.max(s, 1.0e-30), FAR)
    T = transmittance(scene.medium, flight.t)
    pdf = (1.0 - lamp_share) * wp.dot(share, wp.cw_mul(sigma, T))
    if flight.t <= reach:
        y = flight.t - foot
        pdf += lamp_share / (wp.sqrt(h * h + y * y) * (high - low))
    if flight.t < FAR:
        flight.weight = wp.cw_mul(scene.medium.sigma_s, T) / pdf
    return flight


@wp.func
def lamp_distance(scene: SceneData, p: wp.vec3):
    """Distance to the nearest lamp [m], not under a centimetre."""
    nearest = FAR
    for i in range(scene.lights.shape[0]):
        nearest = wp.min(nearest, wp.length(scene.lights[i].position - p))
    return wp.max(nearest, 0.01)


@wp.func
def first_scattering_pdf(medium: Medium, near: float, t_max: float, t: float):
    """Density of sample_first_scattering: half near the lamps, a sixth as a free flight of each channel."""
    reach = wp.min(t_max, 1.0e4)
    pdf = float(0.0)
    if t <= reach:
        pdf = 0.5 * near_pdf(near, reach, t)
    for c in range(3):
        pdf += truncated_exponential_pdf(medium.sigma_t[c], t_max, t) / 6.0
    return pdf


@wp.func
def sample_first_scattering(medium: Medium, near: float, t_max: float, u: float, v: float):
    """Distance of the scattering that starts a walk on the camera's own segment."""
    if u < 0.5:
        return sample_near(near, wp.min(t_max, 1.0e4), v)
    c = wp.min(int(6.0 * (u - 0.5)), 2)
    return sample_truncated_exponential(medium.sigma_t[c], t_max, v)


# ------------------------------------------------------------------------------------------------------------- walks


@wp.struct
class Walk:
    """A path behind the camera's own segment: where it turns next and what light from there on counts."""

    alive: int
    vertex: Vertex
    throughput: wp.vec3
    scatterings: int
    bounces: int
    dimension: int
    """Next dimension of the random numbers."""
    expected_at_start: float
    """What roulette compares the light still to be expected with."""


@wp.func
def lamp_light_at(scene: SceneData, p: wp.vec3):
    """Rough fluence of lamp light at ``p``, for roulette only."""
    total = float(0.0)
    absorbed = wp.min(scene.medium.sigma_t)
    for i in range(scene.lights.shape[0]):
        total += lamp_weight(scene, i, p) * wp.exp(-absorbed * wp.length(scene.lights[i].position - p))
    return total


@wp.func
def expected_light(scene: SceneData, walk: Walk):
    """How much light a walk may still find: its throughput, times the root of the light at its vertex."""
    albedo = wp.where(walk.vertex.on_surface == 1, brightest(surface_albedo(walk.vertex.surface)), 1.0)
    return albedo * brightest(walk.throughput) * wp.sqrt(lamp_light_at(scene, walk.vertex.p))


@wp.func
def walk_from_surface(scene: SceneData, vertex: Vertex, t: float):
    """Walk that starts with a reflection at the end of the camera's ray of length ``t``."""
    walk = Walk()
    walk.vertex = vertex
    walk.bounces = 1
    walk.throughput = transmittance(scene.medium, t)
    reflected = wp.cw_mul(walk.throughput, surface_albedo(vertex.surface))
    walk.alive = wp.where(brightest(reflected) > 0.0, 1, 0)
    walk.expected_at_start = expected_light(scene, walk)
    return walk


@wp.func
def walk_from_water(scene: SceneData, o: wp.vec3, d: wp.vec3, t: float, pdf: float):
    """Walk that starts with a scattering at ``t`` on the camera's ray."""
    walk = Walk()
    walk.vertex = water_vertex(o + t * d, d)
    walk.scatterings = 1
    walk.throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t)) / pdf
    walk.alive = wp.where(brightest(walk.throughput) > 0.0, 1, 0)
    walk.expected_at_start = expected_light(scene, walk)
    return walk


@wp.func
def lamps_in_lobe(scene: SceneData, vertex: Vertex):
    """Share of directions to draw around the lamps for what a metal sees of the water: up to half of them.

    The water shines brightest there, but where the metal's lobe hardly reaches, that is lost, and such directions are
    wasted. With x the density of the lobe towards the lamps over that of all directions alike, x / (1 + x) of the half.
    """
    total = float(0.0)
    lobe = float(0.0)
    for i in range(scene.lights.shape[0]):
        weight = lamp_weight(scene, i, vertex.p)
        total += weight
        lobe += weight * own_lobe_pdf(scene, vertex, wp.normalize(scene.lights[i].position - vertex.p))
    x = 4.0 * wp.pi * lobe / wp.max(total, 1.0e-30)
    return 0.5 * x / (1.0 + x)


@wp.func
def turn(scene: SceneData, walk: Walk, lamp_share: float, u: wp.vec4, v: wp.vec4):
    """Give a walk its next direction, in ``vertex.d``: from the vertex's own lobe or from those around the lamps.

    The weight is the balance heuristic over both (one sample).
    """
    turned = walk
    if v[0] < lamp_share:
        d = sample_lamp_lobes(scene, walk.vertex.p, u)
    else:
        d = sample_own_lobe(scene, walk.vertex, u[2], u[3], v[1])
    f = vertex_eval(scene, walk.vertex, d)
    turned.vertex.d = d
    turned.alive = wp.where(brightest(f) > 0.0, 1, 0)
    if turned.alive == 1:
        pdf = (1.0 - lamp_share) * own_lobe_pdf(scene, walk.vertex, d)
        if lamp_share > 0.0:
            pdf += lamp_share * lamp_lobes_pdf(scene, walk.vertex.p, d)
        turned.throughput = wp.cw_mul(turned.throughput, f) / pdf
    return turned


@wp.func
def roulette(scene: SceneData, walk: Walk, u: float):
    """Let a walk live on with a probability that follows the light it may still find, and weigh it accordingly.

    Unbiased, and ends every walk. The root in expected_light and the bound of 0.3 keep survivors from weighing much
    more than the rest: measured on water with albedo 1, that costs the least error x time.
    """
    after = walk
    survival = wp.clamp(expected_light(scene, walk) / walk.expected_at_start, 0.3, 0.95)
    after.alive = wp.where(u < survival, 1, 0)
    after.throughput /= survival
    return after


@wp.func
def drift(scene: SceneData, walk: Walk, lamp_share: float, u: wp.vec4):
    """Move a walk to its next scattering in water without end (`sample_open_flight`); roulette may end it."""
    moved = walk
    moved.alive = 0
    if brightest(walk.throughput) <= 0.0:
        return moved
    flight = sample_open_flight(scene, walk.vertex.p, walk.vertex.d, walk.throughput, lamp_share, u[0], u[1])
    moved.throughput = wp.cw_mul(walk.throughput, flight.weight)
    if brightest(moved.throughput) <= 0.0:
        return moved
    moved.vertex = water_vertex(walk.vertex.p + flight.t * walk.vertex.d, walk.vertex.d)
    moved.scatterings += 1
    return roulette(scene, moved, u[2])


@wp.func
def advance(scene: SceneData, walk: Walk, hit: Hit, end: Vertex, max_scatterings: int, max_bounces: int, u: wp.vec4):
    """Move a walk along its segment to the next vertex, in the water or at its ``end``; roulette may end it."""
    moved = walk
    moved.alive = 0
    if brightest(walk.throughput) <= 0.0:
        return moved
    in_water = False
    if walk.scatterings < max_scatterings:
        flight = sample_flight(scene.medium, walk.throughput, hit.t, u[0], u[1])
        in_water = flight.t < hit.t
        moved.throughput = wp.cw_mul(walk.throughput, flight.weight)
        if in_water:
            moved.vertex = water_vertex(walk.vertex.p + flight.t * walk.vertex.d, walk.vertex.d)
            moved.scatterings += 1
    else:
        moved.throughput = wp.cw_mul(walk.throughput, transmittance(scene.medium, hit.t))
    if not in_water:
        if hit.face < 0 or walk.bounces >= max_bounces:
            return moved
        moved.vertex = end
        moved.bounces += 1
    return roulette(scene, moved, u[2])
