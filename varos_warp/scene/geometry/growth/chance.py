"""Random numbers and smooth noise that belong to a place, not to a turn.

A copy's numbers follow from keys of its host, its triangle and its number there: they do not depend on what else is
drawn, in which order, or by how many threads.
"""

import zlib
from dataclasses import dataclass

import numpy as np
from scipy.special import pdtr, pdtrik

from varos_warp.device.launch import in_tiles

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
FEW = 12
"""Bound of the Poisson numbers that are found one by one."""
WAVES = 24
TILE = 1 << 13
"""Places at which waves are added together: they stay in a core's cache."""


def key_of(*words: object) -> np.uint64:
    """A key for what some words and numbers name together."""
    text = "\0".join(map(str, words)).encode()
    return np.uint64((zlib.crc32(text) << 32) | zlib.crc32(text[::-1] + b"growth"))


def mixed(*numbers: np.ndarray | np.uint64) -> np.ndarray:
    """One uint64 of several, broadcast (splitmix64 of one after the other; Steele et al. 2014)."""
    state = np.zeros(np.broadcast_shapes(*(np.shape(number) for number in numbers)), np.uint64)
    with np.errstate(over="ignore"):
        for number in numbers:
            state = (state ^ np.asarray(number).astype(np.uint64)) + GOLDEN
            state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            state ^= state >> np.uint64(31)
    return state


def uniform(key: np.ndarray, dimension: int) -> np.ndarray:
    """Numbers in [0, 1) of keys, one sort for each dimension."""
    return (mixed(key, np.uint64(dimension)) >> np.uint64(11)) * 2.0**-53


def poisson_counts(u: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Poisson numbers int64 [N] of means [N] by inversion of uniform numbers [N]."""
    counts = np.zeros(len(u), np.int64)
    mean = np.broadcast_to(mean, len(u))
    more, k = np.flatnonzero(u >= np.exp(-mean)), 1
    while len(more) and k < FEW:
        counts[more] = k
        more, k = more[u[more] >= pdtr(k, mean[more])], k + 1
    counts[more] = _inverse(u[more], mean[more])
    return counts


def _inverse(u, mean):
    """Inverse of the Poisson distribution, as scipy.stats has it, whose import takes a tenth of the start of a run."""
    above = np.ceil(pdtrik(u, mean))
    below = np.maximum(above - 1.0, 0.0)
    return np.where(pdtr(below, mean) >= u, below, above)


@dataclass(frozen=True)
class Field:
    """Smooth noise of variance 1 about 0: plane waves of about one length, in all directions, of phases by chance."""

    k: np.ndarray
    """float64 [3, WAVES] [rad/m]."""
    phase: np.ndarray
    """float64 [WAVES] [rad]."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Values [N] at points [N, 3] [m]."""
        values = np.empty(len(points))

        def fill(tile):
            waves = np.asarray(points[tile] @ self.k + self.phase, np.float32)  # cosines of these are faster
            values[tile] = np.cos(waves, out=waves).sum(axis=1)

        in_tiles(fill, len(points), TILE)
        return values * np.sqrt(2.0 / WAVES)


def field_of(key: np.uint64, wavelength: float, turn: float = 0.0) -> Field:
    """The field of a key, its waves 0.7 to 1.7 times as long as ``wavelength`` [m].

    Those of one key that differ by half a turn are each other's negative, by a quarter independent.
    """
    rng = np.random.default_rng(int(key))
    k = rng.standard_normal((3, WAVES))
    k *= 2.0 * np.pi / wavelength * rng.uniform(0.6, 1.4, WAVES) / np.linalg.norm(k, axis=0)
    return Field(k, rng.uniform(0.0, 2.0 * np.pi, WAVES) + 2.0 * np.pi * turn)
