"""CSV files of a quantity by angle: a measured phase function, the intensity of a lamp."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError, counted
from varos_warp.files import read_text


@dataclass(frozen=True)
class AngleTable:
    """What a file holds: columns ``angle_deg``, increasing from 0 to 180, and one more; others are left."""

    what: str
    """For messages."""
    column: str
    not_negative: str
    """Remedy for a negative value."""
    not_all_0: str
    """Remedy where all values are 0."""

    def read(self, path: Path, key: str) -> tuple[np.ndarray, np.ndarray, list[int]]:
        """Angles [degrees], values, and the numbers of their lines; two at least.

        Raises:
            InputError: The file is missing, or is no such table.
        """
        lines = self._lines(path, key)
        columns, header = ("angle_deg", self.column), [name.strip() for name in lines[0][1]] if lines else []
        missing = [name for name in columns if name not in header]
        if missing:
            raise InputError(f"has no column {' and '.join(missing)}", file=path, key=key,
                             remedy=f"Its first line names the columns: {','.join(columns)}.")
        at = [header.index(name) for name in columns]
        rows = [[_number(path, key, line, name, row[i] if i < len(row) else "")
                 for name, i in zip(columns, at, strict=True)] for line, row in lines[1:]]
        if len(rows) < 2:
            raise InputError(f"has {counted(len(rows), 'row')} of numbers", file=path, key=key,
                             remedy=f"A {self.what} has two at least.")
        numbers = [line for line, _ in lines[1:]]
        angle_deg, values = np.array(rows).T
        self._check(path, key, numbers, angle_deg, values)
        return angle_deg, values, numbers

    def _lines(self, path: Path, key: str) -> list[tuple[int, list[str]]]:
        """Number and cells of every line that is neither empty nor a comment."""
        text = read_text(path, self.what, "Paths are relative to the scene file; export it as CSV.", key)
        lines = enumerate(text.splitlines(), start=1)
        return [(i, next(csv.reader([line]))) for i, line in lines if line.strip(", \t") and not line.startswith("#")]

    def _check(self, path: Path, key: str, lines: list[int], angle_deg: np.ndarray, values: np.ndarray):
        """Angles increase within 0 to 180 degrees; values are not negative, and not all 0."""
        falls = np.concatenate([[False], np.diff(angle_deg) <= 0.0])
        for wrong, found, problem, remedy in (
            ((angle_deg < 0.0) | (angle_deg > 180.0), angle_deg, "angle_deg is not between 0 and 180",
             "Give the angle in degrees; 0 is straight on."),
            (falls, angle_deg, "angle_deg does not increase", "Sort the rows by angle, each angle once."),
            (values < 0.0, values, f"{self.column} is negative", self.not_negative),
        ):
            if wrong.any():
                i = int(np.argmax(wrong))
                raise InputError(problem, file=path, line=lines[i], key=key, value=float(found[i]), remedy=remedy)
        if not values.any():
            raise InputError(f"{self.column} is 0 everywhere", file=path, key=key, remedy=self.not_all_0)


def _number(path: Path, key: str, line: int, column: str, cell: str) -> float:
    """A cell's number."""
    try:
        number = float(cell)
    except ValueError:
        number = np.nan
    if not np.isfinite(number):
        problem = f"{column} is missing" if cell.strip().lower() in ("", "nan") else f"{column} is not a number"
        raise InputError(problem, file=path, line=line, key=key, value=cell.strip(),
                         remedy="Give a number, or leave the row out.")
    return number
