"""What surfaces do to the light of open water: what they keep away, and what they send.

Two walks, for the pixels of kernels/tables.py and the grid of kernels/veil.py alike. `blocked_light` walks through
water without end and counts the light of every connection that something blocks: subtracted from what the tables hold
it makes them right, and where nothing stands in the way it is exactly zero. `surface_light` walks from surface to
surface and takes lamp light and scattered light off each, so that every path is counted once: by the last surface that
it meets on its way from the lamp, or by the tables of the water if it meets none.

Metals see the water in their lobes. No table has that, so walks that leave one gather it on the way.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.conventions import ALL, FAR
from varos_warp.kernels.gather import gather_in_scattered, gather_reflected
from varos_warp.kernels.intersect import Hit, SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.light import brightest
from varos_warp.kernels.lit_points import LitPoint, found_weight, gather_lit_point
from varos_warp.kernels.medium import transmittance
from varos_warp.kernels.open_water import Tables, scattered_irradiance
from varos_warp.kernels.sampling import uniforms
from varos_warp.kernels.sobol import sobol4
from varos_warp.kernels.surface import surface_albedo
from varos_warp.kernels.texture import WALK_ANGLE, footprint_width
from varos_warp.kernels.walk import (
    Vertex,
    Walk,
    advance,
    drift,
    expected_light,
    own_lobe_pdf,
    surface_vertex,
    turn,
    water_vertex,
)

wp.set_module_options({"enable_backward": False})

LOW_DIMENSIONS = wp.constant(12)
"""So many groups of four numbers are low-discrepancy points; what comes after has hardly any use for it."""


@wp.func
def draw(key: wp.uint32, pixel: int, sample: int, group: int):
    """Four numbers in [0, 1): two pairs of a Sobol sequence, or independent ones far down a walk."""
    if group < LOW_DIMENSIONS:
        return sobol4(key, pixel, sample, 2 * group)
    return uniforms(key, pixel, sample, group)


@wp.func
def glow(scene: SceneData, tables: Tables, vertex: Vertex):
    """Radiance that a surface reflects of light scattered in open water; none of a metal."""
    E = wp.vec3(0.0)
    if vertex.surface.metal > 0.0:
        return E
    for i in range(scene.lights.shape[0]):
        E += scattered_irradiance(tables.lamp[i], scene.lights[i], vertex.p, vertex.n)
    return wp.cw_mul(vertex.surface.reflectance, E) / wp.pi


@wp.func
def walk_from_surface(scene: SceneData, vertex: Vertex, t: float):
    """Walk that starts with a reflection at the end of the camera's ray of length ``t``."""
    walk = Walk()
    walk.vertex = vertex
    walk.bounces = 1
    walk.throughput = transmittance(scene.medium, t)
    walk.alive = wp.where(brightest(surface_albedo(vertex.surface)) > 0.0, 1, 0)
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


@wp.struct
class Connection:
    """Light that goes from ``q`` to ``p`` if nothing stands between them."""

    p: wp.vec3
    q: wp.vec3
    L: wp.vec3


@cache
def make_blocked_light(instances: bool):
    """The function ``blocked_light(scene, start, key, pixel, sample, group)``."""
    _, visible = make_rays(instances)

    @wp.func
    def blocked_light(scene: SceneData, start: Walk, key: wp.uint32, pixel: int, sample: int, group: int):
        """What surfaces keep from a walk of the light that open water would send it."""
        walk = start
        before = walk.vertex.p
        clear = bool(True)
        L = wp.vec3(0.0)
        k = group
        while walk.alive == 1:
            u = draw(key, pixel, sample, k)
            v = draw(key, pixel, sample, k + 1)
            w = draw(key, pixel, sample, k + 2)
            k += 3
            walk = turn(scene, walk, 0.5, u, v)
            if walk.alive == 1:
                p = walk.vertex.p
                if walk.vertex.on_surface == 1:
                    clear = wp.dot(walk.vertex.d, start.vertex.n_geometric) > 0.0
                scattered = gather_in_scattered(scene, p, walk.vertex.d, FAR, w[0], w[1])
                # along the path, from the last vertex on: is it free up to here, and on to the lamp?
                segments = wp.where(brightest(scattered.L) > 0.0, 3, 1)
                at = before
                free = clear
                segment = int(0)
                while free and segment < segments:
                    to = p
                    if segment == 1:
                        to = scattered.p
                    if segment == 2:
                        to = scene.lights[scattered.lamp].position
                    free = visible(scene, at, to)
                    if segment == 0:
                        clear = free
                    at = to
                    segment += 1
                if not free:
                    L += wp.cw_mul(walk.throughput, scattered.L)
                before = p
                walk = drift(scene, walk, wp.vec4(w[2], w[3], v[2], 0.0))
        return L

    return blocked_light


