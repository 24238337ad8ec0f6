"""Image A by the textbook: a plain path tracer, the judge of the other integrators.

Free flights, the phase function and what the surface does with light as the only sampling, one shadow ray per lamp at
every vertex, roulette on the throughput. It has the same expectation as the others with far more noise, and shares with
them what the world is (rays, lamps, water, materials), but not how light is carried through it.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.film.film import Film, Sums, add_sample, store
from varos_warp.kernels.sampling import uniforms
from varos_warp.kernels.transport.next_event import irradiance
from varos_warp.kernels.world.bsdf import sample_surface, sample_weight, surface_eval
from varos_warp.kernels.world.camera import Camera, camera_ray
from varos_warp.kernels.world.intersect import Hit, SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import brightest, light_sample
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.phase import phase_eval, phase_sample
from varos_warp.kernels.world.texture import WALK_ANGLE, Surface, footprint_width

wp.set_module_options({"enable_backward": False})

SURVIVAL = wp.constant(0.95)
"""Most that roulette lets a path survive with; in water that absorbs nothing the throughput alone would never end it.
"""


@wp.func
def free_flight(sigma_t: wp.vec3, throughput: wp.vec3, u: float, v: float):
    """Distance [m] to where the water next stops light of one channel; infinite where it never does.

    The channel is drawn in proportion to the throughput, so that no other one comes to weigh much more (Wilkie et al.
    2014, "Hero Wavelength Spectral Sampling").
    """
    x = u * (throughput[0] + throughput[1] + throughput[2])
    c = wp.where(x < throughput[0], 0, wp.where(x < throughput[0] + throughput[1], 1, 2))
    return wp.where(sigma_t[c] > 0.0, -wp.log(1.0 - v) / sigma_t[c], wp.inf)


@wp.func
def balance(throughput: wp.vec3, f: wp.vec3, pdf: wp.vec3):
    """Throughput after an event of value ``f`` that free_flight draws with density ``pdf[c]`` in channel c."""
    return wp.cw_mul(throughput, f) * ((throughput[0] + throughput[1] + throughput[2]) / wp.dot(throughput, pdf))


@cache
def make_reference_kernel(direct: bool, single: bool, multiple: bool, instances: bool, textures: bool) -> wp.Kernel:
    """The kernel that renders a film's parts from ``first`` on.

    Args:
        direct: whether light of one event, a reflection, counts.
        single: whether light of one event, a scattering, counts.
        multiple: whether light of more events counts.
        instances: whether something stands in many places.
        textures: whether some material is more than one constant reflectance.
    """
    first_hit, visible = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.func
    def scattered(scene: SceneData, p: wp.vec3, d: wp.vec3, v: wp.vec2):
        """Light of every lamp that water at ``p`` scatters into a ray along ``d``, per unit sigma_s."""
        L = wp.vec3(0.0)
        for i in range(scene.lights.shape[0]):
            sample = light_sample(scene.lights[i], p, v)
            apart = d - sample.d
            arriving = phase_eval(scene.medium.phase, 0.5 * wp.dot(apart, apart)) * irradiance(scene.medium, sample)
            if brightest(arriving) > 0.0:
                if visible(scene, p, sample.p):
                    L += arriving
        return L

    @wp.func
    def reflected(scene: SceneData, hit: Hit, n: wp.vec3, surface: Surface, d: wp.vec3, v: wp.vec2):
        """Light of every lamp that the surface at ``hit`` reflects against a ray along ``d``."""
        L = wp.vec3(0.0)
        for i in range(scene.lights.shape[0]):
            sample = light_sample(scene.lights[i], hit.p, v)
            if wp.dot(sample.d, hit.n) > 0.0:
                f = surface_eval(scene.lobe_albedo, surface, n, -d, sample.d)
                arriving = wp.cw_mul(f, irradiance(scene.medium, sample))
                if brightest(arriving) > 0.0:
                    if visible(scene, hit.start, sample.p):
                        L += arriving
        return L

    @wp.kernel(module="unique", enable_backward=False)
    def trace_reference(
        scene: SceneData,
        camera: Camera,
        first: int,
        max_scatterings: int,
        max_bounces: int,
        key: wp.uint32,
        # out
        film: Film,
    ):
        i = first + wp.tid()
        part = film.parts[i]
        row, col = part.row, part.col
        pixel = row * film.sums.shape[2] + col
        sums = Sums()
        for sample in range(part.begin, part.end):
            L_direct = wp.vec3(0.0)
            L_single = wp.vec3(0.0)
            L_multiple = wp.vec3(0.0)
            u = uniforms(key, pixel, sample, 0)
            ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
            o = ray.o
            d = ray.d
            throughput = wp.vec3(1.0)
            scatterings = int(0)
            bounces = int(0)
            alive = bool(True)
            while alive:
                events = scatterings + bounces
                u = uniforms(key, pixel, sample, 2 * events + 1)
                v = uniforms(key, pixel, sample, 2 * events + 2)

                # to the next vertex: in the water or on a surface, and the light of the lamps there
                L = wp.vec3(0.0)
                hit = first_hit(scene, o, d)
                t = free_flight(scene.medium.sigma_t, throughput, u[0], u[1])
                in_water = t < hit.t
                if in_water:
                    alive = scatterings < max_scatterings
                    scatterings += 1
                    if alive:
                        T = transmittance(scene.medium, t)
                        f = wp.cw_mul(scene.medium.sigma_s, T)
                        throughput = balance(throughput, f, wp.cw_mul(scene.medium.sigma_t, T))
                        o += t * d
                        L = wp.cw_mul(throughput, scattered(scene, o, d, wp.vec2(u[2], u[3])))
                        d = phase_sample(scene.medium.phase, d, v[0], v[1])
                else:
                    alive = hit.face >= 0 and bounces < max_bounces
                    bounces += 1
                    if alive:
                        T = transmittance(scene.medium, hit.t)
                        throughput = balance(throughput, T, T)
                        n = shading_normal(scene, hit)
                        angle = wp.where(events == 0, camera.pixel_angle, WALK_ANGLE)
                        surface = hit_surface(scene, hit, n, footprint_width(angle, hit.t, d, hit.n))
                        L = wp.cw_mul(throughput, reflected(scene, hit, n, surface, d, wp.vec2(u[2], u[3])))
                        viewer = -d
                        d = sample_surface(surface, n, viewer, v[0], v[1], v[2])
                        throughput = wp.cw_mul(throughput, sample_weight(scene.lobe_albedo, surface, n, viewer, d))
                        alive = wp.dot(d, hit.n) > 0.0
                        o = hit.start

                # the layer that it belongs to
                if events > 0:
                    L_multiple += L
                elif in_water:
                    L_single = L
                else:
                    L_direct = L
                if not wp.static(multiple):
                    alive = False

                # roulette
                survival = wp.min(brightest(throughput), SURVIVAL)
                alive = alive and v[3] < survival
                throughput /= wp.max(survival, 1.0e-30)
            if not wp.static(direct):
                L_direct = wp.vec3(0.0)
            if not wp.static(single):
                L_single = wp.vec3(0.0)
            sums = add_sample(sums, sample, L_direct, L_single, L_multiple, wp.vec3(0.0))
        store(film, i, sums)

    return trace_reference
