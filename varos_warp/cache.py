"""Arrays that took long to compute, kept in a folder of the user under a hash of all that they depend on.

The folder has a size limit: what was used least recently goes first. Any number of processes may share it.
"""

import contextlib
import functools
import hashlib
import json
import logging
import os
import re
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import varos_warp
from varos_warp.errors import InputError, warn

LOG = logging.getLogger("varos_warp")
Arrays = dict[str, np.ndarray]
LIMIT_MB = 2000.0
"""Size limit where ``$VAROS_WARP_CACHE_MB`` says nothing."""
ENTRY, PARTIAL = re.compile(r"\w+-[0-9a-f]{32}\.npz"), re.compile(r"\w+-[0-9a-f]{32}-\w+\.partial")
"""Names of our files, whole and while they are written. Nothing else in the folder is ever touched."""
STALE_S = 86_400.0
"""A file that has been partial for so long is left from a process that was killed."""

IMPORTS = re.compile(r"(?:from|import) (varos_warp[\w.]*)(?: import (\([^)]*\)|[^\n]*))?")
"""Statements that import a module of ours, or names from it."""

_in_use: set[Path] = set()
"""Entries that this process has used: it may want them again, so they are not deleted to make room."""


def cache_folder() -> Path:
    """``$VAROS_WARP_CACHE``, else ``$XDG_CACHE_HOME/varos_warp``, else ``~/.cache/varos_warp``."""
    if os.environ.get("VAROS_WARP_CACHE"):
        return Path(os.environ["VAROS_WARP_CACHE"])
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "varos_warp"


def size_limit() -> int:
    """Most bytes that are kept: ``$VAROS_WARP_CACHE_MB``, else 2 GB.

    Raises:
        InputError: If the variable is not a number of megabytes.
    """
    given = os.environ.get("VAROS_WARP_CACHE_MB") or LIMIT_MB
    with contextlib.suppress(ValueError, OverflowError):
        if (limit := int(1e6 * float(given))) >= 0:
            return limit
    raise InputError(
        "is not a number of megabytes",
        key="VAROS_WARP_CACHE_MB",
        value=given,
        remedy=f"Give 0 or more; absent, it is {LIMIT_MB:g}.",
    )


class Contents(NamedTuple):
    """State of the user's cache: its folder, entries and limit."""

    folder: Path
    entries: list[tuple[str, int]]
    """Name and bytes, the most recently used first."""
    limit: int
    """Most bytes that are kept."""

    @property
    def bytes(self) -> int:
        """Bytes of all entries."""
        return sum(size for _, size in self.entries)


def contents() -> Contents:
    """What the user's cache holds."""
    folder = cache_folder()
    return Contents(folder, [(path.name, size) for _, size, path in reversed(_by_use(folder, ENTRY))], size_limit())


def clear() -> int:
    """Delete every entry of the user's cache; returns the bytes that were freed."""
    return sum(
        size for pattern in (ENTRY, PARTIAL) for _, size, path in _by_use(cache_folder(), pattern) if _delete(path)
    )


def cached(
    name: str, depends_on: dict, build: Callable[[], Arrays], folder: Path | None = None, what: str | None = None
) -> Arrays:
    """Arrays from disk, or built and kept there.

    A file that is damaged is built again, and a folder that cannot be written costs only the time (and one warning).
    Files get their name when they are whole, so that any number of processes may build the same.

    Args:
        name: What the files are called, before the hash.
        depends_on: Everything that the numbers depend on, as JSON.
        build: Makes the arrays.
        folder: Where they are kept; absent: `cache_folder`.
        what: What they are, for a line in the log where they are built; absent: they are built silently.
    """
    text = json.dumps(depends_on, sort_keys=True)
    path = (folder or cache_folder()) / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"
    _in_use.add(path)
    arrays = _read(path, text)
    if arrays is None:
        if what:
            LOG.info("making %s, once; it is kept for later runs ...", what)
        start = time.monotonic()
        arrays = build()
        if what:
            LOG.info("made %s in %.0f s", what, time.monotonic() - start)
        try:
            _write(path, arrays, text)
        except OSError as error:
            warn(f"what was computed is not kept, it will be made again: {error}")
        _make_room(path.parent)
    return arrays


@functools.cache
def code_hash(module: str, within: tuple[str, ...], package: Path = Path(varos_warp.__file__).parent) -> str:
    """Hash of a module's file and of those that it imports that are ``within``."""
    code, unread = {}, [module]
    while unread:
        name = unread.pop()
        path = package.joinpath(*name.split(".")[1:])
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if name in code or not name.startswith(within) or not path.is_file():
            continue
        code[name], imported = _code_of(path)
        unread += imported
    return hashlib.sha256("".join(sorted(name + code[name] for name in code)).encode()).hexdigest()


@functools.cache
def _code_of(path: Path) -> tuple[str, list[str]]:
    """Hash of a file, and the modules that it may import: parsing it would take a hundred times as long."""
    text, imported = path.read_bytes(), []
    for module, names in IMPORTS.findall(text.decode()):
        imported += [module, *(f"{module}.{name}" for name in re.findall(r"\w+", names))]
    return hashlib.sha256(text).hexdigest(), imported


def digest(*arrays: np.ndarray) -> str:
    """SHA-256 of arrays: of their types, shapes and values."""
    sha = hashlib.sha256()
    for array in arrays:
        sha.update(f"{array.dtype.str}{array.shape}".encode())
        sha.update(np.ascontiguousarray(array).data)
    return sha.hexdigest()


def _read(path: Path, text: str) -> Arrays | None:
    """The arrays of a file, if it is whole and says that it holds what is asked for."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        if str(arrays.pop("depends_on")) != text:
            return None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):  # not whole, or not ours
        return None
    with contextlib.suppress(OSError):  # a folder that may only be read
        os.utime(path)
    return arrays


def _write(path: Path, arrays: Arrays, text: str):
    """Write a file under another name and move it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=f"{path.stem}-", suffix=".partial")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, depends_on=np.array(text), **arrays)
        os.replace(partial, path)
    except BaseException:
        Path(partial).unlink(missing_ok=True)
        raise


def _make_room(folder: Path) -> None:
    """Delete what was used least recently, until the rest is within the limit."""
    entries = _by_use(folder, ENTRY)
    too_much = sum(size for _, size, _ in entries) - size_limit()
    for _, size, path in entries:
        if too_much > 0 and path not in _in_use and _delete(path):
            too_much -= size
    for used, _, path in _by_use(folder, PARTIAL):
        if time.time() - used > STALE_S:
            _delete(path)


def _by_use(folder: Path, pattern: re.Pattern) -> list[tuple[float, int, Path]]:
    """Time of the last use, bytes and path of our files, the least recently used first."""
    files = []
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            with contextlib.suppress(OSError):  # another process may have deleted it
                if pattern.fullmatch(path.name) and path.is_file() and not path.is_symlink():
                    files.append((path.stat().st_mtime, path.stat().st_size, path))
    return sorted(files)


def _delete(path: Path) -> bool:
    """Return whether a file could be deleted; some systems keep what another process reads."""
    with contextlib.suppress(OSError):
        path.unlink()
        return True
    return False
