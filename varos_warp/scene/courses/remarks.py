"""Remarks above the poses that say units: a row of units is followed, others must agree with what is read."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from varos_warp.errors import InputError
from varos_warp.scene.courses.lines import Row
from varos_warp.scene.headers import ANGLES, LENGTHS, TIMES, Said, other_units, units_in_remark


class Used(NamedTuple):
    """The units that a table is read in."""

    time: str
    """Unit of the times, a key of `NANOSECONDS`."""
    time_is_stated: bool
    """True if a name of the column, a row of units or the scene says so."""
    lengths: tuple[float, ...]
    """Metres in the units of the position."""
    lengths_are_stated: bool
    attitude: str
    """What the columns of the attitude are."""


@dataclass(frozen=True)
class Remarks:
    """What stands above the poses of a table, without what names its columns."""

    rows: tuple[Row, ...]
    units: tuple[str, ...]
    """Units of the columns, "" for those without; none: no remark has a row of them."""
    line_of_units: int | None
    path: Path
    key: str

    @classmethod
    def of(
        cls, before: Sequence[Row], header: Row | None, width: int, separator: str | None, path: Path, key: str
    ) -> "Remarks":
        """Remarks of the rows before the first pose, of which the last row of units tells those of the columns."""
        rows = tuple(row for row in before if row.is_comment and row != header)
        for row in reversed(rows):
            if units := units_in_remark(row.text, width, separator):
                return cls(tuple(other for other in rows if other != row), tuple(units), row.number, path, key)
        return cls(rows, (), None, path, key)

    def checked(self, used: Used) -> tuple[str, ...]:
        """What may be wrong with the units that a table is read in, by its remarks.

        Raises:
            InputError: A remark says another unit.
        """
        notes = []
        for row in self.rows:
            for one, surely in other_units(row.text, lambda one: _is_used(one, used)):
                if (key := _key_of_other(one, used)) is None:
                    continue
                where = f"'{row.text:.60}' may say that its numbers are in {one.word}, which is not followed"
                if surely:
                    raise InputError(
                        where,
                        file=self.path,
                        line=row.number,
                        key=self.key,
                        remedy=f"State the unit in trajectory.columns.{key}, or in the header behind the "
                        "names of the columns, such as x [mm].",
                    )
                notes.append(f"the remark in line {row.number}, {where}; trajectory.columns.{key} states it")
        return tuple(dict.fromkeys(notes))


def _key_of_other(said: Said, used: Used) -> str | None:
    """The key that would state a unit which is not used; None: another is stated, or it is of nothing that is read."""
    if said.word in LENGTHS:
        return None if used.lengths_are_stated else "position_unit"
    if said.word in TIMES:
        return None if used.time_is_stated else "time_unit"
    if not used.attitude.startswith("euler"):
        return None
    return "euler" if ANGLES[said.word][0] == "rad" else "euler_deg"


def _is_used(said: Said, used: Used) -> bool:
    if said.word in LENGTHS:
        return {*used.lengths} == {LENGTHS[said.word]}
    if said.word in TIMES:
        return TIMES[said.word] == used.time
    return ANGLES[said.word] == (("deg", 1.0) if used.attitude == "euler_deg" else ("rad", 1.0))
