"""How large bodies are, and how many find room in a clump."""

from functools import lru_cache

import numpy as np
from scipy.special import ndtr, ndtri

from varos_warp.scene.geometry.growth.chance import key_of, mixed, uniform
from varos_warp.scene.geometry.growth.clumps import crowding
from varos_warp.scene.geometry.growth.kinds import KINDS, Kind
from varos_warp.scene.geometry.growth.spacing import apart

PER_CLUSTER = 0.28
"""Of what may be loose, clumps have exp(`PER_CLUSTER` cluster) times the mean, or as many as bodies fill the place."""
LOW, HIGH = 1.6, 2.4
"""The smallest and the largest body of a log-normal law are so many deviations from its median."""
YOUNGEST = 0.45
"""Bodies of the youngest clumps over those of the oldest."""
SAMPLE = 30_000
"""Bodies by which the share is found that finds room."""


def sizes(kind: Kind, size_m: tuple[float, float], u: np.ndarray) -> np.ndarray:
    """Sizes [N] [m] of uniform numbers [N]: log-normal between two sizes, or by the power law of a kind."""
    low, high = size_m
    if kind.small is None:
        middle, deviation = _log_normal(size_m)
        return np.clip(np.exp(middle + deviation * ndtri(ndtr(-LOW) + u * (ndtr(HIGH) - ndtr(-LOW)))), low, high)
    s = 1.0 - kind.small
    if s == 0.0:
        return low * (high / low) ** u
    return (low**s + u * (high**s - low**s)) ** (1.0 / s)


def share_above(kind: Kind, size_m: tuple[float, float], size: np.ndarray) -> np.ndarray:
    """Share [N] of bodies that are larger than sizes [N] [m]: what `sizes` is the inverse of."""
    low, high = size_m
    size = np.clip(size, low, high)
    if low == high:
        return (size >= high).astype(float)
    if kind.small is None:
        middle, deviation = _log_normal(size_m)
        return (ndtr(HIGH) - ndtr((np.log(size) - middle) / deviation)) / (ndtr(HIGH) - ndtr(-LOW))
    s = 1.0 - kind.small
    if s == 0.0:
        return np.log(high / size) / np.log(high / low)
    return (high**s - size**s) / (high**s - low**s)


def _log_normal(size_m):
    """Mean and deviation of the logarithm of sizes."""
    low, high = np.log(size_m)
    deviation = (high - low) / (LOW + HIGH)
    return low + LOW * deviation, deviation


def grown_to(kind: Kind, depth: np.ndarray, clump: np.ndarray) -> np.ndarray:
    """Share [N] of their size that bodies have by how deep [N] they are in a clump of some key [N]: its age."""
    if kind.smaller == 0.0:
        return np.ones(len(depth))
    return (1.0 - kind.smaller * (1.0 - depth) ** 2) * (YOUNGEST + (1.0 - YOUNGEST) * np.sqrt(uniform(clump, 7)))


@lru_cache
def room(name: str, size_m: tuple[float, float]) -> tuple[float, float]:
    """How many bodies a square metre of clumps has before those that find no room, and the share that does.

    The share is that on a plane, of clumps by chance on a third of it.
    """
    kind = KINDS[name]
    u = (np.arange(100) + 0.5) / 100
    age = (1.0 - kind.smaller * u**2) if kind.smaller else np.ones(1)
    young = YOUNGEST + (1.0 - YOUNGEST) * np.sqrt(u) if kind.smaller else np.ones(1)
    size = sizes(kind, size_m, u)[:, None, None] * age[:, None] * young
    square = float(np.mean(np.maximum(size, size_m[0]) ** 2))
    full = kind.cover / (0.25 * np.pi * (kind.body or 1.0) ** 2 * square)
    if kind.body == 0.0 or kind.cover == 0.0:
        return full, 1.0
    keys = mixed(key_of("room", name), np.arange(SAMPLE, dtype=np.uint64))
    side = np.sqrt(SAMPLE / full)
    points = side * np.column_stack([uniform(keys, 1), uniform(keys, 2), np.zeros(SAMPLE)])
    crowd = crowding(3.0, min(kind.clump_m, side / 6.0), key_of("room", name), None, stray=0.0)
    there = crowd(points)
    kept = np.flatnonzero(uniform(keys, 4) * crowd.peak < there.weight)
    size = sizes(kind, size_m, uniform(keys[kept], 3)) * grown_to(kind, there.depth[kept], there.clump[kept])
    size = np.maximum(size, size_m[0])
    priority = np.argsort(np.lexsort([keys[kept], size])).astype(np.uint64)
    return full, float(np.mean(apart(points[kept], size, kind.body, priority)))
