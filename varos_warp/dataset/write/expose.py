"""Exposure of a dataset: gains from the statistics of all frames, and the PNG that they decide."""

import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import TIME, Layout
from varos_warp.dataset.reader.exposures import exposure_columns, exposure_row, read_exposures, read_gains
from varos_warp.dataset.write.develop import Developer
from varos_warp.errors import InputError
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.image import exposure
from varos_warp.scene.description.image_types import WATER

Known = dict[tuple[str, str, int], exposure.Statistics]
"""Statistics by camera, letter and frame."""


def expose(
    layout: Layout,
    scene: Any,
    camera: str,
    letter: str,
    frames: list[int],
    time_ns: np.ndarray,
    made: Known,
    has: Callable[[Path], bool] = files.is_complete,
    axis_weight: float = 1.0,
) -> None:
    """Gains of one camera from all its rendered frames; writes the PNG whose gain is new, then the gains.

    The gains come last: if it is interrupted, the next run finds the old ones and does it again. Frames [N] are those
    whose EXR is there, at times [N]; of those that this run ``made`` the statistics are known, and PNG are written
    where the gain was known. ``has`` tells whether an image file is there and good, ``axis_weight`` is the camera's
    (`CameraModel`), for P.
    """
    from varos_warp.device.devices import usable_cores

    rule = exposure.rule_of(scene, camera, letter)
    table, developer = layout.exposures(camera, letter), Developer(layout, scene)
    old: dict[int, tuple[exposure.FrameGain, exposure.Statistics]] = {}
    with contextlib.suppress(InputError):  # where there is nothing to trust, all is made anew
        old = read_exposures(table, rule)
    known = rule.known(letter) is not None

    def statistics(frame: int) -> exposure.Statistics:
        found = made.get((camera, letter, frame)) or (old[frame][1] if frame in old else None)
        return found or rule.statistics(_read_half(layout.exr(camera, letter, frame)))

    def write(frame: int, gain: exposure.FrameGain) -> None:
        fresh = known and (camera, letter, frame) in made
        exposed = fresh or (frame in old and old[frame][0] == gain)
        if not (exposed and all(map(has, developer.files(camera, letter, frame)))):
            developer.write(camera, letter, frame, _read_half(layout.exr(camera, letter, frame)), gain)

    with ThreadPoolExecutor(usable_cores(), "expose") as pool:
        found = list(pool.map(statistics, frames))
        gains = twin_gains(layout, rule, camera, frames, axis_weight) if OUTPUTS[letter].like else None
        if gains is None:
            gains = rule.gains(letter, time_ns * 1e-9, found)
        of_frames = [exposure.as_gain(gain) for gain in gains.tolist()]
        list(pool.map(write, frames, of_frames))
    rows = [exposure_row(gain, known) for gain, known in zip(of_frames, found, strict=True)]
    files.write_csv(table, [TIME, *exposure_columns(rule)], time_ns, frames, *zip(*rows, strict=True))


def twin_gains(
    layout: Layout, rule: exposure.Rule, camera: str, frames: list[int], axis_weight: float
) -> np.ndarray | None:
    """Gains [N] of P: those of A times what its port lets through, so that both show the middle alike.

    With white balance they are [N, 3]. None where A has none for some frame: then P is exposed by itself. ``rule`` is
    that of A (`exposure.rule_of`), the other arguments are those of `expose`.
    """
    try:
        if (gain := rule.known(WATER)) is not None:
            return axis_weight * np.array([gain] * len(frames))
        known = read_gains(layout.exposures(camera, WATER))
        return axis_weight * np.array([known[frame] for frame in frames])
    except (InputError, KeyError):
        return None


def _read_half(path: Path) -> np.ndarray:
    channels = files.read_exr(path)
    return np.stack([channels[c] for c in "RGB"], -1)
