"""Next event estimation: light of one of several lights on a segment of a path, chosen by how much it is unobstructed.

On the way it is scattered into the segment, at its end it is reflected off the surface.
"""

import warp as wp

from varos_warp.kernels.sampling import Pick, one_minus_cos_at, reservoir, sample_equiangular
from varos_warp.kernels.transport.subpath import Vertex, vertex_eval
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.light import (
    Light,
    LightSample,
    LitInterval,
    brightest,
    falloff,
    light_beam,
    light_sample,
)
from varos_warp.kernels.world.medium import Medium, log1p, transmittance
from varos_warp.kernels.world.phase import phase_eval

wp.set_module_options({"enable_backward": False})

FORWARD_SHARE = wp.constant(0.5)
"""Times the mean cosine of the phase function: share of scatterings that are even in the logarithm of their angle."""


@wp.struct
class LightConnection:
    """Radiance that light from ``q`` adds to a segment by one event at ``p``, as if nothing stood between the two."""

    p: wp.vec3
    q: wp.vec3
    L: wp.vec3
    light: int
    """Which light; -1 for none."""
    blocked: int
    """1 where something was found to stand between."""


@wp.func
def irradiance(medium: Medium, sample: LightSample):
    """Irradiance [W/m^2] of a plane that faces the sampled light, through the water, without obstacles."""
    share = 1.0 / (sample.distance * sample.distance * sample.pdf)
    return share * wp.cw_mul(sample.intensity, transmittance(medium, sample.distance))


@wp.func
def sample_scattering(medium: Medium, lit: LitInterval, u: float, v: float):
    """A point y of the lit interval, and 1/(pdf distance^2): even in the scattering angle, or in its logarithm.

    Along a ray the scattering angle is the equiangular one (Kulla and Fajardo 2012), in which the distance law is a
    constant. Phase functions peak ahead as powers of the angle, and its logarithm follows them.
    """
    near = wp.atan2(lit.h, -lit.ya)
    spread = lit.angle * lit.h
    octaves = log1p(spread / near)
    peaked = wp.where(lit.ya < 0.0, FORWARD_SHARE * wp.max(medium.phase.g, 0.0), 0.0)
    if u < peaked:
        y = wp.clamp(-lit.h / wp.tan(near * wp.exp(v * octaves)), lit.ya, lit.yb)
    else:
        y = sample_equiangular(lit.h, lit.ya, lit.yb, v)
    angle = wp.atan2(lit.h, -y)
    return wp.vec2(y, lit.angle / (1.0 - peaked + peaked * spread / (angle * octaves)))


@wp.func
def in_scattered(medium: Medium, light: Light, lit: LitInterval, o: wp.vec3, d: wp.vec3, u: float, v: float):
    """Estimate by one sample of the radiance that a light adds to a ray by scattering once in the lit interval."""
    scattered = LightConnection()
    place = sample_scattering(medium, lit, u, v)
    y = place[0]
    t = wp.max(lit.foot + y, 0.0)
    scattered.p = o + t * d
    scattered.q = light.position
    distance = wp.sqrt(lit.h * lit.h + y * y)
    weight = place[1] * phase_eval(medium.phase, one_minus_cos_at(y, lit.h, distance))
    weight *= falloff(light, wp.dot(scattered.p - light.position, light.axis) / distance)
    T = transmittance(medium, t + distance)
    scattered.L = weight * wp.cw_mul(wp.cw_mul(medium.sigma_s, light.intensity), T)
    return scattered


@wp.func
def sample_in_scattered(scene: SceneData, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """in_scattered of one light, chosen by the integral of 1/d^2 over the interval it lights."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    lit = LitInterval()
    for i in range(scene.lights.shape[0]):
        candidate = light_beam(scene.lights[i], o, d, t_max)
        weight = candidate.angle * brightest(scene.lights[i].intensity)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            lit = candidate
    scattered = LightConnection()
    if total > 0.0:
        scattered = in_scattered(scene.medium, scene.lights[pick.index], lit, o, d, pick.u, v)
        scattered.L *= total / pick.weight
    scattered.light = pick.index
    return scattered


@wp.func
def sample_reflected(scene: SceneData, hit: Hit, vertex: Vertex, u: float, v: wp.vec2):
    """Light of one light reflected at a hit against its ray, chosen by how much that is without obstacles."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    reflected = LightConnection()
    reflected.p = hit.start
    for i in range(scene.lights.shape[0]):
        sample = light_sample(scene.lights[i], hit.p, v)
        L = wp.cw_mul(vertex_eval(scene, vertex, sample.d), irradiance(scene.medium, sample))
        weight = brightest(L)
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            reflected.L = L
            reflected.q = sample.p
    reflected.light = pick.index
    if total > 0.0:
        reflected.L *= total / pick.weight
    return reflected
