"""What the package tells its user: warnings, and errors that the command line prints as a single message.

Bad input ends it with status 2, images that could not be made with status 1.
"""

import contextlib
import difflib
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

PACKAGE = str(Path(__file__).parent)
PARTS = ("problem", "file", "key", "value", "remedy", "line")
"""What an `InputError` is made of."""


class InputError(ValueError):
    """Something the user gave cannot be used; says where it stands, what it is and how to mend it."""

    def __init__(
        self,
        problem: str,
        *,
        file: str | Path | None = None,
        key: str | None = None,
        value: Any = None,
        remedy: str | None = None,
        line: int | None = None,
    ):
        self.problem, self.file, self.key, self.value, self.remedy, self.line = problem, file, key, value, remedy, line
        super().__init__(self.message)

    def but(self, **parts: Any) -> "InputError":
        """This error with some other parts, by the names of the arguments."""
        return InputError(**{name: getattr(self, name) for name in PARTS} | parts)

    def at(self, key: str) -> "InputError":
        """This error with another key; with none if ``key`` is empty."""
        return self.but(key=key or None)

    @property
    def message(self) -> str:
        """``file:line: key = value: problem. Remedy.`` with the parts that are known."""
        where = ":".join(str(part) for part in (self.file, self.line) if part is not None)
        what = self.key if self.value is None else f"{self.key} = {self.value!r}" if self.key else repr(self.value)
        text = ": ".join(part for part in (where, what, self.problem) if part)
        return f"{text}. {self.remedy}" if self.remedy else text


@contextlib.contextmanager
def refused_as(made: Callable[[Exception], InputError]) -> Iterator[None]:
    """A ``with`` statement around a library that may raise anything on bad input: it becomes the error that is made."""
    try:
        yield
    except (InputError, MemoryError):
        raise
    except Exception as error:
        raise made(error) from error


def did_you_mean(word: str, known: Iterable[str]) -> str | None:
    """The remedy for a name that is not known, if one that is known is much like it."""
    names = list(known)
    near = same_name(word, names) or next(iter(difflib.get_close_matches(word, names, 1)), None)
    return f"Did you mean '{near}'?" if near else None


def require_known(name: str, known: Iterable[str], problem: str, near: bool = False, **where: Any) -> None:
    """Refuse a name that is none of those known; the remedy is all of them, or one that is much like it if ``near``.

    Raises:
        InputError: With the ``problem``, and ``where`` it is.
    """
    if name not in (names := list(known)):
        alike = did_you_mean(name, names) if near else None
        raise InputError(problem, value=name, remedy=alike or f"There are: {', '.join(names) or 'none'}.", **where)


def same_name(word: str, known: Iterable[str]) -> str | None:
    """The one of some names that differs by case, blanks, hyphens and underscores between letters at most."""

    def bare(name: str) -> str:
        return re.sub(r"(?<=\w)[\s_-]+(?=\w)", "", name).lower()

    return next((name for name in known if bare(name) == bare(word)), None)


def counted(count: float, name: str) -> str:
    """A number with what it counts: 1 frame, 2 frames."""
    return f"{count} {name}{'s' * (count != 1)}"


def duration(seconds: float) -> str:
    """A time in two digits, in the unit that suits it."""
    for limit, size, name in ((90, 1, "seconds"), (5400, 60, "minutes"), (1.8e5, 3600, "hours")):
        if seconds < limit:
            return f"{float(f'{seconds / size:.2g}'):g} {name}"
    return f"{float(f'{seconds / 86400:.2g}'):g} days"


def optional(name: str, what: str, extra: str, instead: str = "", **where: Any) -> ModuleType:
    """Import a package that comes with an extra; ``instead`` says what else would do, ``where`` is as of `InputError`.

    Raises:
        InputError: If it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        remedy = f'Install it with `pip install "varos_warp[{extra}]"`{instead}.'
        raise InputError(f"{what} is not installed", remedy=remedy, **where) from error


class RunFailed(RuntimeError):
    """Some images could not be made; all others are, and the same command tries again."""


def warn(message: str) -> None:
    """Warn, and point at the line that called the package, however deep inside it the reason was found."""
    frame, level = sys._getframe(), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, stacklevel=level)
