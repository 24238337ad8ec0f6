"""Tables of exposures: of each frame the gain, and what it follows from."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from varos_warp.dataset import files
from varos_warp.errors import InputError
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.image.exposure import Channels, FrameGain, Rule, Statistics, as_gain, as_rgb, rule_by
from varos_warp.scene.description.exposure import CameraExposure, Exposure, gain_of, white_balance_of

MEAN = "centre_weighted_mean"
"""Column of the mean that a meter reads."""


def exposure_rule(meta: Mapping[str, Any], about: Mapping[str, Any], letter: str, file: Path) -> Rule:
    """How a dataset says that A, B or P of a camera, its entry ``about``, gets its gains; errors name ``file``."""
    try:
        own = {key: (about.get("exposure") or {}).get(key) for key in ("gain", "white_balance")}
        setting = Exposure(**meta["color"]["exposure"]), CameraExposure(**own), OUTPUTS[letter].settings
        return rule_by(gain_of(*setting), white_balance_of(*setting), lambda: meta["color"]["lamp_gains"][about["id"]])
    except (ValueError, KeyError, TypeError):
        raise InputError(
            "says no way to expose", file=file, key="color.exposure", remedy="`run` again to make it anew."
        ) from None


def _by_channel(name: str) -> list[str]:
    return [f"{name}_{channel}" for channel in ("red", "green", "blue")]


GAINS = _by_channel("gain")
"""Columns of the gains of an image with white balance."""


def exposure_columns(rule: Rule) -> list[str]:
    """Columns of a table of exposures after the time: those of a frame's number, its gain and its `Statistics`."""
    measured = ["log_average", "highlight", *([rule.meter.column, MEAN] if rule.meter else [])]
    if rule.balance is None:
        return ["frame", "gain", *measured]
    of_channels = ["highlight", "mean", *([rule.meter.column] if rule.meter else [])]
    return ["frame", *GAINS, *measured, *(column for name in of_channels for column in _by_channel(name))]


def exposure_row(gain: FrameGain, known: Statistics) -> list[float]:
    """What stands in the columns of a table of exposures after a frame's number."""
    metered = [] if known.metered is None or known.mean is None else [known.metered, known.mean]
    row = [*(gain if isinstance(gain, tuple) else [gain]), known.log_average, known.highlight, *metered]
    channels = known.channels
    return row if channels is None else [*row, *channels.highlight, *channels.mean, *(channels.metered or ())]


def read_exposures(path: Path, rule: Rule) -> dict[int, tuple[FrameGain, Statistics]]:
    """Gain and statistics of every frame in a table of exposures that was made by a rule."""
    rows = _read(path, exposure_columns(rule))
    return {int(frame): _gain_and_statistics(row, rule) for frame, *row in rows}


def read_gains(path: Path) -> dict[int, FrameGain]:
    """Gain of every frame in a table of exposures: a number, or three of an image with white balance."""
    table = files.read_csv(path)
    names = GAINS if "gain" not in table and set(GAINS) <= table.keys() else ["gain"]
    return {frame: as_gain(row if row[1:] else row[0]) for frame, *row in _read(path, ["frame", *names])}


def _read(path: Path, names: list[str]) -> Iterator[tuple[Any, ...]]:
    """Rows of some columns of a table."""
    table = files.read_csv(path)
    if missing := [name for name in names if name not in table]:
        raise InputError(
            f"has no column {' and no column '.join(missing)}", file=path, remedy="`run` again to make it anew."
        )
    return zip(*(table[name].tolist() for name in names), strict=True)


def _gain_and_statistics(row: list[float], rule: Rule) -> tuple[FrameGain, Statistics]:
    """What `exposure_row` made a row of."""
    if rule.balance is None:
        return row[0], _statistics(row[1:])
    count = 7 if rule.meter else 5
    channels = Channels(*(as_rgb(row[i : i + 3]) for i in range(count, len(row), 3)))
    return as_rgb(row[:3]), _statistics(row[3:count], channels)


def _statistics(scalars: list[float], channels: Channels | None = None) -> Statistics:
    log_average, highlight, *metered = scalars
    read, mean = metered or (None, None)
    return Statistics(log_average, highlight, read, mean, channels)
