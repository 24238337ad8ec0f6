"""Several scatterers at once: the mean of their phase functions, weighted by their shares of the scattering."""

from functools import cached_property

import numpy as np

from varos_warp.scene.water.phase.phase_function import PhaseFunction


class Mixture(PhaseFunction):
    """The weighted mean of phase functions.

    Args:
        parts: Weight, not negative, and phase function of each; weights are divided by their sum.
    """

    kind = "mixture"

    def __init__(self, parts: list[tuple[float, PhaseFunction]]):
        total = sum(weight for weight, _ in parts)
        self.parts = tuple((weight / total, phase) for weight, phase in parts)

    @property
    def key(self) -> tuple:
        """Kind, and weight and key of every part."""
        return (self.kind, *((weight, phase.key) for weight, phase in self.parts))

    @property
    def kinks(self) -> np.ndarray:
        """Kinks of all parts."""
        return np.concatenate([phase.kinks for _, phase in self.parts])

    def describe(self) -> dict:
        """Its facts in plain JSON types, and those of its parts."""
        return {**super().describe(), "of": [{"weight": weight, **phase.describe()} for weight, phase in self.parts]}

    @cached_property
    def light_ahead(self) -> float:
        """Share of the light below S_CUT."""
        return sum(weight * phase.light_ahead / phase.integral for weight, phase in self.parts)

    def density(self, s) -> np.ndarray:
        """Density [1/sr]."""
        return sum(weight * phase.eval_s(s) for weight, phase in self.parts)
