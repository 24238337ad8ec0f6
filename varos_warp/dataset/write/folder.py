"""The folder of a dataset: whose it is, whether another run is writing to it, and what must not be mixed in it."""

import contextlib
import itertools
import os
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from filelock import FileLock, Timeout

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.links import refuse_links_out
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.write import checksums
from varos_warp.dataset.write import texts as writers
from varos_warp.errors import InputError
from varos_warp.scene.description.looks import GAINS, without
from varos_warp.scene.file.load import scene_to_dict

_NAME = re.compile(r"\.run\.(\w+)\.(\d+)-\d+\.(\d+)of(\d+)\.lock")
"""Name of a run's lock file: host, process and shard."""
PLAN_LOCK = ".plan.lock"
_TEMP = re.compile(r"\.(\w+)-(\d+)-\d+\.tmp$")
"""Ends of the names of files that are not complete: host and process."""
_counter = itertools.count()
FREE = ("render.outputs", "render.linear_exr", "render.depth_exr", "render.exposure", *GAINS)
"""Keys that may change between runs into one folder: what they ask for is added, or made from what is there."""


# ---------------------------------------------------------------------------------------------------------- the locks


@contextlib.contextmanager
def claimed(root: Path, shard: tuple[int, int] = (0, 1)) -> Iterator[None]:
    """Keep other runs out of a folder, but for other shards of the same division.

    Every run holds a lock of the operating system on a file of its own, whose name says who it is; a run that was
    killed holds none, whatever it left. (On NFS and Lustre the file system must support locks, as it mostly does.)
    Where nothing can be written, as on a read-only disk, a dataset needs no lock.

    The folder is made where it is missing. Shard (i, n) renders every n-th frame from the i-th.

    Raises:
        InputError: If another run is at it, naming it; or the folder cannot be written to.
    """
    if is_read_only(root):
        yield
        return
    own = root / f".run.{files.HOST}.{os.getpid()}-{next(_counter)}.{shard[0]}of{shard[1]}.lock"
    with files.writing(root):
        root.mkdir(parents=True, exist_ok=True)
        lock = hold(own)
    try:
        for other, name in _runs(root):
            if other != own and _in_use(other):
                _refuse_conflict(root, other, name, shard)
        yield
    finally:
        drop(lock, own)
        with contextlib.suppress(OSError):
            if not any(root.glob(".run.*.lock")):
                (root / PLAN_LOCK).unlink(missing_ok=True)


def hold(path: Path) -> FileLock:
    """A lock on a file that has its name still: another run may have taken it for a dead one's, and removed it."""
    while True:
        lock = FileLock(path)
        lock.acquire()
        if path.exists():
            return lock
        lock.release()


def drop(lock: FileLock, path: Path) -> None:
    """Remove the file of a lock that is held, so that nobody waits for it, and let it go."""
    with contextlib.suppress(OSError):
        path.unlink()
    lock.release()
    with contextlib.suppress(OSError):
        path.unlink()  # Windows removes no file that is open


def _free(path: Path) -> FileLock | None:
    """The lock of a process, taken over from it; None where it is held, or gone."""
    lock = FileLock(path)
    try:
        lock.acquire(timeout=0)
    except (Timeout, OSError):
        return None
    return lock


def _in_use(path: Path) -> bool:
    """Return whether a process holds this lock; a dead one holds none."""
    if (lock := _free(path)) is not None:
        lock.release()
    return lock is None and path.exists()


def _runs(root: Path) -> list[tuple[Path, re.Match]]:
    """Lock files of runs, dead or alive, and who they are."""
    found = [(path, _NAME.fullmatch(path.name)) for path in sorted(root.glob(".run.*.lock"))]
    return [(path, name) for path, name in found if name]


def at_work(root: Path) -> list[str]:
    """The runs that are writing to a folder, in words; removes nothing."""
    return [_words(name) for path, name in _runs(root) if _in_use(path)]


def is_read_only(root: Path) -> bool:
    """Return whether a folder holds a dataset and nothing can be written there."""
    return (root / "dataset.json").exists() and not os.access(root, os.W_OK)


