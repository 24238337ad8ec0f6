"""Files of a lamp's intensity by angle: CSV, and IES LM-63 as makers of lamps publish it."""

import re
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import read_text
from varos_warp.scene.angle_table import AngleTable

TABLE = AngleTable("profile of a lamp", "intensity", "An intensity is 0 or more.", "A lamp must shine somewhere.")
UNEVEN = 0.02
"""Intensities of one angle to the axis may differ by so much of the peak around it; their mean is taken."""
HEADER = 13
"""Numbers of an IES file ahead of its angles."""


def read_profile(path: Path, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Angles to the axis [rad], increasing, and intensities there, in any unit.

    Args:
        path: A file whose name ends in .ies is read as IES LM-63, any other as CSV with angle_deg and intensity.
        key: That names it, for messages.

    Raises:
        InputError: The file is missing, or is no profile of a lamp that is the same all around its axis.
    """
    if path.suffix.lower() == ".ies":
        return _read_ies(path, key)
    angle_deg, intensity, _ = TABLE.read(path, key)
    return np.radians(angle_deg), intensity


def _read_ies(path: Path, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Of an IES file of type C: its vertical angles, from straight down, which is the lamp's axis."""
    text = read_text(path, "IES file", "Paths are relative to the scene file.", key)

    def wrong(problem, remedy="Export it as IES LM-63, type C, or as CSV with the columns angle_deg,intensity."):
        return InputError(problem, file=path, key=key, remedy=remedy)

    _, tilt, rest = text.partition("TILT=")
    if not tilt or rest.split(None, 1)[:1] != ["NONE"]:
        raise wrong("has no line TILT=NONE")
    try:
        numbers = np.array(re.split(r"[\s,]+", rest.split(None, 1)[1].strip()), float)
        vertical, horizontal = int(numbers[3]), int(numbers[4])
        angles = numbers[HEADER:HEADER + vertical]
        candela = numbers[HEADER + vertical + horizontal:].reshape(horizontal, vertical)
    except (ValueError, IndexError, OverflowError):
        raise wrong("its numbers are not those of an IES LM-63 file") from None
    if numbers[5] != 1 or vertical < 2 or angles[0] != 0.0 or not (np.diff(angles) > 0.0).all() or angles[-1] > 180.0:
        raise wrong("is not of type C with increasing angles from 0, straight along the lamp's axis")
    if not np.isfinite(candela).all() or candela.min() < 0.0 or not candela.any():
        raise wrong("its intensities are not 0 or more, with one above")
    if (uneven := np.ptp(candela, axis=0).max() / candela.max()) > UNEVEN:
        raise wrong(f"its intensity changes around the axis by {uneven:.0%} of the peak",
                    "Lamps must shine alike all around their axis: give the mean as CSV.")
    return np.radians(angles), candela.mean(axis=0)
