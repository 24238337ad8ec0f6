"""The clock: one tick is 5 ms, times are integer nanoseconds, every sensor runs at a whole fraction of it."""

import math

import numpy as np

from varos_warp.errors import InputError

TICK_RATE_HZ = 200
TICK_S = 1.0 / TICK_RATE_HZ
TICK_NS = 1_000_000_000 // TICK_RATE_HZ
LONGEST_S = 86_400
"""Longest sequence [s]: a day, whose trajectory is 17 million rows and takes 9 GB to make."""
MAX_TICKS = LONGEST_S * TICK_RATE_HZ


def ticks_per_sample(rate_hz: float, key: str) -> int:
    """Ticks from one sample to the next of a sensor with ``rate_hz``.

    Raises:
        InputError: The rate does not divide 200 Hz, so its samples would fall between ticks; or it is less than one
            sample in the longest sequence.
    """
    step = max(1, round(min(TICK_RATE_HZ / rate_hz, 2.0 * MAX_TICKS)))
    if step > MAX_TICKS:
        raise InputError("is less than a sample a day", key=key, value=rate_hz,
                         remedy=f"Give at least {1.0 / LONGEST_S:.3g} Hz; sequences are no longer than {LONGEST_S} s")
    if not math.isclose(step * rate_hz, TICK_RATE_HZ, rel_tol=1e-9):
        steps = (max(1, whole(TICK_RATE_HZ / rate_hz)) for whole in (math.ceil, math.floor))
        near = " or ".join(f"{TICK_RATE_HZ / step:.10g}" for step in dict.fromkeys(steps))
        raise InputError(f"must divide the simulator's {TICK_RATE_HZ} Hz", key=key, value=rate_hz,
                         remedy=f"Use 200, 100, 50, 40, 25, 20, 10, 8, 5, 4, 2, 1 ... Hz; the nearest is {near}")
    return step


def check_length(seconds: float, key: str, what: str) -> None:
    """Refuse a sequence that would last longer than `LONGEST_S`, by the ``key`` of the scene that makes it so long.

    Raises:
        InputError: It lasts longer.
    """
    if not seconds <= LONGEST_S:
        raise InputError(f"{what} {seconds:.6g} s, more than the {LONGEST_S} s that can be simulated at "
                         f"{TICK_RATE_HZ} Hz", key=key,
                         remedy="Make it shorter (nearer stops, a higher speed) or divide it into several scenes")


def times_ns(count: int, step: int = 1) -> np.ndarray:
    """Times [count] of the samples taken every ``step`` ticks from tick 0; int64, never through a float."""
    return np.arange(count, dtype=np.int64) * (step * TICK_NS)


def frame_count(duration_s: float, step: int) -> int:
    """Frames in [0, ``duration_s``) at one every ``step`` ticks; at least one."""
    return max(1, math.ceil(round(duration_s * TICK_RATE_HZ / step, 6)))
