"""Image A: radiance of underwater pixels lit by lamps, by orders of scattering.

Every camera ray is split in two where it matters most. Its first segment gives the light of one event, lamp by lamp:
`direct` off the surface at its end and `single` scattering on the way. Light of more events is carried by two walks, one
that starts with a scattering on the segment and one that starts with a reflection at its end; at every further segment
a walk gathers the light of one lamp, off the surface and scattered on the way, and moves on to a vertex in the water or
on the surface. No sample is clamped or dropped.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.conventions import FAR, NEAR
from varos_warp.kernels.film import Film, deviation_product
from varos_warp.kernels.intersect import Hit, SceneData, first_hit, hit_reflectance, shading_normal, visible
from varos_warp.kernels.light import Light, LitInterval, brightest, lit_interval
from varos_warp.kernels.medium import (
    Medium,
    exp3,
    near_pdf,
    sample_near,
    sample_truncated_exponential,
    transmittance,
    truncated_exponential_pdf,
)
from varos_warp.kernels.phase import hg_eval, hg_sample
from varos_warp.kernels.sampling import joint_pdf, sample_cosine, sample_joint, uniforms
from varos_warp.kernels.single_scatter import in_scattered, irradiance_unoccluded, reflected

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


@wp.struct
class Vertex:
    """Where a walk turns: in the water, or on a surface with its normals and reflectance."""

    on_surface: int
    p: wp.vec3
    d: wp.vec3
    """Direction in which the ray came."""
    n_geometric: wp.vec3
    n: wp.vec3
    reflectance: wp.vec3


@wp.func
def water_vertex(p: wp.vec3, d: wp.vec3):
    """Vertex in the water."""
    vertex = Vertex()
    vertex.on_surface = 0
    vertex.p = p
    vertex.d = d
    return vertex


@wp.func
def surface_vertex(scene: SceneData, hit: Hit, d: wp.vec3):
    """Vertex on the surface that a ray along ``d`` hit."""
    vertex = Vertex()
    vertex.on_surface = 1
    vertex.p = hit.start
    vertex.d = d
    vertex.n_geometric = hit.n
    vertex.n = shading_normal(scene, hit)
    vertex.reflectance = hit_reflectance(scene, hit, vertex.n)
    return vertex


# --------------------------------------------------------------------------------------------- one of several lamps


@wp.struct
class Pick:
    """State of a choice among weighted candidates in one pass (reservoir sampling, Chao 1982)."""

    u: float
    """Uniform number, stretched again after each decision."""
    weight: float
    """Weight of the candidate held."""
    taken: int
    """Whether the last candidate was taken."""


@wp.func
def reservoir(pick: Pick, weight: float, total: float):
    """Take a candidate of ``weight`` with probability weight/total, where ``total`` includes it."""
    after = pick
    after.taken = 0
    if weight <= 0.0:
        return after
    probability = weight / total
    if pick.u < probability:
        after.u = pick.u / probability
        after.weight = weight
        after.taken = 1
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
        to_light = wp.normalize(scene.lights[i].position - p)
        cosine = wp.dot(to_light, d)
        # |a - b|^2 / 2 = 1 - cos without cancellation
        apart = to_light - d
        lobe = 0.5 * hg_eval(0.5 * wp.dot(apart, apart), scene.medium.g) + 0.5 * joint_pdf(cosine)
        total += weight * lobe
        weights += weight
    return total / weights


@wp.func
def sample_lamp_lobes(scene: SceneData, p: wp.vec3, u: wp.vec4):
    """Direction from ``p`` into the light that lamps scatter: towards a lamp, as the phase function or the joint lobe."""
    total = float(0.0)
    pick = Pick()
    pick.u = u[0]
    to_light = wp.vec3(0.0)
    for i in range(scene.lights.shape[0]):
        weight = lamp_weight(scene, i, p)
        total += weight
        pick = reservoir(pick, weight, total)
        if pick.taken == 1:
            to_light = scene.lights[i].position - p
    to_light = wp.normalize(to_light)
    if u[1] < 0.5:
        return hg_sample(to_light, scene.medium.g, u[2], u[3])
    return sample_joint(to_light, u[2], u[3])


@wp.func
def sample_own_lobe(scene: SceneData, vertex: Vertex, u: float, v: float):
    """Direction from the phase function or the surface's cosine."""
    if vertex.on_surface == 1:
        return sample_cosine(vertex.n, u, v)
    return hg_sample(vertex.d, scene.medium.g, u, v)


