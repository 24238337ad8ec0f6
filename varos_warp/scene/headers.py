"""Headers of tables from elsewhere: names of columns, and the units that they end with.

A unit stands in brackets (``x [mm]``, ``t(s)``) or behind a sign (``x_mm``, ``time/s``, ``x..mm.`` as R writes it).
"""

import csv
import re
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

FOOT, US_FOOT = 0.3048, 1200.0 / 3937.0
LENGTHS = {
    **dict.fromkeys(("m", "metre", "meter", "metres", "meters"), 1.0),
    **dict.fromkeys(("ft", "foot", "feet", "international foot"), FOOT),
    **dict.fromkeys(("us survey foot", "us_ft", "us-ft", "ftus", "foot_us"), US_FOOT),
    **dict.fromkeys(("in", "inch", "inches"), FOOT / 12),
    **dict.fromkeys(("yd", "yard", "yards"), 3 * FOOT),
    **dict.fromkeys(("fathom", "fathoms", "ftm"), 6 * FOOT),
    **dict.fromkeys(("dm", "decimetre", "decimeter", "decimetres", "decimeters"), 0.1),
    **dict.fromkeys(("cm", "centimetre", "centimeter", "centimetres", "centimeters"), 0.01),
    **dict.fromkeys(("mm", "millimetre", "millimeter", "millimetres", "millimeters"), 0.001),
    **dict.fromkeys(("km", "kilometre", "kilometer", "kilometres", "kilometers"), 1000.0),
    **dict.fromkeys(("nmi", "nautical mile", "nautical miles"), 1852.0),
}
"""Metres in a unit of length by its name."""
NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1, "min": 60 * 10**9, "h": 3600 * 10**9, "d": 86400 * 10**9}
"""Nanoseconds in a unit of time."""
TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "\xb5s", "\u03bcs", "micros", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), "min"),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), "h"),
    **dict.fromkeys(("d", "day", "days"), "d"),
}
"""Units of time, of `NANOSECONDS`, by their names."""
ANGLES: dict[str, tuple[str, float]] = {
    **dict.fromkeys(("rad", "rads", "radian", "radians"), ("rad", 1.0)),
    "mrad": ("rad", 1e-3),
    **dict.fromkeys(("deg", "degs", "degree", "degrees", "\xb0", "\xba"), ("deg", 1.0)),
    "cdeg": ("deg", 0.01),
    **dict.fromkeys(("gon", "gradian", "gradians"), ("deg", 0.9)),
}
"""Units of angle by their names: radians or degrees, and how many of them a unit is."""
UNITS: dict[str, object] = {**LENGTHS, **TIMES, **ANGLES}
"""All units by their names, with what tells them apart."""
GEOGRAPHIC = {"lon", "long", "longitude", "lat", "latitude", "lng"}
"""Words in the names of coordinates that are angles."""
NOT_BEHIND_A_SIGN = ("in",)
"""Names of units that are rather something else behind a sign."""
UNSURE = {*"in m s h hr hrs d us min mins foot second minute minutes hour hours day days".split()}
"""Names of units that are other words, too: units only in brackets, or where a text says that one follows."""
NO_UNIT = {"", "-", "1", "none", "unitless", "dimensionless"}
"""What stands in a row of units for a column that has none."""
UNIT_FOLLOWS = re.compile(r"([\[(]|\bin |\bunits?\b[^.;]{0,40}[ :=,])\s*$")
"""What stands before a unit."""
RATE = re.compile(r"\s*(/\s*(s|sec|ms|min|h)\b|per\b|\^|\*\*)")
"""What makes a unit a part of another, of speeds for example."""
OF_TIMES = re.compile(r"\b(t|time|times|timestamps?|stamps?|since)\b|\btime_")
LONG_TIMES = {"min", "mins", "minute", "minutes", "hour", "hours", "hr", "hrs", "day", "days"}
"""Units of time that a text about times probably means."""
PARTED = re.compile(r"\b(milli|centi|deci|kilo|micro|nano)[ -]+(?=met|sec)", re.IGNORECASE)
"""What stands apart from its unit."""
WORD = re.compile(r"[^\W\d_]+|[\xb0\xba]")
GLUED = re.compile(
    r"([tpq]?[xyz]|t|time|(time)?stamp|pos|position|north(ing)?|east(ing)?|down|up|depth|height"
    r"|elev(ation)?|alt(itude)?)(?P<unit>mm|cm|dm|km|ft|feet|ms|us|ns|msec|usec|nsec)"
)
"""A usual name with a unit at its end and no sign between."""
MARKS = "#%!/; \t"
"""What a remark begins with."""
LIKE_NAMES = re.compile(r"[,;\t_\[(]")
"""What names of columns have in them or between them, and plain words mostly not."""
SEPARATOR_LINE = re.compile(r"\"?sep=.?\"?", re.IGNORECASE)
"""A first line that tells spreadsheets what stands between cells."""
LONGEST_REMARK = 20_000
"""Letters of a remark beyond which it names no columns."""
NAME = re.compile(r'"[^"]*"|\'[^\']*\'|[^\s\[({]+(?:\s*[\[({][^\])}]{0,40}[\])}])?\S*|\S+')
"""A name where blanks stand between them, with the unit in brackets behind it."""


