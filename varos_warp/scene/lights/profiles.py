"""Files of a lamp's intensity by angle: CSV, and IES LM-63 as makers of lamps publish it."""

from pathlib import Path

import numpy as np

from varos_warp.errors import InputError, did_you_mean
from varos_warp.files import require_file
from varos_warp.scene.angle_table import AngleTable, CsvFile, read_csv
from varos_warp.scene.description import LAMPS
from varos_warp.scene.lights.goniometry import WIDEST_GAP_DEG, NotMeasured, Profile, full_turn, profile_of
from varos_warp.scene.lights.ies import read_ies

TABLE = AngleTable("profile of a lamp", "intensity", "An intensity is 0 or more.", "A lamp must shine somewhere.")
FULL_TURN = 6.3
"""Azimuths that end below are rather in radians: twice pi, rounded up."""
FOREIGN = {
    ".ldt": "EULUMDAT",
    ".xml": "XML (TM-33 and its like)",
    ".uld": "DIALux's",
    ".rolf": "Relux's",
    ".cib": "TM14",
}
"""Formats of lamps that are not read, by the ends of their names."""
AROUND = ("polar_deg", "azimuth_deg", "intensity")
"""Columns of a lamp that is not the same all around its axis."""


def read_profile(path: Path, key: str) -> Profile:
    """The profile of a lamp in a file: IES LM-63 if its name ends in .ies, else CSV.

    That has the columns angle_deg and intensity, or polar_deg, azimuth_deg and intensity.

    Raises:
        InputError: The file is missing, or is no profile of a lamp.
    """
    if path.suffix.lower() == ".ies":
        file = read_ies(path, key)
        try:
            return profile_of(file)
        except NotMeasured as problem:
            raise InputError(
                str(problem),
                file=path,
                key=key,
                remedy=("Export it anew, or write it as CSV with the columns polar_deg,azimuth_deg,intensity."),
            ) from None
    if format_ := FOREIGN.get(path.suffix.lower()):
        raise InputError(
            f"is a lamp in a format that is not read, {format_}",
            file=path,
            key=key,
            remedy=(
                "Convert it to IES LM-63 (.ies), as DIALux, Relux and free converters of EULUMDAT do, or write it "
                "as CSV with the columns angle_deg,intensity or polar_deg,azimuth_deg,intensity."
            ),
        )
    if not path.suffix:  # no file, rather a lamp of ours
        require_file(
            path,
            TABLE.what,
            did_you_mean(path.name, LAMPS)
            or (f"Give the path of a file, or a lamp that comes with the package: {', '.join(LAMPS)}."),
            key,
        )
    table = read_csv(path, key, TABLE.what)
    if "azimuth_deg" in table.names:
        return _read_around(table)
    angle_deg, intensity = TABLE.of(table).values.T
    return Profile(np.radians(angle_deg), np.zeros(1), intensity[None], "CSV")


def _read_around(table: CsvFile) -> Profile:
    """The profile of intensities at every pair of some angles to the axis and some half planes around it."""
    rows = table.rows(*AROUND)
    polar, azimuth, measured = rows.values.T
    off, straight = (polar < 0.0) | (polar > 180.0), "Give the angle to the axis in degrees; 0 is straight on."
    rows.refuse(off, 0, "polar_deg is not between 0 and 180", straight)
    rows.refuse(np.abs(azimuth) > 360.0, 1, "azimuth_deg is not between -360 and 360", "Give degrees.")
    rows.refuse_amounts(2, TABLE.not_negative, TABLE.not_all_0)
    azimuth_deg, at_azimuth = np.unique(azimuth % 360.0, return_inverse=True)
    polar_deg, at_polar = np.unique(polar, return_inverse=True)
    intensity, again = np.full((len(azimuth_deg), len(polar_deg)), np.nan), np.zeros(len(measured), bool)
    for row, place in enumerate(zip(at_azimuth, at_polar, strict=True)):
        again[row] = not np.isnan(intensity[place]) and intensity[place] != measured[row]
        intensity[place] = measured[row]
    rows.refuse(again, 2, "has two intensities in one direction", "360 degrees of azimuth are 0.")
    _check_grid(table, azimuth_deg, polar_deg, intensity)
    return full_turn(np.radians(polar_deg), np.radians(azimuth_deg), intensity, f"CSV, {len(azimuth_deg)} azimuths")


def _check_grid(table: CsvFile, azimuth_deg: np.ndarray, polar_deg: np.ndarray, intensity: np.ndarray) -> None:
    """Refuse a table in which a direction has no intensity, or whose half planes are not all around."""
    missing = np.argwhere(np.isnan(intensity))
    if len(missing):
        azimuth, polar = azimuth_deg[missing[0, 0]], polar_deg[missing[0, 1]]
        raise table.error(
            f"has no intensity at polar_deg {polar:g}, azimuth_deg {azimuth:g}",
            "Give every azimuth the same polar angles.",
        )
    gap = np.diff(azimuth_deg, append=azimuth_deg[0] + 360.0).max()
    if len(polar_deg) < 2 or (gap > WIDEST_GAP_DEG and len(azimuth_deg) > 1):
        radians = " These look like radians: give degrees." if azimuth_deg[-1] < FULL_TURN else ""
        raise table.error(
            "has one angle to the axis" if len(polar_deg) < 2 else f"has no azimuth in a gap of {gap:g} degrees",
            "Give the whole lamp: several polar_deg, and azimuth_deg all around, at most "
            f"{WIDEST_GAP_DEG:g} apart.{radians}",
        )
