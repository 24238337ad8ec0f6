"""What the names of a table's columns say: which way an axis points, about which an angle turns, in which order."""

import re
from collections.abc import Sequence

from varos_warp.scene.headers import ANGLES, LENGTHS, is_geographic, parse_name

DIRECTIONS = {
    **dict.fromkeys(("e", "east", "easting", "eastings", "utm_e", "utm_east", "utm_easting"), "east"),
    **dict.fromkeys(("n", "north", "northing", "northings", "utm_n", "utm_north", "utm_northing"), "north"),
    **dict.fromkeys(("u", "up", "height", "elev", "elevation"), "up"),
    **dict.fromkeys(("d", "down", "depth"), "down"),
}
"""Which way a coordinate grows, by its name, by which a position is found, too.

Altitude is none: of vehicles in water it is that above the bottom."""
WAYS = {**{word: way for word, way in DIRECTIONS.items() if len(word) > 1}, "alt": "up", "altitude": "up"}
"""Which way a coordinate of a position grows, by a word of its name."""
FRAMES = {"enu": ("east", "north", "up"), "ned": ("north", "east", "down")}
"""Which way the axes of a frame point."""
TURNS = {"roll": "roll", "pitch": "pitch", "yaw": "yaw", "heading": "yaw", "hdg": "yaw", "azimuth": "yaw"}
"""Which of the three angles one is, by a word of its name."""
GREEK = {"phi": "roll", "theta": "pitch", "psi": "yaw"}
"""Which of the three angles one is, by the Greek letter that is its whole name."""
ABOUT = {"flu": {"roll": "x", "pitch": "y", "yaw": "z"}, "rfu": {"roll": "y", "pitch": "x", "yaw": "z"}}
ABOUT["frd"] = ABOUT["flu"]
"""About which axis of a body an angle turns."""

Found = tuple[str, str]
"""A problem and its remedy."""


def base(name: str) -> str:
    """A column's name in small letters, without a unit of length and without ``pos_``."""
    return re.sub(r"^(pos|position)[_ .]", "", parse_name(name, LENGTHS).base)


def ways_of(names: Sequence[str]) -> list[str | None]:
    """Which way each coordinate of a position grows, by the name of its column; None: that does not say."""
    return [_way(name) for name in names]


def _way(name: str) -> str | None:
    if way := DIRECTIONS.get(base(name)):
        return way
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name)
    words = [word for word in re.split(r"[\W\d_]+", parse_name(parted, LENGTHS).base) if word]
    ways = {WAYS[word] for word in words if word in WAYS}
    if len(ways) == 1:
        return ways.pop()
    letters = [word[-1] for word in words if re.fullmatch(r"[tp]?[xyz]", word)]
    frames = [word for word in words if word in FRAMES]
    if len(frames) == len(letters) == 1:
        return FRAMES[frames[0]]["xyz".index(letters[0])]
    short = re.fullmatch(r"(?:p|pos)_?([nedu])", "_".join(words))
    return DIRECTIONS[short[1]] if short else None


def frame_is_half_told(names: Sequence[str]) -> Found | None:
    """Say that names of a position tell by its depth alone that it is ned, not which columns are north and east."""
    ways = ways_of(names)
    if frames_told(names) != ["ned"] or ways[:2] == ["north", "east"]:
        return None
    down = next((name for name, way in zip(names, ways, strict=True) if way == "down"), names[2])
    return (
        f"its positions may be ned by '{down}', but {', '.join(names[:2])} do not both say whether they are north "
        "or east",
        "Say trajectory.frame: ned, and columns.position in the order north, east, down.",
    )


def frames_told(names: Sequence[str]) -> list[str]:
    """Frames whose axes point as the names of the columns of x, y and z say; both where they say nothing."""
    ways = ways_of(names)
    return [
        frame
        for frame, axes in FRAMES.items()
        if all(way in (None, axis) for way, axis in zip(ways, axes, strict=True))
    ]


def geographic_position(names: Sequence[str]) -> Found | None:
    """Say that columns hold longitudes or latitudes, if a name or its unit says so."""
    for name in names:
        if is_geographic(name):
            return (
                f"column '{name}' holds degrees, which are no lengths",
                "Project the course to metres, to a zone of UTM for example, and give trajectory.origin there.",
            )
    return None


def directions_of(names: Sequence[str]) -> tuple[str, ...]:
    """Which of a table's columns are a position by the ways that they point, in the order of a frame; or none."""
    ways: dict[str, list[str]] = {}
    for name in names:
        if way := DIRECTIONS.get(base(name)):
            ways.setdefault(way, []).append(name)
    fitting = [axes for axes in FRAMES.values() if all(len(ways.get(axis, ())) == 1 for axis in axes)]
    return tuple(ways[axis][0] for axis in fitting[0]) if len(fitting) == 1 else ()


def order_of_angles(names: Sequence[str], order: str, body: str | None) -> Found | None:
    """Say that names of three angles give another order than the axes that they turn about, if they do.

    Args:
        body: Axes of the body; None: what roll and pitch turn about is not known.
    """
    words = [re.split(r"[\W_]+", parse_name(name, ANGLES).base) for name in names]
    last = "".join(word[-1][-1:] for word in words)
    named = [
        GREEK.get("_".join(word)) or TURNS.get(next((part for part in word if part in TURNS), "")) for word in words
    ]
    if body is not None and any(named):
        about: list[str | None] = [ABOUT[body][name] if name else None for name in named]
    elif sorted(last) == ["x", "y", "z"]:
        about = [*last]
    else:
        return None
    if all(axis in (None, asked) for axis, asked in zip(about, order.lower(), strict=True)):
        return None
    said = "".join(axis or asked for axis, asked in zip(about, order.lower(), strict=True))
    where = f" of a body {body}" if body and any(named) else ""
    remedy = "Name them in the order in which they turn"
    if sorted(said) == ["x", "y", "z"]:
        remedy += (
            f"; if that is theirs, say euler_order: {said.upper()} about the body's own axes, or {said} about "
            "fixed ones"
        )
    return (
        f"columns.euler_order is {order}, but the angles are about {', '.join(said)}{where} by their names: "
        f"{', '.join(names)}",
        f"{remedy}.",
    )


def order_of_quaternion(remark: str) -> str | None:
    """The order of the four parts of a quaternion, such as wxyz, that a remark tells; None: it tells none."""
    text = remark.lower().replace("w.r.t", "")
    if re.search(r"\b(scalar|w)[ -]first\b", text):
        return "wxyz"
    parts = re.findall(r"(?<![a-z])q(?:uat)?[_. ]?([wxyz])(?![a-z])", text)
    if len(parts) < 4:
        parts = re.findall(r"(?<![a-z])([wxyz])(?![a-z])", text)
    if len(parts) < 4:
        parts = [*next(iter(re.findall(r"\b(wxyz|xyzw)\b", text)), "")]
    order = "".join(parts[-4:])
    return order if sorted(order) == ["w", "x", "y", "z"] else None
