"""Any surface under film and silt, without a form of its own."""

import numpy as np

from varos_warp.scene.geometry.relief.recipes.layers import covered, tones_of
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

PAINT = (0.12, 0.115, 0.10)
"""Reflectance of paint where the block gives none."""


class Plain:
    """``relief: none``: a surface stays where it is, but for its silt."""

    name = "none"
    by_vertex = False  # things run down

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Nothing."""
        return np.zeros(len(sites.p))

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Nothing."""
        return np.zeros(len(sites.p))

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """The paint, uneven and rubbed off edges, under film and silt that have run down from them."""
        tones = tones_of(sites.patterns(look.seed))
        rubbed = min(1.0, 2.0 * look.wear) * sites.edges
        tone = 1.0 + 0.3 * tones.broad + 0.2 * tones.middle + 0.25 * rubbed
        paint = np.asarray(PAINT if look.paint is None else look.paint) * tone[:, None]
        return covered(
            paint, sites, shape, look, hold=0.70, tones=tones, start=np.maximum(sites.edges, 0.6 * shape.hollow)
        )
