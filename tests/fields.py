"""A field of fewer nodes, for tests of other things: solved in a second, and right to a hundredth of the light."""

from varos_warp.render.field.directions import Directions

SMALL_FIELD = {"FINE": (44, 14, 32), "COARSE": (16, 7, 8), "ONCE": Directions.quadrature(56, 20, power=2),
               "AGAIN": Directions.quadrature(16, 6, power=2)}
"""By the names of varos_warp.render.field.solver."""
