"""Exposure of a dataset: gains from the statistics of all frames, and the PNG that they decide."""

import contextlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import TIME, Layout
from varos_warp.dataset.reader.exposures import exposure_columns, read_exposures
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

    The gains come last: if it is interrupted, the next run finds the old ones and does it again.

    Args:
        layout: Of the dataset.
        scene: The scene, which says how the letter is exposed.
        camera: Its id.
        letter: A, B or P.
        frames: Numbers [N] of the frames whose EXR is there.
        time_ns: Their times [N].
        made: What this run rendered: its statistics are known, and its PNG are written where the gain was known.
        has: Whether an image file is there already, and good.
        axis_weight: Of the camera (`CameraModel`), for P.
    """
    from varos_warp.device.devices import usable_cores

    setting = exposure.setting_of(scene, camera, letter)
    table, meter, developer = layout.exposures(camera, letter), exposure.meter_of(setting), Developer(layout, scene)
    old: dict[int, tuple[float, exposure.Statistics]] = {}
    with contextlib.suppress(InputError):  # where there is nothing to trust, all is made anew
        old = read_exposures(table, meter)
    known = exposure.known_gain(setting, letter) is not None

    def statistics(frame: int) -> exposure.Statistics:
        found = made.get((camera, letter, frame)) or (old[frame][1] if frame in old else None)
        return found or exposure.statistics(_read_half(layout.exr(camera, letter, frame)), meter)

    def write(frame: int, gain: float) -> None:
        fresh = known and (camera, letter, frame) in made
        exposed = fresh or (frame in old and old[frame][0] == gain)
        if not (exposed and all(map(has, developer.files(camera, letter, frame)))):
            developer.write(camera, letter, frame, _read_half(layout.exr(camera, letter, frame)), gain)

    with ThreadPoolExecutor(usable_cores(), "expose") as pool:
        found = list(pool.map(statistics, frames))
        gains = twin_gains(layout, setting, camera, frames, axis_weight) if OUTPUTS[letter].like else None
        if gains is None:
            gains = exposure.gains(setting, letter, time_ns * 1e-9, found)
        list(pool.map(write, frames, gains.tolist()))
    read = [[s.metered for s in found], [s.mean for s in found]] if meter else []
    files.write_csv(
        table,
        [TIME, *exposure_columns(meter)],
        time_ns,
        frames,
        gains,
        [s.log_average for s in found],
        [s.highlight for s in found],
        *read,
    )


def twin_gains(
    layout: Layout, setting: exposure.Gain, camera: str, frames: list[int], axis_weight: float
) -> np.ndarray | None:
    """Gains [N] of P: those of A times what its port lets through, so that both show the middle alike.

    None where A has none for some frame: then P is exposed by itself. ``setting`` is what the scene says of A
    (`exposure.setting_of`), the other arguments are those of `expose`.
    """
    if isinstance(setting, float | int):
        return np.full(len(frames), axis_weight * setting)
    try:
        known = read_exposures(layout.exposures(camera, WATER))
        return axis_weight * np.array([known[frame][0] for frame in frames])
    except (InputError, KeyError):
        return None


def _read_half(path: Path) -> np.ndarray:
    channels = files.read_exr(path)
    return np.stack([channels[c] for c in "RGB"], -1)