@cache
def make_surface_light(instances: bool, textures: bool):
    """The function ``surface_light(scene, tables, lit_points, start, max_bounces, key, pixel, sample, group)``."""
    first_hit, visible = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.func
    def surface_light(
        scene: SceneData,
        tables: Tables,
        lit_points: wp.array(dtype=LitPoint),
        start: Walk,
        max_bounces: int,
        key: wp.uint32,
        pixel: int,
        sample: int,
        group: int,
    ):
        """Light that surfaces send to a walk; after a metal also what the water does, up to the next surface."""
        walk = start
        L = wp.vec3(0.0)
        k = group
        sees_water = bool(walk.vertex.on_surface == 1 and walk.vertex.surface.metal > 0.0)
        while walk.alive == 1:
            u = draw(key, pixel, sample, k)
            v = draw(key, pixel, sample, k + 1)
            w = draw(key, pixel, sample, k + 2)
            k += 3
            # a lit point, or on the way to the next surface the water that a metal sees; and lamp light off that surface
            first = Connection()
            first.p = walk.vertex.p
            if not sees_water and walk.bounces < max_bounces:
                seen = gather_lit_point(scene, lit_points, walk.vertex, u[0], u[1])
                first.q = seen.p
                first.L = wp.cw_mul(walk.throughput, seen.L)
            second = Connection()
            lamp_share = float(0.0)
            if wp.static(textures):
                lamp_share = wp.where(sees_water, 0.5, 0.0)
            before = walk.vertex
            walk = turn(scene, walk, lamp_share, u, v)
            hit = Hit()
            end = Vertex()
            if walk.alive == 1:
                d = walk.vertex.d
                hit = first_hit(scene, walk.vertex.p, d)
                if wp.static(textures):
                    if sees_water:
                        scattered = gather_in_scattered(scene, walk.vertex.p, d, hit.t, w[0], w[1])
                        first.p = scattered.p
                        first.q = scene.lights[wp.max(scattered.lamp, 0)].position
                        first.L = wp.cw_mul(walk.throughput, scattered.L)
                if hit.face >= 0 and walk.bounces < max_bounces:
                    n = shading_normal(scene, hit)
                    surface = hit_surface(scene, hit, n, footprint_width(WALK_ANGLE, hit.t, d, hit.n))
                    end = surface_vertex(hit, d, n, surface)
                    throughput = wp.cw_mul(walk.throughput, transmittance(scene.medium, hit.t))
                    reflected = gather_reflected(scene, hit, end, w[2])
                    second.p = reflected.p
                    second.q = scene.lights[wp.max(reflected.lamp, 0)].position
                    second.L = wp.cw_mul(throughput, reflected.L)
                    if not sees_water and surface.metal <= 0.0 and brightest(second.L) > 0.0:
                        pdf = own_lobe_pdf(scene, before, d)
                        second.L *= found_weight(scene, pdf, d, hit.t, reflected.lamp, hit.p, hit.n)
                    L += wp.cw_mul(throughput, glow(scene, tables, end))
            connection = first
            count = int(0)
            while count < 2:  # not a range, which would be unrolled and compiled twice
                if brightest(connection.L) > 0.0:
                    if visible(scene, connection.p, connection.q):
                        L += connection.L
                connection = second
                count += 1
            if walk.alive == 1:
                walk = advance(scene, walk, hit, end, ALL, max_bounces, wp.vec4(w[3], v[2], v[3], 0.0))
                if walk.vertex.on_surface == 1:
                    sees_water = walk.vertex.surface.metal > 0.0
        return L

    return surface_light
