"""The floor to stay above: a plain one-kernel path tracer, as one would write it first.

Free flights, the phase function and the cosine as the only sampling, one shadow ray per lamp at every vertex, roulette
on the throughput. It has the same expectation as ``varos_warp.kernels.path``, with far more noise.
"""

from functools import cache

import warp as wp

from varos_warp.kernels.camera import Camera, camera_ray
from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.intersect import Hit, SceneData, make_hit_surface, make_rays
from varos_warp.kernels.light import Light, brightest, falloff
from varos_warp.kernels.medium import transmittance
from varos_warp.kernels.phase import hg_eval, hg_sample
from varos_warp.kernels.sampling import sample_cosine, uniforms
from varos_warp.kernels.single_scatter import lamp_beam
from varos_warp.kernels.texture import WALK_ANGLE, footprint_width

wp.set_module_options({"enable_backward": False})

first_hit, visible = make_rays(instances=False)


@wp.func
def scattered(scene: SceneData, p: wp.vec3, d: wp.vec3):
    """Light of every lamp that scatters at ``p`` into the ray ``d``, per unit sigma_s."""
    L = wp.vec3(0.0)
    for i in range(scene.lights.shape[0]):
        light = scene.lights[i]
        offset = light.position - p
        distance = wp.length(offset)
        to_light = offset / distance
        share = falloff(light, -wp.dot(to_light, light.axis)) / (distance * distance)
        if share > 0.0:
            if visible(scene, p, light.position):
                share *= hg_eval(1.0 - wp.dot(d, to_light), scene.medium.g)
                L += share * wp.cw_mul(light.intensity, transmittance(scene.medium, distance))
    return L


@wp.func
def reflected(scene: SceneData, light: Light, hit: Hit, n: wp.vec3):
    """Radiance of a white Lambertian surface at ``hit`` lit by one lamp."""
    E = wp.max(wp.dot(n, wp.normalize(light.position - hit.p)), 0.0) * lamp_beam(scene, light, hit.p)
    if wp.max(E) <= 0.0:
        return E
    if not visible(scene, hit.start, light.position):
        return wp.vec3(0.0)
    return E / wp.pi


@cache
def make_plain_kernel(textures: bool) -> wp.Kernel:
    """The kernel, for scenes with or without textures; instances are not for it."""
    hit_surface = make_hit_surface(textures)

    @wp.kernel(module="unique", enable_backward=False)
    def trace_plainly(
        scene: SceneData,
        camera: Camera,
        first_row: int,
        spp: int,
        key: wp.uint32,
        # out
        mean: wp.array2d(dtype=wp.vec3),  # [W/sr/m^2], shape [height, width]
        squares: wp.array2d(dtype=wp.vec3),  # mean of the squared samples
    ):
        tile_row, col = wp.tid()
        row = first_row + tile_row
        pixel = row * mean.shape[1] + col
        total = wp.vec3(0.0)
        total2 = wp.vec3(0.0)
        for sample in range(spp):
            u = uniforms(key, pixel, sample, 0)
            ray = camera_ray(camera, float(col) + u[0], float(row) + u[1], wp.vec2(u[2], u[3]))
            o = ray.o
            d = ray.d
            L = wp.vec3(0.0)
            throughput = wp.vec3(1.0)
            for depth in range(1, 256):
                hit = first_hit(scene, o, d)
                u = uniforms(key, pixel, sample, 2 * depth)
                v = uniforms(key, pixel, sample, 2 * depth + 1)
                c = wp.min(int(3.0 * u[0]), 2)
                sigma = scene.medium.sigma_t[c]
                t = wp.where(sigma > 0.0, -wp.log(1.0 - u[1]) / wp.max(sigma, 1.0e-30), FAR)
                if t < hit.t:
                    T = transmittance(scene.medium, t)
                    throughput = 3.0 * wp.cw_mul(throughput, wp.cw_mul(scene.medium.sigma_s, T))
                    throughput /= wp.dot(scene.medium.sigma_t, T)
                    o = o + t * d
                    L += wp.cw_mul(throughput, scattered(scene, o, d))
                    d = hg_sample(d, scene.medium.g, v[0], v[1])
                else:
                    if hit.face < 0:
                        break
                    T = transmittance(scene.medium, hit.t)
                    throughput = 3.0 * wp.cw_mul(throughput, T) / (T[0] + T[1] + T[2])
                    angle = wp.where(depth == 1, camera.pixel_angle, WALK_ANGLE)
                    footprint = footprint_width(angle, hit.t, d, hit.n)
                    throughput = wp.cw_mul(throughput, hit_surface(scene, hit, hit.n, footprint).reflectance)
                    for i in range(scene.lights.shape[0]):
                        L += wp.cw_mul(throughput, reflected(scene, scene.lights[i], hit, hit.n))
                    o = hit.start
                    d = sample_cosine(hit.n, v[0], v[1])
                survival = wp.min(brightest(throughput), 0.95)
                if v[2] >= survival:
                    break
                throughput /= survival
            total += L
            total2 += wp.cw_mul(L, L)
        mean[row, col] = total / float(spp)
        squares[row, col] = total2 / float(spp)

    return trace_plainly
