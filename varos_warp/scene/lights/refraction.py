"""Refraction at plane interfaces between air, glass and water: Snell's law and Fresnel's equations."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike


def snell(angle: ArrayLike, n: float, n_beyond: float) -> np.ndarray:
    """Angle to the normal [rad] beyond an interface, of one before it; pi/2 where all is reflected."""
    return np.arcsin(np.clip(n / n_beyond * np.sin(angle), -1.0, 1.0))


def transmitted(angle: ArrayLike, indices: Sequence[float]) -> np.ndarray:
    """Share of unpolarised power that passes parallel interfaces, without what is reflected back and forth.

    Args:
        angle: To the normal, in the first medium [rad].
        indices: Refractive indices of the media in order.
    """
    s, p, cos = 1.0, 1.0, np.cos(angle)
    sine = indices[0] * np.sin(angle)
    for n, beyond in pairwise(indices):
        cos_beyond = np.sqrt(np.maximum(1.0 - (sine / beyond) ** 2, 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            s = s * (1.0 - ((n * cos - beyond * cos_beyond) / (n * cos + beyond * cos_beyond)) ** 2)
            p = p * (1.0 - ((beyond * cos - n * cos_beyond) / (beyond * cos + n * cos_beyond)) ** 2)
        cos = cos_beyond
    return np.nan_to_num(0.5 * (s + p))
