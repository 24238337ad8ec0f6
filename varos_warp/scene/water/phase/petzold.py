"""The average particle phase function of Petzold's measurements in sea water.

Petzold (1972), SIO Ref. 72-78; averaged over three of his stations, less pure water, by Mobley et al. (1993),
Appl. Opt. 32, 7484, table 2.
"""

from pathlib import Path

import numpy as np

from varos_warp.scene.water.phase.tabulated import Tabulated

DATA = Path(__file__).parents[3] / "data"

ANGLE_DEG, P = np.loadtxt(DATA / "petzold.csv", delimiter=",", skiprows=2, unpack=True)
"""Angles of the table [degrees], and the density there [1/sr]."""
SLOPE = -1.3467
"""d log p/d log angle ahead of 0.1 degrees, as between the first rows."""


class Petzold(Tabulated):
    """The table, log-log interpolated, normalised."""

    kind = "petzold"

    def __init__(self):
        super().__init__(ANGLE_DEG, P, slope=SLOPE)

    @property
    def key(self) -> tuple:
        """Kind."""
        return (self.kind,)
