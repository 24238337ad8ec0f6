"""Zinc of anodes as it is eaten away: craters in craters, ridges between them, a white crust, rounded edges."""

import numpy as np

from varos_warp.scene.geometry.noise import Patterns
from varos_warp.scene.geometry.relief.recipes.blending import domes, mix, smoothstep
from varos_warp.scene.geometry.relief.recipes.layers import covered, drawn, tones_of
from varos_warp.scene.geometry.relief.recipes.masks import Shape
from varos_warp.scene.geometry.relief.recipes.sites import Look, Sites

LIMIT_M = 0.010
"""Bound of ``coarse`` [m]."""
FINE_LIMIT_M = 0.008
"""Bound of ``fine`` [m]."""
METAL = (0.20, 0.20, 0.195)
"""Reflectance of the metal where the block gives no paint."""
CRUST = np.array([0.300, 0.298, 0.275])
"""Oxide and carbonate that it has turned to."""


class Zinc:
    """Cast zinc or aluminium that protects steel.

    ``coarse`` moves a surface by at most 10 mm, ``fine`` by at most 8 mm, nearly all of it inwards. ``wear`` is how
    much is eaten away.
    """

    name = "zinc"
    by_vertex = False  # things run down

    def coarse(self, sites: Sites, look: Look) -> np.ndarray:
        """Edges worn round, hollows of a decimetre, skin of the casting."""
        pattern = sites.patterns(look.seed)
        eaten = min(1.0, 0.15 + 1.3 * look.wear)
        h = -0.006 * eaten * (sites.edges + smoothstep(0.0, 0.4, pattern.fbm(9.0, 3, 1))) + 0.004 * eaten * pattern.fbm(
            22.0, 3, 2
        )
        return np.clip(h, -LIMIT_M, LIMIT_M)

    def fine(self, sites: Sites, look: Look) -> np.ndarray:
        """Craters, and a crust in them."""
        pattern = sites.patterns(look.seed)
        crater = self._craters(sites, pattern, look)
        return np.clip(-0.005 * crater + 0.0014 * pattern.billow(90.0, 3, 5), -FINE_LIMIT_M, FINE_LIMIT_M)

    def colour(self, sites: Sites, shape: Shape, look: Look) -> tuple[np.ndarray, np.ndarray]:
        """Dull metal, a pale crust in patches and below craters, dark pits, film and silt; mean about 0.15."""
        pattern = sites.patterns(look.seed)
        tones, crater = tones_of(pattern), self._craters(sites, pattern, look)
        hung = drawn(tones, shape)
        metal = (
            np.asarray(METAL if look.paint is None else look.paint)
            * (1.0 + 0.3 * tones.broad + 0.3 * hung + 0.4 * tones.fine)[:, None]
        )
        crust = np.clip(0.35 + 0.8 * hung + 0.7 * tones.fine - 0.5 * crater, 0.0, 1.0) * min(1.0, 0.3 + look.wear)
        metal = mix(metal, CRUST, crust) * (1.0 - 0.45 * crater)[:, None]
        metal = metal * (1.0 + 0.9 * np.clip(shape.convexity, -0.33, 0.33))[:, None]
        return covered(
            metal, sites, shape, look, hold=0.62, tones=tones, start=np.maximum(0.7 * sites.edges, 0.6 * shape.hollow)
        )

    def _craters(self, sites: Sites, pattern: Patterns, look: Look) -> np.ndarray:
        return sites.once(("zinc", look.seed, look.wear), lambda: _craters(pattern, look.wear))


def _craters(pattern: Patterns, wear: float) -> np.ndarray:
    """Depth of craters, [N], 0 to 1.5: of 1 to 4 cm, with small ones in and beside them."""
    moved = pattern.moved(0.008, 30.0, 3)
    large, small = moved.worley(26.0, 4), moved.worley(70.0, 6)
    share = 0.25 + 0.75 * wear
    deep = domes(large.near, 0.35 + 0.35 * large.id) * (large.id > 1.0 - share) * pattern.resolved(0.03)
    pits = domes(small.near, 0.25 + 0.3 * small.id) * (small.id > 1.0 - share) * pattern.resolved(0.012)
    return deep + 0.5 * pits
