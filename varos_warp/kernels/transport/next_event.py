"""Next-event estimation: light that reaches a segment of a path straight from a light.

It is scattered into the segment, or reflected into it by the surface at its end. One of the lights is chosen, in
proportion to what it would add if nothing blocked it; or where they are few, each is asked.
"""

import warp as wp

from varos_warp.kernels.numerics import brightest
from varos_warp.kernels.sampling import equiangular_point, make_reservoir, offer, one_minus_cos_at
from varos_warp.kernels.transport.subpath import Vertex, vertex_eval
from varos_warp.kernels.world.intersect import Hit, SceneData
from varos_warp.kernels.world.lights.light import (
    get_light,
    light_beam,
    light_centre,
    light_count,
    light_sample,
    light_strength,
    light_towards,
)
from varos_warp.kernels.world.lights.record import Light, LightSample, LitInterval
from varos_warp.kernels.world.medium import Medium, transmittance
from varos_warp.kernels.world.phase import angle_integral_at, phase_eval, sample_angle

wp.set_module_options({"enable_backward": False})

LEAST_CHANGE = wp.constant(1.0e-3)
"""Relative change of the cumulative phase function over a lit interval below which float32 does not resolve it, and the
phase function counts as constant."""


@wp.struct
class LightConnection:
    """Radiance that light from ``q`` adds to a segment by one event at ``p``, before its visibility is tested."""

    p: wp.vec3
    q: wp.vec3
    L: wp.vec3
    light: int
    """Number of the light; -1 for none."""
    blocked: int
    """1 if something blocks the light."""


@wp.func
def irradiance(medium: Medium, sample: LightSample):
    """Unobstructed irradiance [W/m^2] of a plane that faces the sampled light, through the water."""
    return (1.0 / sample.pdf) * wp.cw_mul(sample.L, transmittance(medium, sample.distance))


@wp.struct
class Beam:
    """The lit part of a ray, described by the angle through which the light is scattered into the ray."""

    lit: LitInterval
    low: float
    high: float
    """The cumulative phase function (`angle_integral_at`) at both ends."""
    peaked: int
    """1 if the cumulative phase function changes along it by more than LEAST_CHANGE."""
    total: float
    """Approximate integral of the phase function over the squared distance [1/m]."""


@wp.func
def beam_of(medium: Medium, light: Light, o: wp.vec3, d: wp.vec3, t_max: float):
    """The lit part of a ray up to ``t_max``."""
    beam = Beam()
    beam.lit = light_beam(light, o, d, t_max)
    if beam.lit.angle > 0.0:
        start = angle_integral_at(medium.phase, wp.atan2(beam.lit.h, -beam.lit.ya))
        beam.total = beam.lit.angle * start[1]
        # a backward peak is far along the ray, where the water has absorbed the light
        if beam.lit.ya < 0.0 and medium.phase.g >= 0.0:
            beam.low = start[0]
            beam.high = angle_integral_at(medium.phase, wp.atan2(beam.lit.h, -beam.lit.yb))[0]
            if beam.high - beam.low > LEAST_CHANGE * wp.abs(beam.low):
                beam.peaked = 1
                beam.total = (beam.high - beam.low) / beam.lit.h
    return beam


@wp.func
def foot_at(h: float, theta: float):
    """Place, from the light's foot, on a line at distance ``h`` from a light where its light is scattered by ``theta``.

    At small angles, where phase functions peak, a series replaces the tangent: a GPU's approximate one has no digits.
    """
    behind = theta > 0.5 * wp.pi
    x = wp.where(behind, wp.max(wp.pi - theta, 0.0), theta)
    tangent = wp.where(x < 0.03, x * (1.0 + x * x / 3.0), wp.tan(x))
    return wp.where(behind, 1.0, -1.0) * h / wp.max(tangent, 1.0e-30)


@wp.func
def sample_scattering(medium: Medium, beam: Beam, u: float):
    """A point y of the lit interval and 1/(pdf distance^2); drawn by the phase function, or uniformly in the angle.

    Along a ray the scattering angle is the equiangular angle (Kulla and Fajardo 2012), in which the inverse square of
    the distance is constant.
    """
    lit = beam.lit
    if beam.peaked == 1:
        drawn = sample_angle(medium.phase, beam.low, beam.high, u)
        y = wp.clamp(foot_at(lit.h, drawn[0]), lit.ya, lit.yb)
        return wp.vec2(y, 1.0 / (drawn[1] * lit.h))
    return wp.vec2(equiangular_point(lit.h, lit.ya, lit.yb, lit.angle, u), lit.angle)


@wp.func
def in_scattered(medium: Medium, light: Light, beam: Beam, o: wp.vec3, d: wp.vec3, u: float):
    """One-sample estimate of a light's single scattering in the lit interval of a ray."""
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
    """`in_scattered` of one light, chosen in proportion to an estimate of what it adds."""
    chosen = make_reservoir(u)
    beam = Beam()
    for i in range(light_count(scene.lights)):
        light = get_light(scene.lights, i)
        candidate = beam_of(scene.medium, light, o, d, t_max)
        chosen = offer(chosen, i, candidate.total * light_strength(light))
        if chosen.index == i:
            beam = candidate
    scattered = LightConnection()
    if chosen.total > 0.0:
        scattered = in_scattered(scene.medium, get_light(scene.lights, chosen.index), beam, o, d, v)
        scattered.L *= chosen.total / chosen.weight
    scattered.light = chosen.index
    return scattered


@wp.func
def reflected_from(scene: SceneData, hit: Hit, vertex: Vertex, i: int):
    """Light of one of the lights that a surface reflects."""
    sample = light_sample(get_light(scene.lights, i), hit.p)
    reflected = LightConnection()
    reflected.p = hit.start
    reflected.q = sample.p
    reflected.L = wp.cw_mul(vertex_eval(scene, vertex, sample.d), irradiance(scene.medium, sample))
    reflected.light = i
    return reflected


@wp.func
def sample_reflected(scene: SceneData, hit: Hit, vertex: Vertex, u: float):
    """Reflected light of one light, chosen in proportion to what it would add if nothing blocked it."""
    chosen = make_reservoir(u)
    reflected = LightConnection()
    reflected.p = hit.start
    for i in range(light_count(scene.lights)):
        candidate = reflected_from(scene, hit, vertex, i)
        chosen = offer(chosen, i, brightest(candidate.L))
        if chosen.index == i:
            reflected = candidate
    reflected.light = chosen.index
    if chosen.total > 0.0:
        reflected.L *= chosen.total / chosen.weight
    return reflected
