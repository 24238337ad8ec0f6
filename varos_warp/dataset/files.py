"""One file at a time: written under a hidden name and renamed when complete, and read back with clear errors."""

import contextlib
import csv
import errno
import glob
import itertools
import json
import operator
import os
import re
import shutil
import socket
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
import yaml
from filelock import FileLock, Timeout

from varos_warp.dataset import png
from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.limits import check_limit
from varos_warp.scene.images import open_image

HOST = re.sub(r"[^0-9a-zA-Z]", "", socket.gethostname()) or "host"
IN_THE_WAY = (errno.ENOTDIR, errno.EISDIR, errno.EEXIST)
"""Errors that mean: something else has the name."""
OWNER = ".owner.lock"
"""Lock file in a folder that is being made, held by the process that makes it."""
_counter = itertools.count()
_watchers: list[Callable[[Path, Path], None]] = []


# ------------------------------------------------------------------------------------------------------------ writing


def _hidden(path: Path) -> Path:
    """A name beside another that no other process, nor thread, has."""
    return path.with_name(f".{path.name}.{HOST}-{os.getpid()}-{next(_counter)}.tmp")


@contextlib.contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """A hidden name beside ``path`` to write to; it becomes ``path`` on success and is removed on anything else.

    Raises:
        InputError: If the disk is full, or the folder cannot be made or written to.
    """
    temp = _hidden(path)
    try:
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield temp
            _tell(path, temp)
            os.replace(temp, path)
    finally:
        with contextlib.suppress(OSError):
            temp.unlink()


