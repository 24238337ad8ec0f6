"""What surfaces do to the light of open water: what they keep away, and what they send.

Two kinds of walk, both from the same starts: on the surfaces that pixels see (kernels/glow.py), and in the water before
the camera (kernels/veil.py). `block_light` walks through water without end and counts the light of every connection
that something blocks: subtracted from what the tables hold it makes them right, and where nothing stands in the way it
is exactly zero. `reflect_light` walks from surface to surface and takes lamp light and scattered light off each, so
that every path is counted once: by the last surface that it meets on its way from the lamp, or by the tables of the
water if it meets none.

Metals see the water in their lobes. No table has that, so walks that leave one gather it on the way.

A thread takes one start after the other and goes on segment by segment: where walks end early, the threads beside
need not wait (path regeneration, Novak et al. 2010).
"""

from functools import cache

import warp as wp

from varos_warp.kernels.conventions import ALL, FAR, LONG_KERNEL
from varos_warp.kernels.field.open_water import Tables, scattered_irradiance
from varos_warp.kernels.sampling import Pick, reservoir, uniforms
from varos_warp.kernels.transport.next_event import gather_in_scattered, gather_reflected
from varos_warp.kernels.transport.sobol import sobol4
from varos_warp.kernels.transport.subpath import (
    Vertex,
    Walk,
    advance,
    drift,
    expected_light,
    lamps_in_lobe,
    own_lobe_pdf,
    surface_vertex,
    turn,
)
from varos_warp.kernels.transport.virtual_lights import LitPoint, found_weight, gather_lit_point, may_have_lobe
from varos_warp.kernels.world.intersect import SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import brightest
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import WALK_ANGLE, footprint_width

wp.set_module_options({"enable_backward": False})

LOW_DIMENSIONS = wp.constant(14)
"""So many groups of four numbers are low-discrepancy points; what comes after has hardly any use for it."""
HANDED_SHARE = wp.constant(0.25)
"""Share of the walks that hand a surface on: what is blocked of its glow is little."""


@wp.func(inline=False)
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
def lamp_share_at(turns: int):
    """Share of directions and flights to draw around the lamps, after so many turns of a walk.

    What goes another way weighs up to 1 / (1 - share) as much, twice a turn. With a half at every turn weights in water
    that absorbs nothing grew so fast that of a million walks one or two decided what the veil was. With none, light
    next to the lamps would be as rare and as bright.
    """
    return wp.where(turns < 4, 0.5, 0.1)


@wp.struct
class Connection:
    """Light that goes from ``q`` to ``p`` if nothing stands between them."""

    p: wp.vec3
    q: wp.vec3
    L: wp.vec3


@wp.func
def halo_share(eye: wp.vec3, d: wp.vec3, p: wp.vec3, width: float):
    """Share of the light of a surface at ``p`` that belongs to the halo of a ray from ``eye``, and not to the grid.

    All of it within an angle ``width`` [rad] of the ray as the camera sees it, none beyond three times that. What is
    farther off in the image changes little from one node of the grid to the next.
    """
    apart = wp.length(wp.normalize(p - eye) - d)
    if apart >= 3.0 * width:
        return 0.0
    x = wp.max(apart - width, 0.0) / (2.0 * width)
    return 1.0 - x * x * (3.0 - 2.0 * x)


@wp.kernel(enable_backward=False)
def list_walks(
    starts: wp.array(dtype=Walk),
    places: wp.array(dtype=int),
    points: wp.array(dtype=int),
    metals: int,  # 1: walks from metals too
    share: float,  # of the walks to take
    key: wp.uint32,
    # out
    listed: wp.array(dtype=int),
    number: wp.array(dtype=int),  # one number, 0 before
):
    """Write down the starts that walks leave from, in any order: among many others they would leave threads idle."""
    i = wp.tid()
    if starts[i].alive == 0:
        return
    if metals == 0 and starts[i].vertex.on_surface == 1 and starts[i].vertex.surface.metal > 0.0:
        return
    if share < 1.0 and draw(key + wp.uint32(1), places[i], points[i], 1)[1] >= share:
        return
    listed[wp.atomic_add(number, 0, 1)] = i


