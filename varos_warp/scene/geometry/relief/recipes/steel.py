"""Steel that has lain in the sea: paint that breaks and lifts, rust in tones and tubercles, stains, weld seams."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import NOISE_STD, domes, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import Tones, covered, drawn, running, tones_of
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT_M = 0.005
"""Bound of ``coarse`` [m]."""
FINE_LIMIT_M = 0.016
"""Bound of ``fine`` [m]."""
PAINT = (0.17, 0.175, 0.17)
"""Reflectance of paint where the block gives none: a grey primer."""
CHALK = (0.270, 0.245, 0.190)
STOPS = (0.0, 0.25, 0.45, 0.65, 0.82, 1.0)
RUSTS = np.array(
    [
        [0.022, 0.018, 0.016],
        [0.050, 0.029, 0.020],
        [0.095, 0.045, 0.025],
        [0.150, 0.070, 0.031],
        [0.215, 0.108, 0.043],
        [0.290, 0.180, 0.078],
    ]
)
"""Black, brown, red-brown, orange and ochre, along STOPS."""
STAIN, STAINS = np.array([0.80, 0.52, 0.32]), np.array([0.024, 0.010, 0.002])
"""What rust that has run over paint leaves of its reflectance, and adds to it."""
SEAM_SPACING_M, SEAM_WIDTH_M, SEAM_HEIGHT_M = 2.9, 0.014, 0.0032
SCRATCHED = 0.10
"""Mean of scratches over a surface of metres (measured on balls of 1 to 4 m: 0.09 to 0.11)."""
LONGEST_STAIN_M = 0.55
"""How long stains of rust are at most [m]."""
SLENDER = 4.0
"""How many times longer than wide things are that have seams across, and scratches along."""


class Damage(NamedTuple):
    """The state of paint at N places."""

    bare: np.ndarray
    """1 where paint is gone, sharply edged, to 0."""
    lift: np.ndarray
    """1 at the rim of what is left, to 0 farther away."""
    depth: np.ndarray
    """How far inside of a bare patch, 0 to 1: there the rust is older and darker."""
    near: np.ndarray
    """1 where rust is near, to 0: what it has seeped into."""
    tubercles: np.ndarray
    """Height of domes of rust, 0 to 1.3."""


class Steel:
    """Painted or bare steel.

    ``coarse`` moves a surface by at most 5 mm, ``fine`` by at most 16 mm. About the square of ``wear`` is the share of
    the paint that is gone from flat places; edges lose it first.
    """

    name = "steel"
    by_vertex = False  # things run down

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Weld seams around what is long and slender, and dents."""
        dents = 0.006 * sites.patterns(look.seed).fbm(max(1.5, 1.5 / sites.size), 2, 2) * min(1.0, sites.size)
        return np.clip(SEAM_HEIGHT_M * _seams(sites, look.seed) + dents, -LIMIT_M, LIMIT_M)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Edges of the paint, scale, pits, tubercles and soft growth."""
        pattern = sites.patterns(look.seed)
        damage = _damage(sites, pattern, look)
        scale = 0.0022 * (0.5 + 0.5 * pattern.billow(55.0, 4, 8))
        pitted = pattern.worley(85.0, 41)
        pits = 0.0016 * domes(pitted.near, 0.18 + 0.24 * pitted.id) * (pitted.id > 0.45) * pattern.resolved(0.009)
        coat = 0.0009 * (1.0 - damage.bare) + 0.0011 * damage.lift * (1.0 + sites.edges)
        soft = 0.0016 * look.film * (pattern.billow(70.0, 3, 11) + 0.38)
        h = coat + damage.bare * (scale - pits) + 0.0075 * damage.tubercles + soft
        return np.clip(h, -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Faded paint, stains that run down, six tones of rust, film and silt over all; mean about 0.1."""
        pattern = sites.patterns(look.seed)
        damage = _damage(sites, pattern, look)
        tones = tones_of(pattern)
        hung = drawn(tones, shape)
        paint = np.asarray(PAINT if look.paint is None else look.paint)
        paint = _faded(tones, hung, shape, paint, min(1.0, 3.0 * look.wear))
        thin = np.maximum(_scratches(sites, pattern, look.seed), _worn_through(pattern, look.wear))
        paint = mix(paint, PAINT, 0.35 * min(1.0, 4.0 * look.wear) * thin)
        # the more rust there is, the less the paint that is left stands out from it
        stain = np.max(
            [
                (0.5 + 0.4 * look.wear) * damage.near,
                _stains(pattern, shape, damage, look),
                np.full(len(paint), 0.8 * look.wear**2),
            ],
            axis=0,
        )
        paint = mix(paint, paint * STAIN + STAINS, 0.85 * stain)
        rusted = np.maximum(0.95 * damage.bare, 0.9 * np.minimum(damage.tubercles, 1.0))
        steel = mix(paint, _rust(tones, hung, damage), rusted)
        steel = steel * (1.0 + 0.9 * np.clip(shape.convexity, -0.33, 0.33))[:, None]
        gathers = np.max([sites.edges, 0.7 * _seams(sites, look.seed), 0.6 * shape.hollow, 0.7 * damage.lift], axis=0)
        return covered(steel, sites, shape, look, hold=0.62, tones=tones, start=gathers)


def _damage(sites: Sites, pattern: Patterns, look: Look) -> Damage:
    return sites.once(("steel", look.seed, look.wear), lambda: _damaged(sites, pattern, look))


