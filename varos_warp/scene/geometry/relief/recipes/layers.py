"""What lies on all surfaces of the sea: a brown film, silt where it can lie, and what of both has run down."""

from typing import NamedTuple

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import height_blend, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

SILT = np.array([0.200, 0.182, 0.140])
SILT_DARK = np.array([0.130, 0.117, 0.088])
FILM = np.array([0.085, 0.075, 0.040])
SLIME = np.array([0.046, 0.043, 0.028])
"""Reflectance of the film where it has hung in curtains, thick and dark."""
DARKEST, PALEST = 0.01, 0.85
"""Reflectances of all there is in the sea."""
THICKEST_SILT_M = 0.006
LONGEST_RUN_M = 0.7
"""Longest run down a surface [m]."""
RUN_TAIL_M = 0.10
"""Length over which a run fades at its end [m]."""
HUNG = 1.5
"""Strength of streaks where there are some, over that of noise that is alike everywhere."""
FINE = 55.0, 3
"""Cells of the first octave of the finest tones [1/m], and octaves."""
SALT = 900
"""Salt of the noise of these layers; recipes use smaller ones."""


class Tones(NamedTuple):
    """Noise that all layers of a surface share, at three scales, [N] each: causes that they have in common."""

    broad: np.ndarray
    """Metres and decimetres."""
    middle: np.ndarray
    """Decimetres and centimetres."""
    fine: np.ndarray
    """Centimetres and millimetres."""
    hung: np.ndarray
    """Centimetres wide, decimetres long along the vertical, in zones: how what clings to steep places is drawn out."""


def tones_of(pattern: Patterns) -> Tones:
    """The noise of the layers."""
    return Tones(
        pattern.fbm(0.8, 3, SALT + 1),
        pattern.fbm(7.0, 3, SALT + 2),
        pattern.fbm(*FINE, SALT + 3),
        _hung(pattern),
    )


def _hung(pattern):
    """Streaks that wander, strong in some zones and missing in others."""
    zone = smoothstep(-0.12, 0.2, pattern.fbm((1.7, 1.7, 1.1), 3, SALT + 6))
    wander = pattern.moved(0.3, (2.5, 2.5, 1.2), SALT + 7, 3)
    return HUNG * zone * wander.fbm((5.0, 5.0, 1.1), 5, SALT + 5, 0.75)


def drawn(tones: Tones, shape: Shape) -> np.ndarray:
    """The noise of decimetres and centimetres, drawn out along the vertical where a surface is steep, [N]."""
    steep = smoothstep(0.9, 0.5, np.abs(shape.up))
    return tones.middle + (0.8 * tones.hung - 0.5 * tones.middle) * steep


