"""What is not there yet in a dataset that is being made, or whose run was interrupted."""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.dataset.write import checksums
from varos_warp.dataset.write.folder import at_work
from varos_warp.errors import InputError
from varos_warp.render.image.outputs import OUTPUTS


@dataclass(frozen=True)
class Pending:
    """What a run has still to make: nothing in a complete dataset, whatever it lacks."""

    files: frozenset[Path] = frozenset()
    """Images and tables of exposures."""
    frames: frozenset[int] = frozenset()
    """Those that are not rendered, or not in all outputs."""

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
            return {path for path in paths
                    if not path.is_file() and path.relative_to(data.root).as_posix() not in listed}

        by_frame = {frame: absent(images(data, frame)) for frame in data.frames}
        exposed = [output for output in data.outputs if OUTPUTS[output].is_color]  # their PNG follow from all frames
        frames = [frame for frame, paths in by_frame.items() if any(path.parent.name not in exposed for path in paths)]
        return cls(frozenset().union(absent(exposure_tables(data)), *by_frame.values()), frozenset(frames))

    def ready(self, data: Dataset) -> list[int]:
        """Frames that can be looked at."""
        return [frame for frame in data.frames if frame not in self.frames]


def images(data: Dataset, frame: int) -> list[Path]:
    """Every image of a frame that dataset.json asks for."""
    render, paths = data.meta["scene"].get("render", {}), []
    for camera, output in itertools.product(data.cameras, data.outputs):
        paths += [data.layout.png(camera, output, frame), *data.layout.rendered(
            camera, output, frame, render.get("linear_exr", False), render.get("depth_exr", False))]
        if output == "A" and data.has_noise("A"):
            paths.append(data.layout.clean(camera, frame))
    return paths


def exposure_tables(data: Dataset) -> list[Path]:
    """Tables of gains, which are made when all frames are there."""
    return [data.layout.exposures(camera, output)
            for camera in data.cameras for output in data.outputs if OUTPUTS[output].is_color]


def check_complete(data: Dataset, result: Validation, pending: Pending) -> None:
    """One line for all that a run has still to make, and who is at it."""
    if not pending.files:
        return
    count = len(pending.frames)
    what = f"{count} of {len(data)} frames {'is' if count == 1 else 'are'} missing images"
    if not count:
        what = "its images are rendered, but not all exposed"
    runs = " and ".join(at_work(data.root))
    goes_on = f"a run is writing there: {runs}" if runs else "the same `run` goes on"
    result.add(f"not complete: {what}; {goes_on}")
