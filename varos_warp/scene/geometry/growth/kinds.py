"""The kinds of growth: how they look, how many there are, and where they may be (defaults of docs/growth.md)."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from varos_warp.cache import cached, code_hash
from varos_warp.scene.geometry.growth.clumps import STRAY
from varos_warp.scene.geometry.growth.dust import dusted
from varos_warp.scene.geometry.growth.ground import coralline, pebble
from varos_warp.scene.geometry.growth.levels import LEVELS, levels
from varos_warp.scene.geometry.growth.plants import kelp, seagrass
from varos_warp.scene.geometry.growth.shelled import barnacle, mussel, shell, tube_worm
from varos_warp.scene.geometry.growth.soft import anemone, hydroid, starfish, turf
from varos_warp.scene.geometry.growth.solids import Form, Rgb, Solid
from varos_warp.scene.geometry.normals import corner_normals

SOLID = ("vertices", "faces", "colours", "normals")
"""What a `Solid` is made of."""
SMOOTH = np.pi
"""Angle between faces up to which prototypes are smooth [rad]: all of their edges are."""
GREYS: tuple[Rgb, ...] = ((0.7, 0.69, 0.66), (0.9, 0.86, 0.8), (1.15, 1.12, 1.06))


@dataclass(frozen=True)
class Coat:
    """What covers a host at the feet of copies: crust, holdfasts and what is caught between them."""

    colour: Rgb
    """Linear reflectance."""
    share: float
    """Largest share of the host's own colour that the coat hides."""
    reach: float
    """How far the coat reaches from a root, over the copy's size."""


@dataclass(frozen=True)
class Kind:
    """What there is to know of a kind."""

    make: Callable[[np.random.Generator], Form]
    """A shape of about unit size."""
    shapes: int
    tints: tuple[Rgb, ...]
    """Factors of its colours, from dark to light; shapes times all tints is at most 12."""
    per_m2: float
    cluster: float
    up: tuple[float, float]
    size_m: tuple[float, float]
    clump_m: float
    """Median of the radii of clumps [m]."""
    small: float | None = None
    """Exponent s of sizes whose density falls as size^-s; None: they are log-normal, as of what grows."""
    body: float = 0.0
    """Least distance of two copies over the mean of their sizes; 0: they may overlap."""
    straight: float = 0.0
    """How much of the vertical is added to the surface's normal: what stands up."""
    jitter: float = 0.08
    """Deviation of a copy's axis [rad]."""
    tall: bool = False
    """Whether its size is its height over the ground; else how wide it is."""
    scars: bool = True
    """Whether it leaves the host's scars bare, and has its territory there."""
    territory: float = 0.0
    """Phase of a field of the host [turns] where the kind dominates; half a turn away there is next to none of it."""
    cover: float = 0.0
    """What bodies in a clump cover where there are no scars, before those that find no room are left out, over its
    area; 0: it may be loose."""
    smaller: float = 0.0
    """Share of its size that a copy lacks at the rim of its clump."""
    stray: float = STRAY
    """Share of the copies that stand outside of clumps."""
    dusty: tuple[Rgb, ...] = ()
    """Factors of the colours of copies with silt on them, which stand on hosts with silt."""
    coat: Coat | None = None
    """What covers the host between and about copies."""
    flows: bool = False
    """Whether it bends with the current, along its y axis."""
    edges: float = 0.0
    """How much it prefers edges to level places, in deviations of the noise of clumps."""
    under: float = 0.0
    """How much it prefers undersides to walls, and walls to tops, in the same unit; less than 0: it prefers tops."""


