"""Points of text files: XYZ lists and tables (CSV, TSV), with or without a header."""

import re
import warnings
from dataclasses import replace

import numpy as np

from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.asc import reference_beside
from varos_warp.scene.geometry.survey.content import Cloud, Reference, Request
from varos_warp.scene.geometry.survey.crs import refuse_degrees
from varos_warp.scene.headers import (
    ANGLES,
    LENGTHS,
    LIKE_NAMES,
    MARKS,
    SEPARATOR_LINE,
    Name,
    Said,
    hidden_unit,
    is_geographic,
    is_number,
    names_in_remark,
    other_units,
    parse_name,
    split_names,
    units_in_remark,
    units_said,
    with_unit,
)

COMMENTS = ("#", "//", "%", "!")
NAMES = (
    ("x", "e", "east", "easting", "eastings", "utm_x", "utm_e", "x_utm", "point_x", "x_coord", "xcoord"),
    ("y", "n", "north", "northing", "northings", "utm_y", "utm_n", "y_utm", "point_y", "y_coord", "ycoord"),
    ("z", "h", "height", "elev", "elevation", "alt", "altitude", "point_z", "z_coord", "zcoord", "depth"),
)
"""What columns of x, y and height are called, without their units."""
FEET = re.compile(r"(?<![a-z])(ft|feet|foot|ftus|us_ft)(?![a-z])")
MISSING = ("", "na", "n/a", "null", "none", "nodata")
"""What a cell without a height holds, besides NaN."""
MOST_LINE = 100_000
ROWS_LOOKED_AT = 100
"""Rows whose first cells tell whether they are names of rows."""
MOST_REMARKS = 100
"""Remarks above the points that are looked at for names, the last ones."""


