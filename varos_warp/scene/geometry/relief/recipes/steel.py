"""Steel that has lain in the sea: paint that breaks and lifts, rust in tones and tubercles, stains, weld seams."""

from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import NOISE_STD, domes, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import covered
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT_M = 0.005
"""Bound of ``coarse`` [m]."""
FINE_LIMIT_M = 0.016
"""Bound of ``fine`` [m]."""
PAINT = (0.17, 0.175, 0.17)
"""Where the block gives none: a grey primer."""
CHALK = (0.270, 0.245, 0.190)
STOPS = (0.0, 0.25, 0.45, 0.65, 0.82, 1.0)
RUSTS = np.array([[0.022, 0.018, 0.016], [0.050, 0.029, 0.020], [0.095, 0.045, 0.025], [0.150, 0.070, 0.031],
                  [0.215, 0.108, 0.043], [0.290, 0.180, 0.078]])
"""Black, brown, red-brown, orange and ochre, along STOPS."""
SEAM_SPACING_M, SEAM_WIDTH_M, SEAM_HEIGHT_M = 2.9, 0.014, 0.0032
DROPS_M = (0.03, 0.09)
"""How far above a stain there may be rust that it comes from [m]."""


class Damage(NamedTuple):
    """The state of paint at N places."""

    bare: np.ndarray
    """1 where paint is gone, sharply edged, to 0."""
    lift: np.ndarray
    """1 at the rim of what is left, to 0 farther away."""
    depth: np.ndarray
    """How far inside of a bare patch, 0 to 1: there the rust is older and darker."""
    near: np.ndarray
    """1 where rust is near, to 0: what stains reach."""
    tubercles: np.ndarray
    """Height of domes of rust, 0 to 1.3."""


