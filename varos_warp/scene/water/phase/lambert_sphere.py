"""A sphere whose surface scatters after Lambert's law, as a whole: the phase function of an opaque grain."""

import numpy as np

from varos_warp.scene.water.phase.phase_function import PhaseFunction

SMALL = 1e-2
"""Angles [rad] below which a series replaces a difference that would lose its digits."""


def lambert_lobe(angle: np.ndarray) -> np.ndarray:
    """Density [1/sr] of light that a white sphere sends at an angle [rad] to where it comes from, backwards at 0.

    2 / (3 pi^2) (sin a + (pi - a) cos a), which integrates to 1 (Schoenberg 1929; Russell 1916, ApJ 43, 173).
    """
    rest = np.pi - angle
    exact = np.sin(rest) - rest * np.cos(rest)
    return 2.0 / (3.0 * np.pi**2) * np.where(rest < SMALL, rest**3 / 3.0 * (1.0 - rest**2 / 10.0), exact)


class LambertSphere(PhaseFunction):
    """A share ``opacity`` is reflected, the rest transmitted as evenly: the same lobe, turned to the front."""

    kind = "lambert_sphere"

    def __init__(self, opacity: float = 1.0):
        self.opacity = float(opacity)

    @property
    def key(self) -> tuple:
        """Kind and opacity."""
        return (self.kind, self.opacity)

    def density(self, s) -> np.ndarray:
        """Density [1/sr]."""
        forward = 2.0 * np.arcsin(np.sqrt(np.clip(np.asarray(s, float), 0.0, 1.0)))
        back = lambert_lobe(np.pi - forward)
        return back if self.opacity == 1.0 else self.opacity * back + (1.0 - self.opacity) * lambert_lobe(forward)
