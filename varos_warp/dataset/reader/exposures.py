"""Tables of exposures: of each frame the gain, and what it follows from."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from varos_warp.dataset import files
from varos_warp.errors import InputError
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.image.exposure import Statistics
from varos_warp.scene.description.exposure import CameraExposure, Exposure, Gain, PercentileMeter, gain_of

MEAN = "centre_weighted_mean"
"""Column of the mean that a meter reads."""


def exposure_setting(meta: Mapping[str, Any], about: Mapping[str, Any], letter: str, file: Path) -> Gain:
    """How a dataset says that A, B or P of a camera gets its gain; ``about`` is the camera's entry in it.

    Raises:
        InputError: If it is no way to expose; names the dataset's ``file``.
    """
    try:
        own = CameraExposure(gain=(about.get("exposure") or {}).get("gain"))
        return gain_of(Exposure(**meta["color"]["exposure"]), own, OUTPUTS[letter].settings)
    except (ValidationError, KeyError, TypeError):
        raise InputError(
            "says no way to expose", file=file, key="color.exposure", remedy="`run` again to make it anew."
        ) from None


def exposure_columns(meter: PercentileMeter | None) -> list[str]:
    """Columns of a table of exposures after the time: those of a frame's number, its gain and its `Statistics`."""
    return ["frame", "gain", "log_average", "highlight", *((meter.column, MEAN) if meter else ())]


def read_exposures(path: Path, meter: PercentileMeter | None = None) -> dict[int, tuple[float, Statistics]]:
    """Gain and statistics of every frame in a table of exposures, with what a meter reads where one is given.

    Raises:
        InputError: If it cannot be read, or lacks a column.
    """
    table, names = files.read_csv(path), exposure_columns(meter)
    if missing := [name for name in names if name not in table]:
        raise InputError(
            f"has no column {' and no column '.join(missing)}", file=path, remedy="`run` again to make it anew."
        )
    entries = zip(*(table[name].tolist() for name in names), strict=True)
    return {frame: (gain, Statistics(*rest)) for frame, gain, *rest in entries}
