"""A dataset is what lies in its folder: it leads nowhere else, and its files are files."""

import os
from pathlib import Path

from varos_warp.errors import InputError


def refuse_links_out(root: Path) -> None:
    """Refuse a folder with a link that leads out of it, or a pipe or device, which would be read without end.

    Who reads or completes a dataset from elsewhere would otherwise read files of their own, or write to them.
    """
    home, left = root.resolve(), [root]
    while left:
        try:
            with os.scandir(left.pop()) as entries:
                for entry in entries:
                    if entry.is_symlink():
                        _check_link(Path(entry.path), home)
                    elif entry.is_dir():
                        left.append(Path(entry.path))
                    elif not entry.is_file():
                        raise InputError("is no file", file=entry.path, remedy="Take it out of the dataset.")
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror or error}", file=root) from error


def _check_link(path: Path, home: Path) -> None:
    try:
        target = path.resolve()
    except (OSError, RuntimeError):  # a loop
        target = Path("/")
    if not target.is_relative_to(home) or (target.exists() and not target.is_file()):
        raise InputError(
            "is a link that leads out of the dataset, or to a folder",
            file=path,
            remedy="Replace it with what it leads to, if you trust it.",
        )
