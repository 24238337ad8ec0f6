"""Random numbers that belong to a place, not to a turn, and the fields by which copies cluster.

A copy's numbers follow from keys of its host, its triangle and its number there: they do not depend on what else is
drawn, in which order, or by how many threads.
"""

import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr, pdtr
from scipy.stats import poisson

from varos_warp.device.launch import in_tiles

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
WAVES = 24
TILE = 1 << 13
"""Places at which waves are added together: they stay in a core's cache."""
OCTAVES = ((0.35, 0.5), (1.0, 0.6))
"""Wavelengths of clumps and clusters, in those of clusters, and their shares of the noise's deviation."""
GROUPS = (5.0, 0.62)
"""Likewise of groups of clusters, of what has no territory on its host."""
TERRITORY_M, TERRITORY = 0.9, 0.62
"""Wavelength [m] of the field by which kinds divide a host, and its share."""
PER_CLUSTER = 0.28
"""Clusters have exp(`PER_CLUSTER` cluster) times the mean, or as many as bodies fill the place."""
MOST_CROWDED = 300.0
"""But no place has more copies in the mean than so many times ``per_m2``."""
STRAY = 0.015
"""Share of the copies that stand alone."""
RIM = 0.25
"""How far the noise rises from the rim of a clump to where it is full."""
BARE_BELOW, FULL_ABOVE = -0.7, -0.1
"""Of a field of variance 1: scars, where next to nothing grows, and where it does as elsewhere."""
IN_SCARS = 0.04
"""Share of growth that scars have."""


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
    some = np.flatnonzero(u >= np.exp(-mean))
    one = u[some] < pdtr(1, mean[some])
    counts[some[one]] = 1
    more = some[~one]
    counts[more] = poisson.ppf(u[more], mean[more]).astype(np.int64)
    return counts


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
            waves = points[tile] @ self.k
            waves += self.phase
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


@dataclass(frozen=True)
class Crowding:
    """How much more or less than ``per_m2`` there is at places of one host: 1 in the mean over all fields.

    Clumps are full to their rims, with next to nothing between them; they make clusters where their kind has its
    territory, and all kinds of a host leave the same scars bare.
    """

    least_peak: float
    """How many times ``per_m2`` clumps have; 1: there are none, copies are as rain."""
    octaves: tuple[tuple[Field, float], ...]
    """With their shares; the sum of squares of these is 1."""
    scars: Field | None

    @property
    def peak(self) -> float:
        """The most that there can be."""
        return _crowding(self.least_peak, self.scars is not None).peak

    def __call__(self, points: np.ndarray, liking: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Weights [N] at points [N, 3] about the host's own origin [m], and how deep in a clump they are, 0 to 1.

        ``liking`` is added to the noise, of variance 1: more than 0 where there is to be more than elsewhere.
        """
        if self.least_peak == 1.0:
            return np.ones(len(points)), np.ones(len(points))
        clumps = _crowding(self.least_peak, self.scars is not None)
        noise = sum(share * field(points) for field, share in self.octaves) + liking
        weight = clumps.weight(noise)
        if self.scars is not None:
            weight = weight * _left_by_scars(self.scars(points))
        return weight / clumps.mean, clumps.depth(noise)


def crowding(
    least_peak: float, wavelength: float, own: np.uint64, host: np.uint64 | None, territory: float = 0.0
) -> Crowding:
    """Of a kind on a host.

    Args:
        least_peak: How many times the mean its clumps have.
        wavelength: About how far clusters are apart [m].
        own: Key of the kind, the host and the seeds.
        host: Key of the host alone, or None for what leaves no scars and has no territory.
        territory: Where the kind has it, in turns of the host's field.
    """
    some = [(field_of(mixed(own, np.uint64(k)), times * wavelength), share) for k, (times, share) in enumerate(OCTAVES)]
    if host is None:
        some.append((field_of(mixed(own, np.uint64(len(OCTAVES))), GROUPS[0] * wavelength), GROUPS[1]))
    else:
        some.append((field_of(mixed(host, np.uint64(1)), TERRITORY_M, territory), TERRITORY))
    norm = np.sqrt(sum(share * share for _, share in some))
    return Crowding(
        max(min(least_peak, MOST_CROWDED), 1.0),
        tuple((field, share / norm) for field, share in some),
        None if host is None else field_of(host, 0.7),
    )


@dataclass(frozen=True)
class _Clumps:
    """Weights over a normal variable: full above a rim, few below."""

    full: float
    """Weight in a clump, before it is divided by the mean; elsewhere it is `STRAY`."""
    rim: float
    mean: float

    @property
    def peak(self) -> float:
        return self.full / self.mean

    def weight(self, noise):
        return STRAY + (self.full - STRAY) * _smooth((noise - self.rim) / RIM)

    def depth(self, noise):
        """Uniform in (0, 1) over what lies above the rim; 0 below."""
        return np.clip(1.0 - ndtr(-noise) / ndtr(-self.rim), 0.0, 1.0)


def _smooth(t):
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _left_by_scars(noise):
    return IN_SCARS + (1.0 - IN_SCARS) * _smooth((noise - BARE_BELOW) / (FULL_ABOVE - BARE_BELOW))


@lru_cache
def _crowding(least_peak: float, scars: bool) -> _Clumps:
    """Clumps whose weights have the mean 1, but for scars: expectations over a normal variable."""
    z = np.linspace(-9.0, 9.0, 20_001)
    density = np.exp(-0.5 * z * z)
    density /= density.sum()
    bare = float(density @ _left_by_scars(z)) if scars else 1.0

    if least_peak == 1.0:
        return _Clumps(1.0, -np.inf, bare)

    def excess(rim):
        return float(density @ _Clumps(least_peak, rim, 1.0).weight(z)) - 1.0

    return _Clumps(least_peak, brentq(excess, -9.0, 9.0), bare)
