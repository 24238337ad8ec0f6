"""Sand and silt of a sea floor: ripples, mounds and pits of what lives in it, shell hash, a film of diatoms."""

from typing import NamedTuple

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import dots, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import DARKEST, PALEST, SILT, SILT_DARK, filmed
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT_M = 0.05
"""Bound of ``coarse`` [m]."""
FINE_LIMIT_M = 0.035
"""Bound of ``fine`` [m]."""
WAVELENGTH_M = 0.115
"""Of ripples."""
AMPLITUDE_M = 0.0065
"""Of ripples where they are highest; half of their height."""
BLUNT = 0.015
"""How blunt their crests are: 0 is as sharp as a cusp."""
FREE_M = (0.06, 0.30)
"""Ripples end where something stands nearer than the first, and are whole from the second on."""
LEVEL = (0.80, 0.95)
"""Likewise for z of the normal: on a slope sand slides."""
PALE, DARK = (0.190, 0.166, 0.124), (0.140, 0.123, 0.091)
HASH, FLECK, MINERAL = (0.280, 0.257, 0.210), (0.420, 0.395, 0.335), (0.050, 0.045, 0.035)


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

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Ripples that end at objects and on slopes, worm mounds, uneven ground."""
        pattern = sites.patterns(look.seed)
        uneven = 0.020 * pattern.fbm(1.3, 4, 2)
        amplitude, profile = _ripples(sites, pattern)
        return np.clip(uneven + amplitude * profile + 0.026 * _mounds(sites, pattern), -LIMIT_M, LIMIT_M)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Burrows, lumps and grain."""
        pattern = sites.patterns(look.seed)
        dug = _burrows(sites, pattern)
        worked = smoothstep(-0.2, 0.35, pattern.fbm(1.1, 3, 9))
        lumps = 0.0042 * worked * (pattern.billow(13.0, 4, 10) + 0.38) + 0.0030 * pattern.fbm(36.0, 4, 11)
        grain = 0.0014 * pattern.fbm(130.0, 2, 12)
        return np.clip(0.004 * dug.rim - 0.022 * dug.hole + lumps + grain, -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Dull sand under patches of film and silt; shell hash in troughs, few flecks; mean about 0.13."""
        pattern = sites.patterns(look.seed)
        amplitude, profile = _ripples(sites, pattern)
        rippled = amplitude / AMPLITUDE_M
        sand = mix(DARK, PALE, smoothstep(-0.35, 0.35, pattern.fbm(0.8, 5, 20)))
        sand = mix(sand, HASH, 0.30 * _hash(pattern) * rippled * smoothstep(0.1, -0.8, profile))
        sand = mix(sand, SILT, 0.5 * _mounds(sites, pattern))
        tone = 0.45 * pattern.fbm(26.0, 4, 24) + 0.25 * np.clip(3.0 * shape.convexity, -1.0, 1.0)
        sand = sand * (1.0 + tone)[:, None]
        sand = filmed(sand, pattern.scaled(4.0), shape, 0.9 * look.film)  # in patches of a metre
        sand, thickness = _muddy(sand, pattern, look.silt, rippled * profile)
        sand = _flecked(sand, pattern)
        sand = sand * (1.0 - 0.65 * _burrows(sites, pattern).hole)[:, None]
        if look.paint is not None:
            sand = sand * (np.asarray(look.paint) / np.mean([PALE, DARK], axis=0))
        return np.clip(sand, DARKEST, PALEST), thickness


def _ripples(sites: Sites, pattern: Patterns) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude [m] and profile -1..1 of ripples, each [N]; a ninth as high as long, their crests sharp."""
    turn = np.random.default_rng([pattern.seed, 4]).uniform(0.0, np.pi)
    along = sites.p @ np.array([np.cos(turn), np.sin(turn), 0.0])
    # crests wander, fork and end where the phase is uneven
    phase = along / WAVELENGTH_M + 4.0 * pattern.fbm(0.5, 2, 4) + 0.65 * pattern.fbm(3.2, 3, 5)
    strength = smoothstep(-0.25, 0.18, pattern.fbm(0.7, 4, 3)) * np.clip(0.75 + 1.5 * pattern.fbm(2.0, 3, 6), 0.1, 1.0)
    calm = smoothstep(*FREE_M, sites.clear) * smoothstep(*LEVEL, sites.n[:, 2])
    profile = 1.0 - 2.0 * np.sqrt((np.square(np.sin(np.pi * phase)) + BLUNT) / (1.0 + BLUNT))
    return AMPLITUDE_M * strength * calm * pattern.resolved(WAVELENGTH_M), profile


def _mounds(sites: Sites, pattern: Patterns) -> np.ndarray:
    """Casts of lugworms, [N]: cones of unit height in a third of the cells; none against objects."""
    cells = pattern.moved(0.03, 7.0, 71).worley(2.1, 7, flat=True)
    radius = 0.10 + 0.12 * cells.id
    cone = np.clip(1.0 - cells.near / radius, 0.0, 1.0)**1.4 * (cells.id > 0.65)
    return cone * smoothstep(0.02, 0.15, sites.clear) * pattern.resolved(radius / 2.1)


def _burrows(sites: Sites, pattern: Patterns) -> Burrows:
    """Holes 3 cm wide with a rim, in a fifth of the cells and only in some places."""
    cells = pattern.moved(0.03, 14.0, 81).worley(5.2, 8, flat=True)
    there = (cells.id > 0.70) * patches(pattern.fbm(0.9, 2, 82), 0.35, 0.05) * pattern.resolved(0.03)
    size = 0.55 + 0.6 * (cells.id - 0.70) / 0.30
    return Burrows(there * np.exp(-(cells.near / (0.075 * size))**2),
                   there * np.exp(-((cells.near - 0.13 * size) / (0.06 * size))**2))


def _hash(pattern: Patterns) -> np.ndarray:
    """Where broken shells have gathered, [N]."""
    return patches(pattern.fbm(1.6, 3, 21), 0.45, 0.12) * np.clip(0.6 + 2.0 * pattern.fbm(90.0, 2, 22), 0.0, 1.0)


def _muddy(sand: np.ndarray, pattern: Patterns, silt: float, relief: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sand with fine silt in its hollows and in wide patches, and its thickness [m]."""
    if silt == 0.0:
        return sand, np.zeros(len(sand))
    where = pattern.fbm(0.7, 4, 30) + 0.1 * pattern.fbm(11.0, 3, 31) - 0.05 * relief
    cover = patches(where, 0.9 * silt, 0.10)
    tone = mix(SILT_DARK, SILT, smoothstep(-0.4, 0.4, pattern.fbm(3.0, 4, 32)))
    return mix(sand, 0.85 * tone, 0.75 * cover), 0.002 * cover


def _flecked(sand: np.ndarray, pattern: Patterns) -> np.ndarray:
    """Sand with bits of shell and dark grains, more of them in some places; on coarse meshes their mean."""
    rich = np.clip(0.45 + 2.2 * pattern.fbm(1.2, 3, 28), 0.0, 1.0)
    for colour, cycles, salt, share, strength in ((FLECK, 75.0, 25, 0.10, 0.7), (MINERAL, 60.0, 26, 0.16, 0.6)):
        cells = pattern.worley(cycles, salt)
        chosen = cells.id > 1.0 - share * rich
        shown = pattern.resolved(0.7 / cycles)
        mean = 0.12 * share * rich  # of a slice through balls of this radius
        sand = mix(sand, colour, strength * (shown * chosen * dots(cells.near, 0.31) + (1.0 - shown) * mean))
    return sand