@wp.func
def own_lobe_pdf(scene: SceneData, vertex: Vertex, d: wp.vec3):
    """Density of sample_own_lobe; also scattering function times cosine, per unit albedo."""
    if vertex.on_surface == 1:
        if wp.dot(d, vertex.n_geometric) <= 0.0:
            return 0.0
        return wp.max(wp.dot(d, vertex.n), 0.0) / wp.pi
    apart = vertex.d - d
    return hg_eval(0.5 * wp.dot(apart, apart), scene.medium.g)


# ------------------------------------------------------------------------------------------------ distances in the water


@wp.struct
class Flight:
    """Where a walk goes on along a segment: a point in the water or the surface at the end, and its weight."""

    t: float
    ends_on_surface: int
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
    flight.ends_on_surface = 1
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
    lit = LitInterval()
    light = Light()
    for i in range(scene.lights.shape[0]):
        candidate = lit_interval(scene.lights[i], o, d, t_max)
        weight = candidate.angle * brightest(scene.lights[i].intensity)
        total += weight
        pick = reservoir(pick, weight, total)
        if pick.taken == 1:
            lit = candidate
            light = scene.lights[i]
    if total <= 0.0:
        return wp.vec3(0.0)
    return in_scattered(scene, light, lit, o, d, v) * (total / pick.weight)


