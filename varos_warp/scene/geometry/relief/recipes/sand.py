"""Sand and silt of a sea floor: ripples, mounds and pits of what lives in it, shell hash, a film of diatoms."""

from typing import NamedTuple

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import domes, dots, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import DARKEST, PALEST, SILT, SILT_DARK, filmed
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT_M = 0.05
"""Bound of ``coarse`` [m]."""
FINE_LIMIT_M = 0.035
"""Bound of ``fine`` [m]."""
WAVELENGTH_M = 0.115
"""Wavelength of ripples [m]."""
AMPLITUDE_M = 0.0065
"""Amplitude of ripples where they are highest, which is half of their height [m]."""
BLUNT = 0.015
"""Bluntness of the ripples' crests: 0 is as sharp as a cusp."""
FREE_M = (0.02, 0.22)
"""Ripples end where something stands nearer than the first, and are whole from the second on."""
LEVEL = (0.78, 0.97)
"""Vertical parts of the normal at which ripples begin and from which they are whole: on a slope sand slides."""
PALE, DARK = (0.190, 0.166, 0.124), (0.140, 0.123, 0.091)
HASH, FLECK, MINERAL = (0.280, 0.257, 0.210), (0.420, 0.395, 0.335), (0.050, 0.045, 0.035)


FORK = 0.9
"""Strength of the second train of ripples over the first, on average: where they cancel, crests fork and end."""
STONES = ((9.0, 0.10, 0.20), (19.0, 0.16, 0.22))
"""Pebbles that lie in the sand: cells of a metre, share of them with one, and its radius in cells."""
TRACK_M = 0.012
"""Half of the width of the furrow that a snail leaves."""
STONE = (0.085, 0.078, 0.066)
ALGAE = (0.062, 0.058, 0.030)


class Burrows(NamedTuple):
    """What animals have dug, at N places."""

    hole: np.ndarray
    """1 in its middle, to 0."""
    rim: np.ndarray
    """1 on the ring of what was thrown out, to 0."""


