"""Image A: radiance of underwater pixels lit by lamps, by orders of scattering.

Every segment of a path gathers the light that lamps send into it with one more event: reflected off the surface at
its end, and scattered once on the way. On the camera's own segment these are the layers `direct` and `single`. Light
of more events is carried by a walk. It starts with a scattering on the camera's segment or with a reflection at its
end, and moves from vertex to vertex, in the water or on a surface, until roulette ends it. No sample is clamped or
dropped.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, Ray, camera_ray
from varos_warp.kernels.conventions import BLOCK_DIM, CPU_FLAGS, FAR, NEAR
from varos_warp.kernels.film import Film, Sums, add_sample, first_sample, store
from varos_warp.kernels.intersect import Hit, SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.light import LitInterval, brightest, lit_interval
from varos_warp.kernels.medium import (
    Medium,
    near_pdf,
    sample_near,
    sample_truncated_exponential,
    transmittance,
    truncated_exponential_pdf,
)
from varos_warp.kernels.phase import hg_eval, hg_sample
from varos_warp.kernels.sampling import joint_pdf, sample_joint, uniforms
from varos_warp.kernels.single_scatter import LampLight, in_scattered, lamp_beam
from varos_warp.kernels.surface import sample_surface, surface_albedo, surface_eval, surface_pdf
from varos_warp.kernels.texture import WALK_ANGLE, Surface, footprint_width

wp.set_module_options({"enable_backward": False})


@dataclass(frozen=True)
class PathSpec:
    """What a path kernel is compiled for; what is absent costs nothing."""

    medium: bool = True
    """The water scatters."""
    direct: bool = True
    single: bool = True
    multiple: bool = True
    """Which layers are wanted."""
    instances: bool = False
    """Something stands in many places."""
    textures: bool = True
    """Some material is more than one constant reflectance."""


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


# --------------------------------------------------------------------------------------------- one of several lamps


@wp.struct
class Pick:
    """State of a choice among weighted candidates in one pass (reservoir sampling, Chao 1982)."""

    u: float
    """Uniform number, stretched again after each decision."""
    index: int
    """The candidate held, and its weight."""
    weight: float


@wp.func
def reservoir(pick: Pick, index: int, weight: float, total: float):
    """Take candidate ``index`` with probability weight/total, where ``total`` includes its weight."""
    after = pick
    if weight <= 0.0:
        return after
    probability = weight / total
    if pick.u < probability:
        after.u = pick.u / probability
        after.index = index
        after.weight = weight
    else:
        after.u = (pick.u - probability) / (1.0 - probability)
    return after


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
        lobe = 0.5 * hg_eval(0.5 * chord * chord, scene.medium.g) + 0.5 * joint_pdf(chord)
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
        return hg_sample(to_light, scene.medium.g, u[2], u[3])
    return sample_joint(to_light, u[2], u[3])


@wp.func
def sample_own_lobe(scene: SceneData, vertex: Vertex, u: float, v: float, w: float):
    """Direction from the phase function or from what the surface does with light."""
    if vertex.on_surface == 1:
        return sample_surface(vertex.surface, vertex.n, -vertex.d, u, v, w)
    return hg_sample(vertex.d, scene.medium.g, u, v)


@wp.func
def own_lobe_pdf(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Density of sample_own_lobe."""
    if vertex.on_surface == 1:
        return surface_pdf(vertex.surface, vertex.n, -vertex.d, d)
    apart = vertex.d - d
    return hg_eval(0.5 * wp.dot(apart, apart), scene.medium.g)


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


# --------------------------------------------------------------------------------------------------- light on a segment


@wp.func
def gather_in_scattered(scene: SceneData, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """in_scattered of one lamp, chosen by the integral of 1/d^2 over the interval it lights."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    lit = LitInterval()
    for i in range(scene.lights.shape[0]):
        candidate = lit_interval(scene.lights[i], o, d, t_max)
        weight = candidate.angle * brightest(scene.lights[i].intensity)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            lit = candidate
    scattered = LampLight()
    if total > 0.0:
        scattered = in_scattered(scene, scene.lights[pick.index], lit, o, d, v)
        scattered.lamp = pick.index
        scattered.L *= total / pick.weight
    return scattered


@wp.func
def gather_reflected(scene: SceneData, hit: Hit, vertex: Vertex, u: float):
    """Light of one lamp reflected at a hit against its ray, chosen by how much that is without obstacles."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    reflected = LampLight()
    reflected.p = hit.start
    for i in range(scene.lights.shape[0]):
        to_light = wp.normalize(scene.lights[i].position - hit.p)
        L = wp.cw_mul(vertex_eval(scene, vertex, to_light), lamp_beam(scene, scene.lights[i], hit.p))
        weight = brightest(L)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            reflected.L = L
    reflected.lamp = pick.index
    if total > 0.0:
        reflected.L *= total / pick.weight
    return reflected


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
def camera_segment(ray: Ray):
    """The camera's own segment as the first of a path."""
    walk = Walk()
    walk.alive = 1
    walk.vertex = water_vertex(ray.o, ray.d)
    walk.throughput = wp.vec3(1.0)
    return walk


@wp.func
def start_walk(
    scene: SceneData,
    o: wp.vec3,
    d: wp.vec3,
    hit: Hit,
    end: Vertex,
    max_scatterings: int,
    max_bounces: int,
    u: wp.vec4,
):
    """Walk that turns first in the water on the camera's segment, or on the surface at its ``end``.

    Where both can be, either is taken half of the time.
    """
    walk = Walk()
    walk.dimension = 4
    from_water = max_scatterings > 0
    from_surface = hit.face >= 0 and max_bounces > 0 and brightest(surface_albedo(end.surface)) > 0.0
    both = from_water and from_surface
    if from_water and (u[2] < 0.5 or not both):
        near = lamp_distance(scene, o)
        t = sample_first_scattering(scene.medium, near, hit.t, u[0], u[1])
        walk.vertex = water_vertex(o + t * d, d)
        walk.scatterings = 1
        walk.throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t))
        walk.throughput /= first_scattering_pdf(scene.medium, near, hit.t, t)
    elif from_surface:
        walk.vertex = end
        walk.bounces = 1
        walk.throughput = transmittance(scene.medium, hit.t)
    if both:
        walk.throughput *= 2.0
    walk.alive = wp.where(brightest(walk.throughput) > 0.0, 1, 0)
    walk.expected_at_start = expected_light(scene, walk)
    return walk


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
    # Unbiased, and ends every walk. The root in expected_light and the bound of 0.3 keep survivors from weighing much
    # more than the rest: measured on water with albedo 1, that costs the least error x time.
    survival = wp.clamp(expected_light(scene, moved) / walk.expected_at_start, 0.3, 0.95)
    if u[2] < survival:
        moved.throughput /= survival
        moved.alive = 1
    return moved


