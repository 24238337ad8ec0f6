"""ESRI ASCII grids: a header of names and numbers, then rows of heights from north to south."""

import contextlib
import math

import numpy as np

from varos_warp.files import beside
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.survey.content import Raster, Reference, Request
from varos_warp.scene.geometry.survey.crs import MOST_TEXT, of_wkt, refuse_degrees
from varos_warp.scene.geometry.survey.pictures import to_heights
from varos_warp.scene.headers import LENGTHS, is_number

NAMES = ("ncols", "nrows", "xllcorner", "yllcorner", "xllcenter", "yllcenter", "cellsize", "dx", "dy", "nodata_value")
MOST_LINE = 1000


def read_asc(request: Request) -> Raster:
    """Read the heights of an ESRI ASCII grid, with the projection of the .prj file beside it.

    Raises:
        InputError: The header lacks something, or there are not as many heights as it says.
    """
    with request.path.open("rb") as file:
        header, start = _header(file, request)
        rows, columns = int(header["nrows"]), int(header["ncols"])
        check_limit("HEIGHTS", rows * columns, file=request.path, key=f"{request.key}.file")
        file.seek(start)
        values = _heights(file, rows * columns)
        more = bool(file.read(64).strip())
    if values is None or values.size != rows * columns or more:
        what = (
            "not all can be read"
            if values is None
            else "more follow"
            if values.size == rows * columns
            else f"{values.size} are there"
        )
        raise request.error(
            f"its header says {rows} x {columns} heights, but {what}",
            "The file may be cut off, or have decimal commas; export it again.",
        )
    T = _transform(header, rows, request)
    middle = tuple(T @ (0.5 * (columns - 1), 0.5 * (rows - 1), 1.0))
    heights = to_heights(values.reshape(rows, columns), header.get("nodata_value", -9999.0), request, measured=True)
    return Raster(heights, T, reference_beside(request, middle))


def _heights(file, count: int) -> np.ndarray | None:
    """Read up to ``count`` numbers; fewer, or None, where text is no number: older versions of NumPy stop there."""
    try:
        return np.fromfile(file, float, count, sep=" ")
    except ValueError:
        return None


def _header(file, request) -> tuple[dict[str, float], int]:
    """Names in small letters with their numbers, and where the heights begin."""
    header: dict[str, float] = {}
    start = 0
    for line in iter(lambda: file.readline(MOST_LINE), b""):
        words = line.decode("latin-1").removeprefix("\xef\xbb\xbf").split()
        if words and (not words[0][:1].isalpha() or is_number(words[0])):  # nan is one
            break
        start = file.tell()
        if not words:
            continue
        name = words[0].lower()
        try:
            header[name] = float(words[1].replace(",", "."))
        except (IndexError, ValueError):
            raise request.error(
                f"the line '{line[:40].decode('latin-1').strip()}' of its header is no name and number",
                "Give an ESRI ASCII grid.",
            ) from None
        if name not in NAMES:
            raise request.error(f"its header has '{words[0]}'", f"Known are {', '.join(NAMES)}.")
    _check_header(header, request)
    return header, start


def _check_header(header, request) -> None:
    """Refuse a header that lacks something or has numbers that are none."""
    needed = ["ncols", "nrows", *(() if "dx" in header and "dy" in header else ("cellsize",))]
    needed += [f"{axis}llcorner" for axis in "xy" if f"{axis}llcenter" not in header]
    missing = [name for name in needed if name not in header]
    if missing:
        raise request.error(f"its header lacks {', '.join(missing)}", "Give an ESRI ASCII grid.")
    for name in ("ncols", "nrows"):
        if not (1.0 <= header[name] < 1e9 and header[name].is_integer()):
            raise request.error(f"its {name} is {header[name]:g}", "Give a whole number of at least 2.")
    sizes = [header[name] for name in ("dx", "dy", "cellsize") if name in header]
    if not (
        all(size > 0.0 for size in sizes) and np.isfinite([v for k, v in header.items() if k != "nodata_value"]).all()
    ):
        raise request.error("a number of its header is not positive and finite", "Give an ESRI ASCII grid.")


def _transform(header, rows, request) -> np.ndarray:
    """The places of the nodes, the middles of the cells; the first row is the northernmost."""
    dx, dy = (header.get(name, header.get("cellsize")) for name in ("dx", "dy"))
    x, y = (
        header[f"{axis}llcenter"] if f"{axis}llcenter" in header else header[f"{axis}llcorner"] + 0.5 * size
        for axis, size in (("x", dx), ("y", dy))
    )
    return np.array([[dx, 0.0, x], [0.0, -dy, y + dy * (rows - 1)]])


def reference_beside(request: Request, middle: tuple[float, float] | None) -> Reference:
    """Tell what the .prj file beside a file says of its coordinates: well-known text, or ESRI's older lines.

    Raises:
        InputError: The coordinates are degrees.
    """
    path = beside(request.path, ".prj")
    if path is None:
        return Reference()
    with path.open("rb") as file:
        text = file.read(MOST_TEXT).decode("latin-1")
    if "[" in text or "(" in text:
        return of_wkt(text, request, middle)
    return _of_lines(text, path.name, request, middle)


def _of_lines(text: str, name: str, request: Request, middle: tuple[float, float] | None) -> Reference:
    """What the older lines of a .prj file called ``name`` say, each a word and its value (GDAL reads them, too)."""
    lines = [line.split(maxsplit=1) for line in text.splitlines() if len(line.split()) > 1]
    words = {word.lower(): value.strip() for word, value in lines}
    if words.get("projection", "").lower() == "geographic":
        refuse_degrees(request, f"{name} says so", middle)
    unit = words.get("units", "").lower()
    height = words.get("zunits", "no").lower()
    known, known_height = _metres(unit), _metres(height)
    said = None if known_height or height in ("no", "none") else f"{name} gives '{height}'"
    return Reference(
        words.get("projection", name),
        known,
        known_height,
        unknown_unit=None if known else f"{name} gives '{unit}'",
        unknown_height_unit=said,
    )


def _metres(unit: str) -> float | None:
    """Metres in a unit by its name, or by how many of it make a metre; None if it is not known."""
    with contextlib.suppress(ValueError):
        count = float(unit)
        return 1.0 / count if 0.0 < count < math.inf else None
    return LENGTHS.get(unit)
