"""The clock: one tick of the simulation is 5 ms; times are integer nanoseconds; frames and sensors have any rate."""

import math

import numpy as np

from varos_warp.errors import InputError

TICK_RATE_HZ = 200
TICK_S = 1.0 / TICK_RATE_HZ
TICK_NS = 1_000_000_000 // TICK_RATE_HZ
LONGEST_S = 86_400
"""Longest sequence [s]: a day, whose trajectory is 17 million rows and takes 9 GB to make."""
MAX_TICKS = LONGEST_S * TICK_RATE_HZ
HIGHEST_RATE_HZ = 10_000.0
"""Highest rate of frames and sensors [Hz]: 50 to a tick, between which the motion has no more to tell."""


def check_rate(rate_hz: float, key: str) -> None:
    """Refuse a rate that gives less than one sample in the longest sequence, or more than anyone has asked for."""
    if rate_hz * LONGEST_S < 1.0:
        raise InputError(
            "is less than a sample a day",
            key=key,
            value=rate_hz,
            remedy=f"Give at least {1.0 / LONGEST_S:.3g} Hz; sequences are no longer than {LONGEST_S} s",
        )
    if rate_hz > HIGHEST_RATE_HZ:
        raise InputError("is too high", key=key, value=rate_hz, remedy=f"Give at most {HIGHEST_RATE_HZ:g} Hz")


def check_length(seconds: float, key: str, what: str) -> None:
    """Refuse a sequence longer than `LONGEST_S`, by the ``key`` of the scene that makes it so long."""
    if not seconds <= LONGEST_S:
        raise InputError(
            f"{what} {seconds:.6g} s, more than the {LONGEST_S} s that can be simulated at {TICK_RATE_HZ} Hz",
            key=key,
            remedy="Make it shorter (nearer stops, a higher speed) or divide it into several scenes",
        )


def times_ns(count: int, rate_hz: float, first: int = 0) -> np.ndarray:
    """Times of the samples ``first`` to ``count`` - 1 of a rate: int64, to the nearest nanosecond, sample 0 at 0."""
    return np.rint(np.arange(first, count) * (1e9 / rate_hz)).astype(np.int64)


def frame_time_ns(frame: int, rate_hz: float) -> int:
    """Time of one of them, by its number from 0."""
    return int(np.rint(frame * (1e9 / rate_hz)))


def frame_count(duration_s: float, rate_hz: float) -> int:
    """Samples of a rate in [0, ``duration_s``); at least one."""
    return max(1, math.ceil(round(duration_s * rate_hz, 6)))


def frames_until(end_s: float, rate_hz: float) -> int:
    """Samples of a rate in [0, ``end_s``]."""
    return math.floor(round(end_s * rate_hz, 6)) + 1


def samples_until(end_ns: int, rate_hz: float) -> int:
    """Samples of a rate whose times (`times_ns`) are in [0, ``end_ns``]."""
    count = frames_until(1e-9 * end_ns, rate_hz)
    return count - (frame_time_ns(count - 1, rate_hz) > end_ns)


def select(frames: slice, count: int) -> list[int]:
    """Numbers of the frames that a slice names; refuses one that names none."""
    chosen = list(range(count))[frames]
    if not chosen:
        words = ":".join("" if end is None else str(end) for end in (frames.start, frames.stop, frames.step))
        words = words.removesuffix(":")
        raise InputError(
            "names no frame", key="frames", value=words, remedy=f"The sequence has frames 0 to {count - 1}."
        )
    return chosen
