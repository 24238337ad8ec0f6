"""Lines of a table that may be large: a block at a time, with their numbers, and never much more than one in memory."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, TextIO

from varos_warp.errors import InputError
from varos_warp.files import require_file
from varos_warp.scene.headers import SEPARATOR_LINE

BLOCK = 1 << 22
"""Characters that are read at a time."""
LONGEST = 1 << 16
"""Characters of a line, beyond which a file is no table."""
REMEDY = "A recorded course is a text file in UTF-8 with a pose a line (docs/trajectories.md)."


class Row(NamedTuple):
    """A line that is neither empty nor a comment, or one that is a comment."""

    number: int
    text: str

    @property
    def is_comment(self) -> bool:
        """True if it begins with #, or is what spreadsheets write above a table, ``sep=;``."""
        return self.text.startswith("#") or (self.number == 1 and bool(SEPARATOR_LINE.fullmatch(self.text.strip())))


def rows_of(path: Path, key: str) -> Iterator[list[Row]]:
    """All rows and comments, in lists of some thousand; line ends may be those of any system.

    Raises:
        InputError: There is no such file, or it is no text with lines.
    """
    require_file(path, "course file", "Paths are relative to the scene file.", key)
    with _reading(path, key) as file:
        number, rest = 0, ""
        while block := file.read(BLOCK):
            *lines, rest = (rest + block).split("\n")
            if max(map(len, (*lines, rest))) > LONGEST:
                raise InputError(f"has a line of more than {LONGEST} characters", file=path, key=key, remedy=REMEDY)
            yield _rows(lines, number)
            number += len(lines)
        yield _rows([rest], number)


@contextmanager
def _reading(path: Path, key: str) -> Iterator[TextIO]:
    try:
        with path.open(encoding="utf-8-sig", newline=None) as file:
            yield file
    except UnicodeDecodeError:
        raise InputError("is not a text file in UTF-8", file=path, key=key, remedy=REMEDY) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path, key=key, remedy=REMEDY) from error


def _rows(lines: list[str], before: int) -> list[Row]:
    numbered = enumerate(lines, start=before + 1)
    return [Row(number, line.strip(" ")) for number, line in numbered if line.strip()]  # a tab may end an empty cell
