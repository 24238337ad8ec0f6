"""Light that a lamp sends into a ray with one event: off the surface at its end, or scattered once on the way."""

import warp as wp

from varos_warp.kernels.conventions import NEAR
from varos_warp.kernels.sampling import sample_equiangular
from varos_warp.kernels.world.intersect import SceneData
from varos_warp.kernels.world.light import Light, LitInterval, falloff
from varos_warp.kernels.world.medium import transmittance
from varos_warp.kernels.world.phase import phase_eval

wp.set_module_options({"enable_backward": False})


@wp.func
def lamp_beam(scene: SceneData, light: Light, p: wp.vec3):
    """Irradiance [W/m^2] of a plane at ``p`` that faces the lamp, through the water, as if nothing stood between."""
    offset = light.position - p
    distance = wp.max(wp.length(offset), NEAR)
    share = falloff(light, -wp.dot(offset, light.axis) / distance) / (distance * distance)
    return share * wp.cw_mul(light.intensity, transmittance(scene.medium, distance))


@wp.func
def one_minus_cos_at(y: float, h: float, distance: float):
    """1 - cos(theta) = 1 + y/distance for scattering at y from a lamp's foot, without cancellation before the foot."""
    if y < 0.0:
        return h * h / (distance * (distance - y))
    return 1.0 + y / distance


@wp.struct
class LampLight:
    """Radiance that a lamp's light adds to a ray with one event at ``p``, as if nothing stood between the two."""

    lamp: int
    p: wp.vec3
    L: wp.vec3


@wp.func
def in_scattered(scene: SceneData, light: Light, lit: LitInterval, o: wp.vec3, d: wp.vec3, u: float):
    """Estimate of the radiance that one lamp's light adds to a ray by scattering once in the lit interval.

    Unbiased with one equiangular sample ``u`` (Kulla and Fajardo 2012) restricted to the cone: the distance law cancels
    against the density, and ``lit.angle`` = 1/(pdf d^2) is all that remains.
    """
    scattered = LampLight()
    if lit.angle <= 0.0:
        return scattered
    y = sample_equiangular(lit.h, lit.ya, lit.yb, u)
    t = wp.max(lit.foot + y, 0.0)
    scattered.p = o + t * d
    distance = wp.sqrt(lit.h * lit.h + y * y)
    weight = lit.angle * phase_eval(scene.medium.phase, one_minus_cos_at(y, lit.h, distance))
    weight *= falloff(light, wp.dot(scattered.p - light.position, light.axis) / distance)
    T = transmittance(scene.medium, t + distance)
    scattered.L = weight * wp.cw_mul(wp.cw_mul(scene.medium.sigma_s, light.intensity), T)
    return scattered
