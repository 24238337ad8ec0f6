"""Concrete: chipped edges, pores, seams of the boards it was cast in, cracks, aggregate where it is worn."""

from typing import NamedTuple

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import domes, dots, hashed, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import covered, running, tones_of
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT_M = 0.022
"""Bound of ``coarse`` [m]."""
FINE_LIMIT_M = 0.016
"""Bound of ``fine`` [m]."""
PALE, DARK = (0.140, 0.130, 0.107), (0.085, 0.078, 0.064)
LIME = (0.24, 0.225, 0.19)
STONES = (0.085, 0.080, 0.075), (0.230, 0.200, 0.165)
BOARD_M = 0.11
"""Height of a board of the formwork."""
LIFT_M = 0.55
"""What was cast at a time: there a line runs around, above it the concrete has nests of gravel."""
TIES_M, TIE_M = (0.60, 0.55), 0.013
"""Distances between the holes of the formwork's ties, across and up, and the radius of a hole [m]."""


class Wear(NamedTuple):
    """What has become of the skin of concrete, at N places, each 0 to 1."""

    worn: np.ndarray
    pore: np.ndarray
    seam: np.ndarray
    crack: np.ndarray
    stone: np.ndarray
    """Height of the stone of the aggregate."""
    id: np.ndarray
    """A random number of the stone."""
    hole: np.ndarray
    """Depth of the holes of ties, and of the lines between lifts."""