@cache
def make_block_kernel(instances: bool) -> wp.Kernel:
    """What surfaces keep from each start of the light that open water would send it."""
    _, visible = make_rays(instances)

    @wp.kernel(**LONG_KERNEL)
    def block_light(
        scene: SceneData,
        first: int,
        threads: int,
        taken: wp.array(dtype=int),  # one number, 0 before: walks taken beyond the first of every thread
        listed: wp.array(dtype=int),  # of list_walks
        number: wp.array(dtype=int),
        starts: wp.array(dtype=Walk),
        places: wp.array(dtype=int),
        points: wp.array(dtype=int),
        share: float,  # of all that might, so many walk
        key: wp.uint32,
        # out
        light: wp.array(dtype=wp.vec3),  # what is blocked is subtracted
    ):
        k = first + wp.tid()
        i = int(0)
        fresh = bool(True)
        clear = bool(True)
        walk = Walk()
        before = wp.vec3(0.0)
        L = wp.vec3(0.0)
        group = int(0)
        turns = int(0)
        while k < number[0]:
            if fresh:
                i = listed[k]
                walk = starts[i]
                turns = 0
                walk.throughput /= share
                walk.expected_at_start = expected_light(scene, walk)
                before = walk.vertex.p
                clear = True
                L = wp.vec3(0.0)
                group = int(8)
                fresh = False
            if walk.alive == 1:
                u = draw(key, places[i], points[i], group)
                v = draw(key, places[i], points[i], group + 1)
                w = draw(key, places[i], points[i], group + 2)
                group += 3
                # the tables know of one normal only: light between it and the surface is blocked like any other
                facing = walk.vertex.n_geometric
                walk.vertex.n_geometric = walk.vertex.n
                lamp_share = lamp_share_at(turns)
                turns += 1
                walk = turn(scene, walk, lamp_share, u, v)
                if walk.alive == 1:
                    p = walk.vertex.p
                    if walk.vertex.on_surface == 1:
                        clear = wp.dot(walk.vertex.d, facing) > 0.0
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
                    walk = drift(scene, walk, lamp_share, wp.vec4(w[2], w[3], v[2], 0.0))
            if walk.alive == 0:
                light[i] -= L
                k = threads + wp.atomic_add(taken, 0, 1)
                fresh = True

    return block_light


