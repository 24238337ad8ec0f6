"""Which columns of a table hold what: by its format, by usual names in its header, or as the scene file says.

TUM: https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats. EuRoC: https://projects.asl.ethz.ch/datasets.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from varos_warp.errors import InputError, did_you_mean
from varos_warp.scene.courses import meaning
from varos_warp.scene.courses.cells import Cells, separator_of
from varos_warp.scene.courses.lines import REMEDY, Row
from varos_warp.scene.courses.remarks import Remarks, Used
from varos_warp.scene.description.recorded import Columns
from varos_warp.scene.description.vehicle import Trajectory
from varos_warp.scene.headers import (
    ANGLES,
    LENGTHS,
    LIKE_NAMES,
    TIMES,
    hidden_unit,
    is_number,
    names_in_remark,
    parse_name,
    split_names,
    units_in_remark,
    with_unit,
)

Names = tuple[str, ...]
TIME_NAMES = ("t", "time", "timestamp", "stamp")
"""Names of columns of times, without their unit."""
POSITIONS: tuple[Names, ...] = tuple(
    tuple(name.replace("*", axis) for axis in "xyz")
    for name in ("*", "t*", "p*", "p_*", "pos_*", "position_*", "p_rs_r_*", "s_*_vw", "p_wv_*")
)
"""Names of the columns of positions, besides those that say which way they point (meaning.py)."""
QUATERNIONS: tuple[Names, ...] = tuple(
    tuple(name + part for part in "wxyz") for name in ("q", "q_", "q_rs_", "q_wv_", "quat_", "orientation_")
)
"""Names of the columns of quaternions."""
EULER: tuple[Names, ...] = (("theta_x_vw", "theta_y_vw", "theta_z_vw"),)
"""Names of the columns of angles [rad] about the fixed axes x, then y, then z."""
MATRIX: Names = ("r11", "r12", "r13", "r21", "r22", "r23", "r31", "r32", "r33")
"""Names of the columns of a rotation matrix."""
FORMATS = {
    "s_x_vw": ("poses of a dataset", None),
    "p_wv_x": ("states of a dataset", None),
    "p_rs_r_x": ("EuRoC", "ns"),
    "tx": ("TUM", "s"),
}
"""Formats that are known by the first name of their positions, and the unit of times whose name has none."""
ATTITUDE = "^q|quat|roll|pitch|yaw|heading|orient|euler"
"""What names of columns have that may be an attitude."""
TUM = Columns(time=1, time_unit="s", position=(2, 3, 4), quaternion=(8, 5, 6, 7))
TUM_COLUMNS = 8
KITTI_COLUMNS = 12


@dataclass(frozen=True)
class Layout:
    """What a table is, and where its numbers are."""

    format: str
    """Name of the format, in words."""
    cells: Cells
    """Its columns are those of the position, then those of the attitude."""
    attitude: str
    """What the columns of the attitude are: quaternion (w first), euler [rad], euler_deg, matrix or none."""
    euler_order: str
    header: int | None
    """Number of the line of its header."""
    unit_is_stated: bool
    """True if the file or the scene says in which unit the times are."""
    frame: str | None
    """World axes that the names of its columns tell; None: they tell none."""
    notes: tuple[str, ...] = ()
    """What may be wrong, in words."""

    @property
    def is_ours(self) -> bool:
        """True if it is a table of one of our own datasets, in our axes."""
        return self.format.endswith("of a dataset")


def layout_of(rows: Sequence[Row], path: Path, course: Trajectory, key: str) -> Layout:
    """What a table is by its first rows, comments among them.

    Raises:
        InputError: It is not known which columns hold what.
    """
    first = next((row for row in rows if not row.is_comment), None)
    if first is None:
        raise InputError("has no poses" if rows else "is empty", file=path, key=key, remedy=REMEDY)
    separator = separator_of(first.text)
    before = [row for row in rows if row.number < first.number]
    header, names = _header(before, first, separator, course.columns)
    width = len(names) if names else len(split_names(first.text, separator))
    is_sure = header is None or _names_columns(names, course.columns) or LIKE_NAMES.search(header.text)
    remarks = Remarks.of(before, header if is_sure else None, width, separator, path, key)
    finder = _Finder(path, key, names, header, course, remarks)
    if course.columns is not None:
        return finder.layout("table", course.columns, separator, width)
    if names:
        return finder.named(separator)
    if width == TUM_COLUMNS and separator in (None, "\t"):
        _check_tum(before, path, key)
        return _Finder(
            path, key, ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"], None, course, remarks
        ).layout("TUM", _without_unit(TUM, remarks), separator, width)
    what = (
        "are poses of KITTI, which have no times"
        if width == KITTI_COLUMNS and separator is None
        else "have no header that names the columns, and are not those of TUM: t x y z qx qy qz qw, with blanks between"
    )
    raise InputError(
        f"rows of {width} numbers {what}",
        file=path,
        line=first.number,
        key=key,
        remedy="Name the columns, in a first line or by their numbers from 1 in trajectory.columns.",
    )


def _without_unit(columns: Columns, remarks: Remarks) -> Columns:
    """The columns of a format, without its unit of time where a row of units has one."""
    return columns.model_copy(update={"time_unit": None}) if any(unit in TIMES for unit in remarks.units) else columns


def _header(
    before: Sequence[Row], first: Row, separator: str | None, columns: Columns | None
) -> tuple[Row | None, list[str]]:
    """The line that names the columns and their names, without #; none where there is no such line.

    That is the first row that is no remark, or the last remark above it that has a usual name for the time and for the
    position, or all names of ``columns``; or, where these are numbers, as many names as there are columns.
    """
    names = split_names(first.text, separator)
    if not any(map(is_number, names)):
        return first, names
    for row in reversed(before):
        for found in names_in_remark(row.text, len(names), separator):
            if _names_columns(found, columns):
                return row, found
    by_number = columns is not None and all(isinstance(column, int) for column in columns.all_of_them)
    for row in reversed(before if by_number else ()):
        for found in names_in_remark(row.text, len(names), separator):
            if not units_in_remark(row.text, len(names), separator):
                return row, found
    return None, []


def _names_columns(names: Sequence[str], columns: Columns | None) -> bool:
    """Return whether names are those of columns: usual ones, or all that the scene file has."""
    asked = [] if columns is None else [name for name in columns.all_of_them if isinstance(name, str)]
    if asked:
        return all(name.strip() in names for name in asked)
    lengths = [parse_name(name, LENGTHS).base for name in names]
    return any(parse_name(name, TIMES).base in TIME_NAMES for name in names) and bool(
        meaning.directions_of(names)
        or any(all(lengths.count(name) == 1 for name in position) for position in POSITIONS)
    )


def _check_tum(remarks: Sequence[Row], path: Path, key: str) -> None:
    """Refuse remarks that name the parts of quaternions in another order than TUM has them."""
    for row in remarks:
        if (order := meaning.order_of_quaternion(row.text)) not in (None, "xyzw"):
            raise InputError(
                f"this remark may say that quaternions are {', '.join(order or '')}, where those of TUM are x, y, z, w",
                file=path,
                line=row.number,
                key=key,
                remedy="Say which columns are which by their numbers from 1; trajectory.columns: {time: "
                "1, position: [2, 3, 4], quaternion: [5, 6, 7, 8]} has w first.",
            )


@dataclass(frozen=True)
class _Finder:
    """Finds columns by the names of a header."""

    path: Path
    key: str
    names: list[str]
    header: Row | None
    course: Trajectory
    remarks: Remarks

    def named(self, separator: str | None) -> Layout:
        """The layout by usual names."""
        times = [name for name in self.names if parse_name(name, TIMES).base in TIME_NAMES]
        lengths = [parse_name(name, LENGTHS).base for name in self.names]
        positions = [names for names in POSITIONS if {*names} <= {*lengths}]
        directed = meaning.directions_of(self.names)
        turns = [names for names in (*QUATERNIONS, *EULER, MATRIX) if {*names} <= {*lengths}]
        if not positions and not directed and (found := meaning.geographic_position(self.names)):
            raise self._error(*found)
        for what, count in (("the time", len(times)), ("a position", len(positions) + bool(directed))):
            if count != 1:
                raise self._unclear(f"{'several columns' if count else 'no column'} that may be {what}")
        usual = positions[0] if positions else ()
        if twice := [name for name in (*usual, *(turns or [()])[0]) if lengths.count(name) > 1]:
            raise self._error(
                f"has {lengths.count(twice[0])} columns named '{twice[0]}'", "Give each column a name of its own."
            )
        if len(turns) > 1:
            raise self._unclear("several attitudes")
        if not turns and (near := [name for name in self.names if re.search(ATTITUDE, name, re.IGNORECASE)]):
            raise self._unclear(f"what may be an attitude ({', '.join(near[:4])})")
        position, turn = (
            tuple(self.names[lengths.index(name)] for name in names) for names in (usual, (turns or [()])[0])
        )
        return self._of_names(times[0], usual[:1], position or directed, turn, separator)

    def _of_names(self, time: str, usual: Names, position: Names, turn: Names, separator: str | None) -> Layout:
        """The layout by the columns of these names; the first of those of the position tells the format."""
        form, unit = FORMATS.get("".join(usual), ("table", None))
        if form == "TUM" and separator not in (None, "\t"):
            form, unit = "table", None  # much like it, but what wrote it is another program
        named = self._called(self.names.index(time))
        unit = None if {*parse_name(named, TIMES)[1:]} != {None} else unit
        columns = Columns(
            time=time,
            time_unit=unit,
            position=position,
            quaternion=turn if len(turn) == 4 else None,
            euler=turn if len(turn) == 3 else None,
        )
        return self.layout(form, columns, separator, len(self.names), turn if len(turn) == len(MATRIX) else ())

    def layout(
        self, form: str, columns: Columns, separator: str | None, width: int, matrix: Sequence[str] = ()
    ) -> Layout:
        """The layout by columns of the scene file, by those of a format, or by those that were found."""
        given = (key for key in ("quaternion", "euler", "euler_deg") if getattr(columns, key) is not None)
        kind = "matrix" if matrix else next(given, "none")
        turn = tuple(matrix) or getattr(columns, kind, None) or ()
        wanted = [columns.time, *columns.position, *turn]
        at = [self._number(column, width) for column in wanted]
        if len({*at}) < len(at):
            twice = next(name for i, name in enumerate(wanted) if at.index(at[i]) < i)
            raise self._error(f"column {twice} is to hold two things", "Name each column once in trajectory.columns.")
        called = {i: self._called(i) for i in at}
        unit, stated = self._time_unit(columns, at[0])
        names = [called[i] for i in at[1:]]
        factors, frame = self._meaning(kind, names[:3], names[3:], columns)
        by_scene = self.course.columns
        used = Used(
            unit,
            bool(by_scene and by_scene.time_unit) or bool(parse_name(called[at[0]], TIMES).unit),
            factors[:3],
            bool(columns.position_unit) or all(parse_name(name, LENGTHS).unit for name in names[:3]),
            kind,
        )
        notes = (*self.remarks.checked(used), *self._doubts(names[:3], frame))
        cells = Cells(self.path, self.key, separator, width, at[0], unit, tuple(at[1:]), factors, called)
        return Layout(form, cells, kind, columns.euler_order, self._line, stated, frame, notes)

    def _doubts(self, position: list[str], frame: str | None) -> list[str]:
        """Say that a coordinate is taken for a depth because the others are north and east, in this order."""
        if self.course.frame is not None or frame != "ned" or meaning.ways_of(position)[2] == "down":
            return []
        return [
            f"'{position[2]}' is taken for a depth, for {position[0]} and {position[1]} before it are north and "
            "east; if it is a height, give trajectory.frame: enu and columns.position in the order east, north, up"
        ]

    def _called(self, i: int) -> str:
        """The name of a column, with its unit where a row of units has one."""
        name = self.names[i] if self.names else f"column {i + 1}"
        unit = self.remarks.units[i] if self.remarks.units else ""
        if (named := with_unit(name, unit)) is None:
            raise self._error(
                f"column '{name}' is in '{unit}' by the remark in line {self.remarks.line_of_units}",
                "Leave one of the two units out.",
            )
        return named

    def _meaning(
        self, kind: str, position: list[str], turn: list[str], columns: Columns
    ) -> tuple[tuple[float, ...], str | None]:
        """What numbers are multiplied by, and the frame that names tell."""
        if found := meaning.geographic_position(position):
            raise self._error(*found)
        self._check_order(position, "xyz", "position")
        frames = meaning.frames_told(position)
        if not frames or (self.course.frame and self.course.frame not in frames):
            frame = self.course.frame or "enu"
            right = meaning.directions_of(position)
            told = meaning.frames_told(right)[0] if right else "ned"
            named = "Name them in that order, or give another trajectory.frame"
            if right:
                named = f"Say position: [{', '.join(right)}] and trajectory.frame: {told}"
            raise self._error(
                f"columns of the position are {', '.join(position)}, but of frame {frame} they are "
                f"{', '.join(meaning.FRAMES[frame])}",
                f"{named}.",
            )
        if self.course.frame is None and (half := meaning.frame_is_half_told(position)):
            raise self._error(*half)
        factors = [self._length(name, columns.position_unit) for name in position]
        if kind == "quaternion":
            self._check_order(turn, "wxyz", "quaternion")
        if not kind.startswith("euler"):
            return (*factors, *[1.0] * len(turn)), frames[0] if len(frames) == 1 else None
        if found := meaning.order_of_angles(turn, columns.euler_order, self._body(frames)):
            raise self._error(*found)
        factors += [self._factor_of_angle(kind, name) for name in turn]
        return tuple(factors), frames[0] if len(frames) == 1 else None

    def _body(self, frames: list[str]) -> str | None:
        """Axes of the body whose angles a table has, as far as they are known here."""
        if self.course.of not in (None, "vehicle"):
            return None
        ned = "ned" in (self.course.frame, *frames[: len(frames) == 1])
        return self.course.body or ("frd" if ned else "flu")

    def _length(self, name: str, stated: str | None) -> float:
        """How many metres the unit of a column of the position is."""
        own = parse_name(name, LENGTHS)
        if stated is None:
            hidden = None if own.unknown else hidden_unit(name, LENGTHS)
            if hidden and LENGTHS[hidden] != 1.0:
                raise self._error(
                    f"column '{name}' may be in '{hidden}' by its name",
                    "State the unit in trajectory.columns.position_unit, or end its name with it: [mm].",
                )
            return self._factor(name, LENGTHS, "length")
        if own.unit and LENGTHS[own.unit] != LENGTHS[stated]:
            raise self._error(
                f"column '{name}' is in {own.unit} by its name, in {stated} by columns.position_unit",
                "Leave one of them out.",
            )
        return LENGTHS[stated]

    def _factor(self, name: str, units: Mapping[str, float], what: str) -> float:
        """How many metres, or the like, a unit of a column is."""
        found = parse_name(name, units)
        if found.unknown:
            raise self._error(
                f"column '{name}' is in '{found.unknown}', which is no unit of {what} that is known",
                "Write one of its unit in the header, such as [m], [cm] or [ft], or leave it out if it is the metre."
                if what == "length"
                else "Write [rad] or [deg].",
            )
        return units[found.unit] if found.unit else 1.0

    def _factor_of_angle(self, kind: str, name: str) -> float:
        """How many radians, or degrees, a unit of an angle's column is; refused where it is of the other kind."""
        said = "rad" if kind == "euler" else "deg"
        unit = parse_name(name, ANGLES).unit
        if (hidden := hidden_unit(name, ANGLES)) and ANGLES[hidden][1] != 1.0:
            raise self._error(f"column '{name}' may be in '{hidden}' by its name", f"End its name with it: [{hidden}].")
        within = (word for word, other in (("deg", "deg|°"), ("rad", "rad")) if re.search(other, name.lower()))
        family = ANGLES[unit][0] if unit else next(within, said)
        if family != said:
            units, other = ("radians", "euler_deg") if kind == "euler" else ("degrees", "euler")
            raise self._error(
                f"columns.{kind} is in {units}, but its names say otherwise: {name}", f"Name them in columns.{other}."
            )
        return self._factor(name, {word: size for word, (_, size) in ANGLES.items()}, "angle")

    def _number(self, column: str | int, width: int) -> int:
        """The number from 0 of a column that is named."""
        if isinstance(column, int):
            if column > width:
                raise self._error(f"has no column {column}", f"Its rows have the columns 1 to {width}.")
            return column - 1
        places = [i for i, name in enumerate(self.names) if column.strip() in (name, name.lstrip("#% "))]
        if len(places) == 1:
            return places[0]
        if places:
            raise self._error(f"has {len(places)} columns named '{column}'", "Give each column a name of its own.")
        if not self.names:
            raise self._error(
                f"has no header with the name '{column}'",
                "Write a first line with the names of the columns, or give their numbers from 1.",
            )
        near = did_you_mean(column, self.names)
        raise self._error(f"has no column '{column}'", near or f"Its columns are: {', '.join(self.names)}.")

    def _time_unit(self, columns: Columns, at: int) -> tuple[str, bool]:
        """Unit of the times, and whether it is stated."""
        name = self._called(at)
        self._check_one_time(name)
        found = parse_name(name, TIMES)
        if columns.time_unit is None and found.unknown:
            raise self._error(
                f"column '{name}' is in '{found.unknown}', which is no unit of time that is known",
                "State the unit in trajectory.columns.time_unit: s, ms, us, ns, min or h.",
            )
        if columns.time_unit is None and (hidden := hidden_unit(name, TIMES)) and TIMES[hidden] != "s":
            raise self._error(
                f"column '{name}' may be in '{hidden}' by its name",
                "State the unit in trajectory.columns.time_unit, or end its name with it: t [ms].",
            )
        named = TIMES[found.unit] if found.unit else None
        if named and columns.time_unit not in (None, named):
            raise self._error(
                f"column '{name}' is in {named} by its name, in {columns.time_unit} by columns.time_unit",
                "Leave one of them out.",
            )
        unit = columns.time_unit or named
        return unit or "s", unit is not None

    def _check_one_time(self, name: str) -> None:
        """Refuse whole seconds beside a column of the rest, as messages of ROS have them."""
        if not (seconds := re.fullmatch(r"(.*?)secs?", name.strip().lower())):
            return
        part = re.compile(re.escape(seconds[1]) + r"(n|nano|u|micro)secs?")
        if rest := next((other for other in self.names if part.fullmatch(other.strip().lower())), None):
            raise self._error(
                f"column '{name}' has whole seconds, and '{rest}' the rest of the time",
                "Write one column of times, such as t_ns = 1000000000 sec + nanosec.",
            )

    def _check_order(self, columns: Sequence[str], letters: str, key: str) -> None:
        """Refuse names whose last letters say another order than the key asks for."""
        last = "".join(parse_name(column, LENGTHS).base[-1:] for column in columns)
        if last != letters and sorted(last) == sorted(letters):
            raise self._error(
                f"columns.{key} is {', '.join(letters)}, but its names say {', '.join(last)}",
                "Name the columns in that order.",
            )

    def _unclear(self, problem: str) -> InputError:
        return self._error(
            f"has {problem}; its columns are: {', '.join(self.names)}",
            "Say which hold what in trajectory.columns: {time: t_ns, position: [x, y, z], quaternion: "
            "[qw, qx, qy, qz]}.",
        )

    def _error(self, problem: str, remedy: str) -> InputError:
        line = self._line or self.remarks.line_of_units
        return InputError(problem, file=self.path, line=line, key=self.key, remedy=remedy)

    @property
    def _line(self) -> int | None:
        """Number of the line of the header."""
        return self.header.number if self.header else None
