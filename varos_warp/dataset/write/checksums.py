"""SHA-256 of every file of a dataset, in the file ``checksums`` that ``sha256sum -c checksums`` reads as well."""

import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from varos_warp.dataset import files
from varos_warp.errors import InputError
from varos_warp.scene.files import is_file

NAME = "checksums"
LEFT_OUT = (NAME, "report.html", "log")
"""Files and folders beside dataset.json that may change or come later."""


def listed_files(root: Path) -> list[Path]:
    """Files of a dataset that checksums are made of, in order: all but `LEFT_OUT` and hidden ones."""
    return [path for path in files.visible(root) if path.relative_to(root).parts[0] not in LEFT_OUT]


def write_checksums(root) -> Path:
    """Write the checksums of a complete dataset, and return their path.

    What an earlier list has, and has not been written since, keeps its checksum: so a file that decayed on the disk is
    not taken for a good one when a later run completes the dataset.

    Raises:
        InputError: If a file cannot be read, or the list cannot be written.
    """
    root = Path(root)
    path, known = root / NAME, {}
    if path.is_file():
        known, written = read_checksums(root), path.stat().st_mtime_ns

    def digest(file: Path) -> str:
        name = file.relative_to(root).as_posix()
        if name in known and file.stat().st_mtime_ns <= written:
            return known[name]
        return sha256(file)

    paths = listed_files(root)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        lines = [f"{value}  {file.relative_to(root).as_posix()}\n"
                 for file, value in zip(paths, pool.map(digest, paths), strict=True)]
    files.write_bytes(path, "".join(lines).encode())
    return path


def read_checksums(root) -> dict[str, str]:
    """SHA-256 by path relative to the dataset; empty where the dataset has no checksums.

    Raises:
        InputError: If the list is damaged.
    """
    path, result = Path(root) / NAME, {}
    if not path.is_file():
        return result
    try:
        for line in path.read_text(encoding="utf-8").splitlines():
            value, name = line.split("  ", 1)
            if len(value) != 64 or not set(value) <= set("0123456789abcdef"):
                raise ValueError
            result[name] = value
    except ValueError:
        raise InputError("is not a list of SHA-256 sums", file=path, remedy="Delete it and `run` again.") from None
    return result


def sha256(path: Path) -> str:
    """SHA-256 of a file in hexadecimal digits.

    Raises:
        InputError: If it cannot be read.
    """
    if not is_file(path):
        raise InputError("there is no such file", file=path)
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", file=path) from error
