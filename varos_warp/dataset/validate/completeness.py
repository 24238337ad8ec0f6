"""Which files there are to be: what is missing, strange, changed since it was written, or still to be made by a run."""

import itertools
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from varos_warp.dataset.layout import POSE_FORMS
from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write import checksums
from varos_warp.dataset.write.folder import at_work
from varos_warp.errors import InputError, counted
from varos_warp.products.images.registry import OUTPUTS, colors
from varos_warp.products.sensors.registry import BY_ID
from varos_warp.scene.description.image_types import SEGMENTS, WATER


@dataclass(frozen=True)
class Pending:
    """What a run has still to make: nothing in a complete dataset, whatever it lacks."""

    files: frozenset[Path] = frozenset()
    """Images and tables of exposures."""
    frames: frozenset[int] = frozenset()
    """Frames that are not rendered, or not in all outputs."""

    @classmethod
    def of(cls, data: Dataset) -> "Pending":
        """A run ends with the contact sheet and the checksums: what is listed there was made already."""
        try:
            listed = checksums.read_checksums(data.root)
        except InputError:  # told of by `check_checksums`
            return cls()
        if not listed and (data.root / "contact_sheet.png").exists():
            return cls()

        def absent(paths: Iterable[Path]) -> set[Path]:
            return {
                path for path in paths if not path.is_file() and path.relative_to(data.root).as_posix() not in listed
            }

        by_frame = {frame: absent(images(data, frame)) for frame in data.frames}
        exposed = colors(data.outputs)  # their PNG follow from all frames
        frames = [frame for frame, paths in by_frame.items() if any(path.parent.name not in exposed for path in paths)]
        return cls(frozenset().union(absent(exposure_tables(data)), *by_frame.values()), frozenset(frames))

    def ready(self, data: Dataset) -> list[int]:
        """Frames that can be looked at."""
        return [frame for frame in data.frames if frame not in self.frames]


def images(data: Dataset, frame: int) -> list[Path]:
    """Every image of a frame that dataset.json asks for."""
    render, paths = data.meta["scene"].get("render", {}), []
    for camera, output in itertools.product(data.cameras, data.outputs):
        paths += data.layout.image_files(camera, output, frame, render).values()
        if output == WATER and data.has_noise(WATER):
            paths.append(data.layout.clean(camera, frame))
    return paths


def exposure_tables(data: Dataset) -> list[Path]:
    """Tables of gains, which are made when all frames are there."""
    return [data.layout.exposures(camera, output) for camera in data.cameras for output in colors(data.outputs)]


def _texts(data: Dataset) -> Iterator[Path]:
    layout = data.layout
    yield data.root / "README.txt"
    for name in (*data.recorded, *data.cameras, *data.moving):
        yield from (layout.poses(name, form) for form in POSE_FORMS)
    for camera in data.cameras:
        yield from (layout.camera_file(camera, suffix) for suffix in (".yaml", "_timestamps.csv"))
        if "rays" in data.camera(camera):
            yield layout.rays(camera)
        if rows.is_rolling(data.camera(camera)):
            yield layout.row_poses(camera)
    yield from exposure_tables(data)
    if data.meta["lights"]:
        yield layout.lights
    if data.recorded:
        yield layout.states
        yield from map(layout.sensor, data.meta["sensors"])
        erring = filter(data.has_noise, data.meta["sensors"])
        yield from (layout.bias(name) for name in erring if BY_ID[name].bias_apart)
    if SEGMENTS in data.outputs:
        yield layout.segments


def check_complete(data: Dataset, result: Validation, pending: Pending) -> None:
    """One line for all that a run has still to make, and who is at it."""
    if not pending.files:
        return
    count = len(pending.frames)
    what = f"{count} of {counted(len(data), 'frame')} {'is' if count == 1 else 'are'} missing images"
    if not count:
        what = "its images are rendered, but not all exposed"
    runs = " and ".join(at_work(data.root))
    goes_on = f"a run is writing there: {runs}" if runs else "the same `run` goes on"
    result.add(f"not complete: {what}; {goes_on}")


def check_files(data: Dataset, result: Validation, pending: Pending) -> None:
    """Every file that dataset.json asks for is there, and none that it does not account for."""
    required = {*_texts(data), *itertools.chain.from_iterable(images(data, frame) for frame in data.frames)}
    # what an earlier run may have been asked for
    every = dict.fromkeys((key for image in OUTPUTS.values() for key in image.folders.values()), True)
    optional = {
        path
        for camera in data.cameras
        for output in data.outputs
        for frame in data.frames
        for path in data.layout.image_files(camera, output, frame, every).values()
    }
    missing = sorted(path for path in required - pending.files if not path.is_file())
    found = [path for path in data.layout.vehicle_dir.rglob("*") if path.is_file()]
    strays = sorted(p for p in found if p not in required | optional and not p.name.startswith("."))
    remains = [] if pending.files else sorted(data.root.rglob(".*.tmp"))  # the run that goes on removes them
    for paths, problem in (
        (missing, "there is no such file"),
        (strays, "dataset.json does not account for it"),
        (remains, "remains of an interrupted run"),
    ):
        result.add_all([f"{result.name(path)}: {problem}" for path in paths], "files")


def check_checksums(data: Dataset, result: Validation, pending: Pending) -> None:
    """Every file is as it was written; of a dataset that is still made only images, since all else is written anew."""
    known, growing = checksums.read_checksums(data.root), bool(pending.files)
    if growing:
        known = {name: value for name, value in known.items() if Path(name).suffix in (".png", ".exr")}
    if not known:
        return

    def compare(name: str) -> str | None:
        if not (data.root / name).is_file():
            return f"{name}: there is no such file"
        same = checksums.sha256(data.root / name) == known[name]
        return None if same else f"{name}: is not as it was written: its checksum differs"

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = [problem for problem in pool.map(compare, known) if problem]
    added = [] if growing else map(result.name, checksums.listed_files(data.root))
    result.add_all(found + [f"{name}: is not in checksums" for name in added if name not in known], "files")
    result.files_hashed = len(known)
