"""The average particle phase function of Petzold's measurements in sea water.

Petzold (1972), SIO Ref. 72-78; averaged over three of his stations, less pure water, by Mobley et al. (1993),
Appl. Opt. 32, 7484, table 2.
"""

from varos_warp.scene.water.phase.tabulated import Tabulated

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


ANGLE_DEG = (
    0.1,
    0.12589,
    0.15849,
    0.19953,
    0.25119,
    0.31623,
    0.39811,
    0.50119,
    0.63096,
    0.79433,
    1,
    1.2589,
    1.5849,
    1.9953,
    2.5119,
    3.1623,
    3.9811,
    5.0119,
    6.3096,
    7.9433,
    10,
    15,
    20,
    25,
    30,
    35,
    40,
    45,
    50,
    55,
    60,
    65,
    70,
    75,
    80,
    85,
    90,
    95,
    100,
    105,
    110,
    115,
    120,
    125,
    130,
    135,
    140,
    145,
    150,
    155,
    160,
    165,
    170,
    175,
    180,
)
P = (
    1766.61,
    1295.64,
    950.172,
    699.092,
    513.687,
    376.373,
    276.318,
    218.839,
    144.369,
    102.241,
    71.6082,
    49.5803,
    33.9511,
    22.8129,
    15.1622,
    10.0154,
    6.57957,
    4.2953,
    2.8069,
    1.81927,
    1.15257,
    0.489344,
    0.244424,
    0.147151,
    0.0860848,
    0.0593075,
    0.0420985,
    0.0306722,
    0.0227533,
    0.0169904,
    0.0131254,
    0.0104625,
    0.00848826,
    0.00697601,
    0.00584232,
    0.00495306,
    0.00429232,
    0.00378161,
    0.00340405,
    0.00311591,
    0.00291222,
    0.00279696,
    0.00268568,
    0.00257142,
    0.00247603,
    0.00237667,
    0.00232898,
    0.00231308,
    0.00236475,
    0.00250584,
    0.00266183,
    0.00283472,
    0.00303046,
    0.00309206,
    0.00315366,
)
"""Density in the rows of the table [1/sr]."""