class Name(NamedTuple):
    """The name of a column, and what it says of its unit."""

    base: str
    """The name in small letters, without the unit."""
    unit: str | None = None
    """One of those that were looked for; None: the name has none."""
    unknown: str | None = None
    """What stands in brackets in its place; None: nothing does."""


def parse_name(text: str, units: Mapping[str, object]) -> Name:
    """The parts of a column's name, where its unit would be one of ``units``."""
    text = text.strip().lstrip("#%").strip().lower()
    if bracketed := re.search(r"^([^\[({]*)[\[({]([^\])}]*)", text):
        base, inside = _up_to_a_letter(bracketed[1]), bracketed[2].strip()
        return Name(base, inside) if inside in units else Name(base, None, inside or None)
    whole = _up_to_a_letter(text)
    start = len(whole)
    while start and whole[start - 1].isalnum():
        start -= 1
    base, unit = _up_to_a_letter(whole[:start]), whole[start:]
    if unit == "ft" and base[-3:] in ("_us", " us", "-us"):
        base, unit = _up_to_a_letter(base[:-3]), "us_ft"
    if base and unit in units and unit not in NOT_BEHIND_A_SIGN:
        return Name(base, unit)
    return Name(text)


class Said(NamedTuple):
    """A unit that a text names."""

    word: str
    """Name of the unit, one of `UNITS`."""
    is_doubtful: bool
    """True if it may mean something else, as behind a number: ``accurate to 5 mm``."""


def units_said(text: str) -> list[Said]:
    """Units that a remark, or the name of a column, has anywhere; those of speeds and the like are left out."""
    found = []
    text = PARTED.sub(r"\1", text[:LONGEST_REMARK])
    for match in WORD.finditer(text):
        before, word = text[max(0, match.start() - 60) : match.start()], match[0].lower()
        glued = GLUED.fullmatch(word)
        word = glued["unit"] if glued else word
        if word not in UNITS or RATE.match(text, match.end()):
            continue
        doubtful = bool(re.search(r"\d\s*$", before))
        if not glued and not _is_surely_a_unit(match[0], before.lower(), text[match.end() : match.end() + 60].lower()):
            if word not in LONG_TIMES or not OF_TIMES.search(text.lower()):
                continue
            doubtful = True
        found.append(Said(word, doubtful))
    return found


def other_units(
    text: str, is_used: Callable[[Said], bool], is_near: Callable[[Said], bool] | None = None
) -> Iterator[tuple[Said, bool]]:
    """Units that a remark says and that are not used, each with whether it surely means that numbers are in it.

    It may not where the unit is doubtful, or stands beside one of its kind that is used, or nearly that (``is_near``).
    """
    said = units_said(text)
    for one in said:
        if not is_used(one):
            kind = next(units for units in (LENGTHS, TIMES, ANGLES) if one.word in units)
            beside = any((is_near or is_used)(other) for other in said if other.word in kind)
            yield one, not (one.is_doubtful or beside)