@cache
def make_path_kernel(spec: PathSpec) -> wp.Kernel:
    """Path tracing of a range of rows, specialised to ``spec``.

    One loop serves camera segments and walks, segment by segment, so that threads of a GPU's warp trace rays together
    whatever their paths are doing (path regeneration, Novak et al. 2010). The launch bounds trade registers for threads
    that hide the latency of rays: nearly twice as many paths a second on an H200.
    """
    first_hit, visible = make_rays(spec.instances)
    hit_surface = make_hit_surface(spec.textures)

    @wp.kernel(
        module="unique",
        module_options={"cpu_compiler_flags": CPU_FLAGS},
        enable_backward=False,
        launch_bounds=(BLOCK_DIM, 6),
    )
    def trace_paths(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        spp: int,
        max_scatterings: int,
        max_bounces: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        tile_row, col, stratum = wp.tid()
        row = first_row + tile_row
        strata, width = film.squares.shape[0], film.squares.shape[2]
        pixel = row * width + col
        sample = first_sample(stratum, strata, spp)
        end = first_sample(stratum + 1, strata, spp)
        sums = Sums()
        L_direct = wp.vec3(0.0)
        L_single = wp.vec3(0.0)
        L_multiple = wp.vec3(0.0)
        on_camera = bool(True)
        walk = Walk()
        while sample < end:
            # a ray: through the pixel, or on from the vertex where a walk turns
            if on_camera:
                u = uniforms(key, pixel, sample, 0)
                ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
                walk = camera_segment(ray)
            else:
                lamp_share = float(0.0)
                if wp.static(spec.medium):
                    lamp_share = wp.where(walk.scatterings < max_scatterings, 0.5, 0.0)
                u = uniforms(key, pixel, sample, walk.dimension)
                v = uniforms(key, pixel, sample, walk.dimension + 1)
                walk = turn(scene, walk, lamp_share, u, v)

            if walk.alive == 1:
                o = walk.vertex.p
                d = walk.vertex.d
                hit = first_hit(scene, o, d)
                u = uniforms(key, pixel, sample, walk.dimension + 2)
                v = uniforms(key, pixel, sample, walk.dimension + 3)
                walk.dimension += 4

                # light of one more event on the segment: scattered on the way, or reflected at its end
                L_water = wp.vec3(0.0)
                if wp.static(spec.medium and (spec.single or spec.multiple)):
                    if walk.scatterings < max_scatterings and (wp.static(spec.single) or not on_camera):
                        scattered = gather_in_scattered(scene, o, d, hit.t, u[0], u[1])
                        if brightest(scattered.L) > 0.0:
                            if visible(scene, scattered.p, scene.lights[scattered.lamp].position):
                                L_water = scattered.L
                L_surface = wp.vec3(0.0)
                end_vertex = Vertex()
                if hit.face >= 0:
                    n = shading_normal(scene, hit)
                    angle = wp.where(on_camera, camera.pixel_angle, WALK_ANGLE)
                    surface = hit_surface(scene, hit, n, footprint_width(angle, hit.t, d, hit.n))
                    end_vertex = surface_vertex(hit, d, n, surface)
                    if walk.bounces < max_bounces and (wp.static(spec.direct) or not on_camera):
                        reflected = gather_reflected(scene, hit, end_vertex, u[2])
                        if brightest(reflected.L) > 0.0:
                            if visible(scene, reflected.p, scene.lights[reflected.lamp].position):
                                L_surface = wp.cw_mul(transmittance(scene.medium, hit.t), reflected.L)

                # where the path goes on
                if on_camera:
                    L_single = L_water
                    L_direct = L_surface
                    on_camera = False
                    walk.alive = 0
                    if wp.static(spec.multiple):
                        walk = start_walk(scene, o, d, hit, end_vertex, max_scatterings, max_bounces, v)
                else:
                    L_multiple += wp.cw_mul(walk.throughput, L_water + L_surface)
                    walk = advance(scene, walk, hit, end_vertex, max_scatterings, max_bounces, v)

            if walk.alive == 0:
                sums = add_sample(sums, L_direct, L_single, L_multiple)
                L_multiple = wp.vec3(0.0)
                on_camera = True
                sample += 1
        store(film, stratum, row, col, sums)

    return trace_paths
