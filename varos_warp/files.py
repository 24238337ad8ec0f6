"""Files that scenes and datasets name: whether they exist, and their text."""

import contextlib
import itertools
import os
from pathlib import Path

from varos_warp.errors import InputError, did_you_mean
from varos_warp.limits import check_limit

MOST_NAMES = 10_000
"""Most names in a folder that are searched for one like another."""


def is_file(path: Path) -> bool:
    """Return whether a path leads to a regular file; one with NUL, too long or in a loop of links leads nowhere."""
    try:
        return path.is_file()
    except (OSError, ValueError, RuntimeError):
        return False


def stamp_of(path: Path) -> tuple | None:
    """What differs when a file was saved; None where there is none."""
    with contextlib.suppress(OSError, ValueError):
        if is_file(path):
            state = path.stat()
            return state.st_mtime_ns, state.st_size, state.st_ino
    return None


def beside(path: Path, suffix: str) -> Path | None:
    """The file beside another that has its name with this suffix, in any of three cases of letters, or None."""
    made = (path.with_suffix(each) for each in (suffix, suffix.lower(), suffix.upper()))
    return next(filter(is_file, made), None)


def absolute(base: Path, name: str) -> Path:
    """Path of a file by its name, relative to a folder; loops of links and names that no file has stay as they are."""
    path = base / name
    try:
        return (base / path.expanduser()).resolve()
    except (OSError, ValueError, RuntimeError):
        return path


def require_file(path: Path, what: str, remedy: str, key: str | None = None) -> None:
    """Refuse a path at which there is no file.

    Args:
        path: Where it should be.
        what: Its kind, for the message.
        remedy: What to do, for the message.
        key: The key that names it.
    """
    if not is_file(path):
        problem = f"there is no such {what}" + (": this is a folder" if os.path.isdir(path) else "")
        raise InputError(problem, file=path, key=key, remedy=like_it(path) or remedy)


def like_it(path: Path) -> str | None:
    """Remedy for a file that is not there: for a backslash in its name, or if one beside it has a name much like it."""
    if os.sep == "/" and "\\" in str(path):  # a backslash is a character of the name here
        meant = Path(str(path).replace("\\", "/"))
        there = "the file is there" if is_file(meant) else "a backslash parts no folders here"
        return f"Write / instead of \\, which works everywhere: {there}."
    if not str(path).isprintable():
        return "YAML takes \\ in double quotes for the beginning of a sign: write / instead."
    try:
        with os.scandir(path.parent) as entries:
            names = [entry.name for entry in itertools.islice(entries, MOST_NAMES) if entry.is_file()]
    except (OSError, ValueError):
        return None
    return did_you_mean(path.name, names)


def read_text(path: Path, what: str, remedy: str, key: str | None = None) -> str:
    """The text of a file in UTF-8; the arguments are those of `require_file`.

    Raises:
        InputError: There is no such file, or it cannot be read as text.
    """
    data = read_bytes(path, what, remedy, key)
    try:
        return with_line_feeds(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise InputError("is not a text file in UTF-8", file=path, key=key, remedy=remedy) from None


def read_bytes(path: Path, what: str, remedy: str, key: str | None = None) -> bytes:
    """What is in a file of text, in any encoding; the arguments are those of `require_file`.

    Raises:
        InputError: There is no such file, or it cannot be read, or it is larger than the limit.
    """
    require_file(path, what, remedy, key)
    try:
        check_limit("TEXT_BYTES", path.stat().st_size, file=path, key=key)
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path, key=key, remedy=remedy) from error


def with_line_feeds(text: str) -> str:
    """A text whose lines end as those of any system, with line feeds alone."""
    return text.replace("\r\n", "\n").replace("\r", "\n")