@cache
def make_reflect_kernel(instances: bool, textures: bool) -> wp.Kernel:
    """What surfaces send to each start; after a metal also what the water does, up to the next surface."""
    first_hit, visible = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.kernel(**LONG_KERNEL)
    def reflect_light(
        scene: SceneData,
        first: int,
        threads: int,
        taken: wp.array(dtype=int),  # one number, 0 before: walks taken beyond the first of every thread
        listed: wp.array(dtype=int),  # of list_walks
        number: wp.array(dtype=int),
        starts: wp.array(dtype=Walk),  # in the end those of what is blocked of the glow that walks met
        places: wp.array(dtype=int),
        points: wp.array(dtype=int),
        tables: Tables,
        lit_points: wp.array(dtype=LitPoint),
        max_bounces: int,
        eye: wp.vec3,
        halo: float,
        key: wp.uint32,
        # out
        light: wp.array(dtype=wp.vec3),  # added to
    ):
        k = first + wp.tid()
        i = int(0)
        fresh = bool(True)
        at_start = bool(True)
        sees_water = bool(False)
        walk = Walk()
        L = wp.vec3(0.0)
        weights = float(0.0)
        pick = Pick()
        group = int(0)
        while k < number[0]:
            if fresh:
                i = listed[k]
                walk = starts[i]
                sees_water = walk.vertex.on_surface == 1 and walk.vertex.surface.metal > 0.0
                at_start = walk.vertex.on_surface == 0
                L = wp.vec3(0.0)
                weights = float(0.0)
                pick.u = draw(key + wp.uint32(1), places[i], points[i], 1)[0]
                pick.index = 0
                group = int(2)
                fresh = False
            if walk.alive == 1:
                u = draw(key, places[i], points[i], group)
                v = draw(key, places[i], points[i], group + 1)
                w = draw(key, places[i], points[i], group + 2)
                group += 3
                # a lit point, or what a metal sees on the way to the next surface; and lamp light off that surface
                connection = Connection()
                second = Connection()
                connection.p = walk.vertex.p
                if not sees_water and walk.bounces < max_bounces:
                    seen = gather_lit_point(scene, lit_points, walk.vertex, u[0], u[1])
                    connection.q = seen.p
                    connection.L = wp.cw_mul(walk.throughput, seen.L)
                    if at_start:
                        connection.L *= 1.0 - halo_share(eye, walk.vertex.d, seen.p, halo)
                lamp_share = float(0.0)
                if wp.static(textures):
                    if sees_water:
                        lamp_share = lamps_in_lobe(scene, walk.vertex)
                before = walk.vertex
                walk = turn(scene, walk, lamp_share, u, v)
                if walk.alive == 1:
                    d = walk.vertex.d
                    hit = first_hit(scene, walk.vertex.p, d)
                    end = Vertex()
                    if wp.static(textures):
                        if sees_water:
                            scattered = gather_in_scattered(scene, walk.vertex.p, d, hit.t, w[0], w[1])
                            connection.p = scattered.p
                            connection.q = scene.lights[wp.max(scattered.lamp, 0)].position
                            connection.L = wp.cw_mul(walk.throughput, scattered.L)
                    if hit.face >= 0 and walk.bounces < max_bounces:
                        n = shading_normal(scene, hit)
                        surface = hit_surface(scene, hit, n, footprint_width(WALK_ANGLE, hit.t, d, hit.n))
                        end = surface_vertex(hit, d, n, surface)
                        throughput = wp.cw_mul(walk.throughput, transmittance(scene.medium, hit.t))
                        reflected = gather_reflected(scene, hit, end, w[2])
                        second.p = reflected.p
                        second.q = scene.lights[wp.max(reflected.lamp, 0)].position
                        second.L = wp.cw_mul(throughput, reflected.L)
                        if at_start:
                            second.L *= 1.0 - halo_share(eye, before.d, hit.p, halo)
                        if not sees_water and not may_have_lobe(scene, hit) and brightest(second.L) > 0.0:
                            pdf = own_lobe_pdf(scene, before, d)
                            second.L *= found_weight(scene, pdf, d, hit.t, reflected.lamp, hit.p, hit.n)
                        L_glow = wp.cw_mul(throughput, glow(scene, tables, end))
                        L += L_glow
                        # one such surface is handed on, to find what is blocked of its glow
                        weight = brightest(L_glow)
                        weights += weight
                        pick = reservoir(pick, 1, weight, weights)
                        if pick.index == 1:
                            pick.index = 0
                            met = walk
                            met.vertex = end
                            met.throughput = throughput / weight
                            starts[i] = met
                    at_start = False
                    walk = advance(scene, walk, hit, end, ALL, max_bounces, wp.vec4(w[3], v[2], v[3], 0.0))
                    if walk.vertex.on_surface == 1:
                        sees_water = walk.vertex.surface.metal > 0.0
                    if walk.bounces >= max_bounces and not sees_water:
                        walk.alive = 0
                count = int(0)
                while count < 2:  # not a range, which would be unrolled and compiled twice
                    if brightest(connection.L) > 0.0:
                        if visible(scene, connection.p, connection.q):
                            L += connection.L
                    connection = second
                    count += 1
            if walk.alive == 0:
                light[i] += L
                starts[i].alive = 0
                if weights > 0.0 and pick.u < HANDED_SHARE:
                    handed = starts[i]
                    handed.alive = 1
                    handed.throughput *= weights / HANDED_SHARE
                    starts[i] = handed
                k = threads + wp.atomic_add(taken, 0, 1)
                fresh = True

    return reflect_light