class Sand:
    """A sea floor of sand.

    ``coarse`` moves it by at most 5 cm, ``fine`` by at most 3.5 cm.
    """

    name = "sand"
    by_vertex = True

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Ripples that fade at objects and on slopes, worm mounds, uneven ground."""
        pattern = sites.patterns(look.seed)
        uneven = 0.020 * pattern.fbm(1.3, 4, 2)
        amplitude, profile = _ripples(sites, pattern)
        return np.clip(uneven + amplitude * profile + 0.026 * _mounds(sites, pattern), -LIMIT_M, LIMIT_M)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Burrows, tracks, pebbles, lumps and grain."""
        pattern = sites.patterns(look.seed)
        dug = _burrows(sites, pattern)
        worked = smoothstep(-0.25, 0.3, pattern.fbm(1.1, 3, 9))
        lumps = 0.0050 * worked * (pattern.billow(13.0, 4, 10) + 0.38) + 0.0036 * pattern.fbm(36.0, 4, 11)
        grain = 0.0020 * pattern.fbm(130.0, 2, 12)
        stones = sum(0.5 * radius / cycles * rise for _, rise, radius, cycles in _stones(sites, pattern))
        h = 0.004 * dug.rim - 0.022 * dug.hole + lumps + grain + stones - 0.006 * _tracks(sites, pattern)
        return np.clip(h, -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Dull sand under patches of film and silt; shell hash in troughs, flecks and pebbles; mean about 0.12."""
        pattern = sites.patterns(look.seed)
        amplitude, profile = _ripples(sites, pattern)
        rippled = amplitude / AMPLITUDE_M
        sand = mix(DARK, PALE, smoothstep(-0.35, 0.35, pattern.fbm(0.8, 5, 20)))
        trough = rippled * smoothstep(0.1, -0.8, profile)
        sand = mix(sand, HASH, 0.5 * _hash(pattern) * np.maximum(trough, 0.25))
        sand = mix(sand, MINERAL, 0.28 * trough * smoothstep(-0.1, 0.3, pattern.fbm(2.3, 3, 23)))
        sand = mix(sand, SILT, 0.15 * _mounds(sites, pattern))
        tone = 0.75 * pattern.fbm(26.0, 5, 24, 0.7) + 0.25 * np.clip(3.0 * shape.convexity, -1.0, 1.0)
        sand = sand * np.maximum(1.0 + tone, 0.3)[:, None]
        sand = filmed(sand, pattern.scaled(4.0), shape, 0.9 * look.film)  # in patches of a metre
        sand = mix(sand, ALGAE, _algae(pattern, look.film))
        sand, thickness = _muddy(sand, pattern, look.silt, rippled * profile)
        sand = _flecked(sand, pattern, sites.chances(2, pattern.seed, 29))
        for tones, rise, _, _ in _stones(sites, pattern):
            sand = mix(sand, np.asarray(STONE) * (0.6 + 1.3 * tones)[:, None], 0.85 * smoothstep(0.05, 0.35, rise))
        sand = sand * (1.0 - 0.65 * _burrows(sites, pattern).hole - 0.2 * _tracks(sites, pattern))[:, None]
        return np.clip(sand * _tint(look.paint), DARKEST, PALEST), thickness


def tint_of(material) -> np.ndarray:
    """Colour [3] of the ground of a material, over that of plain sand: of what it banks up against things."""
    is_sand = getattr(material, "kind", None) == "layered" and material.relief == "sand"
    return np.asarray(_tint(material.paint if is_sand else None))


def _tint(paint):
    return np.ones(3) if paint is None else np.asarray(paint) / np.mean([PALE, DARK], axis=0)


def _ripples(sites: Sites, pattern: Patterns) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude [m] and profile -1..1 of ripples, each [N]; a ninth as high as long, their crests sharp.

    They are the phase of two trains that wander apart: where those cancel, the phase turns about a point, so a crest
    forks or ends there, and there is no height.
    """
    strength, size, blunt, profile = sites.once(("sand", "ripples", pattern.seed), lambda: _trains(sites, pattern))
    calm = smoothstep(*FREE_M, sites.clear) * smoothstep(*LEVEL, sites.n[:, 2])
    there = strength * calm * smoothstep(0.0, 0.8, size) * (1.0 - 0.6 * np.clip(blunt / 0.25, 0.0, 1.0))
    return AMPLITUDE_M * there * pattern.resolved(WAVELENGTH_M), profile


def _trains(sites, pattern):
    """Strength and size of the sum of both trains, how blunt crests are, and the profile, each [N]."""
    turn = np.random.default_rng([pattern.seed, 4]).uniform(0.0, np.pi)
    along = sites.p @ np.array([np.cos(turn), np.sin(turn), 0.0])
    one = along / WAVELENGTH_M + 4.0 * pattern.fbm(0.5, 2, 4) + 0.65 * pattern.fbm(3.2, 3, 5)
    second = np.maximum(FORK + 2.2 * pattern.fbm(0.8, 2, 14), 0.0)
    both = np.exp(2j * np.pi * one) * (1.0 + second * np.exp(2j * np.pi * 3.4 * pattern.fbm(0.9, 2, 8)))
    phase, size = np.angle(both) / (2.0 * np.pi), np.abs(both)
    strength = smoothstep(-0.34, 0.30, pattern.fbm(0.55, 4, 3)) * np.clip(0.7 + 1.6 * pattern.fbm(2.0, 3, 6), 0.1, 1.0)
    # old ones are blunt
    blunt = BLUNT + 0.25 * np.square(np.clip(0.5 + 1.4 * pattern.fbm(0.8, 2, 13), 0.0, 1.0))
    sharp = (np.sqrt(np.square(np.sin(np.pi * phase)) + blunt) - np.sqrt(blunt)) / (
        np.sqrt(1.0 + blunt) - np.sqrt(blunt)
    )
    return strength, size, blunt, 1.0 - 2.0 * sharp


def _stones(sites: Sites, pattern: Patterns) -> list[tuple[np.ndarray, np.ndarray, float, float]]:
    """Pebbles half sunk in the sand: their tone 0..1 and height 0..1, each [N], radius in cells, cells of a metre."""
    return sites.once(("sand", "stones", pattern.seed), lambda: _strewn(pattern))


def _strewn(pattern):
    made = []
    gathered = np.clip(0.5 + 2.0 * pattern.fbm(0.9, 3, 60), 0.05, 1.6)
    for k, (cycles, share, radius) in enumerate(STONES):
        cells = pattern.moved(0.15 / cycles, 1.5 * cycles, 61 + k).worley(cycles, 64 + k, flat=True)
        own = radius * (0.5 + 0.5 * (cells.id * 37.0 % 1.0))
        there = (cells.id > 1.0 - share * gathered) * pattern.resolved(1.4 * radius / cycles)
        made.append(((cells.id * 101.0) % 1.0, there * np.clip(1.3 * domes(cells.near, own), 0.0, 1.0), radius, cycles))
    return made


def _tracks(sites: Sites, pattern: Patterns) -> np.ndarray:
    """Furrows of snails and crabs, [N]: lines along which a slow noise is 0, in some places."""
    return sites.once(("sand", "tracks", pattern.seed), lambda: _furrows(sites, pattern))


def _furrows(sites, pattern):
    level = pattern.fbm(1.9, 1, 90)
    where = patches(pattern.fbm(0.45, 2, 91), 0.22, 0.05) * smoothstep(0.05, 0.2, sites.clear)
    # the noise changes by about its frequency a metre
    return where * np.exp(-np.square(level / (1.6 * TRACK_M))) * pattern.resolved(2.0 * TRACK_M)


def _algae(pattern: Patterns, film: float) -> np.ndarray:
    """Share of the sand that a film of algae hides, [N]: ragged patches of decimetres inside of others of metres."""
    if film == 0.0:
        return np.zeros(len(pattern.p))
    wide = smoothstep(-0.1, 0.35, pattern.fbm(0.35, 3, 92))
    torn = patches(pattern.moved(0.03, 8.0, 94).fbm(3.1, 5, 93, 0.6), min(0.9, 0.55 * film), 0.12)
    return 0.6 * wide * torn


def _mounds(sites: Sites, pattern: Patterns) -> np.ndarray:
    """Casts of lugworms, [N]: cones of unit height in a third of the cells; none against objects."""
    return sites.once(("sand", "mounds", pattern.seed), lambda: _cast(sites, pattern))


def _cast(sites, pattern):
    cells = pattern.moved(0.03, 7.0, 71).worley(2.1, 7, flat=True)
    radius = 0.10 + 0.12 * cells.id
    cone = np.clip(1.0 - cells.near / radius, 0.0, 1.0) ** 1.4 * (cells.id > 0.65)
    return cone * smoothstep(0.02, 0.15, sites.clear) * pattern.resolved(radius / 2.1)


def _burrows(sites: Sites, pattern: Patterns) -> Burrows:
    """Holes 3 cm wide with a rim, in a fifth of the cells and only in some places."""
    return sites.once(("sand", "burrows", pattern.seed), lambda: _dug(pattern))


def _dug(pattern):
    cells = pattern.moved(0.03, 14.0, 81).worley(5.2, 8, flat=True)
    there = (cells.id > 0.70) * patches(pattern.fbm(0.9, 2, 82), 0.35, 0.05) * pattern.resolved(0.03)
    size = 0.55 + 0.6 * (cells.id - 0.70) / 0.30
    return Burrows(
        there * np.exp(-((cells.near / (0.075 * size)) ** 2)),
        there * np.exp(-(((cells.near - 0.13 * size) / (0.06 * size)) ** 2)),
    )


def _hash(pattern: Patterns) -> np.ndarray:
    """Share of each place that broken shells cover, [N]."""
    return patches(pattern.fbm(1.6, 3, 21), 0.45, 0.12) * np.clip(0.6 + 2.0 * pattern.fbm(90.0, 2, 22), 0.0, 1.0)


def _muddy(sand: np.ndarray, pattern: Patterns, silt: float, relief: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sand with fine silt in its hollows and in wide patches, and its thickness [m]."""
    if silt == 0.0:
        return sand, np.zeros(len(sand))
    where = pattern.fbm(0.7, 4, 30) + 0.1 * pattern.fbm(11.0, 3, 31) - 0.05 * relief
    cover = patches(where, 0.9 * silt, 0.10)
    tone = mix(SILT_DARK, SILT, smoothstep(-0.4, 0.4, pattern.fbm(3.0, 4, 32)))
    return mix(sand, 0.85 * tone, 0.75 * cover), 0.002 * cover


def _flecked(sand: np.ndarray, pattern: Patterns, chance: np.ndarray) -> np.ndarray:
    """Sand with bits of shell and dark grains, more of them in some places.

    On meshes too coarse for them, single vertices stand for those that happen to lie there, by ``chance`` [2, N].
    """
    rich = np.clip(0.45 + 2.2 * pattern.fbm(1.2, 3, 28), 0.0, 1.0)
    for k, (colour, cycles, salt, share, strength) in enumerate(
        ((FLECK, 75.0, 25, 0.16, 0.75), (MINERAL, 60.0, 26, 0.24, 0.65))
    ):
        cells = pattern.worley(cycles, salt)
        chosen = cells.id > 1.0 - share * rich
        shown = pattern.resolved(0.7 / cycles)
        mean = 0.12 * share * rich  # of a slice through balls of this radius
        some = np.minimum(2.5 * mean * _specks(chance[k]), 1.0)
        sand = mix(sand, colour, strength * (shown * chosen * dots(cells.near, 0.31) + (1.0 - shown) * some))
    return sand


def _specks(chance: np.ndarray) -> np.ndarray:
    """How much more than the mean of a vertex flecks cover, [N]: few have much; 1 in the mean."""
    return np.square(np.log1p(-chance)) / 2.0
