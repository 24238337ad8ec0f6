"""Calibration files as plain data with the places of their entries: YAML, JSON, and OpenCV's XML."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

import yaml

from varos_warp.errors import InputError
from varos_warp.files import read_text
from varos_warp.scene import plain_yaml

MOST_NUMBERS = 1000
"""Largest count of numbers in an entry that is a list; a matrix of intrinsics has nine."""
DEEPEST = 20
"""Largest depth of elements within elements of an XML file."""


class _Loader(plain_yaml.PlainLoader):
    """Knows OpenCV's tags: matrices are blocks of rows and cols, or sizes, and dt and data."""

    def plain(self, _suffix: str, node: yaml.Node) -> Any:
        """What a node is without its tag."""
        if isinstance(node, yaml.MappingNode):
            return self.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return self.construct_sequence(node, deep=True)
        return self.construct_scalar(node)


_Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", _Loader.plain)


@dataclass(frozen=True)
class Entry:
    """A value in a calibration file, and where it stands."""

    value: Any
    file: Path
    key: str = ""
    line: int | None = None
    lines: Any = None
    """Line of every key in the file, by its path; None where lines are not known."""
    path: tuple = ()
    """Keys that lead to the entry."""

    def refuse(self, problem: str, remedy: str | None = None) -> NoReturn:
        """Raise an `InputError` about it."""
        simple = isinstance(self.value, str | int | float) and len(str(self.value)) < 60
        raise InputError(
            problem,
            file=self.file,
            line=self.line,
            key=self.key or None,
            value=self.value if simple else None,
            remedy=remedy,
        )

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, dict) and name in self.value

    def __getitem__(self, name: str) -> "Entry":
        path = (*self.path, name)
        line = (self.lines or {}).get(path)
        return Entry(self.value[name], self.file, ".".join(map(str, path)), line, self.lines, path)

    def items(self) -> Iterator[tuple[str, "Entry"]]:
        """The entries of a block by name; nothing if the value is no block."""
        for name in self.value if isinstance(self.value, dict) else ():
            yield str(name), self[name]

    def need(self, name: str) -> "Entry":
        """The entry of a name, which must be there."""
        if name not in self:
            self.refuse(f"has no {name}")
        return self[name]

    def text(self) -> str:
        """The value as a word, without the quotes that XML leaves."""
        if not isinstance(self.value, str):
            self.refuse("should be text")
        return self.value.strip('"')

    def whole(self) -> int:
        """The value as a whole number."""
        number = self._number(self.value)
        if number != int(number):
            self.refuse("should be a whole number")
        return int(number)

    def numbers(self) -> tuple[float, ...]:
        """The numbers of a list, a list of rows, or a matrix."""
        rows, value = None, self.value
        if isinstance(value, dict):
            value, rows = self.need("data").value, self._size()
        value = value if isinstance(value, list) else [] if value is None else [value]
        flat = [number for row in value[:MOST_NUMBERS] for number in (row if isinstance(row, list) else [row])]
        if len(value) > MOST_NUMBERS or len(flat) > MOST_NUMBERS:
            self.refuse(f"has more than {MOST_NUMBERS} numbers")
        if rows is not None and rows != len(flat):
            self.refuse(f"has {len(flat)} numbers, but rows x cols is {rows}")
        return tuple(map(self._number, flat))

    def _size(self) -> int:
        """Numbers that a matrix has by its rows and columns, or sizes."""
        if "dt" in self and self["dt"].text() not in tuple("ucwsifdh"):
            self["dt"].refuse("is a matrix of several channels, or of no numbers")
        if "sizes" in self:
            return math.prod(map(int, self["sizes"].numbers()))
        return self.need("rows").whole() * self.need("cols").whole()

    def _number(self, value: Any) -> float:
        try:
            number = float(value) if not isinstance(value, bool | dict | list | None) else math.nan
        except (ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            self.refuse(
                "should be a finite number" if value is self.value else f"has {value!r}, which is no finite number"
            )
        return number


def read_document(file: Path) -> Entry:
    """All of a calibration file.

    Raises:
        InputError: It is not there, is neither YAML, JSON nor XML, or gives a key twice.
    """
    text = read_text(file, "calibration file", "Give the path of a calibration file, relative to the scene file.")
    if text.lstrip().startswith("<"):
        return Entry(_xml(text, file), file)
    # OpenCV's first line is no YAML, and `rostopic echo` ends each message as if another followed
    text = re.sub(r"\A\s*%YAML:1\.0[^\n]*", "", text)
    text = re.sub(r"\n---\s*\Z", "\n", text)
    data, lines = plain_yaml.read(text, file, _Loader)
    return Entry(data, file, lines=lines)


def _xml(text: str, file: Path) -> Any:
    """The data that OpenCV stored; a document type and entities are refused, so nothing can grow or be fetched."""
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise InputError(
            "declares a document type or entities, which no calibration needs",
            file=file,
            remedy="Remove the declarations.",
        )
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(f"is not valid XML: {error}", file=file, remedy="Write it anew.") from None
    return _element(root, (), file)


def _element(element: ElementTree.Element, path: tuple, file: Path) -> Any:
    """A block of what an element holds; without elements, its one word, or a list of them."""
    if len(path) > DEEPEST:
        raise InputError(f"more than {DEEPEST} elements within elements", file=file)
    children = list(element)
    if not children:
        words = (element.text or "").split()
        if (text := (element.text or "").strip()).startswith('"'):
            return text
        return words[0] if len(words) == 1 else words
    if all(child.tag == "_" for child in children):  # items of a sequence
        return [_element(child, (*path, child.tag), file) for child in children]
    found: dict[str, Any] = {}
    for child in children:
        if child.tag in found:
            raise InputError("is given twice", file=file, key=".".join((*path, child.tag)), remedy="Keep one.")
        found[child.tag] = _element(child, (*path, child.tag), file)
    return found
