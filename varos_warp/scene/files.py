"""Scene files and the files that they name: whether they exist, and their text."""

from pathlib import Path

from varos_warp.errors import InputError


def require_file(path: Path, what: str, remedy: str, key: str | None = None) -> None:
    """Refuse a path at which there is no file.

    Args:
        path: Where it should be.
        what: Its kind, for the message.
        remedy: What to do, for the message.
        key: The key that names it.
    """
    if not path.is_file():
        problem = f"there is no such {what}" + (": this is a folder" if path.is_dir() else "")
        raise InputError(problem, file=path, key=key, remedy=remedy)


def read_text(path: Path, what: str, remedy: str, key: str | None = None) -> str:
    """The text of a file in UTF-8; the arguments are those of `require_file`.

    Raises:
        InputError: There is no such file, or it cannot be read as text.
    """
    require_file(path, what, remedy, key)
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError("is not a text file in UTF-8", file=path, key=key, remedy=remedy) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", file=path, key=key, remedy=remedy) from error
