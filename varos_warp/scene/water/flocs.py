"""Shapes of marine snow: flocs, which are aggregates of smaller grains.

Flocs have no outline of their own: they are where grains stuck to each other. Of N grains of a mean radius a in a floc
with a radius of gyration R_g,

    N = k_f (R_g / a)^D

with a fractal dimension D; that of flocs in the Elbe and in the North Sea was 1.41 to 1.81 (Chen and Eisma 1995, Neth.
J. Sea Res. 33, 173). Small D are stringers, large D are lumps. The shapes here grow grain by grain so that they follow
this law, as in tunable sequential aggregation (Filippov, Zurita and Rosner 2000, J. Colloid Interface Sci. 229, 261).
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

SHAPES, GRAINS = 64, 12
"""How many shapes there are, and grains of each."""
DIMENSIONS = (1.41, 1.81)
"""Fractal dimensions of the first shape and of the last."""
PREFACTOR = 1.3
"""k_f: 1.1 to 1.6 is usual of aggregates."""
WIDEST = 3.0
"""Largest over smallest radius of grains."""
OPACITIES = (0.6, 0.15)
"""Share of the light that meets a grain which does not go through it, of the smallest grains and of the largest: flocs
are the looser the larger they are."""
TOUCH = 0.85
"""Distance of grains that stick to each other, over the sum of their radii: they are soft."""
TRIALS = 96
"""Places that are tried for each grain."""
STEPS = 4096.0
"""Places and radii are multiples of one over this, so that they are the same on all machines."""


class Flocs(NamedTuple):
    """Shapes of bodies whose cross section is that of a sphere of radius 1."""

    at: np.ndarray
    """Places of the grains, float64 [shape, grain, 3]; the middle of their cross sections is at 0."""
    radius: np.ndarray
    """Radii of the grains, float64 [shape, grain]."""
    share: np.ndarray
    """Share of the cross section that is each grain's, float64 [shape, grain]; their sum is 1."""


@lru_cache(maxsize=1)
def flocs() -> Flocs:
    """The shapes, the same ever and everywhere."""
    rng = np.random.default_rng(0x666C6F63)
    large = rng.random((SHAPES, GRAINS))
    radius, opacity = WIDEST**large, OPACITIES[0] * (OPACITIES[1] / OPACITIES[0]) ** large
    at = _grown(radius, rng)
    size = np.sqrt((opacity * radius**2).sum(1))
    at, radius = at / size[:, None, None], np.round(radius / size[:, None] * STEPS) / STEPS
    share = opacity * radius**2
    share /= share.sum(1, keepdims=True)
    at -= np.einsum("sg,sgi->si", share, at)[:, None]
    return Flocs(np.round(at * STEPS) / STEPS, radius, share)


def _grown(radius: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Places [shape, grain, 3] of grains of these radii [shape, grain] that stick to each other."""
    shapes, mean = np.arange(SHAPES), radius.mean(1)
    dimension = np.linspace(*DIMENSIONS, SHAPES)
    at = np.zeros((SHAPES, GRAINS, 3))
    for n in range(1, GRAINS):
        tried = _touching(at[:, :n], radius[:, :n], radius[:, n], rng)
        wanted = mean * ((n + 1) / PREFACTOR) ** (1.0 / dimension)
        off = np.abs(np.log(_gyration(at[:, :n], tried) / wanted[:, None]))
        gap = (
            np.linalg.norm(tried[:, :, None] - at[:, None, :n], axis=-1) / (radius[:, :n] + radius[:, n, None])[:, None]
        )
        off += 100.0 * np.maximum(TOUCH - 1e-9 - gap.min(-1), 0.0)  # it may not lie within another
        at[:, n] = tried[shapes, off.argmin(1)]
    return at


def _touching(at: np.ndarray, radius: np.ndarray, own: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Places [shape, trial, 3] of a further grain of radius ``own`` that each touch some grain."""
    count = radius.shape[1]
    host = np.minimum((rng.random((SHAPES, TRIALS)) * count).astype(int), count - 1)
    z, turn = 2.0 * rng.random((SHAPES, TRIALS)) - 1.0, 2.0 * np.pi * rng.random((SHAPES, TRIALS))
    across = np.sqrt(1.0 - z**2)
    direction = np.stack([across * np.cos(turn), across * np.sin(turn), z], -1)
    away = TOUCH * (np.take_along_axis(radius, host, 1) + own[:, None])
    return np.take_along_axis(at, host[..., None], 1) + away[..., None] * direction


def _gyration(at: np.ndarray, tried: np.ndarray) -> np.ndarray:
    """Radius of gyration [shape, trial] of grains together with a further one, all of the same weight."""
    n = at.shape[1]
    middle = at.mean(1)
    before = ((at - middle[:, None]) ** 2).sum((1, 2))
    further = ((tried - middle[:, None]) ** 2).sum(-1)
    return np.sqrt((before[:, None] + further * n / (n + 1)) / (n + 1))
