"""Blending of values of vertices."""

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtri

Rgb = tuple[float, float, float] | np.ndarray
NOISE_STD = 0.19
"""Standard deviation of a sum of octaves."""
BLEND_DEPTH = 0.08
"""How far below the highest layer another one still shows through."""


def smoothstep(low: float | np.ndarray, high: float | np.ndarray, x: np.ndarray) -> np.ndarray:
    """0 below ``low``, 1 above ``high``, smooth between them."""
    t = np.clip((x - low) / (np.asarray(high) - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def mix(a: Rgb, b: Rgb, t: np.ndarray) -> np.ndarray:
    """Colours [N, 3]: ``a`` where t [N] is 0, ``b`` where it is 1."""
    return np.asarray(a) + (np.asarray(b) - np.asarray(a)) * t[:, None]


def patches(noise: np.ndarray, share: float, soft: float = 0.1) -> np.ndarray:
    """A mask [N] that covers about a share of all places, where a sum of octaves is highest.

    Args:
        noise: `fbm`, [N].
        share: 0: exactly nothing, to 1: exactly everything.
        soft: Half the width of the transition, in units of the noise.
    """
    if share <= 0.0 or share >= 1.0:
        return np.full(len(noise), float(share >= 1.0))
    # within the noise's range, so that small and large shares still lead to none and all of it
    threshold = -NOISE_STD * np.clip(ndtri(share), -4.0, 4.0)
    return smoothstep(threshold - soft, threshold + soft, noise)


def height_blend(
    masks: Sequence[np.ndarray], heights: Sequence[np.ndarray], means: Sequence[float] | None = None
) -> np.ndarray:
    """Weights [K, N] of layers, each of which shows where its mask and its relief rise above those of the others.

    Grains stand out of silt and paint breaks along its pits, where a mere mixture would be a fog.

    Args:
        masks: How much there is of each of K layers, [N] each.
        heights: Their relief, [N] each, in units of what makes up for a whole mask.
        means: Of their relief; None: those of ``heights``.
    """
    means = [height.mean() for height in heights] if means is None else means
    level = np.stack([mask + height - mean for mask, height, mean in zip(masks, heights, means, strict=True)])
    weight = np.maximum(level - (level.max(axis=0) - BLEND_DEPTH), 0.0)
    return weight / weight.sum(axis=0)


def domes(near: np.ndarray, radius: np.ndarray | float) -> np.ndarray:
    """Half balls of unit height on the centres of cells, [N]; ``near`` and ``radius`` in cells."""
    return np.sqrt(np.clip(1.0 - (near / radius) ** 2, 0.0, 1.0))


def dots(near: np.ndarray, radius: np.ndarray | float, soft: float = 0.25) -> np.ndarray:
    """Discs on the centres of cells, [N]: 1 inside of ``radius``, 0 a share ``soft`` of it farther out."""
    radius = np.maximum(radius, 1e-9)
    return 1.0 - smoothstep(radius * (1.0 - soft), radius * (1.0 + soft), near)


def hashed(number: np.ndarray, seed: int) -> np.ndarray:
    """A random number in [0, 1) for each whole number, float64 of the same shape (splitmix64)."""
    with np.errstate(over="ignore"):
        h = number.astype(np.int64).astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15) * np.uint64(seed + 1)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((h ^ (h >> np.uint64(31))) >> np.uint64(11)).astype(np.float64) * 2.0**-53
