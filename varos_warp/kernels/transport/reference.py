"""Image A by a textbook path tracer, the reference for the other integrators.

It samples only free flights, the phase function and the surface's scattering function, sends one shadow ray to each
light at every vertex, and plays roulette on the throughput. It has the same expectation as the others, and far more
noise. It shares the world with them (rays, lights, water, materials), but not the light transport.
"""

import warp as wp

from varos_warp.kernels.film.film import Film, Sums, add_sample, pixel_of, store
from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampler import draw_independent, make_sampler, next_vertex
from varos_warp.kernels.spec import SceneSpec, specialised
from varos_warp.kernels.transport.moments import Moments, instant_of, place_of, with_points
from varos_warp.kernels.transport.next_event import irradiance
from varos_warp.kernels.world.bsdf import bsdf_eval, bsdf_sample, bsdf_weight
from varos_warp.kernels.world.camera import Camera, Ray, make_sample_ray
from varos_warp.kernels.world.intersect import Hit, SceneData, make_rays
from varos_warp.kernels.world.lights.light import get_light, light_count, light_sample
from varos_warp.kernels.world.lights.record import Light
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.phase import phase_eval, phase_sample
from varos_warp.kernels.world.surface import MATERIALS, SurfacePoint, make_surface_at
from varos_warp.kernels.world.texture import SUBPATH_ANGLE

wp.set_module_options({"enable_backward": False})

FLIGHT, DIRECTION = wp.constant(0), wp.constant(1)
"""What random numbers of a vertex are for."""
SURVIVAL = wp.constant(0.95)
"""Largest survival probability of roulette; in water that absorbs nothing the throughput alone would end no path."""


@wp.func
def free_flight(sigma_t: wp.vec3, throughput: wp.vec3, u: float, v: float):
    """Distance [m] to the next scattering or absorption of one channel; infinite without extinction.

    The channel is drawn in proportion to the throughput, so that the weight of no other becomes much larger (Wilkie et
    al. 2014, "Hero Wavelength Spectral Sampling").
    """
    x = u * (throughput[0] + throughput[1] + throughput[2])
    c = wp.where(x < throughput[0], 0, wp.where(x < throughput[0] + throughput[1], 1, 2))
    return wp.where(sigma_t[c] > 0.0, -wp.log(1.0 - v) / sigma_t[c], wp.inf)


@wp.func
def balance(throughput: wp.vec3, f: wp.vec3, pdf: wp.vec3):
    """Throughput after an event of value ``f`` that free_flight draws with density ``pdf[c]`` in channel c."""
    return wp.cw_mul(throughput, f) * ((throughput[0] + throughput[1] + throughput[2]) / wp.dot(throughput, pdf))


@wp.struct
class PlainPath:
    """A path: its last vertex and the light found there, its next direction, and the throughput."""

    alive: int
    p: wp.vec3
    d: wp.vec3
    throughput: wp.vec3
    L: wp.vec3
    """Light from the lights by way of the last vertex."""
    scatterings: int
    bounces: int


@wp.func
def plain_path(ray: Ray, seen: wp.vec3):
    """A path that starts at the camera; none where nothing of it is ``seen``."""
    path = PlainPath()
    path.alive = int(brightest(seen) > 0.0)
    path.p = ray.o
    path.d = ray.d
    path.throughput = seen
    return path


@wp.func
def roulette(path: PlainPath, u: float):
    """Let a path survive with a probability that follows its throughput."""
    after = path
    survival = wp.min(brightest(path.throughput), SURVIVAL)
    after.alive = wp.where(u < survival, path.alive, 0)
    after.throughput /= wp.max(survival, 1.0e-30)
    return after


@specialised("instances", "masks")
def make_gather(spec: SceneSpec) -> tuple[wp.Function, wp.Function]:
    """The functions ``scattered_light`` and ``reflected_light``, for scenes with or without instances and masks."""
    visible = make_rays(spec).visible

    @wp.func
    def scattered_light(scene: SceneData, p: wp.vec3, d: wp.vec3):
        """Light of all lights that water at ``p`` scatters into a ray along ``d``, per unit sigma_s."""
        L = wp.vec3(0.0)
        for i in range(light_count(scene.lights)):
            sample = light_sample(get_light(scene.lights, i), p)
            apart = d - sample.d
            arriving = phase_eval(scene.medium.phase, 0.5 * wp.dot(apart, apart)) * irradiance(scene.medium, sample)
            if brightest(arriving) > 0.0:
                if visible(scene, p, sample.p):
                    L += arriving
        return L

    @wp.func
    def reflected_light(scene: SceneData, hit: Hit, point: SurfacePoint, d: wp.vec3):
        """Light of all lights that the surface at a hit reflects back along a ray of direction ``d``."""
        L = wp.vec3(0.0)
        for i in range(light_count(scene.lights)):
            sample = light_sample(get_light(scene.lights, i), hit.p)
            if wp.dot(sample.d, point.n_geometric) > 0.0:
                f = bsdf_eval(scene.lobe_albedo, point.bsdf, point.n, -d, sample.d)
                arriving = wp.cw_mul(f, irradiance(scene.medium, sample))
                if brightest(arriving) > 0.0:
                    if visible(scene, point.start, sample.p):
                        L += arriving
        return L

    return scattered_light, reflected_light


