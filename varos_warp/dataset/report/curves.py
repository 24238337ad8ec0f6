"""Curves for the page: what the sensors read, how the vehicle moved, the exposure and the time that images took.

A long recording is drawn by the ends of what it does in each of a thousand intervals, so that no peak is lost.
"""

import contextlib
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.sensors.registry import SENSORS
from varos_warp.scene.passes import BandWater

ROUNDING = 1e-12
"""Value below which a quantity in SI units is what rounding left of 0."""
INTERVALS = 1000
"""Number of time intervals, in each of which a curve's least and greatest value are kept."""


def envelope(x: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Curves with few points x, columns [M, k] that cover the same values as x [N], ascending, and columns [N, k].

    As they are if they are short, else the least and the greatest value of each interval in turn: M <= 2 INTERVALS.
    """
    if len(x) <= 2 * INTERVALS:
        return x, columns
    starts = np.linspace(0, len(x), INTERVALS, endpoint=False).astype(int)
    low, high = np.fmin.reduceat(columns, starts), np.fmax.reduceat(columns, starts)
    ends = np.append(starts[1:], len(x)) - 1
    return np.column_stack([x[starts], x[ends]]).ravel(), np.stack([low, high], 1).reshape(2 * INTERVALS, -1)


def curve(
    title: str,
    unit: str,
    x: np.ndarray,
    columns: np.ndarray,
    names: Iterable[str],
    times: np.ndarray | None = None,
    **more: Any,
) -> dict[str, Any]:
    """A plot of columns [N, k] over x [N], ascending, in seconds or with ``distance`` in metres.

    ``times`` [M] [s] are those of the frames that the page shows: the last sample until then is what it states for a
    frame, not an end of an interval. ``more``: ``log`` for a logarithmic axis, ``distance``, ``zero`` for an axis from
    0, ``down`` for one downwards.
    """
    columns = np.reshape(columns, (len(x), -1))
    thin_x, thin = envelope(np.asarray(x, float), columns)
    if times is not None:
        rows = (np.searchsorted(x, times, "right") - 1).clip(min=0)
        more["at_frames"] = [_short(column) for column in columns[rows].T]
    return {
        "title": title,
        "unit": unit,
        "x": _short(thin_x),
        "y": [_short(column) for column in thin.T],
        "names": list(names),
    } | more


def _short(values: np.ndarray, digits: int = 6) -> list[float | None]:
    """Six digits are more than a screen shows; what is no number is left out, and what only rounding leaves is 0."""
    values = np.where(np.abs(values) < ROUNDING, 0.0, values)
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values.tolist()]


def curves(data: Dataset, times: np.ndarray) -> list[dict[str, Any]]:
    """Every plot over time that the dataset has something for, with values at the ``times`` [M] [s] of frames."""
    plots = []
    there = [sensor for sensor in SENSORS if sensor.id in data.recorded]
    for sensor, drawn in ((each, drawn) for each in there for drawn in each.curves):
        readings, more = data.readings(sensor.id), {"down": True} if drawn.down else {}
        plots.append(
            curve(
                drawn.title,
                drawn.unit,
                readings["time_ns"] * 1e-9,
                drawn.scale * readings[drawn.quantity],
                drawn.names,
                times,
                **more,
            )
        )
    if "vehicle" in data.recorded:
        state = data.states()
        speed = np.linalg.norm(state["velocity"], axis=1)
        plots.append(curve("Speed", "m/s", state["time_ns"] * 1e-9, speed, ["speed"], times))
    return plots + _exposure(data, times) + _seconds(data, times)


def _exposure(data: Dataset, times: np.ndarray) -> list[dict[str, Any]]:
    """Gain of every exposed output of every camera, over the frames that all of them have."""
    gains = {
        name: by_frame
        for camera in data.cameras
        for output in data.outputs
        if OUTPUTS[output].is_color and data.layout.exposures(camera, output).is_file()
        for name, by_frame in _curves(f"{camera} {output}" if len(data.cameras) > 1 else output, data, output, camera)
    }
    frames = [f for f in data.frames if all(f in gain for gain in gains.values())]
    if not gains or not frames:
        return []
    columns = np.array([[gain[f] for gain in gains.values()] for f in frames])
    time = data.views()[0][np.searchsorted(data.frames, frames)] * 1e-9
    return [curve("Exposure gain", "", time, columns, gains, times, log=True)]


def _curves(name: str, data: Dataset, output: str, camera: str) -> Iterator[tuple[str, dict[int, float]]]:
    """Gains by frame, by their curve's name: one curve, or with white balance one of each channel."""
    gains = data.gains(output, camera)
    if not any(isinstance(gain, tuple) for gain in gains.values()):
        yield name, gains
        return
    for i, channel in enumerate(("red", "green", "blue")):
        yield f"{name} {channel}", {frame: gain[i] for frame, gain in gains.items()}


def logs(data: Dataset) -> list[dict[str, Any]]:
    """What the runs that rendered the dataset logged, in order of their end; those that cannot be read are left out."""
    found = []
    for path in sorted((data.root / "log").glob("*.json")):
        with contextlib.suppress(InputError):
            log = files.read_json(path)
            if isinstance(log, dict) and isinstance(log.get("frames"), list):
                found.append(log)
    return found


def _seconds(data: Dataset, times: np.ndarray) -> list[dict[str, Any]]:
    """Seconds that each frame took, all cameras together, where all were logged; the last time counts."""
    took: dict[tuple[int, str], float] = {}
    for log in logs(data):
        took |= {(row["frame"], row["camera"]): row["seconds"] for row in log["frames"]}
    known = [i for i, f in enumerate(data.frames) if all((f, camera) in took for camera in data.cameras)]
    if len(known) < 2:
        return []
    seconds = np.array([sum(took[data.frames[i], camera] for camera in data.cameras) for i in known])
    return [curve("Rendering", "s a frame", data.views()[0][known] * 1e-9, seconds, ["seconds"], times)]


def attenuation(data: Dataset) -> dict[str, Any]:
    """What the water leaves of light along a straight way: exp(-sigma_t d) per channel."""
    water, distance = data.meta["water"], np.linspace(0.0, data.meta["depth"]["range_m"][1], 101)
    left = BandWater.of(water, data.cameras[0]).left(distance)
    return curve(
        "Light left after a distance in the water",
        "%",
        distance,
        100 * left,
        ["red", "green", "blue"],
        distance=True,
        zero=True,
    )
