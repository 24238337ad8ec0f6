"""Which columns of a table hold what: by its format, by usual names in its header, or as the scene file says.

TUM: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats. EuRoC: https://projects.asl.ethz.ch/datasets.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from varos_warp.errors import InputError, did_you_mean
from varos_warp.scene.courses.cells import Cells, is_number, separator_of, split
from varos_warp.scene.courses.lines import REMEDY, Row
from varos_warp.scene.description.recorded import Columns
from varos_warp.scene.description.vehicle import Trajectory

Names = tuple[str, ...]
UNITS = {"s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "ms": "ms", "msec": "ms",
         "milliseconds": "ms", "us": "us", "usec": "us", "µs": "us", "microseconds": "us", "ns": "ns", "nsec": "ns",
         "nanoseconds": "ns"}
"""Units that the name of a column of times may end with."""
TIMES = ("t", "time", "timestamp", "stamp")
"""Names of columns of times, without their unit."""
POSITIONS: dict[Names, str | None] = {
    ("x", "y", "z"): None, ("tx", "ty", "tz"): None, ("px", "py", "pz"): None, ("p_x", "p_y", "p_z"): None,
    ("pos_x", "pos_y", "pos_z"): None, ("position_x", "position_y", "position_z"): None,
    ("p_rs_r_x", "p_rs_r_y", "p_rs_r_z"): None, ("s_x_vw", "s_y_vw", "s_z_vw"): None,
    ("p_wv_x", "p_wv_y", "p_wv_z"): None,
    ("n", "e", "d"): "ned", ("north", "east", "down"): "ned", ("e", "n", "u"): "enu", ("east", "north", "up"): "enu"}
"""Names of the columns of positions, and the frame that they tell."""
QUATERNIONS: tuple[Names, ...] = (
    ("qw", "qx", "qy", "qz"), ("q_w", "q_x", "q_y", "q_z"), ("q_rs_w", "q_rs_x", "q_rs_y", "q_rs_z"),
    ("q_wv_w", "q_wv_x", "q_wv_y", "q_wv_z"), ("quat_w", "quat_x", "quat_y", "quat_z"),
    ("orientation_w", "orientation_x", "orientation_y", "orientation_z"))
"""Names of the columns of quaternions."""
EULER: tuple[Names, ...] = (("theta_x_vw", "theta_y_vw", "theta_z_vw"),)
"""Names of the columns of angles [rad] about the fixed axes x, then y, then z."""
MATRIX: Names = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")
"""Names of the columns of a rotation matrix."""
FORMATS = {"s_x_vw": ("poses of a dataset", None), "p_wv_x": ("states of a dataset", None), "p_rs_r_x": ("EuRoC", "ns"),
           "tx": ("TUM", "s")}
"""Formats that are known by the first name of their positions, and the unit of times whose name has none."""
ATTITUDE = "^q|quat|roll|pitch|yaw|heading|orient|euler"
"""What names of columns have that may be an attitude."""
TUM = Columns(time=0, time_unit="s", position=(1, 2, 3), quaternion=(7, 4, 5, 6))
TUM_COLUMNS = 8
KITTI_COLUMNS = 12


@dataclass(frozen=True)
class Layout:
    """What a table is, and where its numbers are."""

    format: str
    """In words."""
    cells: Cells
    """Its columns are those of the position, then those of the attitude."""
    attitude: str
    """What the columns of the attitude are: quaternion (w first), euler [rad], euler_deg, matrix or none."""
    euler_order: str
    header: int | None
    """Number of the line of its header."""
    unit_is_stated: bool
    """Whether the file or the scene says in which unit the times are."""
    frame: str | None
    """World axes that the names of its columns tell."""

    @property
    def is_ours(self) -> bool:
        """Whether it is a table of one of our own datasets, in our axes."""
        return self.format.endswith("of a dataset")


def layout_of(rows: Sequence[Row], path: Path, course: Trajectory, key: str) -> Layout:
    """What a table is by its first rows.

    Args:
        rows: With comments.
        path: The file.
        course: What the scene says of it.
        key: The key of the scene that names the file.

    Raises:
        InputError: It is not known which columns hold what.
    """
    first = next((row for row in rows if not row.is_comment), None)
    if first is None:
        raise InputError("has no poses" if rows else "is empty", file=path, key=key, remedy=REMEDY)
    separator = separator_of(first.text)
    header, names = _header(rows, first, separator, known=course.columns is not None)
    width = len(names) if names else len(split(first.text, separator))
    finder = _Finder(path, key, names, header)
    if course.columns is not None:
        return finder.layout("table", course.columns, separator, width)
    if names:
        return finder.named(separator)
    if width == TUM_COLUMNS and separator in (None, "\t"):
        return _Finder(path, key, ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"], None).layout(
            "TUM", TUM, separator, width)
    what = ("are poses of KITTI, which have no times" if width == KITTI_COLUMNS and separator is None else
            "have no header that names the columns, and are not those of TUM: t x y z qx qy qz qw, with blanks between")
    raise InputError(f"rows of {width} numbers {what}", file=path, line=first.number, key=key,
                     remedy="Name the columns, in a first line or by their numbers from 0 in trajectory.columns.")


def _header(rows: Sequence[Row], first: Row, separator: str | None, known: bool) -> tuple[Row | None, list[str]]:
    """The line that names the columns and their names, without #; none where there is no such line.

    In a comment names count only if there is one for each column, and, where blanks part them as they do the words of a
    remark, if they are usual ones or the scene names some (``known``).
    """
    names = split(first.text, separator)
    names = names[:-1] if separator is not None and not names[-1] else names  # what a last separator parts is nothing
    if not any(map(is_number, names)):
        return first, names
    before = [row for row in rows if row.number < first.number]
    if not before:
        return None, []
    found = split(before[-1].text.lstrip("#"), separator)
    usual = separator is not None or known or _base(found[:1]) <= set(TIMES)
    if len(found) != len(names) or any(map(is_number, found)) or not usual:
        return None, []
    return before[-1], found


def _base(names: Sequence[str]) -> set[str]:
    return {plain_name(name)[0] for name in names}


def plain_name(name: str) -> tuple[str, str | None]:
    """A column's name in small letters without its unit, and the unit, if it is one of time."""
    text = name.strip().lstrip("#%").strip().lower()
    word, _, rest = re.sub(r"[\[(]", "\0", text, count=1).partition("\0")
    if rest:
        return word.strip(" _"), UNITS.get(rest.strip(" ])"))
    word, _, unit = text.rpartition("_")
    return (word, UNITS[unit]) if word and unit in UNITS else (text, None)


