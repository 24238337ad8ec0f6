"""CSV files of a quantity by angle: a measured phase function, the intensity of a lamp."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError, counted
from varos_warp.files import read_text


@dataclass(frozen=True)
class CsvFile:
    """The lines of a CSV file that are neither empty nor comments, in cells."""

    path: Path
    key: str
    """The key that names the file, for messages."""
    what: str
    """What the file is, for messages."""
    lines: list[tuple[int, list[str]]]
    """Number and cells of each line."""

    @property
    def names(self) -> list[str]:
        """What the first line names its columns; nothing if the file is empty."""
        return [name.strip() for name in self.lines[0][1]] if self.lines else []

    def rows(self, columns: tuple[str, ...]) -> tuple[np.ndarray, list[int]]:
        """Numbers in some columns, float64 [rows, columns], and the numbers of their lines; two at least.

        Raises:
            InputError: A column is missing, or something is no number.
        """
        missing = [name for name in columns if name not in self.names]
        if missing:
            raise InputError(
                f"has no column {' and '.join(missing)}",
                file=self.path,
                key=self.key,
                remedy=f"Its first line names the columns: {','.join(columns)}.",
            )
        at = [self.names.index(name) for name in columns]
        rows = [
            [
                _number(self.path, self.key, line, name, row[i] if i < len(row) else "")
                for name, i in zip(columns, at, strict=True)
            ]
            for line, row in self.lines[1:]
        ]
        if len(rows) < 2:
            raise InputError(
                f"has {counted(len(rows), 'row')} of numbers",
                file=self.path,
                key=self.key,
                remedy=f"A {self.what} has two at least.",
            )
        return np.array(rows), [line for line, _ in self.lines[1:]]


def read_csv(path: Path, key: str, what: str) -> CsvFile:
    """The lines of a CSV file but for empty ones and those that begin with #.

    Raises:
        InputError: The file is missing, or is no CSV file.
    """
    text = read_text(path, what, "Paths are relative to the scene file; export it as CSV.", key)
    lines = [
        (i, line)
        for i, line in enumerate(text.splitlines(), start=1)
        if line.strip(", \t") and not line.startswith("#")
    ]
    try:
        return CsvFile(path, key, what, [(i, next(csv.reader([line]))) for i, line in lines])
    except csv.Error as error:
        raise InputError(f"is no CSV file: {error}", file=path, key=key, remedy="Export it as CSV.") from None


@dataclass(frozen=True)
class AngleTable:
    """What a file holds: columns ``angle_deg``, increasing from 0 to 180, and one more; others are left."""

    what: str
    """What the file is, for messages."""
    column: str
    """The name of the other column."""
    not_negative: str
    """Remedy for a negative value."""
    not_all_0: str
    """Remedy where all values are 0."""

    def read(self, path: Path, key: str) -> tuple[np.ndarray, np.ndarray, list[int]]:
        """Angles [degrees], values, and the numbers of their lines; two at least.

        Raises:
            InputError: The file is missing, or is no such table.
        """
        return self.of(read_csv(path, key, self.what))

    def of(self, file: CsvFile) -> tuple[np.ndarray, np.ndarray, list[int]]:
        """Angles [degrees], values, and the numbers of their lines, of a file that was opened by `read_csv`.

        Raises:
            InputError: It is no such table.
        """
        rows, numbers = file.rows(("angle_deg", self.column))
        angle_deg, values = rows.T
        self._check(file.path, file.key, numbers, angle_deg, values)
        return angle_deg, values, numbers

    def _check(self, path: Path, key: str, lines: list[int], angle_deg: np.ndarray, values: np.ndarray):
        """Angles increase within 0 to 180 degrees; values are not negative, and not all 0."""
        falls = np.concatenate([[False], np.diff(angle_deg) <= 0.0])
        for wrong, found, problem, remedy in (
            (
                (angle_deg < 0.0) | (angle_deg > 180.0),
                angle_deg,
                "angle_deg is not between 0 and 180",
                "Give the angle in degrees; 0 is straight on.",
            ),
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
        raise InputError(
            problem, file=path, line=line, key=key, value=cell.strip(), remedy="Give a number, or leave the row out."
        )
    return number
