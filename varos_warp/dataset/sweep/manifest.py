"""``sweep.json`` in the folder of a sweep: its versions, what each changes and shares, and how far it is."""

import contextlib
import functools
from pathlib import Path
from typing import Any

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.run.shared import fingerprint
from varos_warp.dataset.sweep.units import Unit
from varos_warp.dataset.write.checksums import NAME as CHECKSUMS
from varos_warp.dataset.write.checksums import sha256
from varos_warp.dataset.write.folder import FREE, drop, hold, open_folder
from varos_warp.dataset.write.texts import sources
from varos_warp.errors import InputError

NAME, LOCK, FORMAT, COMPLETE = "sweep.json", ".sweep.lock", "varos_warp sweep", "complete"
"""Name of the manifest, name of the file that one process at a time locks to write it, what it calls itself, and the
word for a dataset that is done."""
REMEDY = "Give the sweep that this folder holds, to which versions may be added, or another folder with -o."


class Manifest:
    """What is asked of a folder, and what stands in it."""

    def __init__(self, out: Path, units: list[Unit], frames: slice):
        self.out, self.path, self.units, self.frames = out, out / NAME, units, frames
        sum_of = functools.cache(sha256)
        self._scenes = {
            unit.version.name: fingerprint(
                unit.scene, FREE, version=varos_warp.__version__, files=sources(unit.scene, sum_of)
            )
            for unit in units
        }
        """Fingerprints of what may not change between runs, by version."""
        self._complete: dict[str, dict[str, Any]] = {}
        """What stands in the file of each dataset that is complete, by its folder."""

    def folder_of(self, unit: Unit) -> str:
        """Folder of a dataset, in that of the sweep."""
        return unit.root.relative_to(self.out).as_posix()

    def is_complete(self, unit: Unit) -> bool:
        """Return whether a sweep made a dataset with all that is asked for, and checked that it shares what it should.

        A dataset whose run was killed at its very end is not.
        """
        return self.folder_of(unit) in self._complete

    # ------------------------------------------------------------------------------------------------- what is there

    def check(self) -> None:
        """Refuse a folder that holds something else, naming the first thing of it; changes nothing."""
        for folder in (self.out, *self.out.absolute().parents):
            if (folder / "dataset.json").exists():
                raise InputError(
                    f"{folder} is a dataset, which holds its own files alone",
                    file=self.out,
                    remedy="Give another folder with -o.",
                )
        with files.writing(self.out):
            foreign = [entry.name for entry in self.out.iterdir()] if self.out.exists() else []
        if not self.path.exists() and any(not name.startswith(".") for name in foreign):
            raise InputError(
                "the folder is not empty and holds no sweep",
                file=self.out,
                remedy="Give a new folder with -o, or empty this one.",
            )
        for unit in self.units:
            open_folder(unit.scene, unit.layout)
        if self.path.exists():
            with files.reading(self.path, REMEDY):
                there = files.read_json(self.path, REMEDY)
                self._check_versions(there)
                self._take(there)

    def _check_versions(self, there: dict) -> None:
        """Refuse versions of which something was made, and which are not asked for, or are other ones now."""
        if there.get("format") != FORMAT or not isinstance(there.get("versions"), list):
            raise InputError("is not the list of a sweep", file=self.path, remedy=REMEDY)
        asked = {unit.version.name: unit.version.overrides for unit in self.units}
        for old in there["versions"]:
            if not any((self.out / entry["folder"]).exists() for entry in old["datasets"]):
                continue  # nothing of it was made
            key = f"versions.{old['name']}"
            if old["name"] not in asked:
                raise InputError(
                    "is a version of the sweep in this folder, and not of the one asked for",
                    file=self.path,
                    key=key,
                    remedy=REMEDY,
                )
            for inner, before, now in _changed(old["overrides"], asked[old["name"]]):
                raise InputError(
                    f"is {before!r} in the sweep in this folder, and {now!r} in the one asked for",
                    file=self.path,
                    key=f"{key}.{inner}",
                    remedy=REMEDY,
                )
            if old["scene"] != self._scenes[old["name"]]:
                raise InputError(
                    "the scene, a file that it names, an option or varos_warp is not what it was when the "
                    "sweep in this folder was begun",
                    file=self.path,
                    key=key,
                    remedy=REMEDY,
                )

    # ------------------------------------------------------------------------------------------------ what is written

    def write(self, made: Unit | None = None) -> None:
        """Write what is so by now, such as that a dataset was made; any number of processes may do so."""
        with files.writing(self.path):
            self.out.mkdir(parents=True, exist_ok=True)
            lock = hold(self.out / LOCK)
            try:
                if self.path.exists():
                    self._take(files.read_json(self.path, REMEDY))
                if made is not None:
                    self._complete[self.folder_of(made)] = self._described(made)
                files.write_json(self.path, self.content())
            finally:
                drop(lock, self.out / LOCK)

    def withdraw(self) -> None:
        """Remove the file where it is all that there is, and then the folder."""
        if not any(unit.root.exists() for unit in self.units):
            with contextlib.suppress(OSError):
                self.path.unlink()
                self.out.rmdir()

    def _take(self, there: dict) -> None:
        """Believe what the file says of datasets that are complete, if they are what is asked for, and as they were."""
        known = {entry["folder"]: entry for version in there["versions"] for entry in version["datasets"]}
        for unit in self.units:
            folder = self.folder_of(unit)
            entry = known.get(folder, {})
            if (
                folder not in self._complete
                and entry.get("state") == COMPLETE
                and unit.is_whole(self.frames)
                and entry["checksums"] == sha256(unit.root / CHECKSUMS)
            ):
                self._complete[folder] = entry

    def content(self) -> dict[str, Any]:
        """What it says: of each version what it changes, and of its datasets the state and what they share."""
        versions: dict[str, dict[str, Any]] = {}
        for unit in self.units:
            name, folder = unit.version.name, self.folder_of(unit)
            entry = versions.setdefault(
                name, {"name": name, "overrides": unit.version.overrides, "scene": self._scenes[name], "datasets": []}
            )
            state = {"folder": folder, "state": "begun" if unit.layout.metadata.exists() else "missing"}
            entry["datasets"].append(self._complete.get(folder, state))
        chosen = {"start": self.frames.start, "stop": self.frames.stop, "step": self.frames.step}
        return {
            "format": FORMAT,
            "schema_version": 1,
            "varos_warp": varos_warp.__version__,
            "frames": chosen,
            "versions": [*versions.values()],
        }

    def _described(self, unit: Unit) -> dict[str, Any]:
        """Entry of a complete dataset: whose course it has, and whose images, by letter, as the bytes say."""
        before = self.units[: self.units.index(unit)]
        shared = {}
        for letter in unit.scene.render.outputs:
            same = (other for other in before if unit.has_same(letter, other) and unit.shares(letter, other))
            if (first := next(same, None)) is not None:
                shared[letter] = self.folder_of(first)
        course = next(other for other in (*before, unit) if unit.course == other.course)
        return {
            "folder": self.folder_of(unit),
            "state": COMPLETE,
            "course": self.folder_of(course),
            "shared": shared,
            "checksums": sha256(unit.root / CHECKSUMS),
        }


def _changed(old: dict, new: dict) -> list[tuple[str, Any, Any]]:
    """Keys whose values differ, with both values; of a key that one does not have, None."""
    return [
        (key, old.get(key), new.get(key))
        for key in {**old, **new}
        if old.get(key) != new.get(key) or (key in old) != (key in new)
    ]