class Table:
    """How the lines of a text file are divided into columns, and what these are called."""

    def __init__(self, request: Request):
        self.request, self.header, self.skip, self.delimiter, self.comma = request, None, 0, None, False
        self.remarks: list[tuple[int, str]] = []
        self.units: list[str] = []
        with request.path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, line in enumerate(iter(lambda: file.readline(MOST_LINE), ""), 1):
                if line.lstrip().startswith(COMMENTS):
                    self.remarks = [*self.remarks[1 - MOST_REMARKS :], (number, line)]
                elif not line.strip():
                    continue
                elif number == 1 and SEPARATOR_LINE.fullmatch(line.strip()):
                    self.skip = 1
                elif self.header is None and not _is_number(next(filter(None, re.split(r"[\s,;]+", line)), "")):
                    self.header, self.skip = line, number
                else:
                    line = line.strip(" \r\n")  # a tab may end an empty cell
                    self._divide(line)
                    self.width = len(self.words(line))
                    self._read_remarks()
                    self.names = self._names_of_header(line, file) if self.header else self._names_of(self.remarks)
                    return
        raise request.error("there are no points in it", "Give lines of x, y and height.")

    def _divide(self, line: str) -> None:
        """Find out what stands between numbers, and whether they have decimal commas, from the first line of them."""
        words = line.split()
        spaced = len(words) >= 3 and "," in line and all(_is_number(word.replace(",", ".")) for word in words[:3])
        self.delimiter = ";" if ";" in line else "\t" if "\t" in line else "," if "," in line and not spaced else None
        self.comma = self.delimiter != "," and "," in line
        if self.delimiter == "," and "." not in line and ", " in line and re.search(r"\d,\d", line):
            raise self.request.error(
                "its commas may be decimal commas or stand between columns",
                "Write decimal points, or ; between columns.",
            )

    def _read_remarks(self) -> None:
        """Take the units of the columns from the last remark that has a row of them."""
        for place, (_, remark) in reversed([*enumerate(self.remarks)]):
            if units := units_in_remark(remark.strip().lstrip(MARKS), self.width, self.delimiter):
                self.units = units
                del self.remarks[place]
                return

    def called(self, i: int) -> str:
        """The name of a column, with its unit where a row of units has one."""
        name = self.names[i] if self.names else f"column {i + 1}"
        if (named := with_unit(name, self.units[i] if self.units else "")) is None:
            raise self.request.error(
                f"column '{name}' is in '{self.units[i]}' by a remark", "Leave one of the two out."
            )
        return named

    def _names_of_header(self, line: str, file) -> list[str]:
        """Names of the columns by the header; where rows have one cell more, the first is R's name of the row."""
        header = (self.header or "").strip(" \r\n")
        names = split_names(header, self.delimiter)
        if len(names) == self.width and not names[0] and not any(map(is_number, names)):
            return names  # the first has none, as pandas writes it
        for names in names_in_remark(header, self.width, self.delimiter):
            return names
        names, cells = split_names(header, self.delimiter), line.split(self.delimiter)
        if len(names) == self.width - 1:
            if not cells[-1].strip():
                self.width -= 1  # what a last separator parts is nothing
                return names
            if self._are_names_of_rows([line, *(file.readline(MOST_LINE) for _ in range(ROWS_LOOKED_AT))]):
                return ["", *names]
        asked = self.request.asked.columns
        if asked is not None and all(isinstance(column, int) for column in asked):
            return []
        raise self.request.error(
            f"its header '{header[:80]}' does not name {self.width} columns, as many as the rows have",
            "Give the numbers of the columns from 1, such as [1, 2, 3].",
            "columns",
        )

    def _are_names_of_rows(self, lines: list[str]) -> bool:
        """Return whether first cells are names of rows, as R writes them: quoted, or words, or 1, 2, 3 and so on."""
        cells = [
            line.strip(" \r\n").split(self.delimiter)[0].strip()
            for line in lines
            if line.strip() and not line.lstrip().startswith(COMMENTS)
        ]
        counted = all(cell == str(i) for i, cell in enumerate(cells, 1))
        return counted or all(re.fullmatch(r"\".*\"|'.*'|[^\W\d]\S*", cell) for cell in cells)

    def _names_of(self, remarks: list[tuple[int, str]]) -> list[str]:
        """Names of the columns by the last remark that tells which are x, y and height; empty where none does."""
        asked = self.request.asked.columns
        wanted = [column.lower() for column in asked or () if isinstance(column, str)]
        found: tuple[int, list[str]] | None = None
        for place, (_, remark) in reversed([*enumerate(remarks)]):
            for names in names_in_remark(remark, self.width, self.delimiter):
                bare = _bare(names)
                if (wanted and {*wanted} <= {*bare, *map(str.lower, names)}) or (
                    not wanted and (None not in _places(bare) or any(map(is_geographic, names)))
                ):
                    del remarks[place]
                    return names
                found = found or (place, names)
        if found and asked is not None and not wanted:  # numbers of columns: as many names are theirs
            if LIKE_NAMES.search(remarks[found[0]][1]):
                del remarks[found[0]]
            return found[1]
        for _, remark in reversed(remarks if asked is None else ()):
            words = re.split(r"[\s,;]+", remark.strip().lstrip(MARKS))
            places = [place for name in _bare(words) for place, known in enumerate(NAMES) if name in known]
            if len({*places}) == 3 and places[:3] != [0, 1, 2]:
                raise self.request.error(
                    f"the remark '{remark.strip()[:80]}' may name its columns, which are not x, y "
                    "and height in this order",
                    "Give their numbers from 1, such as [2, 1, 3].",
                    "columns",
                )
        return []

    def words(self, line: str) -> list[str]:
        """The columns of a line."""
        cells = line.strip(" \r\n").split(self.delimiter)
        return [word.strip().strip("\"'") for word in cells]

    def lines(self, file):
        """The lines with numbers, with decimal points.

        Raises:
            ValueError: A line has more or fewer separators than the first.
        """
        for line in file:
            if not line.strip() or line.lstrip().startswith(COMMENTS):
                continue
            if self.delimiter and '"' not in line:
                count = line.count(self.delimiter) + 1
                if count != self.width and not (
                    abs(count - self.width) == 1 and line.rstrip(" \r\n").endswith(self.delimiter)
                ):
                    raise ValueError(f"the line '{line.strip()[:60]}' has {count} columns, the first {self.width}")
            yield line.replace(",", ".") if self.comma else line


def _is_number(word: str) -> bool:
    """Return whether a word is a number, for which quotes and a decimal comma are allowed."""
    return is_number(word.strip('"').replace(",", "."))


def _bare(names: list[str]) -> list[str]:
    """Names in small letters without their units."""
    return [parse_name(name, LENGTHS).base.replace(" ", "_") for name in names]


def _places(bare: list[str]) -> list[int | None]:
    """Numbers, from 0, of the columns of x, y and height; None for one that is not there, or more than once."""
    found = [[i for i, name in enumerate(bare) if name in known] for known in NAMES]
    return [places[0] if len(places) == 1 else None for places in found]


