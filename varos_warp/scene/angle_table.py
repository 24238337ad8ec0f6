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
        rows, numbers = read_rows(path, key, self.what, ("angle_deg", self.column))
        angle_deg, values = rows.T
        self._check(path, key, numbers, angle_deg, values)
        return angle_deg, values, numbers

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


def column_names(path: Path, key: str, what: str) -> list[str]:
    """What the first line of a CSV file names; nothing if it is empty. Arguments as for `read_rows`.

    Raises:
        InputError: The file is missing, or no text.
    """
    lines = _lines(path, key, what)
    return [name.strip() for name in lines[0][1]] if lines else []


def read_rows(path: Path, key: str, what: str, columns: tuple[str, ...]) -> tuple[np.ndarray, list[int]]:
    """Numbers in some columns of a CSV file, float64 [rows, columns], and the numbers of their lines; two at least.

    Args:
        path: Of the file; empty lines, those that begin with # and other columns are left.
        key: That names it, for messages.
        what: It is, for messages.
        columns: Their names, as in the file's first line.

    Raises:
        InputError: The file is missing, or is no such table.
    """
    header = column_names(path, key, what)
    missing = [name for name in columns if name not in header]
    if missing:
        raise InputError(f"has no column {' and '.join(missing)}", file=path, key=key,
                         remedy=f"Its first line names the columns: {','.join(columns)}.")
    at = [header.index(name) for name in columns]
    lines = _lines(path, key, what)[1:]
    rows = [[_number(path, key, line, name, row[i] if i < len(row) else "")
             for name, i in zip(columns, at, strict=True)] for line, row in lines]
    if len(rows) < 2:
        raise InputError(f"has {counted(len(rows), 'row')} of numbers", file=path, key=key,
                         remedy=f"A {what} has two at least.")
    return np.array(rows), [line for line, _ in lines]


def _lines(path: Path, key: str, what: str) -> list[tuple[int, list[str]]]:
    """Number and cells of every line that is neither empty nor a comment."""
    text = read_text(path, what, "Paths are relative to the scene file; export it as CSV.", key)
    lines = [(i, line) for i, line in enumerate(text.splitlines(), start=1)
             if line.strip(", \t") and not line.startswith("#")]
    try:
        return [(i, next(csv.reader([line]))) for i, line in lines]
    except csv.Error as error:
        raise InputError(f"is no CSV file: {error}", file=path, key=key, remedy="Export it as CSV.") from None


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
