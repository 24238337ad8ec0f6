"""Coordinate reference systems, as far as a sea floor needs them: degrees or lengths, their units, and which way is up.

They are told by keys of GeoTIFF (OGC 19-008r4), which LAS files have, too, and by well-known text (OGC 01-009 and
18-010r7).
"""

import bisect
import math
import re
from collections.abc import Iterator
from functools import cache
from importlib import resources

from varos_warp.scene.geometry.survey.content import Reference, Request
from varos_warp.scene.headers import FOOT, US_FOOT

UNITS = {"m": 1.0, "ft": FOOT, "us_ft": US_FOOT}
"""Metres in a unit of scene files."""
EPSG_UNITS = {9001: 1.0, 9002: FOOT, 9003: US_FOOT, 9014: 6 * FOOT, 9036: 1000.0}
"""Metres in a unit of length by its EPSG code."""
DEPTHS = (
    5336,
    5612,
    5614,
    5706,
    5715,
    5734,
    5739,
    5789,
    5831,
    *range(5861, 5868),
    5873,
    *range(6357, 6360),
    7976,
    8051,
    8053,
    8358,
    9287,
    9288,
    9672,
    10150,
    10151,
    10349,
    10364,
    *range(10370, 10380),
    *range(10547, 10553),
    10649,
    10650,
    10678,
)
"""EPSG codes of vertical systems that count downwards."""
MERCATORS = (3857, 3785, 3395, 900913, 102100, 102113, 54004)
"""Codes of Mercator projections whose scale is that of the equator, of EPSG, Google and Esri."""
MERCATOR_NAMES = tuple(f"EPSG:{code}" for code in MERCATORS)
MERCATOR = re.compile(r"(pseudo|web|world)[ _-]?mercator|mercator[ _-]auxiliary[ _-]sphere|google[ _-]maps", re.I)
"""Pattern of the names that these projections have elsewhere."""
EARTH_M = 6378137.0
"""Radius of the sphere of web maps."""
SOME_ZONE = "EPSG:32632 for UTM zone 32 north, or another zone"


def refuse_degrees(request: Request, name: str, middle: tuple[float, float] | None = None):
    """Refuse longitudes and latitudes, and tell the UTM zone of the middle, if that is known and there is one."""
    target = (middle and _utm(*middle)) or SOME_ZONE
    raise request.error(f"its coordinates are degrees ({name}), which are no lengths", _project(request, target))


def refuse_mercator(request: Request, name: str, middle: tuple[float, float] | None):
    """Refuse a Mercator projection whose scale is that of the equator, and tell by how much it is wrong in the middle.

    On a sphere of radius R a metre of ground at y = R arsinh(tan(latitude)) is cosh(y / R) = 1 / cos(latitude) long.
    """
    by, target = "", SOME_ZONE
    if middle is not None and abs(middle[1]) < 4.0 * EARTH_M and abs(middle[0]) <= math.pi * EARTH_M:
        latitude = math.degrees(math.atan(math.sinh(middle[1] / EARTH_M)))
        by = f": {math.cosh(middle[1] / EARTH_M):.3g} times too long at its latitude of {latitude:.1f} degrees"
        target = _utm(math.degrees(middle[0] / EARTH_M), latitude) or target
    raise request.error(
        f"its coordinates are in the Mercator projection of maps ({name}), which are no lengths on the ground{by}",
        _project(request, target),
    )


