"""What the field's solver asks of a phase function."""

from typing import Protocol

import numpy as np


class PhaseFunction(Protocol):
    """A phase function on the host."""

    mean_cosine: float

    @property
    def key(self) -> object:
        """What tells it from others, for the cache; JSON."""

    def eval_s(self, s: np.ndarray) -> np.ndarray:
        """Density [1/sr] at s = sin^2(theta/2)."""


class HenyeyGreenstein:
    """That of Henyey and Greenstein (1941)."""

    def __init__(self, g: float):
        self.mean_cosine = float(g)

    @property
    def key(self):
        return {"henyey_greenstein": self.mean_cosine}

    def eval_s(self, s):
        g = self.mean_cosine
        return (1.0 - g * g) / (4.0 * np.pi * ((1.0 - g) ** 2 + 4.0 * g * s) ** 1.5)


def phase_of(water):
    return getattr(water, "phase", None) or HenyeyGreenstein(water.g)