def _is_surely_a_unit(word: str, before: str, behind: str) -> bool:
    """Return whether the name of a unit is that, and no other word, by what stands around it."""
    short, word, known = word.isupper() and len(word) == 2, word.lower(), word
    if word not in UNSURE and not short:
        return True
    if before[-1:] in ("[", "(") and behind[:1] in ("]", ")"):
        return True
    if word == "in":
        return bool(re.search(r"\bunits?\b[ :=]*$", before)) and not behind.strip(" .;")
    if word == "us" and (known == "US" or re.match(r"[ _-]*(survey|ft|feet|foot)", behind)):
        return False
    return bool(
        UNIT_FOLLOWS.search(before)
        or (short and before[-1:] == "_")
        or (word in TIMES and re.search(r"\b(t|time|stamp|timestamp)/$", before))
    )


def hidden_unit(name: str, units: Mapping[str, object]) -> str | None:
    """A unit that stands elsewhere in a column's name than at its end, as in ``x_mm_ned``; None: there is none."""
    if parse_name(name, units).unit:
        return None
    words = [said.word for said in units_said(name.lower())]
    words += {"us", "min", "minutes", "hours"} & {*WORD.findall(name.lower())}  # in a text they are other words, too
    return next((word for word in words if word in units), None)


def with_unit(name: str, unit: str) -> str | None:
    """A column's name with the unit that a row of units gives it; None: the name has another."""
    own = parse_name(name, UNITS)
    if not unit or (own.unit and UNITS[own.unit] == UNITS[unit]):
        return name
    if own.unknown or own.unit:
        return name if own.unknown else None
    return f"{name.partition('[')[0].partition('(')[0].strip()} [{unit}]"


def units_in_remark(text: str, width: int, separator: str | None) -> list[str]:
    """Units of the columns of a table, where a remark has one for each and nothing else; "" for those without.

    Args:
        text: The remark with its mark.
        width: Columns of the table.
        separator: What stands between its cells.
    """
    for cells in _parted(text, width, separator):
        units = [cell.strip("[]() ").lower() for cell in cells]
        if all(unit in UNITS or unit in NO_UNIT for unit in units) and any(unit in UNITS for unit in units):
            return ["" if unit in NO_UNIT else unit for unit in units]
    return []


def is_geographic(name: str) -> bool:
    """Return whether a column holds longitudes or latitudes, or other angles, by its name or its unit."""
    parts = parse_name(name, ANGLES)
    return bool(parts.unit or GEOGRAPHIC & {parts.unknown, *re.split(r"[\W_\d]+", parts.base)})


def _up_to_a_letter(text: str) -> str:
    """A text without signs at its end; no pattern, which would take long for as many signs as some files have."""
    end = len(text)
    while end and not text[end - 1].isalnum():
        end -= 1
    return text[:end]


def split_names(text: str, separator: str | None) -> list[str]:
    """The names in a header that has this between them; None: blanks, but for those before a unit in brackets."""
    if separator is None:
        names = [match[0] for match in NAME.finditer(text)]
    else:
        try:
            names = next(csv.reader([text], delimiter=separator), [])
        except csv.Error:
            names = text.split(separator)
        names = names[:-1] if names and not names[-1].strip() else names  # what a last separator parts is nothing
    return [name.strip().strip("\"'").strip() for name in names]


def names_in_remark(text: str, width: int, separator: str | None) -> Iterator[list[str]]:
    """All that a remark may name the columns of a table as: as many names as it has, none of them a number.

    Args:
        text: The remark with its mark; a word with a colon before the names counts as none.
        width: Columns of the table.
        separator: What stands between its cells; names may have another between them.
    """
    for names in _parted(text, width, separator):
        if not any(map(is_number, names)):
            yield names


def _parted(text: str, width: int, separator: str | None) -> Iterator[list[str]]:
    """All ways to part a remark into as many cells as a table has columns."""
    if len(text) > LONGEST_REMARK:
        return
    text = text.strip().lstrip(MARKS)
    without = re.sub(r"^[^:\[(,;\t]{1,40}:\s*", "", text)
    for words in dict.fromkeys((text, without)):
        for between in dict.fromkeys((separator, ",", ";", "\t", None)):
            if between is not None and between not in words:
                continue
            cells = split_names(words, between)
            if len(cells) == width:
                yield cells


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, or stands for one that is missing."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
