"""CSV files of quantities by angle or wavelength: measured phase functions, intensities of lamps, spectra."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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

    def error(self, problem: str, remedy: str, line: int | None = None, value: Any = None) -> InputError:
        """An error about the file, or a line of it."""
        return InputError(problem, file=self.path, line=line, key=self.key, value=value, remedy=remedy)

    def rows(self, *columns: str) -> "CsvRows":
        """Numbers in columns of these names, two rows at least; other columns are left.

        Raises:
            InputError: A column is missing, or something is no number.
        """
        missing = [name for name in columns if name not in self.names]
        if missing:
            raise self.error(
                f"has no column {' and '.join(missing)}", f"Its first line names the columns: {','.join(columns)}."
            )
        at = [self.names.index(name) for name in columns]
        rows = [
            [self._number(line, name, row[i] if i < len(row) else "") for name, i in zip(columns, at, strict=True)]
            for line, row in self.lines[1:]
        ]
        if len(rows) < 2:
            raise self.error(f"has {counted(len(rows), 'row')} of numbers", f"A {self.what} has two at least.")
        return CsvRows(self, columns, np.array(rows))

    def _number(self, line: int, column: str, cell: str) -> float:
        try:
            number = float(cell)
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            problem = f"{column} is missing" if cell.strip().lower() in ("", "nan") else f"{column} is not a number"
            raise self.error(problem, "Give a number, or leave the row out.", line, cell.strip())
        return number


@dataclass(frozen=True)
class CsvRows:
    """The numbers of a CSV file."""

    file: CsvFile
    columns: tuple[str, ...]
    values: np.ndarray
    """float64 [rows, columns]."""

    def refuse(self, wrong: np.ndarray, column: int, problem: str, remedy: str) -> None:
        """Refuse the first of the rows that are wrong, bool [rows], for its value in a column."""
        if wrong.any():
            i = int(np.argmax(wrong))
            raise self.file.error(problem, remedy, self.file.lines[1 + i][0], float(self.values[i, column]))

    def refuse_falls(self, column: int, remedy: str) -> None:
        """Refuse the first of the rows whose value in a column is not above that of the row before."""
        falls = np.diff(self.values[:, column], prepend=-np.inf) <= 0.0
        self.refuse(falls, column, f"{self.columns[column]} does not increase", remedy)

    def refuse_amounts(self, column: int, negative: str, all_0: str) -> None:
        """Refuse a column with a value below 0, or without any above; the texts are remedies."""
        self.refuse(self.values[:, column] < 0.0, column, f"{self.columns[column]} is negative", negative)
        if not self.values[:, column].any():
            raise self.file.error(f"{self.columns[column]} is 0 everywhere", all_0)


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

    def of(self, file: CsvFile) -> CsvRows:
        """Angles [degrees] and values of a file that was opened by `read_csv`.

        Raises:
            InputError: It is no such table.
        """
        rows = file.rows("angle_deg", self.column)
        angle_deg, straight = rows.values[:, 0], "Give the angle in degrees; 0 is straight on."
        rows.refuse((angle_deg < 0.0) | (angle_deg > 180.0), 0, "angle_deg is not between 0 and 180", straight)
        rows.refuse_falls(0, "Sort the rows by angle, each angle once.")
        rows.refuse_amounts(1, self.not_negative, self.not_all_0)
        return rows