@contextlib.contextmanager
def watched(watcher: Callable[[Path, Path], None]) -> Iterator[None]:
    """Have ``watcher(path, where its bytes are)`` called before a file gets its name, or when it keeps its bytes."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def _tell(path: Path, holds: Path) -> None:
    for watcher in list(_watchers):
        watcher(path, holds)


@contextlib.contextmanager
def new_folder(out: Path) -> Iterator[Path]:
    """A hidden folder beside ``out`` that becomes it on success and is removed on anything else.

    Raises:
        InputError: If ``out`` is there already, lies within a dataset, or cannot be made or written to.
    """
    if out.exists() or out.is_symlink():
        raise InputError("is there already", file=out, remedy="Name another folder with -o; nothing is overwritten.")
    inside = [folder for folder in out.absolute().parents if (folder / "dataset.json").exists()]
    if inside:
        raise InputError(
            f"lies within the dataset {inside[0]}, which holds its own files alone",
            file=out,
            remedy="Name a folder elsewhere with -o.",
        )
    temp = _hidden(out.absolute())
    lock = FileLock(temp / OWNER)
    try:
        with writing(out):
            _remove_left(temp.parent.glob(f".{glob.escape(out.absolute().name)}.*.tmp"))
            temp.mkdir(parents=True)
            lock.acquire()
            yield temp
            with contextlib.suppress(OSError):
                (temp / OWNER).unlink()  # Windows waits until it is released
            lock.release()
            (temp / OWNER).unlink(missing_ok=True)
            temp.rename(out)
    finally:
        lock.release()
        shutil.rmtree(temp, ignore_errors=True)


def link(source: Path, target: Path) -> None:
    """Hard-link a file, or copy it where the file system has no links or is another one."""
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        os.link(source.resolve(), target)
    except OSError:
        shutil.copyfile(source, target)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """What the disk refuses becomes one message for the user."""
    try:
        yield
    except OSError as error:
        instead = "choose another folder or name with -o"
        remedy = (
            f"A file is where a folder is needed, or a folder where a file is: {instead}."
            if error.errno in IN_THE_WAY
            else f"Free some space, mend the permissions or {instead}."
        )
        raise InputError(f"cannot be written: {error.strerror or error}", file=path, remedy=remedy) from error


def write_bytes(path: Path, data: bytes) -> bool:
    """Write a whole file; one that holds these bytes already stays as it is. Returns whether it was written."""
    with contextlib.suppress(OSError):
        if is_file(path) and path.stat().st_size == len(data) and path.read_bytes() == data:
            _tell(path, path)
            return False
    with atomic(path) as temp:
        temp.write_bytes(data)
    return True


def write_json(path: Path, content) -> bool:
    """Write indented JSON; NaN and infinity are refused, since JSON has no word for them."""
    return write_bytes(path, (json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode())


def write_csv(path: Path, header: list[str], *columns) -> bool:
    """Write columns ([N] or [N, k] each) with full precision: 17 digits read back to the same float64."""
    series = [c for column in columns for c in np.atleast_2d(np.asarray(column).T).tolist()]
    if len(series) != len(header):
        raise ValueError(f"{path}: {len(header)} names for {len(series)} columns")
    texts = [column if column and isinstance(column[0], str) else map(repr, column) for column in series]
    lines = [",".join(header), *map(",".join, zip(*texts, strict=True))]
    return write_bytes(path, ("\n".join(lines) + "\n").encode())


def write_png(path: Path, pixels: np.ndarray) -> bool:
    """Write uint8 or uint16 [H, W] or [H, W, 3] losslessly.

    The pixels are those given, always; the bytes follow from the version of isal, which dataset.json names.
    """
    return write_bytes(path, png.encode(pixels))


def write_exr(path: Path, channels: dict[str, np.ndarray]) -> None:
    """Write float16 or float32 channels [H, W] (or ``RGB`` [H, W, 3]), losslessly compressed.

    Wavelets (PIZ) suit half floats, ZIP is twice as fast for 32 bits.
    """
    import OpenEXR

    half = all(values.dtype == np.float16 for values in channels.values())
    compression = OpenEXR.PIZ_COMPRESSION if half else OpenEXR.ZIP_COMPRESSION
    with atomic(path) as temp:
        try:
            OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, dict(channels)).write(str(temp))
        except RuntimeError as error:  # the library's word for a full disk
            raise OSError(str(error)) from error
        if not is_complete(temp, ".exr"):  # when a disk fills up with the last buffer, the library says nothing
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write_image(path: Path, pixels: np.ndarray) -> None:
    """Write a finished image as its name says: as a PNG, or as float32 channels of an EXR, R, G, B or, of [H, W], Y."""
    if path.suffix == ".exr":
        write_exr(path, {"RGB" if pixels.ndim == 3 else "Y": np.ascontiguousarray(pixels, np.float32)})
    else:
        write_png(path, pixels)


def visible(folder: Path) -> list[Path]:
    """Files in a folder and those below it, sorted by their paths in it; none that is hidden or lies in what is."""
    found = []
    for here, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        found += [Path(here, name) for name in names if not name.startswith(".")]
    return sorted(found, key=lambda path: path.relative_to(folder).as_posix())


def _remove_left(folders: Iterable[Path]) -> None:
    """Remove the folders of killed attempts: their lock is there, and nobody holds it."""
    for folder in list(folders):
        lock = FileLock(folder / OWNER, timeout=0)
        with contextlib.suppress(Timeout):
            if is_file(folder / OWNER) and not (folder / OWNER).is_symlink():
                with lock:
                    shutil.rmtree(folder)


# ------------------------------------------------------------------------------------------------------------ reading


_ANEW = "`run` again to make it anew."
_REMEDY = "The file is damaged; delete it and `run` again to make it anew."


@contextlib.contextmanager
def reading(path: Path, remedy: str = _REMEDY) -> Iterator[None]:
    """What cannot be read becomes one message for the user."""
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError("there is no such file", file=path, remedy=_ANEW) from error
    except (
        OSError,
        ValueError,
        SyntaxError,
        RuntimeError,
        LookupError,
        TypeError,
        AttributeError,
        OverflowError,
        MemoryError,
        struct.error,
        zlib.error,
        csv.Error,
        yaml.YAMLError,
    ) as error:
        raise InputError(f"cannot be read: {error}", file=path, remedy=remedy) from error


def read_json(path: Path, remedy: str = _REMEDY) -> dict:
    """Contents of a JSON file; ``remedy``: what to do where it is damaged."""
    with reading(path, remedy):
        return json.loads(_text(path), parse_constant=_no_number)


def _no_number(word: str) -> float:
    raise ValueError(f"{word} is no number that JSON has")


def _text(path: Path) -> str:
    """Text of a file."""
    if text := path.read_text(encoding="utf-8"):
        return text
    raise ValueError("it is empty")


def differences(
    first, second, same: Callable = operator.eq, every: bool = True, path: str = ""
) -> Iterator[tuple[str, object, object]]:
    """(key, value in the first, in the second) of everything that differs between two trees of dicts and lists.

    ``same`` compares what has no parts; with ``every``, keys of both count, else those of the second; ``path`` is that
    of the trees within others.
    """
    if isinstance(first, dict) and isinstance(second, dict):
        pairs = [(key, first.get(key), second.get(key)) for key in ({**first, **second} if every else second)]
    elif isinstance(first, list | tuple) and isinstance(second, list | tuple) and len(first) == len(second):
        pairs = [(i, *pair) for i, pair in enumerate(zip(first, second, strict=True))]
    else:
        if not same(first, second):
            yield path, first, second
        return
    for key, a, b in pairs:
        yield from differences(a, b, same, every, f"{path}.{key}" if path else str(key))


def read_csv(path: Path) -> dict[str, np.ndarray]:
    """Columns by name: int64 where every entry is an integer, else float64, else text."""
    with reading(path):
        text = _text(path)
        if not text.endswith("\n"):  # the last number may lack digits and look whole
            raise ValueError("its last line is cut")
        header, *body = csv.reader(text.splitlines())
        if wrong := [(line, row) for line, row in enumerate(body, 2) if len(row) != len(header)]:
            line, row = wrong[0]
            raise InputError(
                f"cannot be read: a row of {len(row)} entries, not {len(header)}", file=path, line=line, remedy=_REMEDY
            )
        return {name: _typed([row[i] for row in body]) for i, name in enumerate(header)}


def _typed(entries: list[str]) -> np.ndarray:
    for dtype in (np.int64, np.float64):
        with contextlib.suppress(ValueError, OverflowError):
            return np.array([int(e) for e in entries] if dtype is np.int64 else entries, dtype)
    return np.array(entries)


def read_numbers(path: Path, count: int | None = None) -> list[np.ndarray]:
    """The first columns of a table of numbers, int64 time stamps first; all of them where no count is given.

    Raises:
        InputError: If it has fewer columns, no rows, or entries in them that are not numbers.
    """
    table = dict(list(read_csv(path).items())[:count])
    columns = list(table.values())
    if len(columns) < (count or 1):
        raise InputError(f"has {len(columns)} columns, not {count}", file=path, remedy=_REMEDY)
    if not len(columns[0]):
        raise InputError("has no rows", file=path, remedy=_REMEDY)
    for i, (name, column) in enumerate(table.items()):
        kinds, problem = ("i", "is not a whole number") if i == 0 else ("if", "is not a number")
        if column.dtype.kind not in kinds:
            entries = column.tolist()
            row = next((row for row, entry in enumerate(entries) if not _is_number(entry, i == 0)), 0)
            raise InputError(problem, file=path, line=row + 2, key=plain_name(name), value=entries[row], remedy=_REMEDY)
    return columns


def _is_number(entry: str | float, whole: bool) -> bool:
    try:
        return float(entry).is_integer() or not whole
    except ValueError:
        return False


def plain_name(header: str) -> str:
    """A column's name without its unit."""
    return header.removeprefix("# ").split(" [")[0]


