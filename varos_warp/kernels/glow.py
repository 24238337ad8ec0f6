"""The residual of a pixel: what surfaces block of the scattered light that the tables send to the one it sees, and add.

It has samples of its own, for it needs fewer than the edges and shadows of a pixel do. With them goes the halo of
bright surfaces: lamp light of those that the camera sees close by, which the water bends into the pixel's ray.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.conventions import LONG_KERNEL
from varos_warp.kernels.film.film import Film, is_finite, of_tile, start_of, weight_of
from varos_warp.kernels.residual import draw, halo_share
from varos_warp.kernels.transport.next_event import gather_reflected
from varos_warp.kernels.transport.subpath import Walk, lamp_light_at, surface_vertex, walk_from_surface
from varos_warp.kernels.world.bsdf import surface_albedo
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import brightest
from varos_warp.kernels.world.medium import sample_truncated_exponential, transmittance, truncated_exponential_pdf
from varos_warp.kernels.world.phase import phase_sample
from varos_warp.kernels.world.texture import WALK_ANGLE, footprint_width

wp.set_module_options({"enable_backward": False})


FULL_SHARE, LEAST_SHARE = wp.constant(2.0), wp.constant(0.25)
"""Walks start everywhere where a surface may send half of what the image has on average; from darker ones in
proportion, but not under the second number."""


@wp.func
def thinned(scene: SceneData, walk: Walk, level: float, u: float):
    """Roulette before a walk starts, where a surface, even lit, is dark beside the image's ``level`` (0: none)."""
    after = walk
    if level > 0.0 and walk.vertex.surface.metal == 0.0:
        reflected = brightest(wp.cw_mul(walk.throughput, surface_albedo(walk.vertex.surface)))
        lit = reflected * lamp_light_at(scene, walk.vertex.p) / wp.pi
        share = wp.clamp(FULL_SHARE * lit / level, LEAST_SHARE, 1.0)
        if u >= share:
            after.alive = 0
        after.throughput /= share
        after.expected_at_start /= share
    return after


@cache
def make_start_glow_kernel(instances: bool, textures: bool) -> wp.Kernel:
    """Starts of walks on what the pixels see, and their halo."""
    first_hit, visible = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.kernel(**LONG_KERNEL)
    def start_glow(
        scene: SceneData,
        camera: Camera,
        first: int,
        width: int,
        halo: float,
        level: float,
        key: wp.uint32,
        places: wp.array(dtype=int),  # the pixels,
        points: wp.array(dtype=int),  # and which of its samples each start is
        # out
        starts: wp.array(dtype=Walk),
        light: wp.array(dtype=wp.vec3),
    ):
        i = first + wp.tid()
        pixel = places[i]
        row = pixel / width
        col = pixel % width
        u = draw(key, pixel, points[i], 0)
        v = draw(key, pixel, points[i], 1)
        w = draw(key + wp.uint32(1), pixel, points[i], 0)
        ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
        o = ray.o
        d = ray.d
        angle = camera.pixel_angle
        start = Walk()
        throughput = wp.vec3(1.0)
        L = wp.vec3(0.0)
        # first along the pixel's ray, then along one that is bent at a place before its end
        leg = int(0)
        while leg < 2:
            hit = first_hit(scene, o, d)
            if hit.face >= 0:
                n = shading_normal(scene, hit)
                surface = hit_surface(scene, hit, n, footprint_width(angle, hit.t, d, hit.n))
                vertex = surface_vertex(hit, d, n, surface)
                if leg == 0:
                    start = thinned(scene, walk_from_surface(scene, vertex, hit.t), level, v[2])
                share = halo_share(ray.o, ray.d, hit.p, halo)
                if leg == 1 and share > 0.0:
                    reflected = gather_reflected(scene, hit, vertex, w[2])
                    if brightest(reflected.L) > 0.0:
                        if visible(scene, reflected.p, scene.lights[reflected.lamp].position):
                            throughput = wp.cw_mul(throughput, transmittance(scene.medium, hit.t))
                            L = share * wp.cw_mul(throughput, reflected.L)
            if leg == 0:
                c = wp.min(int(3.0 * w[0]), 2)
                t = sample_truncated_exponential(scene.medium.sigma_t[c], hit.t, w[1])
                pdf = float(0.0)
                for channel in range(3):
                    pdf += truncated_exponential_pdf(scene.medium.sigma_t[channel], hit.t, t) / 3.0
                throughput = wp.cw_mul(scene.medium.sigma_s, transmittance(scene.medium, t)) / pdf
                o = o + t * d
                d = phase_sample(scene.medium.phase, d, v[0], v[1])
                angle = WALK_ANGLE
            leg += 1
        starts[i] = start
        light[i] = L

    return start_glow


@wp.kernel(enable_backward=False)
def count_starts(
    film: Film,
    metal_samples: int,
    # out
    counts: wp.array(dtype=int),  # per pixel
):
    """Samples that each pixel is to take."""
    pixel = wp.tid()
    row = pixel / film.residual.shape[1]
    col = pixel % film.residual.shape[1]
    counts[pixel] = of_tile(film.wanted, row, col) * weight_of(film, metal_samples, row, col)


@wp.kernel(enable_backward=False)
def list_starts(
    ends: wp.array(dtype=int),  # running sum of the samples over the pixels
    taken: wp.array2d(dtype=int),  # samples that pixels have
    begin: int,
    end: int,
    # out
    places: wp.array(dtype=int),  # of the samples ``begin`` to ``end`` of all
    points: wp.array(dtype=int),
):
    """Write down pixel and number of each sample, pixel by pixel."""
    pixel = wp.tid()
    start = start_of(ends, pixel)
    for i in range(wp.max(start, begin), wp.min(ends[pixel], end)):
        places[i - begin] = pixel
        points[i - begin] = taken[pixel / taken.shape[1], pixel % taken.shape[1]] + i - start


@wp.kernel(enable_backward=False)
def add_residual(
    ends: wp.array(dtype=int),
    light: wp.array(dtype=wp.vec3),  # of the samples ``begin`` to ``end`` of all
    begin: int,
    end: int,
    # out
    film: Film,
):
    """Add samples of the residual to the film."""
    row, col = wp.tid()
    pixel = row * film.residual.shape[1] + col
    start = start_of(ends, pixel)
    for i in range(wp.max(start, begin), wp.min(ends[pixel], end)):
        if is_finite(light[i - begin]):
            L = wp.vec3d(light[i - begin])
            film.residual[row, col] += L
            film.residual_squares[row, col] += wp.cw_mul(L, L)
        else:
            wp.atomic_add(film.lost, 0, 1)


@wp.kernel(enable_backward=False)
def add_counts(counts: wp.array(dtype=int), film: Film):
    """Note the samples that pixels took."""
    row, col = wp.tid()
    film.residual_count[row, col] += counts[row * film.residual.shape[1] + col]
