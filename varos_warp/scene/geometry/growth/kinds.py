"""The kinds of growth: how they look, how many there are, and where they may be (defaults of docs/growth.md)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from varos_warp.scene.geometry.growth.ground import coralline, pebble
from varos_warp.scene.geometry.growth.levels import levels
from varos_warp.scene.geometry.growth.plants import kelp, seagrass
from varos_warp.scene.geometry.growth.shelled import barnacle, mussel, shell, tube_worm
from varos_warp.scene.geometry.growth.soft import anemone, hydroid, starfish
from varos_warp.scene.geometry.growth.solids import Form, Rgb, Solid

GREYS: tuple[Rgb, ...] = ((0.75, 0.75, 0.73), (1.0, 1.0, 1.0), (1.2, 1.18, 1.14))


@dataclass(frozen=True)
class Kind:
    """What there is to know of a kind."""

    make: Callable[[np.random.Generator], Form]
    """A shape of about unit size."""
    shapes: int
    tints: tuple[Rgb, ...]
    """Factors of its colours; shapes times tints is at most 12."""
    per_m2: float
    cluster: float
    up: tuple[float, float]
    size_m: tuple[float, float]
    wavelength: float
    """About how far clusters are apart [m]."""
    small: float = 1.5
    """Exponent s of sizes, whose density falls as size^-s: the larger, the more are small."""
    body: float = 0.0
    """Least distance of two copies over the mean of their sizes; 0: they may overlap."""
    straight: float = 0.0
    """How much of the vertical is added to the surface's normal: what stands up."""
    jitter: float = 0.08
    """Deviation of a copy's axis [rad]."""
    tall: bool = False
    """Whether its size is its height over the ground; else how wide it is."""
    scars: bool = True
    """Whether it leaves the host's scars bare."""


KINDS = {
    "barnacle": Kind(barnacle, 4, ((0.8, 0.8, 0.8), (1.0, 1.0, 0.97), (1.18, 1.17, 1.12)), 230.0, 11.0, (-1.0, 1.0),
                     (0.007, 0.024), 0.16, small=2.0, body=0.82),
    "tube_worm": Kind(tube_worm, 6, ((0.62, 0.62, 0.6), (0.95, 0.93, 0.88)), 35.0, 9.0, (-1.0, 1.0), (0.018, 0.058),
                      0.25),
    "hydroid": Kind(hydroid, 3, ((1.0, 1.0, 1.0), (0.65, 0.8, 0.6), (1.15, 0.72, 0.85), (1.35, 1.5, 1.6)), 270.0, 7.0,
                    (-0.6, 1.0), (0.012, 0.055), 0.28, straight=0.35, jitter=0.2, tall=True),
    "anemone": Kind(anemone, 4, ((1.0, 1.0, 1.0), (1.15, 0.8, 0.65), (1.1, 1.35, 1.7)), 1.6, 6.0, (-0.2, 1.0),
                    (0.03, 0.08), 0.5, body=0.7, straight=0.25, tall=True),
    "coralline": Kind(coralline, 4, ((0.8, 0.75, 0.75), (1.0, 1.0, 1.0), (1.15, 1.25, 1.3)), 18.0, 8.0, (-0.4, 1.0),
                      (0.015, 0.11), 0.4, small=2.0, body=0.55, jitter=0.03),
    "mussel": Kind(mussel, 4, ((0.8, 0.82, 0.9), (1.1, 1.05, 1.0), (1.5, 1.35, 1.1)), 250.0, 12.0, (-0.5, 1.0),
                   (0.02, 0.06), 0.5, small=1.0, body=0.35, jitter=0.35),
    "starfish": Kind(starfish, 3, ((1.0, 1.0, 1.0), (0.75, 0.7, 0.9), (1.25, 1.5, 1.4)), 0.2, 4.0, (0.3, 1.0),
                     (0.07, 0.14), 1.5, small=1.0, body=1.0, jitter=0.03, scars=False),
    "shell": Kind(shell, 6, ((0.7, 0.68, 0.64), (1.0, 1.0, 1.0)), 10.0, 4.5, (0.75, 1.0), (0.012, 0.034), 1.4,
                  body=0.8, jitter=0.25, scars=False),
    "pebble": Kind(pebble, 4, GREYS, 190.0, 4.5, (0.7, 1.0), (0.005, 0.07), 1.4, small=2.7, body=0.85, jitter=0.2,
                   scars=False),
    "kelp": Kind(kelp, 6, ((0.85, 0.9, 0.9), (1.15, 1.05, 1.0)), 3.0, 7.0, (0.4, 1.0), (0.5, 1.6), 2.5, small=1.0,
                 body=0.08, straight=2.5, tall=True, scars=False),
    "seagrass": Kind(seagrass, 6, ((0.85, 0.9, 0.9), (1.15, 1.1, 1.0)), 120.0, 9.0, (0.75, 1.0), (0.15, 0.5), 2.0,
                     small=1.0, straight=2.0, jitter=0.15, tall=True, scars=False),
}


@lru_cache
def prototypes(kind: str) -> tuple[tuple[Solid, ...], ...]:
    """The levels of every shape in every tint, the tints of a shape one after the other; the same in every scene."""
    chosen, number = KINDS[kind], list(KINDS).index(kind)
    made = [levels(chosen.make(np.random.default_rng([number, k]))) for k in range(chosen.shapes)]
    shapes = [tuple(_of_unit_size(solid, chosen.tall) for solid in shape) for shape in made]
    return tuple(tuple(solid.tinted(tint) for solid in shape) for shape in shapes for tint in chosen.tints)


def _of_unit_size(solid, tall):
    return solid.scaled(1.0 / (solid.vertices[:, 2].max() if tall else np.ptp(solid.vertices, axis=0).max()))
