"""SHA-256 of every file of a dataset, in the file ``checksums`` that ``sha256sum -c checksums`` reads as well.

A sum is made by the run that writes the bytes, before they get their name, and is noted in ``log``. What has changed
since is never taken for good: `Record` says which files are as some run wrote them.
"""

import contextlib
import hashlib
import os
import threading
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from varos_warp.dataset import files
from varos_warp.errors import InputError
from varos_warp.files import is_file

NAME = "checksums"
LEFT_OUT = (NAME, "report.html", "readiness.html", "log")
"""Files and folders beside dataset.json that may change or come later."""
NOTES = "written_*.sha256"
"""Files in ``log``, one of each process, with the sums of the files that it wrote."""


def listed_files(root: Path) -> list[Path]:
    """Files of a dataset that checksums are made of, in order: all but `LEFT_OUT` and hidden ones."""
    return [path for path in files.visible(root) if path.relative_to(root).parts[0] not in LEFT_OUT]


def only_notes(path: Path) -> bool:
    """Return whether this log has nothing but notes, of a run that was killed before its first file had a name."""
    return path.name == "log" and path.is_dir() and all(note.match(NOTES) for note in path.iterdir())


class Record:
    """What runs wrote into a dataset: by file, the sums of all bytes that any of them gave it."""

    def __init__(self, root: Path):
        self.root = root
        self.notes = root / "log" / f"{NOTES.replace('*', f'{files.HOST}_{os.getpid()}')}"
        self._turn, self._now = threading.Lock(), {}
        self.known: dict[str, set[str]] = defaultdict(set)
        self.reload()

    def reload(self) -> None:
        """Take in what other runs have noted by now."""
        for path in (self.root / NAME, *(self.root / "log").glob(NOTES)):
            for name, value in _lines(path):
                self.known[name].add(value)

    def has(self, path: Path) -> bool:
        """Return whether an image is there, has its end, and was written by a run."""
        return files.is_complete(path) and self._name(path) in self.known

    @contextlib.contextmanager
    def recording(self) -> Iterator["Record"]:
        """Note what this process writes meanwhile, from any thread."""
        with files.watched(self._note):
            yield self

    def _note(self, path: Path, holds: Path) -> None:
        """A file of the dataset is about to be what another file holds."""
        if (name := self._name(path)) is not None:
            self.vouch(name, sha256(holds))

    def vouch(self, name: str, value: str) -> None:
        """Note that a run has written a file with this sum."""
        with self._turn:
            self._now[name] = value
            if value not in self.known.get(name, ()):
                self.notes.parent.mkdir(exist_ok=True)
                with self.notes.open("ab") as notes:
                    notes.write(f"{value}  {name}\n".encode())
                self.known[name].add(value)

    def _name(self, path: Path) -> str | None:
        """Name of a listed file, as in the list; None of another."""
        parts = path.relative_to(self.root).parts if path.is_relative_to(self.root) else ()
        return None if not parts or parts[0] in LEFT_OUT or parts[-1].startswith(".") else "/".join(parts)

    def damaged(self) -> list[str]:
        """Files that are not as any run wrote them, or gone though `checksums` lists them; reads all that is there."""
        found = [name for name, value in self._there() if value not in self.known[name]]
        listed = read_checksums(self.root)
        return sorted([name for name in listed if not (self.root / name).exists()] + found)

    def _there(self) -> list[tuple[str, str]]:
        """(name, sum) of each file that is there and that some run wrote."""

        def value(name: str) -> str:
            if name not in self._now:
                self._now[name] = sha256(self.root / name)
            return self._now[name]

        names = [name for path in listed_files(self.root) if (name := self._name(path)) in self.known]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return list(zip(names, pool.map(value, names), strict=True))

    def forget(self, name: str) -> None:
        """Remove a damaged file, so that it is made again."""
        self._now.pop(name, None)
        with files.writing(self.root / name):
            (self.root / name).unlink(missing_ok=True)

    def write_checksums(self) -> Path:
        """Write the checksums of a complete dataset, and return their path; files of nobody's are left out."""
        self.reload()
        lines = []
        for name, value in self._there():
            if value not in self.known[name]:
                raise InputError(
                    "is not as a run wrote it: its checksum differs",
                    file=self.root / name,
                    remedy="`run` again to make it anew.",
                )
            lines.append(f"{value}  {name}\n")
        files.write_bytes(self.root / NAME, "".join(lines).encode())
        return self.root / NAME


def read_checksums(root) -> dict[str, str]:
    """SHA-256 by path relative to the dataset; empty where the dataset has no checksums."""
    return dict(_lines(Path(root) / NAME))


def _lines(path: Path) -> list[tuple[str, str]]:
    """(name, sum) of each line of a list; the last line of a process that was killed may be cut off."""
    if not is_file(path):
        return []
    with files.reading(path):
        text = path.read_text(encoding="utf-8")
    lines = text.split("\n")[:-1] if path.name != NAME else text.splitlines()
    result = []
    for line in lines:
        value, _, name = line.partition("  ")
        if (
            len(value) != 64
            or not set(value) <= set("0123456789abcdef")
            or ".." in name.split("/")
            or (not name or name.startswith("/"))
        ):
            raise InputError("is not a list of SHA-256 sums", file=path, remedy="Delete it and `run` again.")
        result.append((name, value))
    return result


def sha256(path: Path) -> str:
    """SHA-256 of a file in hexadecimal digits; an `InputError` if it cannot be read."""
    if not is_file(path):
        raise InputError("there is no such file", file=path)
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=path) from error