def sweep(root: Path) -> None:
    """Remove what killed runs left: the hidden files of processes whose lock nobody holds, and then that lock.

    The folder must be known to be ours (`open_folder`).
    """
    alive = {name.group(1, 2) for path, name in _runs(root) if _in_use(path)}
    for path, name in _runs(root):
        if name.group(1, 2) in alive or (lock := _free(path)) is None:
            continue
        for temp in list(root.rglob(".*.tmp")):
            if (owner := _TEMP.search(temp.name)) and owner.groups() == name.group(1, 2):
                temp.unlink(missing_ok=True)
        drop(lock, path)


def _words(name: re.Match) -> str:
    return f"process {name[2]} on {name[1]}"


def _refuse_conflict(root: Path, other: Path, found: re.Match, shard: tuple[int, int]) -> None:
    """Refuse a run beside another, unless both are different shards of one division."""
    index, of = int(found[3]), int(found[4])
    if of == shard[1] > 1 and index != shard[0]:
        return
    part = f", shard {index}/{of}," if of > 1 else ""
    with contextlib.suppress(OSError):
        part += f" since {time.strftime('%Y-%m-%d %H:%M', time.localtime(other.stat().st_mtime))}"
    raise InputError(
        f"another run is writing to this folder: {_words(found)}{part}",
        file=root,
        remedy="Wait for it, or end it; several runs can share a folder as --shard I/N, each with an I of "
        "its own and the same N.",
    )


@contextlib.contextmanager
def planning(root: Path, tell: Callable[[], None] = lambda: None) -> Iterator[None]:
    """One shard at a time may plan and write dataset.json; ``tell`` is called where this means to wait."""
    if is_read_only(root):
        yield
        return
    lock = FileLock(root / PLAN_LOCK)
    with files.writing(root):
        try:
            lock.acquire(timeout=0)
        except Timeout:
            tell()
            lock.acquire()
    try:
        yield
    finally:
        lock.release()


# ------------------------------------------------------------------------------------------------------- whose it is


def open_folder(scene, layout: Layout) -> dict | None:
    """Contents of dataset.json of this scene, or None where the folder is new. Refuses any other; changes nothing."""
    root = layout.root
    if not root.exists():
        return None
    with files.writing(root):
        entries = [entry for entry in root.iterdir() if not (entry.name.startswith(".") or checksums.only_notes(entry))]
    if entries and not layout.metadata.exists():
        raise InputError(
            "the folder is not empty and holds no dataset",
            file=root,
            remedy="Give a new folder with -o, or empty this one.",
        )
    refuse_links_out(root)
    return recorded(scene, layout)


def recorded(scene, layout: Layout) -> dict | None:
    """Contents of dataset.json, which must be of this scene; None where there is none yet."""
    if not layout.metadata.exists():
        return None
    data = Dataset(layout.root)
    meta = data.meta
    if meta.get("noise") and not data.has_scene_noise:
        raise InputError(
            "noise was added to the dataset in this folder, which cannot go on without it",
            file=layout.metadata,
            key="noise.profile.name",
            value=meta["noise"]["profile"]["name"],
            remedy="`run` into the folder of the dataset that it was made of, and add the noise anew.",
        )
    check_same(scene, meta, layout.metadata)
    return meta


def check_same(scene, meta: dict, file: Path) -> None:
    """Refuse to mix what two different scenes make, naming the first key that differs."""
    here = {"varos_warp version": varos_warp.__version__, "contents of": writers.sources(scene), **scene_to_dict(scene)}
    there = {"varos_warp version": meta["versions"]["varos_warp"], "contents of": meta["sources"], **meta["scene"]}
    if different := list(files.differences(without(there, FREE), without(here, FREE))):
        key, old, new = different[0]
        rest = [d[0] for d in different[1:4]] + ["..."] * (len(different) > 4)
        also = f" (also different: {', '.join(rest)})" if rest else ""
        raise InputError(
            f"the dataset in this folder was made with {_short(old)}, not {_short(new)}{also}",
            file=file,
            key=key,
            remedy="Give the same scene and options, another folder with -o, or delete this one.",
        )


def _short(value) -> str:
    text = "no value" if value is None else repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
