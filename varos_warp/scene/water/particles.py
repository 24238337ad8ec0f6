"""The bodies of a block ``particles``: how many there are, how large, and how much of the water's light they carry.

The number of bodies by radius is n(r) = K r^-s between two radii. A body takes its projected area out of a ray and
scatters of it what its albedo says, so that a share f of the scattering coefficient b means

    f max(b) = K pi int r^(2-s) dr

where the maximum is over the channels. The albedo is ``reflectance``, or b / max(b) without it, so that the bodies
scatter b_s = f max(b) albedo. They have a phase function p_s of their own, and the rest of the water keeps what makes
the whole that of the scene, b p = b_s p_s + (b - b_s) p_c with p_c >= 0. So b_s / b is at most the least of p / p_s.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.description.particles import Particles
from varos_warp.scene.water.phase.lambert_sphere import LambertSphere
from varos_warp.scene.water.properties import OpticalProperties, optical_properties

LITRE = 1e-3
"""[m^3]"""
ANGLES = np.linspace(0.0, np.pi, 7201)[1:]
"""Angles at which phase functions are compared [rad]; straight ahead the water's has no bound."""


def power_integral(exponent: float, low, high) -> np.ndarray:
    """Integral of r^exponent between radii [m]; 0 where they do not ascend."""
    low, high = np.broadcast_arrays(np.asarray(low, float), np.asarray(high, float))
    high = np.maximum(high, low)
    if abs(exponent + 1.0) < 1e-9:
        return np.log(high / low)
    return (high ** (exponent + 1.0) - low ** (exponent + 1.0)) / (exponent + 1.0)


def rounded_down(share: float) -> float:
    """A share with four digits that is not above it: a limit that may be given."""
    if share <= 0.0:
        return 0.0
    step = 10.0 ** (np.floor(np.log10(share)) - 3)
    return float(f"{np.floor(share / step * (1.0 - 1e-12)) * step:.4g}")


@dataclass(frozen=True)
class ParticleLaw:
    """Bodies of one block in the water of a scene."""

    block: Particles
    water: OpticalProperties

    @cached_property
    def phase(self) -> LambertSphere:
        """Phase function of a body."""
        return LambertSphere(self.block.opacity)

    @property
    def sigma_s(self) -> np.ndarray:
        """Scattering coefficient of the bodies [1/m], float64 [3]."""
        if self.block.reflectance is None:  # so that rounding leaves it the share of each channel
            return self.block.share * self.water.sigma_s
        return self.extinction * self.albedo

    @property
    def albedo(self) -> np.ndarray:
        """Share of the light that a body scatters, float64 [3]."""
        if self.block.reflectance is not None:
            return np.array(self.block.reflectance)
        return self.water.sigma_s / self.water.sigma_s.max()

    @property
    def extinction(self) -> float:
        """Projected area of all bodies in a cubic metre [1/m]."""
        return float((self.block.share * self.water.sigma_s).max())

    @property
    def density(self) -> float:
        """The factor K of n(r) = K r^-s."""
        return self.extinction / (np.pi * float(power_integral(2.0 - self.block.slope, *self.block.radius_m)))

    def number(self, low: float, high: float) -> float:
        """Bodies in a cubic metre with radii between these [m]."""
        r0, r1 = self.block.radius_m
        return self.density * float(power_integral(-self.block.slope, max(low, r0), min(high, r1)))

    @property
    def largest_share(self) -> float:
        """What ``share`` may be at most in this water; 1 for bodies that scatter nothing."""
        return min(1.0, self.block.share / float(self.used.max())) if self.used.any() else 1.0

    @cached_property
    def used(self) -> np.ndarray:
        """What the bodies scatter of the most that the water leaves them, float64 [3]; above 1 is too much."""
        s = np.sin(ANGLES / 2.0) ** 2
        bodies = self.phase.eval_s(s)
        lit = bodies > 1e-12 * bodies.max()
        least = np.min(self.water.phase.eval_s(s[lit]) / bodies[lit])
        b, scattered = self.water.sigma_s, self.sigma_s
        return np.where(scattered > 0.0, scattered / np.maximum(least * b, 1e-300), 0.0)

    def drawn(self, t: np.ndarray, least_angle: float, fade: float) -> np.ndarray:
        """Share of the scattering by bodies that is drawn at distances ``t`` [m]: of those that seem large enough.

        Args:
            t: Distances from the camera.
            least_angle: Radius over distance at which bodies begin to be drawn.
            fade: By how much larger those are that are drawn wholly; between, it is linear in the radius.
        """
        (r0, r1), s = self.block.radius_m, self.block.slope
        begin = least_angle * np.maximum(np.asarray(t, float), 1e-9)
        whole = (1.0 + fade) * begin
        low, high = np.clip(begin, r0, r1), np.clip(whole, r0, r1)
        part = (power_integral(3.0 - s, low, high) / begin - power_integral(2.0 - s, low, high)) / fade
        return (part + power_integral(2.0 - s, high, r1)) / power_integral(2.0 - s, r0, r1)

    def describe(self) -> dict:
        """Its facts in plain JSON types; numbers of bodies are per litre, by diameter."""
        low, high = self.block.radius_m
        return {
            "share": self.block.share,
            "largest_share": rounded_down(self.largest_share),
            "slope": self.block.slope,
            "radius_m": [low, high],
            "opacity": self.block.opacity,
            "per_litre": self.number(low, high) * LITRE,
            "per_litre_over_0.5_mm": self.number(0.25e-3, high) * LITRE if high > 0.25e-3 else 0.0,
        }


def particle_laws(scene: Scene) -> list[ParticleLaw]:
    """The bodies of a scene's blocks; none where no block says so.

    Raises:
        InputError: If the water does not scatter, or bodies would scatter more light than it does.
    """
    if not scene.particles:
        return []
    water = optical_properties(scene)
    if not water.sigma_s.any():
        raise InputError(
            "the water does not scatter, and particles are a share of what it scatters",
            key="particles",
            remedy="Give a water that scatters, or leave particles out.",
        )
    laws = [ParticleLaw(block, water) for block in scene.particles]
    used = np.zeros(3)
    for i, law in enumerate(laws):
        before, used = used, used + law.used
        if used.max() > 1.0:
            taken = law.used > 0.0
            rest = law.block.share * float(np.clip((1.0 - before[taken]) / law.used[taken], 0.0, None).min())
            others = " beside the blocks before it" if i else ""
            coloured = " and of this reflectance" if law.block.reflectance is not None else ""
            raise InputError(
                f"is more light than the water scatters backwards: in this water bodies of opacity "
                f"{law.block.opacity:g}{coloured} can be at most {rounded_down(rest):g} of the scattering{others}",
                key=f"particles.{i}.share",
                value=law.block.share,
                remedy="Give at most that. Of a smaller opacity, or a darker reflectance, the water allows more.",
            )
    return laws
