"""Points of text files: XYZ lists and tables (CSV, TSV), with or without a header."""

import re
import warnings

import numpy as np

from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.asc import reference_beside
from varos_warp.scene.geometry.survey.content import Cloud, Request
from varos_warp.scene.geometry.survey.crs import refuse_degrees

COMMENTS = ("#", "//", "%", "!")
NAMES = (
    ("x", "e", "east", "easting", "eastings", "x_m", "utm_x", "utm_e", "x_utm", "point_x", "x_coord", "xcoord"),
    ("y", "n", "north", "northing", "northings", "y_m", "utm_y", "utm_n", "y_utm", "point_y", "y_coord", "ycoord"),
    ("z", "h", "height", "elev", "elevation", "alt", "altitude", "z_m", "point_z", "z_coord", "zcoord", "depth",
     "depth_m"))
"""What columns of x, y and height are called."""
DEGREES = ("lon", "long", "longitude", "lat", "latitude")
FEET = re.compile(r"(?<![a-z])(ft|feet|foot|ftus|us_ft)(?![a-z])")
MOST_LINE = 100_000


class Table:
    """How the lines of a text file are divided into columns."""

    def __init__(self, request: Request):
        self.request, self.header, self.skip, self.delimiter, self.comma = request, None, 0, None, False
        with request.path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, line in enumerate(iter(lambda: file.readline(MOST_LINE), ""), 1):
                if not line.strip() or line.lstrip().startswith(COMMENTS):
                    continue
                if self.header is None and not _is_number(re.split(r"[\s,;]+", line.strip())[0]):
                    self.header, self.skip = line, number
                    continue
                self._divide(line.strip())
                return
        raise request.error("there are no points in it", "Give lines of x, y and height.")

    def _divide(self, line: str) -> None:
        """Find out what stands between numbers, and whether they have decimal commas, from the first line of them."""
        words = line.split()
        spaced = len(words) >= 3 and "," in line and all(_is_number(word.replace(",", ".")) for word in words[:3])
        self.delimiter = ";" if ";" in line else "\t" if "\t" in line else "," if "," in line and not spaced else None
        self.comma = self.delimiter != "," and "," in line
        if self.delimiter == "," and "." not in line and ", " in line and re.search(r"\d,\d", line):
            raise self.request.error("its commas may be decimal commas or stand between columns",
                                     "Write decimal points, or ; between columns.")

    def words(self, line: str) -> list[str]:
        """Return the columns of a line."""
        return [word.strip().strip('"\'') for word in line.strip().split(self.delimiter)]

    def lines(self, file):
        """Return the lines with numbers, with decimal points."""
        lines = (line for line in file if not line.lstrip().startswith(COMMENTS))
        return (line.replace(",", ".") for line in lines) if self.comma else lines


def _is_number(word: str) -> bool:
    try:
        float(word.strip('"').replace(",", "."))
    except ValueError:
        return False
    return True


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
    return Cloud(points, reference_beside(request, (middle[0], middle[1])), notes)


def _numbers(table: Table, columns: list[int]) -> np.ndarray:
    """Return the numbers of columns, [N, 3]."""
    request = table.request
    try:
        with (request.path.open(encoding="utf-8-sig", errors="replace") as file,
              warnings.catch_warnings(action="ignore", category=UserWarning)):  # of no lines
            for _ in range(table.skip):
                file.readline()
            return np.loadtxt(table.lines(file), delimiter=table.delimiter, usecols=columns, comments=None, ndmin=2,
                              quotechar='"')
    except (ValueError, IndexError, OverflowError) as error:
        where = f", counted from 0 after the header in line {table.skip}" if table.skip else ", counted from 0"
        raise request.error(f"a line cannot be read: {error}{where}", "Give numbers in all lines; those that begin "
                            "with # are passed over.") from error


def _columns(table: Table) -> list[int]:
    """Return the numbers, from 0, of the columns of x, y and height."""
    asked, request = table.request.asked.columns, table.request
    names = [word.lower() for word in table.words(table.header)] if table.header else []
    if names:
        _check_header(names, request)
    bare = [re.sub(r"[\[(].*", "", name).strip().replace(" ", "_") for name in names]
    if asked is not None:
        columns = [_column(column, i, names, bare, request) for i, column in enumerate(asked)]
    else:
        columns = _known_columns(table, bare) if names else [0, 1, 2]
    height = bare[columns[2]] if columns[2] < len(bare) else ""
    if height.startswith("depth") and request.asked.positive is None:
        raise request.error("its heights are called depth, which may grow up or down", "Give down if they are positive "
                            "below the surface, or up.", "positive")
    return columns


def _known_columns(table: Table, bare: list[str]) -> list[int]:
    """Return the numbers, from 0, of the columns whose names tell that they are x, y and height."""
    found = [[i for i, name in enumerate(bare) if name in known] for known in NAMES]
    if any(len(places) != 1 for places in found):
        raise table.request.error(
            f"its header '{table.header.strip()[:80]}' does not tell which columns are x, y and height",
            "Name them or give their numbers from 1, such as [x, y, z] or [1, 2, 3].", "columns")
    return [places[0] for places in found]


def _check_header(names: list[str], request: Request) -> None:
    """Refuse columns of degrees, and of feet where the unit is not given."""
    if request.asked.columns is None and (degrees := [name for name in names if re.split(r"\W", name)[0] in DEGREES]):
        refuse_degrees(request, f"a column is called {degrees[0]}")
    feet = [name for name in names if FEET.search(name)]
    if feet and request.asked.unit is None and request.asked.height_unit is None:
        raise request.error(f"a column is called {feet[0]}", "Give the unit of the file: m, ft or us_ft.", "unit")


def _column(column, i, names, bare, request) -> int:
    """Return the number, from 0, of a column that the block names."""
    if isinstance(column, int):
        return column - 1
    for known in (names, bare):
        if known.count(column.lower()) == 1:
            return known.index(column.lower())
    there = f"there are: {', '.join(names)}" if names else "it has no header"
    raise request.error(f"no column of the file is called so ({there})",
                        "Give a name of its header, or a number from 1.", f"columns.{i}", column)
