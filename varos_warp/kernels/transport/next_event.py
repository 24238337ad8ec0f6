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
    light_beam,
    light_centre,
    light_sample,
    light_strength,
    light_towards,
)
from varos_warp.kernels.world.medium import Medium, transmittance
from varos_warp.kernels.world.phase import beam_at, phase_eval, sample_beam

wp.set_module_options({"enable_backward": False})

LEAST_CHANGE = wp.constant(1.0e-3)
"""Of the cdf of scattering angles over a part of a ray: below that it has no digits, and the density no change."""


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


@wp.struct
class Beam:
    """A light's light along the part of a ray that it lights, by the angle in which it is scattered into the ray."""

    lit: LitInterval
    low: float
    high: float
    """The first of `beam_at` at its ends."""
    peaked: int
    """1 if the phase function changes along it, more than rounding of the cdf does."""
    total: float
    """Integral of the phase function over the squared distance, about [1/m]."""


@wp.func
def beam_of(medium: Medium, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """The part of a ray up to ``t_max`` that a light lights."""
    beam = Beam()
    beam.lit = light_beam(light, o, d, t_max)
    if beam.lit.angle > 0.0:
        start = beam_at(medium.phase, wp.atan2(beam.lit.h, -beam.lit.ya))
        beam.total = beam.lit.angle * start[1]
        # a peak behind lies far along the ray, where thick water leaves nothing of it
        if beam.lit.ya < 0.0 and medium.phase.g >= 0.0:
            beam.low = start[0]
            beam.high = beam_at(medium.phase, wp.atan2(beam.lit.h, -beam.lit.yb))[0]
            if beam.high - beam.low > LEAST_CHANGE * wp.abs(beam.low):
                beam.peaked = 1
                beam.total = (beam.high - beam.low) / beam.lit.h
    return beam


@wp.func
def foot_at(h: float, theta: float):
    """Where on a line at distance ``h`` from a light its light is scattered by ``theta``, from the light's foot.

    Approximate tangents of a GPU have no digits at small angles, where phase functions peak.
    """
    behind = theta > 0.5 * wp.pi
    x = wp.where(behind, wp.max(wp.pi - theta, 0.0), theta)
    tangent = wp.where(x < 0.03, x * (1.0 + x * x / 3.0), wp.tan(x))
    return wp.where(behind, 1.0, -1.0) * h / wp.max(tangent, 1.0e-30)


@wp.func
def sample_scattering(medium: Medium, beam: Beam, u: float):
    """A point y of the lit interval, and 1/(pdf distance^2): by the phase function of its angle, or even in the angle.

    Along a ray the scattering angle is the equiangular one (Kulla and Fajardo 2012), in which the distance law is a
    constant.
    """
    lit = beam.lit
    if beam.peaked == 1:
        drawn = sample_beam(medium.phase, beam.low, beam.high, u)
        y = wp.clamp(foot_at(lit.h, drawn[0]), lit.ya, lit.yb)
        return wp.vec2(y, 1.0 / (drawn[1] * lit.h))
    return wp.vec2(sample_equiangular(lit.h, lit.ya, lit.yb, u), lit.angle)


@wp.func
def in_scattered(medium: Medium, light: Light, beam: Beam, o: wp.vec3, d: wp.vec3, u: float):
    """Estimate by one sample of the radiance that a light adds to a ray by scattering once in the lit interval."""
    scattered = LightConnection()
    lit = beam.lit
    place = sample_scattering(medium, beam, u)
    y = place[0]
    t = wp.max(lit.foot + y, 0.0)
    scattered.p = o + t * d
    scattered.q = light_centre(light)
    distance = wp.sqrt(lit.h * lit.h + y * y)
    weight = place[1] * phase_eval(medium.phase, one_minus_cos_at(y, lit.h, distance))
    sent = wp.cw_mul(light_towards(light, scattered.p, distance), transmittance(medium, t + distance))
    scattered.L = weight * wp.cw_mul(medium.sigma_s, sent)
    return scattered


@wp.func
def sample_in_scattered(scene: SceneData, o: wp.vec3, d: wp.vec3, t_max: float, u: float, v: float):
    """in_scattered of one light, chosen by about what it adds."""
    total = float(0.0)
    pick = Pick()
    pick.u = u
    pick.index = -1
    beam = Beam()
    for i in range(scene.lights.shape[0]):
        candidate = beam_of(scene.medium, scene.lights[i], o, d, t_max)
        weight = candidate.total * light_strength(scene.lights[i])
        total += weight
        pick = reservoir(pick, i, weight, total)
        if pick.index == i:
            beam = candidate
    scattered = LightConnection()
    if total > 0.0:
        scattered = in_scattered(scene.medium, scene.lights[pick.index], beam, o, d, v)
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
