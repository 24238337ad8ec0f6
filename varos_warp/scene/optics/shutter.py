"""Times at which the rows of an image are exposed: instants of its exposure, and how long strobes shine in each."""

from typing import Any, NamedTuple

import numpy as np

MOST_INSTANTS = 512
"""Instants of an exposure: a streak has no steps until it is longer than so many pixels."""
MOST_IN_ALL = 4096
"""Instants of exposure and readout together; of exposures shorter than that, as many as there are rows."""


class Instants(NamedTuple):
    """Instants over the exposures of all rows, each the middle of a stretch of time."""

    offset_s: np.ndarray
    """Middles of the instants [N], from the frame's time stamp [s]."""
    length_s: float
    """Length of the stretch that each instant stands for [s]."""
    per_row: float
    """Instants between the beginnings of the exposures of one row and the next."""
    open: float
    """Length of a row's exposure, in instants; 0: it is one instant."""
    share: float = 1.0
    """Share of the exposure that the instants cover: elsewhere no light is on."""
    lit: tuple[int, int] = (0, 0)
    """The first instant of a rolling shutter in which some light is on, and the one after the last; (0, 0): in all."""


STILL = Instants(np.zeros(1), 0.0, 0.0, 0.0)
"""The one instant of an image without a shutter."""


def row_offsets_s(camera: Any) -> np.ndarray:
    """Times [H] from a frame's time stamp to the middle of the exposure of each row [s]."""
    return offsets_of_rows_s(camera.resolution[1], camera.exposure.readout_s)


def offsets_of_rows_s(rows: int, readout_s: float) -> np.ndarray:
    """Times [rows] from a frame's time stamp to the middle of the exposure of each row [s], by a shutter's numbers."""
    return ((np.arange(rows) + 0.5) / rows - 0.5) * readout_s


def in_ns(seconds: np.ndarray) -> np.ndarray:
    """Whole nanoseconds, int64."""
    return np.rint(1e9 * seconds).astype(np.int64)


def is_rolling(camera: Any) -> bool:
    """Whether the rows of a camera's images are of different instants."""
    return camera.exposure.readout_s > 0.0


def instants(camera: Any, lights: Any = ()) -> Instants:
    """The instants that samples of a camera's image are of; one only without a shutter.

    The mean over them is that over the exposure by the midpoint rule: its error falls with the square of their length.
    A global shutter leaves out what is dark before the first strobe and after the last, and so does each row of a
    rolling one, by ``lit``.
    """
    if camera.exposure.is_instant:
        return STILL
    exposure, readout, rows = camera.exposure.time_s, camera.exposure.readout_s, camera.resolution[1]
    if readout == 0.0:
        begin, end = _lit(-0.5 * exposure, 0.5 * exposure, lights)
        length = (end - begin) / MOST_INSTANTS
        return Instants(
            begin + (np.arange(MOST_INSTANTS) + 0.5) * length,
            length,
            0.0,
            float(MOST_INSTANTS),
            (end - begin) / exposure,
        )
    length = max(exposure / MOST_INSTANTS, (exposure + readout) / MOST_IN_ALL)
    if exposure <= length:
        return Instants(row_offsets_s(camera), exposure, 1.0, 0.0)  # one to a row
    per_row = readout / rows / length
    if per_row > 1.0:  # then rows begin with an instant
        per_row = float(np.ceil(per_row))
        length = readout / rows / per_row
    closed = 0.5 * exposure - row_offsets_s(camera)[0]
    count = int(np.ceil((rows - 1) * per_row + exposure / length))
    middles = (np.arange(count) + 0.5) * length - closed
    lit = 0, 0
    if (flash := _lit(-closed, closed, lights)) != (-closed, closed):
        begin, end = ((time + closed) / length for time in flash)
        lit = max(int(begin), 0), min(int(np.ceil(end)), count)
    return Instants(np.minimum(middles, closed), length, per_row, exposure / length, lit=lit)


def lit_of_rows(camera: Any, lights: Any) -> np.ndarray | None:
    """Share of the exposure of each row [H] of which samples are taken; None: of all of it."""
    when = STILL if camera.exposure.is_instant else instants(camera, lights)
    if when.lit == (0, 0):
        return None
    begin = np.arange(camera.resolution[1]) * when.per_row
    return np.maximum(np.minimum(begin + when.open, when.lit[1]) - np.maximum(begin, when.lit[0]), 0.0) / when.open


def _lit(begin: float, end: float, lights: Any) -> tuple[float, float]:
    """The part of an exposure in which some light is on; all of it if none ever is."""
    strobes = [getattr(light, "strobe", None) for light in lights]
    if not strobes or None in strobes:
        return begin, end
    first = max(begin, min(strobe.delay_s - 0.5 * strobe.on_s for strobe in strobes))
    last = min(end, max(strobe.delay_s + 0.5 * strobe.on_s for strobe in strobes))
    return (first, last) if first < last else (begin, end)


def on_share(strobe: Any, when: Instants) -> np.ndarray | float:
    """How long a light shines in each instant, of the time that this stands for; 1 without a strobe."""
    if strobe is None:
        return when.share
    begin, end = strobe.delay_s - 0.5 * strobe.on_s, strobe.delay_s + 0.5 * strobe.on_s
    if when.length_s == 0.0:
        return ((begin <= when.offset_s) & (when.offset_s < end)).astype(float)
    half = 0.5 * when.length_s
    on = np.minimum(when.offset_s + half, end) - np.maximum(when.offset_s - half, begin)
    return when.share * np.maximum(on, 0.0) / when.length_s


def open_ns(cameras: Any) -> int:
    """Longest time from a frame's stamp until a shutter of these cameras closes [ns]."""
    exposures = [camera.exposure for camera in cameras]
    return int(np.ceil(max((0.5e9 * (each.time_s + each.readout_s) for each in exposures), default=0.0)))
