"""Cells of a table as numbers: times to the nanosecond whatever their epoch, and float64; or what is wrong with one."""

import contextlib
import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.courses.lines import Row
from varos_warp.scene.headers import NANOSECONDS, is_number

MOST_NS = 2**63 - 1
"""The last time that is read, in the year 2262."""
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", None: "blanks"}
"""What parts the cells of a row, and what it is called; None: any blanks."""


def separator_of(text: str) -> str | None:
    """What parts the cells of a row."""
    return next((each for each in (";", ",", "\t") if each in text), None)


def split(text: str, separator: str | None) -> list[str]:
    """The cells of a row, without quotes and blanks around them."""
    if separator is None:
        return text.split()
    cells = text.split(separator)
    if '"' in text:
        with contextlib.suppress(csv.Error):
            cells = next(csv.reader([text], delimiter=separator))
    return [cell.strip() for cell in cells]


@dataclass(frozen=True)
class Cells:
    """Columns and units of the numbers to read from the rows of a table."""

    path: Path
    key: str
    """The key of the scene that names the file."""
    separator: str | None
    count: int
    """Number of cells in a row."""
    time: int
    """Column of the time."""
    unit: str
    """Unit of the time, a key of `NANOSECONDS`."""
    columns: tuple[int, ...]
    """Columns of all other numbers."""
    factors: tuple[float, ...]
    """Factor of each of ``columns``: metres, or radians or degrees, in the unit of the column."""
    names: dict[int, str]
    """What columns are called in messages."""

    def read(self, rows: Sequence[Row]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Numbers of the lines int64 [N], times int64 [N] [ns], and the other numbers float64 [N, k].

        Raises:
            InputError: The first row that is not as the others, or holds something that is no finite number.
        """
        try:
            if not rows:
                return np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, len(self.columns)))
            texts = [self._plain(row) for row in rows]
            size = NANOSECONDS[self.unit]
            times = [nanoseconds(text.split(self.separator, self.time + 1)[self.time].strip(), size) for text in texts]
            values = np.loadtxt(texts, delimiter=self.separator, usecols=self.columns, comments=None, ndmin=2)
            if not np.isfinite(values).all():
                raise ValueError
        except ValueError:
            raise self._first_problem(rows) from None
        if any(factor != 1.0 for factor in self.factors):
            values = values * self.factors
        return np.array([row.number for row in rows]), np.array(times, np.int64), values

    def _plain(self, row: Row) -> str:
        """The text of a row that has as many cells as it must, without quotes."""
        text = row.text
        if '"' in text and self.separator is not None:
            text = self.separator.join(split(text, self.separator))
        count = len(text.split()) if self.separator is None else text.count(self.separator) + 1
        if count == self.count + 1 and self.separator is not None and text.endswith(self.separator):
            return text[:-1]  # a separator after the last cell parts nothing
        if count != self.count:
            raise ValueError
        return text

    def _first_problem(self, rows: Sequence[Row]) -> InputError:
        """What is wrong with the first row that cannot be read."""
        for row in rows:
            cells = split(row.text, self.separator)
            if len(cells) == self.count + 1 and not cells[-1] and self.separator is not None:
                cells.pop()
            if len(cells) != self.count:
                return self.problem(
                    row.number,
                    f"has {len(cells)} cells parted by {SEPARATORS[self.separator]}, where others have {self.count}",
                    "Part all rows alike, and write numbers with a decimal point, not a comma.",
                )
            for column in (self.time, *self.columns):
                if found := problem_of(cells[column], self.unit if column == self.time else None):
                    cell = f" '{cells[column]:.40}'" if cells[column] else ""
                    return self.problem(row.number, f"{self.names[column]}{cell} {found[0]}", found[1])
        return self.problem(rows[0].number, "cannot be read as numbers", "Write one pose a line.")

    def problem(self, line: int | None, problem: str, remedy: str) -> InputError:
        """An error about a line of the file."""
        return InputError(problem, file=self.path, line=line, key=self.key, remedy=remedy)


def problem_of(cell: str, unit: str | None) -> tuple[str, str] | None:
    """What is wrong with a cell, a time in a unit if one is given, and what to do; None: nothing."""
    if cell.lower() in ("", "nan", "-nan", "null", "none"):
        return "is missing", "Give a number, or leave the row out."
    if re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", cell, re.IGNORECASE):
        return "has a decimal comma", "Write decimal points."
    if len(cell.split()) > 1:
        return "is more than one number", "Part all cells alike."
    if not is_number(cell) or "_" in cell or not cell.isascii():
        return "is not a number", "Give a number, or leave the row out."
    if not np.isfinite(float(cell)):
        return "is not a finite number", "Give a number, or leave the row out."
    if unit is not None and abs(float(cell)) >= MOST_NS / NANOSECONDS[unit]:
        return f"is too large for a time in {unit}", "State its unit in trajectory.columns.time_unit: ns, us or ms."
    return None


def nanoseconds(cell: str, size: int) -> int:
    """The nearest nanosecond of a time in units of ``size`` ns, never through float64: 1.6e18 ns have more digits.

    Raises:
        ValueError: It is none, or has more than 63 bits.
    """
    whole, _, part = cell.partition(".")
    if cell.isascii() and whole.isdecimal() and (part.isdecimal() or not part) and len(cell) < 40:
        exact, rest = divmod(int(whole + part) * size, 10 ** len(part))
        if not rest and exact <= MOST_NS:
            return exact
    try:
        time = Decimal(cell) * size
        if "_" in cell or not abs(time) <= MOST_NS:
            raise ValueError
        return int(time.to_integral_value())
    except ArithmeticError:  # of a decimal that is none, or too large
        raise ValueError from None
