"""Random numbers that belong to a place, not to a turn, and the fields by which copies cluster.

A copy's numbers follow from keys of its host, its triangle and its number there: they do not depend on what else is
drawn, in which order, or by how many threads.
"""

import zlib
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import pdtr
from scipy.stats import poisson

GOLDEN = np.uint64(0x9E3779B97F4A7C15)
WAVES = 24
SPREAD = 0.2
"""Standard deviation of the noise that ``cluster`` multiplies, that of gradient noise of four octaves."""
OCTAVES = (0.35, 1.0, 5.0)
"""Wavelengths of clumps, clusters and groups, in those of clusters."""
MOST_CROWDED = 30.0
"""No place has more copies in the mean than so many times ``per_m2``: bodies fill it."""
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
        return np.cos(points @ self.k + self.phase).sum(axis=1) * np.sqrt(2.0 / WAVES)


def field_of(key: np.uint64, wavelength: float) -> Field:
    """The field of a key, its waves 0.7 to 1.7 times as long as ``wavelength`` [m]."""
    rng = np.random.default_rng(int(key))
    k = rng.standard_normal((3, WAVES))
    k *= 2.0 * np.pi / wavelength * rng.uniform(0.6, 1.4, WAVES) / np.linalg.norm(k, axis=0)
    return Field(k, rng.uniform(0.0, 2.0 * np.pi, WAVES))


@dataclass(frozen=True)
class Crowding:
    """How much more or less than ``per_m2`` there is at places of one host: 1 in the mean over all fields.

    Clumps make clusters, which stand in larger groups, and all kinds of a host leave the same scars bare.
    """

    cluster: float
    octaves: tuple[Field, ...]
    """Of clumps, clusters and groups; the sum of all is as of one field."""
    scars: Field | None

    @property
    def peak(self) -> float:
        """The most that there can be."""
        return _crowding(self.cluster, self.scars is not None)[0]

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Weights [N] at points [N, 3] about the host's own origin [m]."""
        if self.cluster == 0.0:
            return np.ones(len(points))
        peak, mean = _crowding(self.cluster, self.scars is not None)
        noise = sum(field(points) for field in self.octaves) / np.sqrt(len(self.octaves))
        weight = _clusters(self.cluster, noise)
        return np.minimum((weight if self.scars is None else weight * _left_by_scars(self.scars(points))) / mean, peak)


def crowding(cluster: float, wavelength: float, own: np.uint64, scars: np.uint64 | None) -> Crowding:
    """Of a kind on a host.

    Args:
        cluster: Its key in the scene file.
        wavelength: About how far clusters are apart [m].
        own: Key of the kind, the host and the seeds.
        scars: Key of the host alone, or None for what leaves no scars.
    """
    octaves = tuple(field_of(mixed(own, np.uint64(k)), times * wavelength) for k, times in enumerate(OCTAVES))
    bare = None if scars is None or cluster == 0.0 else field_of(scars, 0.7)
    return Crowding(cluster, octaves, bare)


def _clusters(cluster, noise):
    """Lognormal with mean 1, cut off where bodies fill the place."""
    s = SPREAD * cluster
    return np.minimum(np.exp(s * noise - 0.5 * s * s), min(MOST_CROWDED, np.exp(2.5 * s - 0.5 * s * s)))


def _left_by_scars(noise):
    t = np.clip((noise - BARE_BELOW) / (FULL_ABOVE - BARE_BELOW), 0.0, 1.0)
    return IN_SCARS + (1.0 - IN_SCARS) * t * t * (3.0 - 2.0 * t)


@lru_cache
def _crowding(cluster: float, scars: bool) -> tuple[float, float]:
    """Peak of the weights, and what they are divided by for their mean to be 1: expectations over a normal variable."""
    if cluster == 0.0:
        return 1.0, 1.0
    z = np.linspace(-9.0, 9.0, 20_001)
    density = np.exp(-0.5 * z * z)
    density /= density.sum()
    mean = float(density @ _clusters(cluster, z)) * (float(density @ _left_by_scars(z)) if scars else 1.0)
    return float(_clusters(cluster, np.inf)) / mean, mean