def _utm(longitude: float, latitude: float) -> str | None:
    """The UTM zone of a place in words, if there is one."""
    if not (abs(longitude) <= 180.0 and abs(latitude) <= 84.0):
        return None
    zone = min(int((longitude + 180.0) // 6.0) + 1, 60)
    side = "south" if latitude < 0.0 else "north"
    return f"EPSG:{(32700 if side == 'south' else 32600) + zone} for UTM zone {zone} {side}"


def _project(request: Request, target: str) -> str:
    code = target.partition(" ")[0]
    return (
        f"Project it to metres, {target}: gdalwarp -t_srs {code} {request.path.name} utm.tif for grids, pdal or "
        "QGIS for points."
    )


# ----------------------------------------------------------------------------------------------------- keys of GeoTIFF


def of_geokeys(keys: dict[int, object], request: Request, middle: tuple[float, float] | None) -> Reference:
    """Tell what the keys of a GeoTIFF or LAS file say.

    Args:
        keys: Values by the number of the key: ints, floats and texts.
        middle: x, y of the middle of the file, in its own axes.

    Raises:
        InputError: The coordinates are degrees, or geocentric.
    """
    model, code = keys.get(1024), keys.get(3072)
    name = next((str(keys[key]) for key in (3073, 1026, 2049) if keys.get(key)), None)
    known = isinstance(code, int) and 1024 <= code < 32767
    if model == 2 or (model is None and code is None and 2048 in keys):
        refuse_degrees(request, f"EPSG:{keys[2048]}" if 2048 in keys else name or "a geographic system", middle)
    if model == 3:
        raise request.error("its coordinates are geocentric", "Project it to metres, to a zone of UTM for example.")
    if code in MERCATORS or MERCATOR.search(name or ""):
        refuse_mercator(request, f"EPSG:{code}" if known else name or str(code), middle)
    unit, unknown = _unit(keys, 3076, 3077, 3072)
    height, unknown_height = _unit(keys, 4099, None, 4096)
    if unknown and not known and name:
        unknown = name
    down = keys.get(4096) in DEPTHS or _is_depth(str(keys.get(4097, "")))
    return Reference(f"EPSG:{code}" if known else name, unit, height, down, unknown, unknown_height)


def _is_depth(name: str) -> bool:
    return re.search(r"\bdepths?\b", name.lower()) is not None


def _unit(keys, key, size_key, system_key) -> tuple[float | None, str | None]:
    """The metres in the unit that a key names, else in that of the system, and what is named if unknown."""
    code, system = keys.get(key), keys.get(system_key)
    if code is None:
        if system is None:
            return None, None
        unit = unit_of_system(system)
        return unit, None if unit else f"EPSG:{system}"
    if code == 32767 and isinstance(keys.get(size_key), float):
        return keys[size_key], None
    return EPSG_UNITS.get(code), None if code in EPSG_UNITS else f"the unit EPSG:{code}"


def unit_of_system(code: object) -> float | None:
    """The metres in a unit of a projected or vertical system by its EPSG code; None if it is not known."""
    if not isinstance(code, int):
        return None
    first, last, metres = _systems()
    place = bisect.bisect_right(first, code) - 1
    return metres[place] if place >= 0 and code <= last[place] else None


@cache
def _systems() -> tuple[list[float], list[float], list[float]]:
    """The first and last codes of runs of systems, and the metres in their unit."""
    text = (resources.files("varos_warp") / "data" / "epsg_units.csv").read_text(encoding="utf-8")
    rows = [list(map(float, line.split(","))) for line in text.splitlines()[3:]]
    first, last, metres = zip(*rows, strict=True)
    return list(first), list(last), list(metres)


def geokeys(directory, doubles, text: str) -> dict[int, object]:
    """The values of the keys of a GeoKeyDirectory, its numbers and its text, without what is damaged."""
    keys: dict[int, object] = {}
    for key, place, count, value in zip(*[iter(directory[4:])] * 4, strict=False):
        if place == 0:
            keys[key] = int(value)
        elif place == 34736 and value < len(doubles):
            keys[key] = float(doubles[value])
        elif place == 34737:
            keys[key] = text[value : value + count].rstrip("|\0 ")
    return keys


# ----------------------------------------------------------------------------------------------------- well-known text

TOKEN = re.compile(r'([A-Za-z_]\w*)\s*[\[(]|"((?:[^"]|"")*)"|([\])])|([^\s,\[\]()"]+)')
MOST_TEXT = 100_000
"""Letters of a description that are looked at."""


class Node:
    """``NAME[...]`` of a well-known text: its name in capitals, texts and numbers as texts, and nodes inside."""

    def __init__(self, name: str):
        self.name, self.values, self.nodes = name.upper(), [], []

    def find(self, *names: str) -> Iterator["Node"]:
        """Yield the nodes of these names, outside in."""
        waiting = [self]
        for node in waiting:  # which grows on the way
            if node.name in names:
                yield node
            waiting += node.nodes

    def inside(self, *names: str) -> list["Node"]:
        """The nodes of these names right inside this one."""
        return [node for node in self.nodes if node.name in names]


def parse_wkt(text: str) -> Node:
    """A node around a well-known text; brackets that are not closed end with the text."""
    root = Node("")
    stack = [root]
    for match in TOKEN.finditer(text[:MOST_TEXT]):
        opened, quoted, closed, plain = match.groups()
        if opened:
            stack[-1].nodes.append(Node(opened))
            stack.append(stack[-1].nodes[-1])
        elif closed:
            if len(stack) > 1:
                stack.pop()
        elif quoted is not None or plain is not None:
            stack[-1].values.append(quoted if quoted is not None else plain)
    return root


def of_wkt(text: str, request: Request, middle: tuple[float, float] | None) -> Reference:
    """Tell what a well-known text says of coordinates.

    Raises:
        InputError: The coordinates are degrees, or geocentric.
    """
    root = parse_wkt(text)
    projected = next(root.find("PROJCS", "PROJCRS", "PROJECTEDCRS"), None)
    local = next(root.find("LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"), None)
    if projected is None and local is None:
        if geographic := next(root.find("GEOGCS", "GEOGCRS", "GEOGRAPHICCRS"), None):
            refuse_degrees(request, (geographic.values or ["a geographic system"])[0], middle)
        if next(root.find("GEOCCS", "GEODCRS", "GEODETICCRS"), None):
            raise request.error(
                "its coordinates are geocentric or degrees", "Project it to metres, to a zone of UTM for example."
            )
        return Reference(unknown_unit="its projection is of no kind that is known")
    system = projected or local
    method = " ".join(node.values[0] for node in system.find("PROJECTION", "METHOD") if node.values)
    if (name := _name_of_node(system)) in MERCATOR_NAMES or MERCATOR.search(f"{system.values[:1]} {method}"):
        refuse_mercator(request, name or method, middle)
    unit, unknown = _unit_of_node(system)
    vertical = next(root.find("VERT_CS", "VERTCS", "VERTCRS", "VERTICALCRS"), None)
    height, unknown_height = _unit_of_node(vertical) if vertical else (None, None)
    down = vertical is not None and (
        _is_depth(" ".join(vertical.values[:1]))
        or any(value.upper() == "DOWN" for axis in vertical.find("AXIS") for value in axis.values)
    )
    return Reference(_name_of_node(system), unit, height, down, unknown, unknown_height)


def _name_of_node(node: Node) -> str | None:
    """EPSG's number of a system, else its name."""
    for authority in node.inside("AUTHORITY", "ID"):
        if len(authority.values) >= 2 and authority.values[0].upper() == "EPSG":
            return f"EPSG:{authority.values[1]}"
    return node.values[0] if node.values else None


def _unit_of_node(node: Node) -> tuple[float | None, str | None]:
    """The metres in the unit of a system, and its name if that is no number."""
    units = node.inside("UNIT", "LENGTHUNIT") or [
        unit for axis in node.inside("AXIS") for unit in axis.inside("UNIT", "LENGTHUNIT")
    ]
    name = (node.values or ["its system"])[0]
    try:
        size = float(units[0].values[1])
    except (IndexError, ValueError):
        return None, name
    return (size, None) if 0.0 < size < 1e6 else (None, name)