class Concrete:
    """Cast concrete.

    ``coarse`` moves a surface by at most 22 mm, ``fine`` by at most 16 mm. ``wear`` is about the share of the skin of
    cement that is gone.
    """

    name = "concrete"
    by_vertex = False  # things run down

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Chips off the edges, spalls and uneven faces."""
        pattern = sites.patterns(look.seed)
        broken = smoothstep(-0.12, 0.25, pattern.fbm(14.0, 4, 1) + 0.4 * pattern.fbm(45.0, 3, 2))
        chips = 0.014 * sites.edges * broken * min(1.0, 0.4 + 2.0 * look.wear)
        spalls = 0.008 * _spalled(pattern, look) * np.clip(0.7 + 1.5 * pattern.fbm(30.0, 3, 3), 0.2, 1.0)
        return np.clip(0.002 * pattern.fbm(2.5, 3, 10) - chips - spalls, -LIMIT_M, LIMIT_M)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Aggregate, pores, seams, holes, cracks and grain."""
        pattern = sites.patterns(look.seed)
        wear = _wear(sites, pattern, look)
        h = 0.0035 * wear.worn * (wear.stone - 0.6) - 0.004 * wear.pore + 0.0014 * wear.seam - 0.005 * wear.crack
        h += (0.0004 + 0.0012 * wear.worn) * pattern.fbm(130.0, 2, 9)  # the skin is as smooth as its formwork
        return np.clip(h - 0.009 * wear.hole, -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Cement, stones where it is worn, lime below cracks, bands of tides, film and silt; mean about 0.1."""
        pattern = sites.patterns(look.seed)
        wear = _wear(sites, pattern, look)
        tones = tones_of(pattern)
        steep = smoothstep(0.7, 0.3, np.abs(sites.n[:, 2]))
        band = pattern.fbm((0.15, 0.15, 2.4), 2, 11) * steep  # as the tide and each lift have left it
        skin = mix(DARK, PALE, np.clip(0.5 + 1.1 * band + 0.5 * tones.broad + 0.5 * tones.middle, 0.0, 1.0))
        if look.paint is not None:
            skin = skin * (np.asarray(look.paint) / np.mean([PALE, DARK], axis=0))
        skin = mix(skin, mix(*STONES, wear.id), 0.75 * wear.worn * smoothstep(0.2, 0.5, wear.stone))
        lime = running(pattern, shape, np.maximum(wear.crack, 0.5 * wear.hole), 50, 0.5)
        skin = mix(skin, LIME, 0.45 * np.maximum(lime, 0.5 * wear.crack * steep))
        shade = (
            1.0
            + 0.9 * np.clip(shape.convexity, -0.33, 0.33)
            - 0.5 * wear.crack
            - 0.4 * np.maximum(wear.pore, wear.hole)
        )
        gathers = np.maximum(sites.edges, np.maximum(wear.hole, 0.6 * shape.hollow))
        return covered(skin * shade[:, None], sites, shape, look, hold=0.55, tones=tones, start=gathers)


def _spalled(pattern: Patterns, look: Look) -> np.ndarray:
    """Share of each place whose skin has come off in plates, [N]."""
    return patches(pattern.moved(0.04, 7.0, 61).fbm(3.5, 4, 62), 0.30 * look.wear, 0.02)


def _wear(sites: Sites, pattern: Patterns, look: Look) -> Wear:
    return sites.once(("concrete", look.seed, look.wear), lambda: _worn(sites, pattern, look))


def _worn(sites, pattern, look):
    line, nests = _lifts(sites, pattern)
    gone = pattern.fbm(5.0, 5, 20) + 0.25 * sites.edges + 0.22 * nests * min(1.0, 4.0 * look.wear)
    worn = np.maximum(patches(gone, look.wear, 0.10), _spalled(pattern, look))
    stones = pattern.worley(55.0, 21)
    stone = domes(stones.near, 0.5) * pattern.resolved(0.018)
    holes = pattern.worley(38.0, 22)
    pore = dots(holes.near, 0.10 + 0.16 * holes.id) * (holes.id > 0.45) * (1.0 - worn) * pattern.resolved(0.009)
    return Wear(
        worn,
        pore,
        _seams(sites, pattern) * (1.0 - worn),
        _cracks(sites, pattern),
        stone,
        stones.id,
        np.maximum(_ties(sites, pattern), 0.35 * line),
    )


def _upright(sites):
    """1 on upright faces, [N], else 0."""
    return smoothstep(0.6, 0.3, np.abs(sites.n[:, 2]))


def _lifts(sites, pattern):
    """The lines between lifts, and the nests of gravel above them, [N] each."""
    height = sites.p[:, 2] / LIFT_M + 0.03 * pattern.fbm(2.0, 2, 32)
    above = (height - np.floor(height)) * LIFT_M
    off = np.minimum(above, LIFT_M - above)
    line = np.exp(-((off / np.maximum(0.005, sites.edge)) ** 2)) * pattern.resolved(0.02)
    return line * _upright(sites), smoothstep(0.16, 0.03, above) * _upright(sites)


def _ties(sites, pattern):
    """Holes that the ties of the formwork have left, [N]: 1 in them; some are filled."""
    across = np.where(np.abs(sites.n[:, 0]) > np.abs(sites.n[:, 1]), sites.p[:, 1], sites.p[:, 0])
    place = np.stack([across, sites.p[:, 2]], axis=1) / TIES_M
    column = np.round(place)
    away = np.linalg.norm((place - column) * TIES_M, axis=1)
    is_open = hashed((column[:, 0] + 4096.0 * column[:, 1]).astype(np.int64), pattern.seed) < 0.7
    return is_open * _upright(sites) * dots(away, TIE_M, 0.3) * pattern.resolved(2.0 * TIE_M)


def _seams(sites: Sites, pattern: Patterns) -> np.ndarray:
    """Fins of cement that ran between the boards, [N]; on upright faces only."""
    board = (sites.p[:, 2] + 0.012 * pattern.fbm(8.0, 2, 30)) / BOARD_M
    off = np.abs(board - np.round(board)) * BOARD_M
    broken = smoothstep(-0.2, 0.15, pattern.fbm(9.0, 3, 31))
    return np.exp(-((off / np.maximum(0.003, sites.edge)) ** 2)) * broken * _upright(sites) * pattern.resolved(0.02)


def _cracks(sites: Sites, pattern: Patterns) -> np.ndarray:
    """One family of cracks, [N], wide and narrow along their length."""
    cells = pattern.moved(0.05, 6.0, 40, 3).worley(2.2, 43)
    width = np.maximum(0.008 + 0.03 * smoothstep(0.0, 0.3, pattern.fbm(4.0, 3, 44)), 2.0 * 2.2 * sites.edge)
    return (1.0 - smoothstep(0.0, width, cells.gap)) * patches(pattern.fbm(3.0, 2, 45), 0.35, 0.08)