class Steel:
    """Painted or bare steel.

    ``coarse`` moves a surface by at most 5 mm, ``fine`` by at most 16 mm. About the square of ``wear`` is the share of
    the paint that is gone from flat places; edges lose it first.
    """

    name = "steel"

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Weld seams around what is long and slender, and dents."""
        dents = 0.006 * sites.patterns(look.seed).fbm(max(1.5, 1.5 / sites.size), 2, 2) * min(1.0, sites.size)
        return np.clip(SEAM_HEIGHT_M * _seams(sites, look.seed) + dents, -LIMIT_M, LIMIT_M)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Edges of the paint, scale, pits, tubercles and soft growth."""
        pattern = sites.patterns(look.seed)
        damage = _damage(sites, pattern, look)
        scale = 0.0022 * (0.5 + 0.5 * pattern.billow(55.0, 4, 8)) + 0.0014 * pattern.fbm(160.0, 3, 9)
        pitted = pattern.worley(85.0, 41)
        pits = 0.0016 * domes(pitted.near, 0.42) * (pitted.id > 0.45) * pattern.resolved(0.009)
        coat = 0.0009 * (1.0 - damage.bare) + 0.0011 * damage.lift
        soft = 0.0016 * look.film * (pattern.billow(70.0, 4, 11) + 0.38)
        h = coat + damage.bare * (scale - pits) + 0.0075 * damage.tubercles + soft
        return np.clip(h, -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Faded paint, stains, six tones of rust, film and silt over all; mean about 0.1."""
        pattern = sites.patterns(look.seed)
        damage = _damage(sites, pattern, look)
        paint = _faded(pattern, np.asarray(PAINT if look.paint is None else look.paint), min(1.0, 3.0 * look.wear))
        stain = np.maximum(0.85 * damage.near, _streaks(sites, pattern, look))
        paint = mix(paint, paint * (0.80, 0.50, 0.30) + (0.026, 0.011, 0.002), 0.85 * stain)
        steel = mix(paint, _rust(pattern, damage), 0.97 * damage.bare)
        steel = mix(steel, _rust(pattern, damage), 0.9 * np.minimum(damage.tubercles, 1.0))
        steel = steel * (1.0 + 0.9 * np.clip(shape.convexity, -0.33, 0.33))[:, None]
        return covered(steel, sites, shape, look, hold=0.62)


def _damage(sites: Sites, pattern: Patterns, look: Look) -> Damage:
    """Where paint is gone: in patches, along edges and seams, around pits."""
    least = max(3.2, 1.5 / sites.size)
    warped = pattern.moved(min(0.03, 0.1 * sites.size), 6.0, 3, 4)
    rough = 0.45 * pattern.fbm(0.35 * least, 2, 14) + 0.62 * warped.fbm(least, 6, 13) + 0.50 * pattern.fbm(19.0, 5, 4)
    edges = 0.25 * sites.edges + 0.20 * _seams(sites, look.seed)
    worn = rough + edges * min(1.0, 4.0 * look.wear) + 0.95 * NOISE_STD * np.clip(
        ndtri(np.clip(look.wear**2, 1e-9, 1.0 - 1e-9)), -6.0, 6.0)
    # what is left out of the noise on coarse meshes would have made the edge ragged: there it is a blur
    bare = smoothstep(0.0, 0.015 + 0.15 * (1.0 - pattern.resolved(0.02)), worn)
    cells = pattern.moved(0.006, 40.0, 5).worley(24.0, 6)
    rusting = (cells.id > 0.55) * smoothstep(-0.02, 0.14, worn + 0.15 * pattern.fbm(8.0, 3, 7))
    domed = rusting * domes(cells.near, 0.24 + 0.25 * cells.id) * (0.30 + cells.id) * pattern.resolved(0.02)
    return Damage(bare, smoothstep(-0.07, 0.0, worn) * (1.0 - bare), smoothstep(0.0, 0.25, worn),
                  smoothstep(-0.30, 0.02, worn) * (look.wear > 0.0), domed)


def _seams(sites: Sites, seed: int) -> np.ndarray:
    """Weld seams across the long axis of what is at least four times as long as wide, [N]: 1 on their crest."""
    centred = sites.p - (sites.p.mean(axis=0) if sites.middle is None else sites.middle)
    covariance = np.einsum("ni,nj->ij", centred, centred) / max(len(centred), 1)
    spread, axes = np.linalg.eigh(covariance if sites.spread is None else sites.spread)
    axes = axes * np.sign(np.take_along_axis(axes, np.abs(axes).argmax(axis=0)[None], axis=0))
    if spread[2] < 16.0 * max(spread[1], 1e-12) or sites.size < 1.0:
        return np.zeros(len(centred))
    along = centred @ axes[:, 2] / SEAM_SPACING_M + np.random.default_rng([seed, 2]).random()
    off = (along - np.round(along)) * SEAM_SPACING_M
    around = smoothstep(0.5, 0.2, np.abs(sites.n @ axes[:, 2]))  # not on end faces
    width = np.maximum(0.5 * SEAM_WIDTH_M, sites.edge)
    return around * np.exp(-(off / width)**2) * (1.0 + 0.5 * sites.patterns(seed).fbm(60.0, 2, 42))


def _streaks(sites: Sites, pattern: Patterns, look: Look) -> np.ndarray:
    """Rust that has run down from what rusts above, [N]: on steep places, in streaks 15 times as long as wide."""
    if look.wear == 0.0:
        return np.zeros(len(sites.p))
    least = max(3.2, 1.5 / sites.size)
    ran = np.zeros(len(sites.p))
    for drop, strength in zip(DROPS_M, (0.75, 0.5), strict=True):
        above = pattern.at(pattern.p + np.array([0.0, 0.0, drop])).moved(min(0.03, 0.1 * sites.size), 6.0, 3, 4)
        ran = np.maximum(ran, strength * patches(above.fbm(least, 3, 13), min(1.0, look.wear**2 + 0.12), 0.06))
    steep = smoothstep(0.95, 0.5, np.abs(sites.n[:, 2]))
    return ran * steep * smoothstep(-0.1, 0.25, pattern.fbm((38.0, 38.0, 2.5), 3, 18))


def _faded(pattern: Patterns, paint: np.ndarray, age: float) -> np.ndarray:
    """Paint that has bleached and, with age, chalked, [N, 3]."""
    tone = 1.0 + 0.6 * pattern.fbm(2.2, 5, 12) + 0.25 * pattern.fbm(60.0, 4, 13)
    return mix(paint * tone[:, None], CHALK, age * (0.25 + 0.30 * patches(pattern.fbm(6.0, 5, 15), 0.4, 0.25)))


def _rust(pattern: Patterns, damage: Damage) -> np.ndarray:
    """Rust, [N, 3]: its tones by noise, paler on tubercles."""
    tone = np.clip(0.55 - 0.28 * damage.depth + 0.9 * pattern.fbm(11.0, 6, 19, 0.6) + 0.5 * pattern.fbm(75.0, 4, 20)
                   + 0.25 * damage.tubercles, 0.0, 1.0)
    return np.stack([np.interp(tone, STOPS, RUSTS[:, channel]) for channel in range(3)], axis=1)
