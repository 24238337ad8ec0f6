"""A measured phase function, or volume scattering function: powers of the angle between the rows of a table."""

import hashlib
from pathlib import Path

import numpy as np

from varos_warp.scene.angle_table import AngleTable, read_csv
from varos_warp.scene.water.phase.phase_function import PhaseFunction
from varos_warp.scene.water.phase.power_table import S_CUT

SMALLEST_DEG = 1e-4
"""Smaller angles are one: below, kernels hold the density constant."""
STEEPEST = -1.9
"""Least slope over the angle ahead of the first row; at -2 there would be light without end."""
ZERO = 1e-6
"""Stands for a value of 0, in units of the smallest positive one: a power law never reaches 0."""


class Tabulated(PhaseFunction):
    """Density in any scale at some angles, interpolated log-log, normalised.

    Ahead of the first row the power law of the first two goes on, behind the last row the density is constant.

    Args:
        angle_deg: Increasing, 0 to 180, two at least.
        p: Density at the angles, none negative and not all 0.
        slope: d log p/d log angle ahead of the first row; absent: of the first two rows, if between STEEPEST and 0.
        name: Of the file, for people.
    """

    kind = "tabulated"

    def __init__(self, angle_deg, p, slope: float | None = None, name: str = ""):
        degrees, p = np.maximum(np.asarray(angle_deg, float), SMALLEST_DEG), np.asarray(p, float)
        self.name = name
        self._log_angle = np.log(np.radians(degrees))
        self._log_p = np.log(np.where(p > 0.0, p, ZERO * p[p > 0.0].min()))
        self._slope = self._first_slope() if slope is None else slope
        rows = np.stack([self._log_angle, self._log_p])
        self._digest = hashlib.sha256(rows.tobytes()).hexdigest()

    def _first_slope(self) -> float:
        """Slope ahead by the first two rows, from STEEPEST to 0; 0 if the first row is straight ahead."""
        if self._log_angle[0] <= np.log(np.radians(SMALLEST_DEG)):
            return 0.0
        slope = (self._log_p[1] - self._log_p[0]) / (self._log_angle[1] - self._log_angle[0])
        return float(np.clip(slope, STEEPEST, 0.0))

    @property
    def key(self) -> tuple:
        """Kind, digest of the rows, and slope ahead."""
        return (self.kind, self._digest, self._slope)

    @property
    def last_deg(self) -> float:
        """Angle of the last row [degrees]."""
        return float(np.degrees(np.exp(self._log_angle[-1])))

    @property
    def kinks(self) -> np.ndarray:
        """Values of s of the rows beyond S_CUT."""
        s = np.sin(0.5 * np.exp(self._log_angle)) ** 2
        return s[s > S_CUT]

    def describe(self) -> dict:
        """Its facts in plain JSON types, the table's own integral over the sphere, and the light beyond its rows."""
        ahead, up_to_last = self.cdf(np.sin(0.5 * np.exp(self._log_angle[[0, -1]])) ** 2)
        return {
            **super().describe(),
            "file": self.name,
            "integral": self.integral,
            "share_ahead_of_first_row": float(ahead),
            "share_behind_last_row": float(max(1.0 - up_to_last, 0.0)),
        }

    def density(self, s) -> np.ndarray:
        """Density, in the scale of the table."""
        log_angle = np.log(2.0 * np.arcsin(np.sqrt(np.asarray(s, float))))
        ahead = np.minimum(log_angle - self._log_angle[0], 0.0)
        return np.exp(np.interp(log_angle, self._log_angle, self._log_p) + self._slope * ahead)


TABLE = AngleTable(
    "table of a phase function",
    "p",
    "A density is 0 or more; leave the row out.",
    "Some light must be scattered somewhere.",
)


def read_table(path: Path, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Angles [degrees] and densities of a CSV file with the columns angle_deg and p; other columns are left.

    Raises:
        InputError: The file is missing, or is no such table.
    """
    rows = TABLE.of(read_csv(path, key, TABLE.what))
    angle_deg, p = rows.values.T
    same = (angle_deg <= SMALLEST_DEG) & (np.arange(len(p)) == 1)
    two = f"has two angles up to {SMALLEST_DEG:g} degrees, which are one here"
    rows.refuse(same, 0, two, "Leave the smaller ones out.")
    return angle_deg, p
