"""Rock: beds that weather unlike each other, ridges, joints with blocks that have moved, cracks, grain."""

from typing import NamedTuple

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import dots, hashed, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import covered
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT = 0.15
"""Bound of ``coarse`` over the size."""
FINE_LIMIT_M = 0.018
"""Bound of ``fine`` [m]."""
PALE, DARK = (0.110, 0.099, 0.084), (0.050, 0.046, 0.041)
IRON = (0.185, 0.118, 0.066)
CORALLINE = (0.250, 0.120, 0.125)
FACETS = 2.3, 5.9, 14.0, 33.0
"""Faces along the size of a rock, of each generation."""
FACET_SLOPE = 0.30
"""How far faces lean at most, as a tangent; the edges between them are steeper."""
LOOSE_M = 2.5, 8.0
"""Objects of rock below the first size have been loose for long, those above the second are bedrock."""
THICKEST_BED_M, THINNEST_BED_M = 0.25, 0.012


class Beds(NamedTuple):
    """The beds of a sediment at N places."""

    level: np.ndarray
    """How far the bed stands out, -1 to 1, [N]; hard beds do."""
    parting: np.ndarray
    """1 in the plane between two beds to 0 inside of them, [N]."""
    tone: np.ndarray
    """A random number of the bed, 0 to 1, [N]."""


class Facets(NamedTuple):
    """Faces of broken rock at N places."""

    height: np.ndarray
    """Height over the mean surface, in units of the rock's size, [N]."""
    tone: np.ndarray
    """A random number of the face, of mean 0, about -1 to 1, [N]."""


