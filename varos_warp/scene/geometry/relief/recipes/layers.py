"""What lies on all surfaces of the sea: a brown film, and silt where it can lie."""

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import height_blend, mix, patches, smoothstep
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

SILT = np.array([0.200, 0.182, 0.140])
SILT_DARK = np.array([0.130, 0.117, 0.088])
FILM = np.array([0.085, 0.075, 0.040])
DARKEST, PALEST = 0.01, 0.85
"""Reflectances of all there is in the sea."""
THICKEST_SILT_M = 0.006
SALT = 900
"""Of the noise of these layers; recipes use smaller ones."""


def covered(colour: np.ndarray, sites: Sites, shape: Shape, look: Look, hold: float) -> tuple[np.ndarray, np.ndarray]:
    """A surface under its film and silt.

    Args:
        colour: Of the surface, float64 [N, 3].
        sites: The vertices.
        shape: Their masks.
        look: How much there is of film and silt.
        hold: How steep silt may lie on it, as the cosine of the slope: rough surfaces shed or hide it.

    Returns:
        Reflectance, float64 [N, 3], and thickness of the silt [m], float64 [N], at most THICKEST_SILT_M.
    """
    pattern = sites.patterns(look.seed)
    colour, thickness = silted(filmed(colour, pattern, shape, look.film), pattern, sites, shape, look.silt, hold)
    return np.clip(colour * (1.0 + 0.35 * pattern.fbm(190.0, 2, SALT))[:, None], DARKEST, PALEST), thickness


def filmed(colour: np.ndarray, pattern: Patterns, shape: Shape, film: float, tone: np.ndarray = FILM) -> np.ndarray:
    """A surface under a film of diatoms and bacteria: thin everywhere, dense in patches, worn off edges."""
    if film == 0.0:
        return colour
    warped = pattern.moved(0.03, 6.0, SALT + 1)
    where = warped.fbm(4.5, 5, SALT + 5) + 0.08 * shape.up + 0.10 * shape.hollow - 0.12 * np.clip(
        3.0 * shape.convexity, 0.0, 1.0)
    dense = patches(where, 0.95 * film, 0.24)
    own = tone * (1.0 + 0.9 * pattern.fbm(50.0, 4, SALT + 6) + 0.5 * pattern.fbm(3.0, 2, SALT + 7))[:, None]
    return mix(colour, own, np.maximum(0.85 * film, 0.85 * dense))


def silted(colour: np.ndarray, pattern: Patterns, sites: Sites, shape: Shape, silt: float,
           hold: float) -> tuple[np.ndarray, np.ndarray]:
    """A surface with silt on what faces up, in hollows and near the ground, and a dust of it; and its thickness [m]."""
    if silt == 0.0:
        return colour, np.zeros(len(colour))
    ragged = 0.45 * pattern.fbm(9.0, 4, SALT + 10) + 0.35 * pattern.fbm(45.0, 3, SALT + 11)
    lies = shape.up + ragged + 0.25 * shape.hollow + 0.3 * (0.8 - shape.exposure)
    least = hold + 0.7 * (0.5 - silt)
    cover = min(1.0, 4.0 * silt) * smoothstep(least, least + 0.35, lies)
    # silt that waves have thrown up lies at the foot of things
    foot = smoothstep(0.14, 0.0, sites.height + 0.12 * pattern.fbm(10.0, 3, SALT + 12)) * smoothstep(-0.5, 0.4, lies)
    cover = np.maximum(cover, 0.7 * min(1.0, 2.0 * silt) * foot)
    dust = 0.5 * silt * smoothstep(-0.4, 0.7, shape.up + 0.6 * pattern.fbm(6.0, 3, SALT + 13))
    relief = np.clip(shape.convexity, -0.3, 0.3)  # grains and edges stand out of it
    share = height_blend([1.0 - cover, cover], [relief, 0.3 * pattern.fbm(30.0, 2, SALT + 14)])[1]
    tone = mix(SILT_DARK, SILT, smoothstep(-0.4, 0.4, pattern.fbm(7.0, 4, SALT + 15)))
    thickness = THICKEST_SILT_M * cover * np.clip(0.6 + pattern.fbm(12.0, 3, SALT + 16), 0.3, 1.0)
    return mix(colour, tone, np.maximum(0.92 * np.maximum(0.6 * cover, share * cover), dust)), thickness
