"""Arrays that took long to make, kept in a folder of the user under the hash of what they depend on."""

import hashlib
import json
import os
import tempfile
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

Arrays = dict[str, np.ndarray]
DAMAGED = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)
"""What reading a file raises that is not whole, or not ours."""


def cache_folder() -> Path:
    """``$VAROS_WARP_CACHE``, else ``$XDG_CACHE_HOME/varos_warp``, else ``~/.cache/varos_warp``."""
    if os.environ.get("VAROS_WARP_CACHE"):
        return Path(os.environ["VAROS_WARP_CACHE"])
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "varos_warp"


class Contents(NamedTuple):
    """What is kept, largest first."""

    folder: Path
    entries: list[tuple[str, int]]
    """Name and bytes."""
    limit: int | None = None
    """Most bytes that are kept; None: no limit."""

    @property
    def bytes(self) -> int:
        """Of all entries."""
        return sum(size for _, size in self.entries)


def contents() -> Contents:
    """What the cache of this user holds."""
    folder = cache_folder()
    return Contents(folder, sorted(((path.name, path.stat().st_size) for path in folder.glob("*.npz")),
                                   key=lambda entry: -entry[1]))


def clear() -> None:
    """Delete every entry."""
    for path in cache_folder().glob("*.npz"):
        path.unlink(missing_ok=True)


def cached(name: str, depends_on: dict, build: Callable[[], Arrays], folder: Path | None = None) -> Arrays:
    """Arrays from disk, or built and kept there.

    A file that is damaged is built again, and a folder that cannot be written costs only the time (and one warning).
    Files get their name when they are whole, so that any number of processes may build the same.

    Args:
        name: what the files are called, before the hash.
        depends_on: everything that the numbers depend on, as JSON.
        build: makes the arrays.
        folder: where they are kept; absent: `cache_folder`.
    """
    text = json.dumps(depends_on, sort_keys=True)
    path = (folder or cache_folder()) / f"{name}-{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"
    arrays = _read(path, text)
    if arrays is None:
        arrays = build()
        try:
            _write(path, arrays, text)
        except OSError as error:
            warnings.warn(f"tables of light are not kept, they will be made again: {error}", stacklevel=2)
    return arrays


def _read(path: Path, text: str) -> Arrays | None:
    """The arrays of a file, if it is whole and says that it holds what is asked for."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        return arrays if str(arrays.pop("depends_on")) == text else None
    except DAMAGED:
        return None


def _write(path: Path, arrays: Arrays, text: str):
    """Write a file under another name and move it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, partial = tempfile.mkstemp(dir=path.parent, suffix=".partial")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, depends_on=np.array(text), **arrays)
        os.replace(partial, path)
    except BaseException:
        Path(partial).unlink(missing_ok=True)
        raise