def covered(
    colour: np.ndarray,
    sites: Sites,
    shape: Shape,
    look: Look,
    hold: float,
    tones: Tones | None = None,
    start: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """A surface under its film and silt.

    Args:
        colour: Of the surface, float64 [N, 3].
        sites: The vertices.
        shape: Their masks.
        look: How much there is of film and silt.
        hold: How steep silt may lie on it, as the cosine of the slope: rough surfaces shed or hide it.
        tones: Noise of the layers; None: is made.
        start: How much film and silt gather at a place and run down from there, 0 to 1, [N]; None: nothing runs.

    Returns:
        Reflectance, float64 [N, 3], and thickness of the silt [m], float64 [N], at most THICKEST_SILT_M.
    """
    pattern = sites.patterns(look.seed)
    tones = tones or tones_of(pattern)
    colour = _filmed(colour, tones, shape, look.film)
    if start is not None and max(look.film, look.silt) > 0.0:
        colour = _curtained(colour, pattern, tones, shape, look, start)
    colour, thickness = silted(colour, tones, sites, shape, look, hold)
    return np.clip(colour * (1.0 + 0.25 * tones.fine)[:, None], DARKEST, PALEST), thickness


def filmed(colour: np.ndarray, pattern: Patterns, shape: Shape, film: float) -> np.ndarray:
    """A surface under mats of diatoms and bacteria: a thin film everywhere, dense in patches, worn off edges."""
    if film == 0.0:
        return colour
    warped = pattern.moved(0.03, 6.0, SALT + 11)
    where = (
        warped.fbm(4.5, 5, SALT + 15)
        + 0.08 * shape.up
        + 0.10 * shape.hollow
        - 0.12 * np.clip(3.0 * shape.convexity, 0.0, 1.0)
    )
    dense = patches(where, 0.95 * film, 0.24)
    own = FILM * (1.0 + 0.9 * pattern.fbm(50.0, 4, SALT + 16) + 0.5 * pattern.fbm(3.0, 2, SALT + 17))[:, None]
    return mix(colour, own, np.maximum(0.85 * film, 0.85 * dense))


def _filmed(colour, tones, shape, film):
    """A surface under a film: nearly even, drawn out downwards, denser in hollows and above, worn off edges."""
    if film == 0.0:
        return colour
    edge = np.clip(3.0 * shape.convexity, 0.0, 1.0)
    hung = drawn(tones, shape)
    dense = (
        1.0 + 1.1 * tones.broad + 0.5 * hung + 0.3 * tones.fine + 0.10 * shape.up + 0.25 * shape.hollow - 0.35 * edge
    )
    own = FILM * (1.0 + 0.35 * hung + 0.6 * tones.fine - 0.25 * tones.broad)[:, None]
    return mix(colour, own, np.clip(0.85 * film * dense, 0.0, 0.93))


def running(
    pattern: Patterns, shape: Shape, start: np.ndarray, salt: int, longest: float = LONGEST_RUN_M
) -> np.ndarray:
    """Runs down a surface, [N]: 1 where something has come down from above, 0 elsewhere, fading to their ends.

    Args:
        pattern: Noise at the vertices: one run in a few is long.
        shape: The form of the mesh, whose ways of water they take.
        start: How much there is to run down, 0 to 1, [N].
        salt: Of the noise; another one has other lengths.
        longest: The length of the longest [m].
    """
    lot = np.clip(0.5 + 1.9 * pattern.fbm(38.0, 1, salt), 0.0, 1.0)
    length = longest * start * lot**3
    left = shape.slopes.runs(np.where(length > 0.01, length, 0.0))
    steep = smoothstep(0.97, 0.75, np.abs(shape.up))
    return shape.slopes.softened(np.clip(left / RUN_TAIL_M, 0.0, 1.0) * steep)


def _curtained(colour, pattern, tones, shape, look, start):
    """Film that hangs in dark curtains from where it gathers, and silt that has trickled beside it."""
    run = running(pattern, shape, start, SALT + 4)
    pale = smoothstep(-0.4, 0.4, tones.broad + 0.8 * tones.middle)[:, None]
    tone = SLIME + (SILT_DARK - SLIME) * pale * min(1.0, 2.0 * look.silt)
    thick = np.clip(run * (0.8 + 0.8 * tones.fine), 0.0, 1.0)
    return mix(colour, tone, min(0.85, 1.8 * max(look.film, look.silt)) * thick)


def _standing_out(shape):
    """How far grains and edges stand out of silt."""
    return np.clip(shape.convexity, -0.3, 0.3)


def _heaped(fine):
    """How unevenly silt lies, by the fine tones."""
    return 0.3 * fine


def _means(sites, shape, look, heights):
    """Means of what stands out and of what is heaped over the whole mesh, of which these may be some vertices."""
    if sites.whole is None:
        return [height.mean() for height in heights]

    def make():
        fine = sites.whole.patterns(look.seed).fbm(*FINE, SALT + 3)
        return [_standing_out(shape.whole).mean(), _heaped(fine).mean()]

    return sites.whole.once(("silt", "means", look.seed), make)


def silted(
    colour: np.ndarray, tones: Tones, sites: Sites, shape: Shape, look: Look, hold: float
) -> tuple[np.ndarray, np.ndarray]:
    """A surface with silt on what faces up, in hollows and near the ground, and a dust of it; and its thickness [m]."""
    silt = look.silt
    if silt == 0.0:
        return colour, np.zeros(len(colour))
    lies = shape.up + 0.32 * tones.middle + 0.35 * tones.fine + 0.25 * shape.hollow + 0.3 * (0.8 - shape.exposure)
    least = hold + 0.7 * (0.5 - silt)
    cover = min(1.0, 4.0 * silt) * smoothstep(least - 0.06, least + 0.26, lies)
    # silt that waves have thrown up lies at the foot of things, thinner upwards
    foot = smoothstep(0.22, 0.0, sites.height + 0.16 * tones.middle + 0.08 * tones.broad) * smoothstep(-0.5, 0.4, lies)
    cover = np.maximum(cover, 0.7 * min(1.0, 2.0 * silt) * foot)
    dust = 0.5 * silt * smoothstep(-0.5, 0.8, shape.up + 0.4 * drawn(tones, shape) + 0.4 * tones.broad)
    heights = [_standing_out(shape), _heaped(tones.fine)]
    share = height_blend([1.0 - cover, cover], heights, _means(sites, shape, look, heights))[1]
    tone = mix(SILT_DARK, SILT, np.clip(0.55 + 0.6 * tones.broad - 0.6 * tones.middle + 0.5 * tones.fine, 0.0, 1.0))
    thickness = THICKEST_SILT_M * cover * np.clip(0.6 + tones.middle + tones.fine, 0.3, 1.0)
    return mix(colour, tone, np.maximum(0.92 * np.maximum(0.6 * cover, share * cover), dust)), thickness
