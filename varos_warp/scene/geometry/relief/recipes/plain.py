"""Any surface under film and silt, without a form of its own."""

import numpy as np

from varos_warp.scene.geometry.relief.recipes.layers import covered
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

PAINT = (0.12, 0.115, 0.10)
"""Where the block gives none."""


class Plain:
    """``relief: none``: a surface stays where it is, but for its silt."""

    name = "none"

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Nothing."""
        return np.zeros(len(sites.p))

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Nothing."""
        return np.zeros(len(sites.p))

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """The paint, uneven, under film and silt."""
        tone = 1.0 + 0.3 * sites.patterns(look.seed).fbm(2.2, 4, 1)
        paint = np.asarray(PAINT if look.paint is None else look.paint) * tone[:, None]
        return covered(paint, sites, shape, look, hold=0.70)