def read_points(request: Request) -> Cloud:
    """Read the points of a text file; those without a height are left out.

    Raises:
        InputError: A line is not made of numbers, or the columns of x, y and height are not known.
    """
    table = Table(request)
    columns = _columns(table)
    with request.path.open("rb") as file:
        count = sum(block.count(b"\n") for block in iter(lambda: file.read(1 << 20), b""))
    check_limit("HEIGHTS", count, file=request.path, key=f"{request.key}.file")
    points = _numbers(table, columns)
    nodata = request.asked.nodata
    none = ~np.isfinite(points).all(axis=1) | (False if nodata is None else points[:, 2] == nodata)
    notes = [f"{none.sum()} of its {len(points)} points have no height"] * bool(none.any())
    points = points[~none]
    if len(points) == 0:
        raise request.error("there are no points in it", "Give lines of x, y and height.")
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    reference = reference_beside(request, (middle[0], middle[1]))
    reference = _with_units_of_header(reference, table, columns)
    return Cloud(points, reference, [*notes, *_checked_remarks(reference, table, columns, middle)])


def _checked_remarks(reference: Reference, table: Table, columns: list[int], middle: np.ndarray) -> list[str]:
    """Notes of what remarks say of units that is not followed."""
    asked, request = table.request.asked, table.request
    stated = all(parse_name(table.called(i), LENGTHS).unit for i in columns) or asked.unit is not None
    in_part = asked.height_unit is not None or asked.height_scale is not None
    may_be_degrees = abs(middle[0]) <= 360.0 and abs(middle[1]) <= 90.0 and reference.name is None
    unit = reference.unit_m or 1.0
    used, notes = [unit, reference.height_unit_m or unit], []

    def fits(one: Said, share: float) -> bool:
        return one.word in LENGTHS and np.allclose(used, LENGTHS[one.word], rtol=share)

    for number, remark in table.remarks:
        where = f"line {number}, '{remark.strip()[:60]}', may say that its numbers are in "
        words = {*re.split(r"[\W\d_]+", remark.lower())}
        degrees = ["degrees"] * bool(words & {"lon", "lng", "longitude"} and words & {"lat", "latitude"})
        degrees += [one.word for one in units_said(remark) if one.word in ANGLES and not one.is_doubtful]
        if degrees and may_be_degrees and not stated:
            raise request.error(
                f"{where}{degrees[0]}",
                "Project degrees to metres; or if x and y are lengths, give their unit: m, ft or us_ft.",
                "unit",
            )
        for one, surely in other_units(remark, lambda one: fits(one, 1e-8), lambda one: fits(one, 1e-5)):
            if stated or one.word not in LENGTHS:
                continue
            if surely and not in_part:
                raise request.error(
                    f"{where}{one.word}, which is not followed",
                    "Give the unit of the file, m, ft or "
                    "us_ft, and height_scale if heights have another; or write it behind the names of "
                    "the columns: x [mm].",
                    "unit",
                )
            notes.append(f"{where}{one.word}, which is not followed; unit: and height_scale: state it")
    return [*dict.fromkeys(notes)]


def _with_units_of_header(reference: Reference, table: Table, columns: list[int]) -> Reference:
    """The reference with the units that the names of the columns end with, which say more than a system."""
    if not (table.names or table.units) or max(columns) >= table.width:
        return reference
    request, named = table.request, [table.called(i) for i in columns]
    x, y, z = (_with_hidden_unit(name) for name in named)
    unknown, unknown_height = next(filter(None, (x.unknown, y.unknown)), None), z.unknown
    sizes = {LENGTHS[axis.unit] for axis in (x, y) if axis.unit}
    if reference.unit_m is not None and sizes:
        sizes.add(reference.unit_m)
    if len(sizes) > 1 and request.asked.unit is None:
        raise request.error(
            f"the units of {named[0]} and {named[1]} are not the same, or not that of the .prj file",
            "Give the unit of the file: m, ft or us_ft.",
            "unit",
        )
    if z.unit and LENGTHS[z.unit] != 1.0 and request.asked.height_scale and request.asked.height_unit is None:
        raise request.error(
            f"the heights are in {z.unit} by the name of their column, {named[2]}, and would be scaled besides",
            "Leave it out, or give height_unit.",
            "height_scale",
            request.asked.height_scale,
        )
    if sizes:
        reference = replace(reference, unit_m=sizes.pop(), unknown_unit=None)
    if z.unit:
        reference = replace(reference, height_unit_m=LENGTHS[z.unit], unknown_height_unit=None)
    return replace(
        reference,
        unknown_unit=(unknown and f"a column has '{unknown}'") or reference.unknown_unit,
        unknown_height_unit=(unknown_height and f"{named[2]} has '{unknown_height}'") or reference.unknown_height_unit,
    )


