"""Virtual point lights: places on surfaces that rays from the lights meet first, spread over the scene before a frame.

Light that goes light, surface, vertex can be found from the vertex (a ray in a direction of its lobe, that happens to
meet a lit place) or from the light (a virtual point light, that happens to be seen). Each fails where the other is
good: small bright places far away, and places close by. Both are taken, weighted by the power heuristic (Veach and
Guibas 1995), which bounds both and leaves less to rays that seldom find what is near a light. Of several virtual point
lights one is chosen by what it would send without obstacles (resampling, Talbot et al. 2005).
"""

from functools import cache

import warp as wp

from varos_warp.kernels.sampling import Pick, half_key, reservoir
from varos_warp.kernels.transport.next_event import irradiance
from varos_warp.kernels.transport.sobol import sobol4
from varos_warp.kernels.transport.subpath import Vertex, own_lobe_pdf, vertex_eval
from varos_warp.kernels.world.intersect import Hit, SceneData, make_hit_surface, make_rays, shading_normal
from varos_warp.kernels.world.light import brightest, light_emit, light_flux, light_sample, light_solid_angle
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.texture import METAL, WALK_ANGLE, footprint_width

wp.set_module_options({"enable_backward": False})

CANDIDATES = wp.constant(4)
"""Virtual point lights that one is chosen from."""


@wp.struct
class VirtualLight:
    """A place that one light lights."""

    p: wp.vec3
    """Where rays from it start."""
    n: wp.vec3
    """Geometric normal on the lit side."""
    L: wp.vec3
    """Radiance of the light's light off the surface; 0 where the ray met nothing, or a material that may be metal."""
    density: float
    """Of such points per area [1/m^2]."""


@wp.func
def may_have_lobe(scene: SceneData, hit: Hit):
    """Whether a surface's material can be metal: by the material, so that rays of any width agree on it."""
    material = scene.materials[hit.part]
    return material.kind == METAL or material.metallic == 1


@wp.func
def virtual_density(scene: SceneData, i: int, p: wp.vec3, n: wp.vec3):
    """Density per area of virtual point lights of light ``i`` at a place with geometric normal ``n`` that it lights."""
    total = float(0.0)
    for k in range(scene.lights.shape[0]):
        total += light_flux(scene.lights[k])
    sample = light_sample(scene.lights[i], p, wp.vec2(0.5))
    facing = wp.abs(wp.dot(n, sample.d)) / (sample.distance * sample.distance)
    return light_flux(scene.lights[i]) / total * facing / light_solid_angle(scene.lights[i])


@cache
def make_virtual_lights_kernel(instances: bool, textures: bool) -> wp.Kernel:
    """Rays from the lights to their first surfaces."""
    first_hit, _ = make_rays(instances)
    hit_surface = make_hit_surface(textures)

    @wp.kernel(module="unique", enable_backward=False)
    def find_virtual_lights(
        scene: SceneData,
        first: int,
        key: wp.uint32,
        # out
        points: wp.array(dtype=VirtualLight),
    ):
        k = first + wp.tid()
        in_half = points.shape[0] / 2
        u = sobol4(half_key(key, k / in_half), -1, k % in_half, 0)
        total = float(0.0)
        pick = Pick()
        pick.u = u[2]
        for i in range(scene.lights.shape[0]):
            weight = light_flux(scene.lights[i])
            total += weight
            pick = reservoir(pick, i, weight, total)
        light = scene.lights[pick.index]
        ray = light_emit(light, u[0], u[1])
        d = ray.d
        hit = first_hit(scene, ray.o, d)
        point = VirtualLight()
        if hit.face >= 0:
            n = shading_normal(scene, hit)
            surface = hit_surface(scene, hit, n, footprint_width(WALK_ANGLE, hit.t, d, hit.n))
            point.p = hit.start
            point.n = hit.n
            if not may_have_lobe(scene, hit):
                E = wp.max(-wp.dot(n, d), 0.0) * irradiance(scene.medium, light_sample(light, hit.p, wp.vec2(0.5)))
                point.L = wp.cw_mul(surface.reflectance, E) / wp.pi
                point.density = virtual_density(scene, pick.index, hit.p, hit.n)
        points[k] = point

    return find_virtual_lights


@wp.func
def square(x: float):
    """The square."""
    return x * x


@wp.struct
class VirtualConnection:
    """Light of one virtual point light at a vertex, as if nothing stood between the two."""

    p: wp.vec3
    L: wp.vec3


@wp.func
def gather_virtual_light(scene: SceneData, points: wp.array(dtype=VirtualLight), vertex: Vertex, half: int, u: wp.vec2):
    """Light of virtual point lights on a vertex, towards where its ray came from, estimated by one of them.

    Each of the CANDIDATES is drawn from its own part of one half of the points, so that independent samples have
    independent points, and the error that all pixels share shows in their difference.
    """
    total = float(0.0)
    pick = Pick()
    pick.u = u[1]
    best = VirtualConnection()
    in_half = points.shape[0] / 2
    candidates = int(CANDIDATES)  # a variable, so that the loop is not unrolled: small code is what GPUs like
    for k in range(candidates):
        at = int((float(k) + u[0]) / float(CANDIDATES) * float(in_half))
        point = points[half * in_half + wp.min(at, in_half - 1)]
        offset = point.p - vertex.p
        r2 = wp.max(wp.dot(offset, offset), 1.0e-12)
        r = wp.sqrt(r2)
        d = offset / r
        facing = -wp.dot(point.n, d) / r2
        if facing > 0.0 and point.density > 0.0:
            found = own_lobe_pdf(scene, vertex, d) * facing
            # the weight over the density; neither is squared by itself, which could be too large a number
            share = 1.0 / (point.density * (1.0 + square(found / (float(CANDIDATES) * point.density))))
            f = vertex_eval(scene, vertex, d)
            L = (facing * share) * wp.cw_mul(wp.cw_mul(f, transmittance(scene.medium, r)), point.L)
            weight = brightest(L)
            total += weight
            pick = reservoir(pick, k, weight, total)
            if weight > 0.0 and pick.index == k:
                best.p = point.p
                best.L = L / weight
    best.L *= total / float(CANDIDATES)
    return best


@wp.func
def found_weight(scene: SceneData, lobe_pdf: float, d: wp.vec3, t: float, light: int, p: wp.vec3, n: wp.vec3):
    """Weight of what a ray of density ``lobe_pdf`` found at ``p`` after ``t``, beside gather_virtual_light."""
    found = lobe_pdf * wp.abs(wp.dot(d, n)) / (t * t)
    ratio = float(CANDIDATES) * virtual_density(scene, light, p, n) / wp.max(found, 1.0e-30)
    return 1.0 / (1.0 + square(wp.min(ratio, 1.0e15)))