def read_png(path: Path) -> np.ndarray:
    """Pixels of a PNG: uint8 [H, W, 3], uint16 [H, W] or uint16 [H, W, 3]."""
    with reading(path):
        _refuse_incomplete(path)
        if png.has_three_channels_of_16_bits(path):
            return png.decode(path)
        with open_image(path) as image:
            return np.array(image)


def read_exr(path: Path) -> dict[str, np.ndarray]:
    """Channels [H, W] of an EXR by name."""
    import OpenEXR

    with reading(path):
        _refuse_incomplete(path)
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            low, high = (np.asarray(corner, np.int64) for corner in file.header()["dataWindow"])
            check_limit("TEXTURE_PIXELS", int(np.prod(np.maximum(high - low + 1, 0))), file=path)
        with OpenEXR.File(str(path), separate_channels=True) as file:
            return {name: channel.pixels for name, channel in file.channels().items()}


def read_image(path: Path) -> np.ndarray:
    """Pixels of a file of `write_image`."""
    if path.suffix != ".exr":
        return read_png(path)
    channels = read_exr(path)
    return channels["Y"] if "Y" in channels else np.stack(channels_of(path, channels, *"RGB"), -1)


def channels_of(path: Path, channels: dict[str, np.ndarray], *names: str) -> list[np.ndarray]:
    """Channels of an EXR that have these names, in their order; an `InputError` where there is no such."""
    if missing := [name for name in names if name not in channels]:
        raise InputError(f"has no channel {missing[0]}", file=path, remedy="`run` again to make it anew.")
    return [channels[name] for name in names]


def _refuse_incomplete(path: Path) -> None:
    if not is_complete(path):
        raise ValueError(f"it is not a whole {path.suffix[1:].upper()}") if path.exists() else FileNotFoundError(path)


def is_complete(path: Path, suffix: str | None = None) -> bool:
    """Return whether an image file is there and has its end; costs two small reads, so thousands can be asked."""
    try:
        with path.open("rb") as file:
            return _png_has_end(file) if (suffix or path.suffix) == ".png" else _exr_has_end(file)
    except (OSError, ValueError, IndexError, struct.error):
        return False


def _png_has_end(file) -> bool:
    start = file.read(8)
    file.seek(-12, os.SEEK_END)
    return start == b"\x89PNG\r\n\x1a\n" and file.read(12) == b"\0\0\0\0IEND\xaeB`\x82"


def _exr_has_end(file) -> bool:
    """Return whether the last block of scan lines in the table of a single-part EXR ends where the file ends."""
    head = file.read(4096)
    if head[:4] != b"\x76\x2f\x31\x01":
        return False
    at = 8
    while head[at]:  # attributes: name, type, size, value
        at = head.index(b"\0", head.index(b"\0", at) + 1) + 1
        at += 4 + struct.unpack_from("<i", head, at)[0]
    first = struct.unpack_from("<Q", head, at + 1)[0]
    if first > file.seek(0, os.SEEK_END):
        return False
    file.seek(at + 1)
    last = max(struct.unpack(f"<{(first - at - 1) // 8}Q", file.read(first - at - 1)))
    file.seek(last)
    size = struct.unpack("<ii", file.read(8))[1]
    return file.seek(0, os.SEEK_END) == last + 8 + size