def _damaged(sites, pattern, look):
    """State of the paint: it is gone in chips, most along edges, seams and scratches, and more in some zones."""
    zone = pattern.fbm(max(0.7, 1.0 / sites.size), 2, 14)
    chips = pattern.moved(0.02, 9.0, 3).fbm(11.0, 5, 13, 0.62)
    # what scratches lose more, the rest loses less: the share of flat places stays that of wear
    scratched = _scratches(sites, pattern, look.seed) - SCRATCHED
    edges = 0.28 * sites.edges + 0.20 * _seams(sites, look.seed) + 0.30 * scratched
    worn = (
        0.42 * zone
        + 0.95 * chips
        + edges * min(1.0, 4.0 * look.wear)
        + 0.95 * NOISE_STD * np.clip(ndtri(np.clip(look.wear**2, 1e-9, 1.0 - 1e-9)), -6.0, 6.0)
    )
    # what is left out of the noise on coarse meshes would have made the edge ragged: there it is a blur
    bare = smoothstep(0.0, 0.015 + 0.08 * (1.0 - pattern.resolved(0.02)), worn)
    cells = pattern.moved(0.045, 26.0, 5, 4).worley((24.0, 24.0, 17.0), 6)
    rusting = (cells.id > 0.55) * smoothstep(-0.02, 0.14, worn + 0.15 * zone)
    domed = rusting * domes(cells.near, 0.24 + 0.25 * cells.id) * (0.30 + cells.id) * pattern.resolved(0.02)
    return Damage(
        bare,
        smoothstep(-0.07, 0.0, worn) * (1.0 - bare),
        smoothstep(0.0, 0.25, worn),
        smoothstep(-0.16, 0.02, worn) * (look.wear > 0.0),
        domed,
    )


def _axes(sites: Sites) -> tuple[np.ndarray, np.ndarray]:
    """Extent of a surface along its principal axes [3] [m^2], rising, and these, [3, 3] in columns."""
    centred = sites.p - sites.p.mean(axis=0)
    covariance = np.einsum("ni,nj->ij", centred, centred) / max(len(centred), 1)
    spread, axes = np.linalg.eigh(covariance if sites.spread is None else sites.spread)
    return spread, axes * np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=0)[None], axis=0))


def _scratches(sites: Sites, pattern: Patterns, seed: int) -> np.ndarray:
    """Scratches along what is long, else level, [N], many in some places: where chains and nets have passed."""
    spread, axes = _axes(sites)
    longest = axes[:, 2] if spread[2] > 2.0 * spread[1] else np.array([1.0, 0.0, 0.0])
    along = longest + np.random.default_rng([seed, 3]).normal(0.0, 0.06, 3)
    turned = np.linalg.qr(np.column_stack([along, np.roll(np.eye(3), -np.argmax(np.abs(along)), axis=0)[1:].T]))[0]
    lines = pattern.moved(0.3, 0.6, 30, 3)
    lines = lines.at(lines.p @ turned).fbm((1.1, 14.0, 14.0), 4, 16, 0.8)
    return smoothstep(0.30, 0.42, lines + 1.3 * pattern.fbm((1.2, 1.2, 1.8), 3, 17))


def _seams(sites: Sites, seed: int) -> np.ndarray:
    """Weld seams across the long axis of what is at least SLENDER times as long as wide, [N]: 1 on their crest."""
    spread, axes = _axes(sites)
    if spread[2] < SLENDER**2 * max(spread[1], 1e-12) or sites.size < 1.0:
        return np.zeros(len(sites.p))
    centred = sites.p - (sites.p.mean(axis=0) if sites.middle is None else sites.middle)
    along = centred @ axes[:, 2] / SEAM_SPACING_M + np.random.default_rng([seed, 2]).random()
    off = (along - np.round(along)) * SEAM_SPACING_M
    around = smoothstep(0.5, 0.2, np.abs(sites.n @ axes[:, 2]))  # not on end faces
    width = np.maximum(0.5 * SEAM_WIDTH_M, sites.edge)
    return around * np.exp(-((off / width) ** 2)) * (1.0 + 0.5 * sites.patterns(seed).fbm(60.0, 2, 42))


def _worn_through(pattern: Patterns, wear: float) -> np.ndarray:
    """Share of each place where the last coat has worn thin and an older one shows, [N]: patches with ragged rims."""
    where = 0.7 * pattern.fbm(1.3, 2, 19) + pattern.moved(0.3, 3.0, 34, 3).fbm((5.0, 5.0, 7.0), 5, 21, 0.6)
    return patches(where, min(0.8 * wear, 0.5), 0.03)


def _stains(pattern: Patterns, shape: Shape, damage: Damage, look: Look) -> np.ndarray:
    """Rust that has run down from where it is, [N]."""
    if look.wear == 0.0:
        return np.zeros(len(pattern.p))
    return running(pattern, shape, np.maximum(damage.bare, np.minimum(damage.tubercles, 1.0)), 18, LONGEST_STAIN_M)


def _faded(tones: Tones, hung: np.ndarray, shape: Shape, paint: np.ndarray, age: float) -> np.ndarray:
    """Paint that has bleached over metres, most where it faces up, and chalked with age, [N, 3]."""
    tone = 1.0 + 0.40 * tones.broad + 0.15 * hung + 0.25 * tones.fine
    chalk = age * np.clip(0.22 + 0.5 * tones.broad + 0.20 * hung + 0.12 * shape.up, 0.0, 0.6)
    return mix(paint * tone[:, None], 0.5 * (paint + CHALK), chalk)


def _rust(tones: Tones, hung: np.ndarray, damage: Damage) -> np.ndarray:
    """Rust, [N, 3]: dark where it is old, paler on tubercles; large areas are much alike."""
    tone = np.clip(
        0.50 - 0.22 * damage.depth + 0.25 * tones.broad + 0.40 * hung + 0.7 * tones.fine + 0.25 * damage.tubercles,
        0.0,
        1.0,
    )
    return np.stack([np.interp(tone, STOPS, RUSTS[:, channel]) for channel in range(3)], axis=1)
