"""What versions of one scene have in common: made for the first of them, and taken from there by the others.

Two scenes have something in common if they are the same but for keys from which it does not follow. Geometry, course
and renderer stay in memory; images are linked from one dataset to the next. A product states such keys itself
(`ImageProduct.beside`), and it is not believed: the first frame of every dataset is rendered anyway, and what has been
linked is given up unless that frame has the same bytes (`unlike`).
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.write.checksums import Record, read_checksums, sha256
from varos_warp.device.devices import usable_cores
from varos_warp.files import is_file
from varos_warp.products.images.registry import colors
from varos_warp.scene.description import Scene
from varos_warp.scene.description.looks import LOOKS, without
from varos_warp.scene.file.load import scene_to_dict


def fingerprint(scene: Scene, beside: Iterable[str] = (), **more: Any) -> str:
    """SHA-256 of all that a scene says but some keys, and of ``more``, in hexadecimal digits; files count by name."""
    text = json.dumps([without(scene_to_dict(scene), beside), more], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass
class Shared:
    """What a run may take from others; what it makes of it stays for the next run."""

    donors: Mapping[str, Path] = field(default_factory=dict)
    """Folders of datasets that have the same images, by their letters."""
    parts: list | None = None
    """Everything solid in the scene."""
    simulation: Any = None
    renderer: Any = None
    is_lit: bool = False
    """True if the renderer is of the very scene that is to be rendered, not of one that may look different."""
    _of: str | None = None
    _trajectory: Any = None

    def suited(self, scene: Scene) -> Scene:
        """Forget what is not the same in a scene; returns the scene, which knows of its course what is known."""
        key = fingerprint(scene, LOOKS)
        if key != self._of:
            self._of, self._trajectory = key, scene.trajectory
            self.parts = self.simulation = self.renderer = None
        return scene.model_copy(update={"trajectory": self._trajectory})


def images_of(layout: Layout, scene: Scene, letter: str, frames: Iterable[int]) -> list[Path]:
    """All files of an image type at some frames, whichever camera they are of."""
    return [
        path
        for frame in frames
        for camera in layout.cameras
        for path in layout.image_files(camera, letter, frame, vars(scene.render)).values()
    ]


def borrow(donors: Mapping[str, Path], layout: Layout, scene: Scene, frames: list[int], record: Record) -> None:
    """Link images that are missing from folders of ``donors``, by letter, if they are as they were written there."""
    records = {root: Record(root) for root in {*donors.values()}}

    def link(path: Path, root: Path) -> None:
        name = path.relative_to(layout.root).as_posix()
        source, is_there = root / name, path.is_file() if path.suffix == ".csv" else record.has(path)
        if not is_there and is_file(source) and sha256(source) in records[root].known[name]:
            with files.atomic(path) as temp:
                files.link(source, temp)

    gains = {letter: [layout.exposures(camera, letter) for camera in layout.cameras] for letter in colors([*donors])}
    wanted = [
        (path, root)
        for letter, root in donors.items()
        if letter in scene.render.outputs
        for path in [*gains.get(letter, ()), *images_of(layout, scene, letter, frames)]
    ]
    with ThreadPoolExecutor(usable_cores(), "link") as pool:
        list(pool.map(link, *zip(*wanted, strict=True)) if wanted else ())


def unlike(donors: Mapping[str, Path], layout: Layout, scene: Scene, frames: list[int]) -> list[str]:
    """Letters of images that are not the same as in another dataset, at some frames that both have made themselves."""
    own, found = Record(layout.root).known, []
    for letter, root in donors.items():
        theirs = Record(root).known
        names = [path.relative_to(layout.root).as_posix() for path in images_of(layout, scene, letter, frames)]
        if any(name in own and name in theirs and not own[name] & theirs[name] for name in names):
            found.append(letter)
    return found


def give_up(letters: Iterable[str], layout: Layout, scene: Scene, frames: list[int]) -> None:
    """Remove images of a dataset, so that they are made anew."""
    record = Record(layout.root)
    for letter in letters:
        for path in images_of(layout, scene, letter, frames):
            record.forget(path.relative_to(layout.root).as_posix())


def link_equal(root: Path, others: Iterable[Path]) -> None:
    """Keep files that are the same in complete datasets only once on the disk: tables, calibrations, rays."""
    own = read_checksums(root)
    for other in others:
        theirs = read_checksums(other)
        for name in [name for name, value in own.items() if theirs.get(name) == value]:
            path, source = root / name, other / name
            if source.is_file() and not path.samefile(source) and sha256(source) == own[name]:
                with files.atomic(path) as temp:
                    files.link(source, temp)