@dataclass(frozen=True)
class _Finder:
    """Finds columns by the names of a header."""

    path: Path
    key: str
    names: list[str]
    header: Row | None

    def named(self, separator: str | None) -> Layout:
        """The layout by usual names."""
        bases = [plain_name(name)[0] for name in self.names]
        times = [name for name, base in zip(self.names, bases, strict=True) if base in TIMES]
        positions = [names for names in POSITIONS if {*names} <= {*bases}]
        turns = [names for names in (*QUATERNIONS, *EULER, MATRIX) if {*names} <= {*bases}]
        for what, found in (("the time", times), ("a position", positions)):
            if len(found) != 1:
                raise self._unclear(f"{'several columns' if found else 'no column'} that may be {what}")
        wanted = (*positions[0], *(turns or [()])[0])
        if twice := [name for name in wanted if bases.count(name) > 1]:
            raise self._error(f"has {bases.count(twice[0])} columns named '{twice[0]}'",
                              "Give each column a name of its own.")
        if len(turns) > 1:
            raise self._unclear("several attitudes")
        if not turns and (near := [name for name in self.names if re.search(ATTITUDE, name, re.IGNORECASE)]):
            raise self._unclear(f"what may be an attitude ({', '.join(near[:4])})")
        position, turn = (tuple(self.names[bases.index(name)] for name in names) for names in (wanted[:3], wanted[3:]))
        form, unit = FORMATS.get(wanted[0], ("table", None))
        if form == "TUM" and separator not in (None, "\t"):
            form, unit = "table", None  # much like it, but what wrote it is another program
        columns = Columns(time=times[0], time_unit=None if plain_name(times[0])[1] else unit, position=position,
                          quaternion=turn if len(turn) == 4 else None, euler=turn if len(turn) == 3 else None)
        return self.layout(form, columns, separator, len(self.names), turn if len(turn) == len(MATRIX) else ())

    def layout(self, form: str, columns: Columns, separator: str | None, width: int, matrix: Sequence[str] = ()
               ) -> Layout:
        """The layout by columns of the scene file, by those of a format, or by those that were found."""
        kind = "matrix" if matrix else next((key for key in ("quaternion", "euler", "euler_deg")
                                             if getattr(columns, key) is not None), "none")
        turn = tuple(matrix) or getattr(columns, kind, None) or ()
        if kind == "quaternion":
            self._check_order(turn, "wxyz", "quaternion")
        self._check_order(columns.position, "xyz", "position")
        self._check_angles(kind, turn)
        wanted = [columns.time, *columns.position, *turn]
        at = [self._number(column, width) for column in wanted]
        if len({*at}) < len(at):
            twice = next(name for i, name in enumerate(wanted) if at.index(at[i]) < i)
            raise self._error(f"column {twice} is to hold two things", "Name each column once in trajectory.columns.")
        called = {i: self.names[i] if self.names else f"column {i}" for i in at}
        unit, stated = self._unit(columns, at[0])
        cells = Cells(self.path, self.key, separator, width, at[0], unit, tuple(at[1:]), called)
        frame = POSITIONS.get(tuple(plain_name(self.names[i])[0] for i in at[1:4])) if self.names else None
        return Layout(form, cells, kind, columns.euler_order, self._line, stated, frame)

    def _number(self, column: str | int, width: int) -> int:
        """The number of a column that is named."""
        if isinstance(column, int):
            if column >= width:
                raise self._error(f"has no column {column}", f"Its rows have the columns 0 to {width - 1}.")
            return column
        places = [i for i, name in enumerate(self.names) if column.strip() in (name, name.lstrip("#% "))]
        if len(places) == 1:
            return places[0]
        if places:
            raise self._error(f"has {len(places)} columns named '{column}'", "Give each column a name of its own.")
        if not self.names:
            raise self._error(f"has no header with the name '{column}'", "Write a first line with the names of the "
                              "columns, or give their numbers from 0.")
        near = did_you_mean(column, self.names)
        raise self._error(f"has no column '{column}'", near or f"Its columns are: {', '.join(self.names)}.")

    def _unit(self, columns: Columns, at: int) -> tuple[str, bool]:
        """Unit of the times, and whether it is stated."""
        named = plain_name(self.names[at])[1] if self.names else None
        if named and columns.time_unit not in (None, named):
            raise self._error(f"column '{self.names[at]}' is in {named} by its name, in {columns.time_unit} by "
                              "columns.time_unit", "Leave one of them out.")
        unit = columns.time_unit or named
        return unit or "s", unit is not None

    def _check_order(self, columns: Sequence[str | int], letters: str, key: str) -> None:
        """Refuse names whose last letters say another order than the key asks for."""
        if not all(isinstance(column, str) for column in columns):
            return
        last = "".join(plain_name(str(column))[0][-1:] for column in columns)
        if last != letters and sorted(last) == sorted(letters):
            raise self._error(f"columns.{key} is {', '.join(letters)}, but its names say {', '.join(last)}",
                              "Name the columns in that order.")

    def _check_angles(self, kind: str, columns: Sequence[str | int]) -> None:
        """Refuse angles whose names say another unit."""
        named = " ".join(column.lower() for column in columns if isinstance(column, str))
        for key, other, word in (("euler", "euler_deg", "deg|°"), ("euler_deg", "euler", "rad")):
            if kind == key and re.search(word, named):
                raise self._error(f"columns.{key} is in {'radians' if kind == 'euler' else 'degrees'}, but its names "
                                  f"say otherwise: {named}", f"Name them in columns.{other}.")

    def _unclear(self, problem: str) -> InputError:
        return self._error(f"has {problem}; its columns are: {', '.join(self.names)}",
                           "Say which hold what in trajectory.columns: {time: t_ns, position: [x, y, z], quaternion: "
                           "[qw, qx, qy, qz]}.")

    def _error(self, problem: str, remedy: str) -> InputError:
        return InputError(problem, file=self.path, line=self._line, key=self.key, remedy=remedy)

    @property
    def _line(self) -> int | None:
        """Number of the line of the header."""
        return self.header.number if self.header else None