class Rock:
    """Bedrock and boulders.

    ``coarse`` moves a surface by at most 0.15 of its size, ``fine`` by at most 18 mm.
    """

    name = "rock"
    by_vertex = True

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Beds, ridges, blocks between joints and the joints themselves."""
        size, bent = sites.size, _bent(sites, look)
        beds = _wide_beds(sites, look)
        gap, id, joint = _joints(sites, bent)
        rough, sharp = _kept(sites)
        ridges = 0.030 * sharp * (bent.ridged(3.2 / size, 6, 40) - 0.5)
        blocks = 0.032 * rough * (id - 0.5) * smoothstep(0.0, np.maximum(0.05, 8.0 * sites.edge / size), gap)
        facets = rough * _facets(sites, look).height
        h = rough * (0.012 * beds.level - 0.008 * beds.parting) + ridges + blocks + facets - 0.008 * rough * joint
        return size * np.clip(h, -LIMIT, LIMIT)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Thin beds where a bed is soft, knobs, cracklets and grain."""
        pattern, size = sites.patterns(look.seed), sites.size
        least = max(10.0 / size, 14.0)
        thin = _thin_beds(sites, look)
        laminae = 0.0045 * (thin.level - thin.parting) * _laminated(sites, look)
        knobs = 0.0040 * min(size, 1.0) * (pattern.billow(least, 5, 60, 0.55) + 0.38)
        cells = pattern.moved(0.02, 9.0, 50).worley(least, 53)
        open = smoothstep(0.0, 0.3, pattern.fbm(6.0, 2, 54)) * pattern.resolved(0.25 / least)
        cracklets = 0.003 * (1.0 - smoothstep(0.0, 0.09, cells.gap)) * open
        grain = 0.0060 * pattern.fbm(60.0, 4, 61, 0.7)
        return np.clip(laminae + knobs - cracklets + grain, -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Stone by its beds, iron stain, coralline crusts, film and a little silt; mean about 0.1."""
        size, bent, pattern = sites.size, _bent(sites, look), sites.patterns(look.seed)
        beds, thin = _wide_beds(sites, look), _thin_beds(sites, look)
        joint = _joints(sites, bent)[2]
        stone = mix(DARK, PALE, smoothstep(-0.35, 0.35, bent.fbm(1.6 / size, 4, 80)))
        stone = stone * (0.78 + 0.44 * beds.tone + 0.3 * _facets(sites, look).tone)[:, None] * _family(look.seed)
        stone = stone * (1.0 + 0.4 * (thin.tone - 0.5) * _laminated(sites, look))[:, None]
        stone = mix(
            stone,
            np.asarray(IRON) * (0.6 + 0.6 * beds.tone)[:, None],
            0.55 * patches(bent.fbm(4.0 / size, 5, 81), 0.22, 0.12),
        )
        coarse = 0.15 + 0.85 * smoothstep(-0.2, 0.25, pattern.fbm(7.0, 3, 83))  # in some places more than in others
        stone = stone * (1.0 + coarse * pattern.fbm(70.0, 3, 82, 0.7))[:, None]  # minerals
        edge, groove = np.clip(3.0 * shape.convexity, 0.0, 1.0), shape.hollow
        dark = 0.5 * np.maximum(joint, 0.7 * beds.parting)
        stone = stone * (1.0 + 0.30 * edge - 0.15 * groove)[:, None] * (1.0 - 0.5 * dark)[:, None]
        if look.film > 0.0:
            stone = mix(stone, _crust_tone(pattern), 0.75 * _crusts(pattern, shape) * min(1.0, 2.0 * look.film))
        if look.paint is not None:
            stone = stone * (np.asarray(look.paint) / np.mean([PALE, DARK], axis=0))
        return covered(stone, sites, shape, look, hold=0.74)


def _kept(sites: Sites) -> tuple[float, float]:
    """Shares of the large forms, and of ridges among them, that a rock has kept.

    Loose stones have forms of their own: what stuck out of them has long since been knocked off.
    """
    # a sea floor, which has no edges of its own, is bedrock
    whole = 1.0 if sites.sharp is None else float(smoothstep(*LOOSE_M, np.asarray(sites.size)))
    return 0.35 + 0.65 * whole, 0.12 + 0.88 * whole


def _family(seed: int) -> np.ndarray:
    """Factors [3] of the reflectance of one stone: those of a place differ in tone, and a little in hue."""
    tone, warm = np.random.default_rng([seed, 9]).uniform(-1.0, 1.0, 2)
    return np.exp(0.38 * tone) * np.array([1.0 + 0.10 * warm, 1.0, 1.0 - 0.12 * warm])


def _bent(sites: Sites, look: Look) -> Patterns:
    """Patterns at places that are bent over the whole object."""
    return sites.once(
        ("rock", "bent", look.seed),
        lambda: sites.patterns(look.seed).moved(0.045 * sites.size, 2.0 / sites.size, 10, 3),
    )


def _bedding(seed: int) -> np.ndarray:
    """Unit vector across the beds: they dip by up to 40 degrees."""
    dip, azimuth = np.random.default_rng([seed, 5]).uniform([0.1, 0.0], [0.7, 2.0 * np.pi])
    return np.array([np.sin(dip) * np.cos(azimuth), np.sin(dip) * np.sin(azimuth), np.cos(dip)])


def _thickness(size: float) -> float:
    """Mean thickness of the beds of a rock [m]."""
    return float(np.clip(0.085 * size, THINNEST_BED_M, THICKEST_BED_M))


def _beds(pattern: Patterns, across: np.ndarray, thickness: float, salt: int) -> Beds:
    """Beds of a mean thickness [m], thinner and thicker along a slow noise; ledges no steeper than the mesh shows."""
    s = pattern.p @ across / thickness
    line = pattern.at(np.stack([s, np.zeros_like(s), np.zeros_like(s)], axis=1))
    s = s + 1.4 * line.fbm(0.21, 2, salt)
    index = np.floor(s)
    width = np.clip(3.0 * pattern.edge / thickness, 0.22, 0.6)
    above = smoothstep(1.0 - width, 1.0, s - index)
    this, next_ = (hashed(index + k, pattern.seed + salt) for k in (0, 1))
    level = 2.0 * (this + (next_ - this) * above) - 1.0
    off = (s - index - 1.0 + 0.5 * width) / (0.4 * width)
    deep = smoothstep(0.35, 0.9, hashed(index, pattern.seed + salt + 1))
    share = pattern.resolved(thickness)
    tone = hashed(index + (above > 0.5), pattern.seed + salt + 2)
    return Beds(level * share, np.exp(-(off**2)) * deep * share, 0.5 + (tone - 0.5) * share)


def _wide_beds(sites: Sites, look: Look) -> Beds:
    """The beds that are seen from afar."""
    return sites.once(
        ("rock", "beds", look.seed),
        lambda: _beds(_bent(sites, look), _bedding(look.seed), _thickness(sites.size), 20),
    )


def _thin_beds(sites: Sites, look: Look) -> Beds:
    """The laminae inside of the beds: what bedding is at arm's length."""
    return sites.once(
        ("rock", "thin", look.seed),
        lambda: _beds(
            sites.patterns(look.seed).moved(0.02, 4.0, 15, 3),
            _bedding(look.seed),
            float(np.clip(0.016 * sites.size, 0.007, 0.022)),
            25,
        ),
    )


def _laminated(sites: Sites, look: Look) -> np.ndarray:
    """Share of each place that shows laminae, [N]: six tenths of the surface."""
    return sites.once(
        ("rock", "laminated", look.seed),
        lambda: patches(sites.patterns(look.seed).fbm(max(1.6, 1.8 / sites.size), 3, 26), 0.6, 0.15),
    )


def _joints(sites: Sites, bent: Patterns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gap of the cells between joints, their random numbers, and how much of an open joint is there, each [N].

    Joints open and close along their length: of one width they would look like stitches.
    """
    return sites.once(("rock", "joints", bent.seed), lambda: _jointed(sites, bent))


def _jointed(sites, bent):
    size, plain = sites.size, sites.patterns(bent.seed)
    # jagged: borders of cells alone are as smooth as a cut
    cells = bent.moved(0.022 * size, 11.0 / size, 34, 4).worley(2.6 / size, 30)
    open = smoothstep(-0.05, 0.25, plain.fbm(2.0 / size, 3, 31))
    width = 0.012 + 0.05 * smoothstep(-0.1, 0.35, plain.fbm(3.0 / size, 3, 33))
    shown = np.maximum(width, 4.0 * sites.edge * 2.6 / size)
    # wider than it is on a coarse mesh, and less deep by as much
    joint = (1.0 - smoothstep(0.0, shown, cells.gap)) * open * width / shown
    return cells.gap, cells.id * open + 0.5 * (1.0 - open), joint


def _facets(sites: Sites, look: Look) -> Facets:
    """Faces that broke along planes: large ones, and smaller ones on them."""
    return sites.once(("rock", "facets", look.seed), lambda: _faceted(sites, sites.patterns(look.seed)))


def _faceted(sites, plain):
    size, height, tone = sites.size, 0.0, 0.0
    for k, cycles in enumerate(FACETS):
        # jagged borders, of a size that the mesh shows
        moved = plain.moved(0.06 * size / cycles, 2.5 * cycles / size, 70 + 4 * k)
        shown = plain.resolved(0.5 * size / cycles)
        faces = moved.faces(cycles / size, 90 + k)
        height = height + FACET_SLOPE / cycles * faces.height * shown
        tone = tone + (faces.id - 0.5) * shown
    return Facets(height, tone)


def _crusts(pattern: Patterns, shape: Shape) -> np.ndarray:
    """Share of each place that coralline algae cover, [N]: lobed patches that keep off hollows, in colonies."""
    colonies = patches(pattern.fbm(2.5, 4, 86) - 0.2 * shape.hollow, 0.16, 0.06)
    cells = pattern.moved(0.035, 14.0, 84, 3).worley(11.0, 85)
    lobes = dots(cells.near, 0.30 + 0.35 * cells.id + 0.5 * pattern.fbm(38.0, 3, 87), 0.12)
    return colonies * lobes * pattern.resolved(0.05)


def _crust_tone(pattern: Patterns) -> np.ndarray:
    """Reflectance of coralline crusts, [N, 3]: pink, paler where they are dead."""
    worn = smoothstep(0.0, 0.35, pattern.fbm(30.0, 4, 88))
    return mix(np.asarray(CORALLINE), (0.27, 0.22, 0.20), worn) * (1.0 + pattern.fbm(12.0, 3, 89))[:, None]
