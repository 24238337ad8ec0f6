"""The clock: one tick is 5 ms, times are integer nanoseconds, every sensor runs at a whole fraction of it."""

import math

import numpy as np

from varos_warp.errors import InputError

TICK_RATE_HZ = 200
TICK_S = 1.0 / TICK_RATE_HZ
TICK_NS = 1_000_000_000 // TICK_RATE_HZ


def ticks_per_sample(rate_hz: float, key: str) -> int:
    """Ticks from one sample to the next of a sensor with ``rate_hz``.

    Raises:
        InputError: The rate does not divide 200 Hz, so its samples would fall between ticks.
    """
    step = max(1, round(TICK_RATE_HZ / rate_hz))
    if not math.isclose(step * rate_hz, TICK_RATE_HZ, rel_tol=1e-9):
        faster = TICK_RATE_HZ / max(1, math.floor(TICK_RATE_HZ / rate_hz))
        slower = TICK_RATE_HZ / max(1, math.ceil(TICK_RATE_HZ / rate_hz))
        near = " or ".join(f"{rate:.10g}" for rate in dict.fromkeys((slower, faster)))
        raise InputError(f"must divide the simulator's {TICK_RATE_HZ} Hz", key=key, value=rate_hz,
                         remedy=f"Use 200, 100, 50, 40, 25, 20, 10, 8, 5, 4, 2, 1 ... Hz; the nearest is {near}")
    return step


def times_ns(count: int, step: int = 1) -> np.ndarray:
    """Times [count] of the samples taken every ``step`` ticks from tick 0; int64, never through a float."""
    return np.arange(count, dtype=np.int64) * (step * TICK_NS)


def frame_count(duration_s: float, step: int) -> int:
    """Frames in [0, ``duration_s``) at one every ``step`` ticks; at least one."""
    return max(1, math.ceil(round(duration_s * TICK_RATE_HZ / step, 6)))
