"""Everything that readiness tells of one dataset."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.frames.excitation import excitation
from varos_warp.dataset.readiness.frames.features import Keypoints, detect, matches, repeatability
from varos_warp.dataset.readiness.frames.light import (
    attenuation,
    black_level,
    layers_of,
    median_range,
    rms_contrast,
    veil_over_signal,
)
from varos_warp.dataset.readiness.frames.loops import loop_closures
from varos_warp.dataset.readiness.frames.truth import moves, source_of_moves
from varos_warp.dataset.readiness.odometry.forecast import failure_chances
from varos_warp.dataset.readiness.odometry.odometry import Odometry, odometries
from varos_warp.dataset.readiness.odometry.signs import signs
from varos_warp.dataset.readiness.odometry.tracking import View
from varos_warp.dataset.readiness.opencv import opencv
from varos_warp.errors import InputError
from varos_warp.scene.description.image_types import DEPTH, WATER

KINDS = ("orb", "sift")


@dataclass(frozen=True)
class Readiness:
    """Measures of one camera of a dataset. A frame's value is None if there is nothing to measure."""

    root: Path
    camera: str
    frames: list[int]
    time_s: list[float]
    by_frame: dict[str, list[float | None]]
    """Measures by name; those between frames stand with the first of the two."""
    excitation: dict[str, Any] | None
    loop_closures: list[tuple[int, int]] | None
    """(frame, earlier frame)."""
    odometry: dict[str, Odometry]
    left_out: list[str]
    """What was not measured, and why."""
    group: str | None = None
    """Name that datasets share if they differ in their seed alone."""

    def medians(self) -> dict[str, float | None]:
        """Return the median of each measure over the frames that have it."""
        known = {name: [v for v in values if v is not None] for name, values in self.by_frame.items()}
        return {name: float(np.median(values)) if values else None for name, values in known.items()}

    def failure_chance(self) -> float:
        """Mean over the steps from each frame to the next of the chance that the small odometry fails there."""
        return float(np.mean([chance for chance in self.by_frame["failure_chance"] if chance is not None]))

    def plain(self) -> dict[str, Any]:
        """Return plain types for JSON."""
        return {
            "dataset": str(self.root),
            "camera": self.camera,
            "group": self.group,
            "frames": self.frames,
            "time_s": self.time_s,
            "by_frame": self.by_frame,
            "median": self.medians(),
            "failure_chance": self.failure_chance(),
            "excitation": self.excitation,
            "loop_closures": self.loop_closures,
            "left_out": self.left_out,
            "odometry": {name: found.plain() for name, found in self.odometry.items()},
        }


def measure(root: Path, camera: str | None = None, seeds: int = 3) -> Readiness:
    """Measure the dataset in a folder, with so many runs of the odometry; absent: its first camera.

    Raises an `InputError` as `check` does, or if there is no such camera, a file is damaged, or OpenCV is not
    installed.
    """
    data = Dataset(root)
    opencv()
    camera = data.camera(camera)["id"]
    check(data, camera)
    frames, source = by_frame(data, camera), source_of_moves(data)
    frames["failure_chance"] = failure_chances(frames)
    odometry, left_out = odometries(data, camera, seeds)
    if source is None:
        left_out.append(
            "repeatability and inlier shares: they need F"
            + (", since objects move" if DEPTH in data.outputs else ", or D")
        )
    if "direct_contrast" not in frames:
        left_out.append("contrast of the direct layer and veil over signal: `run` with --linear-exr keeps the layers")
    if DEPTH not in data.outputs:
        left_out.append("optical depth and loop closures: they need D")
    excited = excitation(data)
    if excited is None:
        left_out.append("excitation of the IMU: there is none on record over three frames")
    loops = loop_closures(data, camera) if DEPTH in data.outputs else None
    time_s = (data.views(camera)[0] * 1e-9).tolist()
    return Readiness(root, camera, data.frames, time_s, frames, excited, loops, odometry, left_out)


def check(data: Dataset, camera: str) -> None:
    """Refuse a dataset without A, of fewer than two frames, without poses of the camera, or with an image gone."""
    if WATER not in data.outputs:
        raise InputError(
            "the dataset has no A, which is what features are found in",
            file=data.root,
            key="outputs",
            value="".join(data.outputs),
            remedy="`run` again with A among --outputs.",
        )
    if len(data) < 2:
        raise InputError(
            "readiness compares each frame with the next",
            file=data.root,
            key="frames",
            value=len(data),
            remedy="Give a dataset of two frames or more.",
        )
    data.views(camera)
    data.require_images([WATER, *({DEPTH} & set(data.outputs))], [camera])


def by_frame(data: Dataset, camera: str) -> dict[str, list[float | None]]:
    """Measures of each frame and of the step to the next, as `Readiness` has them, but for the forecast."""
    rows, view, before, last = [], View(data, camera), None, None
    for index in range(len(data)):
        gray = view.gray(index)
        now = {kind: detect(kind, gray) for kind in KINDS}
        row = _of_image(data, index, camera, now)
        if before is not None and last is not None:
            rows[-1] |= signs(view, last, gray, before["orb"], now["orb"])
            if source_of_moves(data):
                rows[-1] |= _between(before, now, data, index - 1, camera)
        rows.append(row)
        before, last = now, gray
    known = dict.fromkeys(name for row in rows for name, value in row.items() if value is not None)
    return {name: [row.get(name) for row in rows] for name in known}


def _of_image(data: Dataset, index: int, camera: str, found: dict[str, Keypoints]) -> dict[str, float | None]:
    frame, about = data.frames[index], data.camera(camera)
    mpx = about["width"] * about["height"] / 1e6
    row: dict[str, float | None] = {}
    for kind, keypoints in found.items():
        row |= {f"{kind}_count": len(keypoints.points), f"{kind}_per_mpx": len(keypoints.points) / mpx}
    layers, distance = layers_of(data, frame, camera), median_range(data, frame, camera)
    picture = data.image(WATER, frame, camera)
    row["contrast"], row["black_level"] = rms_contrast(picture), black_level(picture)
    row["direct_contrast"] = rms_contrast(layers["direct"]) if "direct" in layers else None
    row["veil_over_signal"] = veil_over_signal(layers)
    row["median_range_m"] = distance
    row["optical_depth"] = None if distance is None else float(attenuation(data, camera)[1] * distance)
    return row


def _between(
    here: dict[str, Keypoints], there: dict[str, Keypoints], data: Dataset, index: int, camera: str
) -> dict[str, float | None]:
    """Measure from the frame at a place to the one after it."""
    moved, row = moves(data, index, camera), {}
    for kind in KINDS:
        repeated, chance = repeatability(here[kind], there[kind], moved)
        count, right = matches(here[kind], there[kind], moved)
        row |= {
            f"{kind}_repeatability": repeated,
            f"{kind}_chance": chance,
            f"{kind}_matches": count,
            f"{kind}_inlier_share": right,
        }
    return row
