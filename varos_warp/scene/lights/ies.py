"""IES LM-63, the format in which makers of lamps publish intensities: its text, as numbers with their meaning.

All editions (1986, 1991, 1995, 2002 and 2019) have, after a line ``TILT=``, the same numbers in the same order, divided
by blanks, commas and line ends wherever these stand. What the numbers mean for a lamp is in goniometry.py.
"""

import codecs
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import read_bytes, with_line_feeds

KINDS = {1: "C", 2: "B", 3: "A"}
"""Types of photometry, by their numbers."""
UNITS_M = {1: 0.3048, 2: 1.0}
"""Metres in a foot and in a metre, by the numbers of the units."""
EDITIONS = re.compile(r"IES(?:NA)?\s*:?\s*(?:LM-63-)?((?:19|20)?\d\d)\b", re.IGNORECASE)
"""The first line of a file since 1991: IESNA91, IESNA:LM-63-1995, IESNA:LM-63-2002, IES:LM-63-2019."""
TILT = re.compile(r"^[ \t]*TILT[ \t]*=[ \t]*(\S*)(.*)$", re.IGNORECASE | re.MULTILINE)
"""The line ahead of the numbers. The same word within a line belongs to what a keyword says."""
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MARKS = ((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
"""First bytes of files that are not in one byte a letter, and their encodings."""
AFTER_ALL = "\x00\x1a \t\n"
"""Bytes that may stand behind the text: blanks, and those with which programs of old ended files."""


@dataclass(frozen=True)
class IesFile:
    """The facts that a file gives of a lamp."""

    edition: str
    """Year of the edition of LM-63: 1986, 1991, 1995, 2002 or 2019."""
    kind: str
    """Type of photometry: C, B or A."""
    vertical: np.ndarray
    """Vertical angles [degrees], as they stand in the file."""
    horizontal: np.ndarray
    """Horizontal angles [degrees], as they stand in the file."""
    candela: np.ndarray
    """Intensities [horizontal, vertical], 0 or more, of any scale."""
    opening_m: tuple[float, float, float] | None
    """Width, length and height of the luminous opening [m]; a negative one is a diameter. None: in no known unit."""
    tilted: bool = False
    """True if the file tells how the output changes as the lamp is tilted."""


def read_ies(path: Path, key: str) -> IesFile:
    """Read a file; whether its angles are those of a lamp is not looked at.

    Raises:
        InputError: The file is missing, or is no IES LM-63, or its tilt is in another file.
    """
    text = _decoded(read_bytes(path, "IES file", "Paths are relative to the scene file.", key))
    return _Reader(path, key).read(text)


def _decoded(data: bytes) -> str:
    """The text: in UTF-8 or UTF-16 where it is marked so, else one byte a letter; all that counts is in ASCII."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            return with_line_feeds(data.decode(encoding, "replace")).rstrip(AFTER_ALL)
    data = data.removeprefix(codecs.BOM_UTF8)
    return with_line_feeds(data.decode("latin-1")).rstrip(AFTER_ALL)


def _edition(text: str) -> str:
    """The edition by the first line; the first edition has none."""
    found = EDITIONS.match(text.lstrip())
    if found is None:
        return "1986"
    return found[1] if len(found[1]) == 4 else f"19{found[1]}"


class _Reader:
    """Takes the numbers of a file one after the other."""

    def __init__(self, path: Path, key: str):
        self.path, self.key = path, key
        self.words: list[tuple[int, str]] = []
        """The numbers that are left, the next one last, each with its line."""

    def wrong(
        self,
        problem: str,
        remedy: str = "Export it anew as IES LM-63, or as CSV (docs/lamps.md).",
        line: int | None = None,
    ) -> InputError:
        """The error that says what is the matter with the file."""
        return InputError(problem, file=self.path, key=self.key, line=line, remedy=remedy)

    def read(self, text: str) -> IesFile:
        """All data of a file's text."""
        tilt = TILT.search(text)
        if tilt is None:
            raise self.wrong("is no IES LM-63: it has no line TILT=NONE or TILT=INCLUDE")
        first = text.count("\n", 0, tilt.start()) + 1
        after = [tilt[2], *text[tilt.end() + 1 :].split("\n")]
        self.words = [(first + i, word) for i, line in enumerate(after) for word in re.split(r"[\s,]+", line) if word]
        self.words.reverse()
        tilted = self.skip_tilt(tilt[1].upper(), f"{tilt[1]}{tilt[2]}".strip(), first)
        self.take(2, "the number of lamps and their lumens")
        self.positive("the candela multiplier")
        vertical, horizontal = self.count("vertical angles", 2), self.count("horizontal angles", 1)
        kind, unit = self.kind(), UNITS_M.get(self.take(1, "the unit of lengths")[0])
        opening = self.take(3, "the luminous opening")
        self.positive("the ballast factor")
        self.take(2, "the ballast-lamp factor and the input power")
        angles = self.take(vertical, "the vertical angles"), self.take(horizontal, "the horizontal angles")
        candela = self.take(vertical * horizontal, "the intensities").reshape(horizontal, vertical)
        if self.words:
            raise self.wrong(
                f"has {len(self.words)} more numbers than {horizontal} times {vertical} intensities",
                line=self.words[-1][0],
            )
        if candela.min() < 0.0 or not candela.any():
            raise self.wrong("its intensities are not 0 or more, with one above")
        return IesFile(_edition(text), kind, *angles, candela, unit and tuple((unit * opening).tolist()), tilted)

    def skip_tilt(self, how: str, named: str, line: int) -> bool:
        """Step over the factors of a lamp that stands askew, if any: they scale its output, not where it shines."""
        if how == "INCLUDE":
            self.take(1, "the lamp's place in the luminaire")
            self.take(2 * self.count("angles of tilt", 0), "the angles and factors of tilt")
        elif how != "NONE":
            raise self.wrong(
                f"its factors of tilt are in another file: TILT={named}",
                line=line,
                remedy=("They do not change where the lamp shines: write TILT=NONE there."),
            )
        return how == "INCLUDE"

    def take(self, count: int, what: str) -> np.ndarray:
        """The next numbers, float64 [count]."""
        if count > len(self.words):
            raise self.wrong(f"ends within {what}: {count} are announced, {len(self.words)} are there")
        taken = [self.words.pop() for _ in range(count)]
        for line, word in taken:
            if not NUMBER.fullmatch(word) or not np.isfinite(float(word)):
                raise self.wrong(f"{what}: {word[:20]!r} is not a number", line=line)
        return np.array([float(word) for _, word in taken])

    def positive(self, what: str) -> None:
        """Step over a factor, which must be above 0: the scale of the intensities does not count."""
        line = self.words[-1][0] if self.words else None
        if (value := self.take(1, what)[0]) <= 0.0:
            raise self.wrong(f"{what} is {value:g}, so it has no light", line=line)

    def count(self, what: str, least: int) -> int:
        """The next number, a count."""
        line = self.words[-1][0] if self.words else None
        value = self.take(1, f"the number of {what}")[0]
        if value != int(value) or value < least:
            raise self.wrong(f"the number of {what} is {value:g}", line=line)
        return int(value)

    def kind(self) -> str:
        """The next number, as the type of photometry that it stands for."""
        line = self.words[-1][0] if self.words else None
        value = self.take(1, "the type of photometry")[0]
        if value not in KINDS:
            raise self.wrong(f"the type of photometry is {value:g}; there are 1 (C), 2 (B) and 3 (A)", line=line)
        return KINDS[value]