KINDS = {
    "barnacle": Kind(
        barnacle,
        6,
        ((0.86, 0.83, 0.75),),
        230.0,
        11.0,
        (-1.0, 1.0),
        (0.005, 0.028),
        0.04,
        body=0.8,
        territory=0.0,
        cover=2.2,
        smaller=0.55,
        stray=0.1,
        dusty=((0.75, 0.72, 0.65),),
        coat=Coat((0.12, 0.108, 0.085), 0.7, 1.2),
    ),
    "tube_worm": Kind(
        tube_worm,
        6,
        ((0.5, 0.48, 0.44), (0.75, 0.72, 0.66)),
        60.0,
        9.0,
        (-1.0, 1.0),
        (0.018, 0.058),
        0.07,
        territory=0.65,
        cover=2.1,
        smaller=0.3,
        stray=0.15,
        under=0.7,
    ),
    "hydroid": Kind(
        hydroid,
        3,
        ((0.72, 0.74, 0.66), (0.9, 0.8, 0.72), (1.05, 1.05, 1.0)),
        270.0,
        7.0,
        (-0.6, 1.0),
        (0.012, 0.055),
        0.05,
        straight=0.35,
        jitter=0.25,
        tall=True,
        territory=0.8,
        cover=1.05,
        smaller=0.5,
        stray=0.1,
        dusty=((0.95, 0.92, 0.86),),
        coat=Coat((0.105, 0.092, 0.066), 0.75, 0.8),
        flows=True,
        edges=1.4,
    ),
    "anemone": Kind(
        anemone,
        4,
        ((0.8, 0.8, 0.8), (0.95, 0.7, 0.6), (0.85, 0.95, 1.1)),
        1.0,
        6.0,
        (-1.0, 1.0),
        (0.03, 0.08),
        0.07,
        body=0.7,
        straight=0.1,
        tall=True,
        territory=0.55,
        cover=0.6,
        smaller=0.3,
        edges=0.3,
        under=0.5,
    ),
    "coralline": Kind(
        coralline,
        4,
        ((0.8, 0.78, 0.76), (1.0, 1.0, 1.0), (1.1, 1.15, 1.15)),
        18.0,
        8.0,
        (-0.4, 1.0),
        (0.015, 0.11),
        0.1,
        body=0.4,
        jitter=0.03,
        territory=0.3,
        cover=1.0,
    ),
    "mussel": Kind(
        mussel,
        6,
        ((1.0, 1.0, 1.0),),
        250.0,
        12.0,
        (-0.5, 1.0),
        (0.02, 0.06),
        0.12,
        body=0.3,
        jitter=0.35,
        territory=0.4,
        cover=2.0,
        smaller=0.5,
        stray=0.01,
        dusty=((1.2, 1.12, 1.0),),
        coat=Coat((0.028, 0.025, 0.019), 0.92, 0.6),
    ),
    "starfish": Kind(
        starfish,
        3,
        ((0.85, 0.85, 0.85), (0.75, 0.72, 0.8), (0.95, 1.1, 1.1)),
        0.1,
        4.0,
        (0.3, 1.0),
        (0.07, 0.14),
        0.4,
        body=1.0,
        jitter=0.03,
        scars=False,
    ),
    "shell": Kind(
        shell,
        6,
        ((0.6, 0.57, 0.52), (0.9, 0.88, 0.85)),
        6.0,
        4.5,
        (0.75, 1.0),
        (0.012, 0.034),
        0.2,
        small=1.5,
        body=0.8,
        jitter=0.25,
        scars=False,
    ),
    "pebble": Kind(
        pebble, 4, GREYS, 190.0, 4.5, (0.7, 1.0), (0.005, 0.07), 0.2, small=2.7, body=0.85, jitter=0.15, scars=False
    ),
    "kelp": Kind(
        kelp,
        12,
        ((1.0, 1.0, 1.0),),
        3.0,
        7.0,
        (0.4, 1.0),
        (0.5, 1.6),
        0.4,
        body=0.08,
        straight=2.5,
        tall=True,
        scars=False,
        flows=True,
    ),
    "seagrass": Kind(
        seagrass,
        6,
        ((0.85, 0.9, 0.9), (1.15, 1.1, 1.0)),
        120.0,
        9.0,
        (0.75, 1.0),
        (0.15, 0.5),
        0.3,
        straight=2.0,
        jitter=0.15,
        tall=True,
        scars=False,
    ),
    "turf": Kind(
        turf,
        3,
        ((0.72, 0.7, 0.62), (0.84, 0.88, 0.7), (1.05, 0.97, 0.84)),
        900.0,
        9.0,
        (-0.7, 1.0),
        (0.006, 0.04),
        0.06,
        straight=0.2,
        jitter=0.3,
        tall=True,
        territory=0.9,
        cover=1.35,
        smaller=0.65,
        stray=0.05,
        dusty=((0.8, 0.78, 0.7),),
        coat=Coat((0.115, 0.102, 0.074), 0.8, 1.3),
        edges=1.8,
        under=-0.5,
    ),
}
"""Kinds of growth by name. A new one comes last: its number seeds the shapes."""


@lru_cache
def prototypes(kind: str) -> tuple[tuple[Solid, ...], ...]:
    """The levels of every shape in every tint; the same in every scene.

    The tints of a shape come one after the other, those without silt first.
    """
    chosen, made = KINDS[kind], []
    depends_on = {"kind": kind, "code": code_hash(__name__, ("varos_warp.scene.geometry",))}
    kept = cached("prototypes", depends_on, lambda: _shapes(kind))
    for k in range(chosen.shapes):
        shape = [Solid(*(kept[f"{column}_{k}_{level}"] for column in SOLID)) for level in range(len(LEVELS) + 1)]
        is_whole = bool(kept[f"is_whole_{k}"])
        made += [tuple(solid.tinted(tint) for solid in shape) for tint in chosen.tints]
        made += [tuple(dusted(solid.tinted(tint), is_whole) for solid in shape) for tint in chosen.dusty]
    return tuple(made)


def _shapes(kind):
    """The levels of every shape, as arrays, and whether it is without a body of its own."""
    chosen, number = KINDS[kind], list(KINDS).index(kind)
    forms = [chosen.make(np.random.default_rng([number, k])) for k in range(chosen.shapes)]
    made = [[_finished(solid, chosen.tall) for solid in levels(form)] for form in forms]
    return {f"is_whole_{k}": np.array(form.body is None) for k, form in enumerate(forms)} | {
        f"{column}_{k}_{level}": getattr(solid, column)
        for k, shape in enumerate(made)
        for level, solid in enumerate(shape)
        for column in SOLID
    }


def _finished(solid, tall):
    """A prototype of unit size with its normals, which copies of all tints share."""
    unit = solid.scaled(1.0 / (solid.vertices[:, 2].max() if tall else np.ptp(solid.vertices, axis=0).max()))
    return replace(unit, normals=corner_normals(unit.vertices, unit.faces, SMOOTH))