def _with_hidden_unit(name: str) -> Name:
    """The parts of a name, where a unit that stands before its end counts as one that is not known, but metres."""
    parts = parse_name(name, LENGTHS)
    hidden = None if parts.unknown else hidden_unit(name, LENGTHS)
    if hidden and LENGTHS[hidden] == 1.0:
        return parts._replace(unit=hidden)
    return parts._replace(unknown=parts.unknown or hidden)


def _numbers(table: Table, columns: list[int]) -> np.ndarray:
    """The numbers of columns, [N, 3]; NaN for heights that are missing."""
    request = table.request
    try:
        try:
            return _loaded(table, columns, None)
        except ValueError:  # perhaps of an empty cell; readers in Python are ten times slower
            return _loaded(table, columns, {columns[2]: _height})
    except (ValueError, IndexError, OverflowError) as error:
        raise request.error(
            f"a line cannot be read: {error} (rows count from 0 after the header)",
            "Give numbers in all lines; those that begin with # are passed over.",
        ) from error


def _height(cell: str) -> float:
    return np.nan if cell.strip().strip('"').lower() in MISSING else float(cell)


def _loaded(table: Table, columns: list[int], converters) -> np.ndarray:
    with (
        table.request.path.open(encoding="utf-8-sig", errors="replace") as file,
        warnings.catch_warnings(action="ignore", category=UserWarning),
    ):  # of no lines
        for _ in range(table.skip):
            file.readline()
        return np.loadtxt(
            table.lines(file),
            delimiter=table.delimiter,
            usecols=columns,
            comments=None,
            ndmin=2,
            quotechar='"',
            converters=converters,
        )


def _columns(table: Table) -> list[int]:
    """The numbers, from 0, of the columns of x, y and height."""
    asked, request = table.request.asked, table.request
    bare = _bare(table.names)
    if asked.columns is not None:
        columns = [_column(column, i, table.names, bare, request) for i, column in enumerate(asked.columns)]
    else:
        columns = _known_columns(table, bare) if table.names else [0, 1, 2]
    if not (table.names or table.units) or max(columns) >= table.width:
        return columns
    named = [table.called(i).lower() for i in columns]
    if degrees := [name for name in named[:2] if is_geographic(name)]:
        refuse_degrees(request, f"a column is called {degrees[0]}")
    if table.names and "depth" in bare[columns[2]] and asked.positive is None:
        raise request.error(
            "its heights are called depth, which may grow up or down",
            "Give down if they are positive below the surface, or up.",
            "positive",
        )
    if (feet := [name for name in named if FEET.search(name)]) and asked.unit is None and asked.height_unit is None:
        raise request.error(f"a column is called {feet[0]}", "Give the unit of the file: m, ft or us_ft.", "unit")
    return columns


def _known_columns(table: Table, bare: list[str]) -> list[int]:
    """The numbers, from 0, of the columns whose names tell that they are x, y and height."""
    places = [place for place in _places(bare) if place is not None]
    if len(places) == 3:
        return places
    if degrees := [name for name in table.names if is_geographic(name)]:
        refuse_degrees(table.request, f"a column is called {degrees[0].lower()}")
    raise table.request.error(
        f"its header '{', '.join(table.names)[:80]}' does not tell which columns are x, y and height",
        "Name them or give their numbers from 1, such as [x, y, z] or [1, 2, 3].",
        "columns",
    )


def _column(column, i, names, bare, request) -> int:
    """The number, from 0, of a column that the block names."""
    if isinstance(column, int):
        return column - 1
    for known in ([name.lower() for name in names], bare):
        if known.count(column.lower()) == 1:
            return known.index(column.lower())
    there = f"there are: {', '.join(names)}" if names else "it has no header"
    raise request.error(
        f"no column of the file is called so ({there})",
        "Give a name of its header, or a number from 1.",
        f"columns.{i}",
        column,
    )
