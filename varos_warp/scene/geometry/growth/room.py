"""How large bodies are, and how many find room in a clump."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtr, ndtri

from varos_warp.scene.geometry.growth.chance import key_of, mixed, uniform
from varos_warp.scene.geometry.growth.clumps import (
    LEAST_CROWDED,
    crowding,
    left_by_scars,
    patches_of,
    scars,
    share_of,
)
from varos_warp.scene.geometry.growth.kinds import KINDS, Kind
from varos_warp.scene.geometry.growth.spacing import apart

PER_CLUSTER = 0.28
"""Clumps that may be loose have exp(`PER_CLUSTER` cluster) times the mean density, or more where bodies fill them."""
LOW, HIGH = 1.6, 2.4
"""The smallest and the largest body of a log-normal law are so many deviations from its median."""
YOUNGEST = 0.45
"""Bodies of the youngest clumps over those of the oldest."""
MOST_CROWDED = 300.0
"""No place has more copies in the mean than so many times ``per_m2``."""
BODIES = 30_000
"""Bodies laid into clumps to measure the share that finds room, which is then known to about two in a hundred."""
SPARSEST = 0.08
"""Share of a plane that clumps have at least when that is found: they touch so few others that no fewer matter."""
ROUNDS, MOST_ROUNDS, ABOUT = 2, 8, 0.25
"""What is left and how much of a surface clumps have follow from each other: so often at least and at most, from such
a share; the fuller clumps are, the fewer find room."""
CROWDED = 4.0
"""Area of bodies over that of the surface, above which hardly any more find room."""
ALONE = 0.02
"""Mean number of others in a body's reach below which all are taken to find room; one of a hundred would not."""


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


@dataclass(frozen=True)
class Filling:
    """How full clumps are of a kind, so that as many are left as asked for."""

    times: float
    """Density in clumps without scars, over ``per_m2``, counting bodies that find no room."""
    left: float
    """Share of these that scars leave and that finds room, in the mean."""
    most: float
    """Density that is reached [1/m^2]: ``per_m2``, or less where not so many find room."""


@lru_cache
def filling(name: str, size_m: tuple[float, float], per_m2: float, cluster: float) -> Filling:
    """Clumps of what lives packed are as full as bodies make them; of the rest, by ``cluster``, or as full."""
    kind, most = KINDS[name], most_laid(name, size_m) / per_m2
    packed = kind.cover > 0.0 and kind.body > 0.0
    times = most if packed else np.exp(PER_CLUSTER * cluster)
    if kind.cover > 0.0 and not packed:
        times = max(times, full_of(name, size_m) / per_m2)
    times = float(min(times, most, MOST_CROWDED))
    share = share_of(times, kind.stray, ABOUT)
    for n in range(MOST_ROUNDS):
        left = left_of(name, size_m, times * per_m2, share_of_patches(share))
        enough = packed or times >= most or times * left >= 0.99 * LEAST_CROWDED
        if n + 1 == MOST_ROUNDS or (enough and n + 1 >= ROUNDS):
            break
        if not enough:
            times = float(min(LEAST_CROWDED / left, most))
        share = share_of(times, kind.stray, left)
    return Filling(times, left, min(times * left / LEAST_CROWDED, 1.0) * per_m2)


def full_of(name: str, size_m: tuple[float, float]) -> float:
    """How many bodies a square metre of clumps has before those that find no room [1/m^2]."""
    return _covering(KINDS[name], size_m, KINDS[name].cover)


def most_laid(name: str, size_m: tuple[float, float]) -> float:
    """How many bodies are laid down on a square metre at most, some of which find no room [1/m^2]."""
    kind = KINDS[name]
    return _covering(kind, size_m, kind.cover or CROWDED) if kind.body > 0.0 else np.inf


def _covering(kind, size_m, cover):
    """How many bodies a square metre has that cover so many times its area [1/m^2]."""
    u = (np.arange(100) + 0.5) / 100
    age = (1.0 - kind.smaller * u**2) if kind.smaller else np.ones(1)
    young = YOUNGEST + (1.0 - YOUNGEST) * np.sqrt(u) if kind.smaller else np.ones(1)
    size = sizes(kind, size_m, u)[:, None, None] * age[:, None] * young
    square = float(np.mean(np.maximum(size, size_m[0]) ** 2))
    return cover / (0.25 * np.pi * (kind.body or 1.0) ** 2 * square)


def share_of_patches(share: float) -> float:
    """Share of patches that clumps have, by that of the surface: what is found for one serves many."""
    return max(share / patches_of(share), SPARSEST)


@lru_cache
def left_of(name: str, size_m: tuple[float, float], density: float, share: float) -> float:
    """Share of so many bodies a square metre of clumps that scars leave and that finds room, in the mean.

    Bodies are laid down on a plane, in clumps as close to each other as they are in patches, for each of what scars
    may leave.

    Args:
        name: Kind.
        size_m: Smallest and largest size [m].
        density: Where there are no scars, before those that find no room [1/m^2].
        share: Of patches that clumps have (`share_of_patches`).
    """
    kind = KINDS[name]
    if density * np.pi * (kind.body * size_m[1]) ** 2 < ALONE:
        return left_by_scars() if kind.scars else 1.0
    leaves, weights = scars() if kind.scars else (np.ones(1), np.ones(1))
    plane = _plane(kind, name, size_m, density, share)
    return float(np.dot(weights, [_found_room(kind, *plane, leaf) for leaf in leaves]))


def _found_room(kind, keys, points, size, inside, leaf):
    """Share of all bodies that find room where chance leaves such a share of them."""
    some = np.flatnonzero(uniform(keys, 12) < leaf)
    priority = np.argsort(np.lexsort([keys[some], size[some]])).astype(np.uint64)
    stays = apart(points[some], size[some], kind.body, priority)
    return np.count_nonzero(stays & inside[some]) / np.count_nonzero(inside)


def _plane(kind, name, size_m, density, share):
    """Keys, places [N, 3], sizes of bodies, and which are so far inside of a plane that they have all neighbours."""
    count = int(BODIES / share)
    keys = mixed(key_of("room", name), np.arange(count, dtype=np.uint64))
    side = np.sqrt(count / density)
    points = side * np.column_stack([uniform(keys, 1), uniform(keys, 2), np.zeros(count)])
    crowd = crowding(1.0 / share, min(kind.clump_m, side / 6.0), key_of("room", name), None, stray=0.0, patchy=False)
    there = crowd(points)
    kept = np.flatnonzero(uniform(keys, 4) * crowd.peak < there.weight)
    keys, points, depth = keys[kept], points[kept], there.depth[kept]
    clump = np.where(there.clump[kept] > 0, there.clump[kept], keys)
    margin = min(kind.body * size_m[1], 0.2 * side)
    inside = ((points[:, :2] > margin) & (points[:, :2] < side - margin)).all(axis=1)
    size = sizes(kind, size_m, uniform(keys, 3)) * grown_to(kind, depth, clump)
    return keys, points, np.maximum(size, size_m[0]), inside