@specialised("instances", *MATERIALS, "masks", "bands")
def make_events(spec: SceneSpec) -> tuple[wp.Function, wp.Function]:
    """The functions ``scatter`` and ``reflect``, for scenes with or without instances and textures."""
    surface_at = make_surface_at(spec)
    scattered_light, reflected_light = make_gather(spec)

    @wp.func
    def scatter(scene: SceneData, path: PlainPath, t: float, v: wp.vec4):
        """Scatter a path in the water after ``t``."""
        after = path
        after.scatterings += 1
        T = transmittance(scene.medium, t)
        f = wp.cw_mul(scene.medium.sigma_s, T)
        after.throughput = balance(path.throughput, f, wp.cw_mul(scene.medium.sigma_t, T))
        after.p += t * path.d
        after.L = wp.cw_mul(after.throughput, scattered_light(scene, after.p, path.d))
        after.d = phase_sample(scene.medium.phase, path.d, v[0], v[1])
        return after

    @wp.func
    def reflect(scene: SceneData, path: PlainPath, hit: Hit, angle: float, v: wp.vec4):
        """Reflect a path, whose ray stands for a cone of ``angle``, off a surface."""
        after = path
        after.bounces += 1
        T = transmittance(scene.medium, hit.t)
        throughput = balance(path.throughput, T, T)
        point = surface_at(scene, hit, path.d, angle)
        after.L = wp.cw_mul(throughput, reflected_light(scene, hit, point, path.d))
        after.d = bsdf_sample(point.bsdf, point.n, -path.d, v[0], v[1], v[2])
        weight = bsdf_weight(scene.lobe_albedo, point.bsdf, point.n, -path.d, after.d)
        after.throughput = wp.cw_mul(throughput, weight)
        after.alive = wp.where(wp.dot(after.d, point.n_geometric) > 0.0, 1, 0)
        after.p = point.start
        return after

    return scatter, reflect


@specialised("direct", "single", "multiple", "instances", *MATERIALS, "masks", "bands", "optics", "varies", "disks")
def make_reference_kernel(spec: SceneSpec) -> wp.Kernel:
    """The kernel that renders a film's batches from ``first_row`` on, specialised to ``spec``."""
    first_hit = make_rays(spec).first_hit
    sample_ray = make_sample_ray(spec.optics)
    scatter, reflect = make_events(spec)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_reference(
        scene: SceneData,
        camera: Camera,
        moments: Moments,
        first_row: int,
        max_scatterings: int,
        max_bounces: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first_row + wp.tid()
        batch = film.batches[i]
        sums = Sums()
        if wp.static(spec.disks > 0):
            drawn = wp.zeros(shape=wp.static(spec.disks), dtype=Light)
            lights = scene.lights
        for sample in range(batch.begin, batch.end):
            L_direct = wp.vec3(0.0)
            L_single = wp.vec3(0.0)
            L_multiple = wp.vec3(0.0)
            sampler = make_sampler(key, pixel_of(film, batch), sample)
            u = draw_independent(sampler, 0)
            sampler = next_vertex(sampler, 1)
            if wp.static(spec.varies):
                instant = instant_of(moments, batch.row, sampler)
                scene.lights = moments.lights[instant]
                scene.moving = moments.moving[instant]
                camera = moments.cameras[instant]
            if wp.static(spec.disks > 0):
                if wp.static(spec.varies):
                    lights = scene.lights
                scene = with_points(scene, lights, place_of(sampler), drawn)
            x, y = float(batch.col) + u[0], float(batch.row) + u[1]
            ray, seen = sample_ray(camera, x, y, wp.vec2(u[2], u[3]), sampler)
            path = plain_path(ray, seen)
            while path.alive == 1:
                events = path.scatterings + path.bounces
                u = draw_independent(sampler, FLIGHT)
                v = draw_independent(sampler, DIRECTION)
                sampler = next_vertex(sampler, 2)

                # go to the next vertex, in the water or on a surface
                hit = first_hit(scene, path.p, path.d)
                t = free_flight(scene.medium.sigma_t, path.throughput, u[0], u[1])
                in_water = t < hit.t
                if in_water:
                    if path.scatterings == max_scatterings:
                        break
                    path = scatter(scene, path, t, v)
                else:
                    if hit.face < 0 or path.bounces == max_bounces:
                        break
                    angle = wp.where(events == 0, camera.pixel_angle, SUBPATH_ANGLE)
                    path = reflect(scene, path, hit, angle, v)

                # the layer to which its light belongs
                if events > 0:
                    L_multiple += path.L
                elif in_water:
                    L_single = path.L
                else:
                    L_direct = path.L
                if not wp.static(spec.multiple):
                    path.alive = 0
                path = roulette(path, v[3])
            if not wp.static(spec.direct):
                L_direct = wp.vec3(0.0)
            if not wp.static(spec.single):
                L_single = wp.vec3(0.0)
            sums = add_sample(sums, sample, L_direct, L_single, L_multiple, wp.vec3(0.0))
        store(film, i, sums)

    return trace_reference