@wp.func
def gather_reflected(scene: SceneData, hit: Hit, n: wp.vec3, u: float):
    """Light of one lamp reflected at ``hit``, chosen by its unoccluded irradiance; white surface."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    E = wp.vec3(0.0)
    position = wp.vec3(0.0)
    for i in range(scene.lights.shape[0]):
        candidate = irradiance_unoccluded(scene, scene.lights[i], hit, n)
        weight = brightest(candidate)
        total += weight
        pick = reservoir(pick, weight, total)
        if pick.taken == 1:
            E = candidate
            position = scene.lights[i].position
    if total <= 0.0 or not visible(scene, hit.start, position):
        return wp.vec3(0.0)
    return E * (total / (pick.weight * wp.pi))


@wp.func
def lamp_light_at(scene: SceneData, p: wp.vec3):
    """Rough fluence of lamp light at ``p``, for roulette only."""
    total = float(0.0)
    absorbed = wp.min(scene.medium.sigma_t)
    for i in range(scene.lights.shape[0]):
        total += lamp_weight(scene, i, p) * wp.exp(-absorbed * wp.length(scene.lights[i].position - p))
    return total


@cache
def make_path_kernel(spec: PathSpec) -> wp.Kernel:
    """Path tracing of a range of rows, specialised to ``spec``."""

    @wp.func
    def walk(
        scene: SceneData,
        start: Vertex,
        start_throughput: wp.vec3,
        scattered: int,
        bounced: int,
        max_scatterings: int,
        max_bounces: int,
        key: wp.uint32,
        pixel: int,
        sample: int,
        first_dimension: int,
    ):
        """Radiance that arrives over a walk that turns at ``start``, after so many scatterings and bounces."""
        L = wp.vec3(0.0)
        throughput = start_throughput
        vertex = start
        scatterings = scattered
        bounces = bounced
        dimension = first_dimension
        light_at_start = lamp_light_at(scene, start.p)
        while scatterings < max_scatterings or bounces < max_bounces:
            # 1. a direction, from the vertex's own lobe or from the lobes around the lamps
            u = uniforms(key, pixel, sample, dimension)
            u_next = uniforms(key, pixel, sample, dimension + 1)
            lamp_share = float(0.0)
            if wp.static(spec.medium):
                lamp_share = wp.where(scatterings < max_scatterings, 0.5, 0.0)
            if u_next[0] < lamp_share:
                d = sample_lamp_lobes(scene, vertex.p, u)
            else:
                d = sample_own_lobe(scene, vertex, u[2], u[3])
            f = own_lobe_pdf(scene, vertex, d)
            if f <= 0.0:
                break
            if vertex.on_surface == 1:
                throughput = wp.cw_mul(throughput, vertex.reflectance)
            if lamp_share > 0.0:
                throughput *= f / (lamp_share * lamp_lobes_pdf(scene, vertex.p, d) + (1.0 - lamp_share) * f)

            # 2. light of one more event on the segment in that direction
            hit = first_hit(scene, vertex.p, d)
            if wp.static(spec.medium):
                if scatterings < max_scatterings:
                    L += wp.cw_mul(throughput, gather_in_scattered(scene, vertex.p, d, hit.t, u_next[1], u_next[2]))
            here = vertex.p
            if hit.face >= 0:
                vertex = surface_vertex(scene, hit, d)
                if bounces < max_bounces:
                    E = gather_reflected(scene, hit, vertex.n, u_next[3])
                    L += wp.cw_mul(wp.cw_mul(throughput, transmittance(scene.medium, hit.t)),
                                   wp.cw_mul(vertex.reflectance, E))

            # 3. the next vertex: in the water, or the surface at the segment's end
            if brightest(throughput) <= 0.0:
                break
            u = uniforms(key, pixel, sample, dimension + 2)
            dimension += 3
            on_surface = int(1)
            if wp.static(spec.medium):
                if scatterings < max_scatterings:
                    flight = sample_flight(scene.medium, throughput, hit.t, u[0], u[1])
                    on_surface = flight.ends_on_surface
                    throughput = wp.cw_mul(throughput, flight.weight)
                    if on_surface == 0:
                        vertex = water_vertex(here + flight.t * d, d)
                        scatterings += 1
                else:
                    throughput = wp.cw_mul(throughput, transmittance(scene.medium, hit.t))
            if on_surface == 1:
                if hit.face < 0 or bounces >= max_bounces:
                    break
                bounces += 1

            # 4. roulette on the light still to be expected; unbiased, and ends every walk. The square root and the
            # floor keep survivors from weighing much more than the rest (measured: 0.3 has the least error x time)
            albedo = wp.where(on_surface == 1, brightest(vertex.reflectance), 1.0)
            expected = albedo * brightest(throughput) / brightest(start_throughput)
            expected *= wp.sqrt(lamp_light_at(scene, vertex.p) / light_at_start)
            survival = wp.clamp(expected, 0.3, 0.95)
            if u[2] >= survival:
                break
            throughput /= survival
        return L

    @wp.kernel(module="unique", enable_backward=False)
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
        pixel = row * film.m2.shape[2] + col
        strata = film.m2.shape[0]
        direct = wp.vec3(0.0)
        single = wp.vec3(0.0)
        multiple = wp.vec3(0.0)
        m2 = wp.vec3(0.0)
        count = float(0.0)
        for sample in range(stratum * spp / strata, (stratum + 1) * spp / strata):
            u = uniforms(key, pixel, sample, 0)
            ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
            hit = first_hit(scene, ray.o, ray.d)
            T = transmittance(scene.medium, hit.t)
            L_direct = wp.vec3(0.0)
            L_single = wp.vec3(0.0)
            L_multiple = wp.vec3(0.0)
            surface = Vertex()

            # direct: lamp -> surface -> camera
            if hit.face >= 0:
                surface = surface_vertex(scene, hit, ray.d)
                if wp.static(spec.direct) and max_bounces > 0:
                    for i in range(scene.lights.shape[0]):
                        L_direct += reflected(scene, scene.lights[i], hit, surface.n)
                    L_direct = wp.cw_mul(wp.cw_mul(T, surface.reflectance), L_direct)

            # single: lamp -> water -> camera
            if wp.static(spec.medium and spec.single):
                if max_scatterings > 0:
                    for i in range(scene.lights.shape[0]):
                        light = scene.lights[i]
                        lit = lit_interval(light, ray.o, ray.d, hit.t)
                        u = uniforms(key, pixel, sample, 8 + i)
                        L_single += in_scattered(scene, light, lit, ray.o, ray.d, u[0])

            # multiple: two walks, one from the water and one from the surface
            if wp.static(spec.multiple and spec.medium):
                if max_scatterings > 0:
                    u = uniforms(key, pixel, sample, 1)
                    near = lamp_distance(scene, ray.o)
                    t = sample_first_scattering(scene.medium, near, hit.t, u[0], u[1])
                    throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t))
                    throughput /= first_scattering_pdf(scene.medium, near, hit.t, t)
                    if brightest(throughput) > 0.0:
                        L_multiple += walk(scene, water_vertex(ray.o + t * ray.d, ray.d), throughput, 1, 0,
                                           max_scatterings, max_bounces, key, pixel, sample, 1 << 10)
            if wp.static(spec.multiple):
                if hit.face >= 0 and max_bounces > 0 and brightest(T) > 0.0:
                    L_multiple += walk(scene, surface, T, 0, 1, max_scatterings, max_bounces,
                                       key, pixel, sample, 1 << 20)

            count += 1.0
            before = direct + single + multiple
            direct += (L_direct - direct) / count
            single += (L_single - single) / count
            multiple += (L_multiple - multiple) / count
            m2 += deviation_product(L_direct + L_single + L_multiple, before, direct + single + multiple)
        film.direct[stratum, row, col] = direct
        film.single[stratum, row, col] = single
        film.multiple[stratum, row, col] = multiple
        film.m2[stratum, row, col] = m2

    return trace_paths
