"""Roots: the arguments at which increasing functions take given values."""

from collections.abc import Callable

import numpy as np

STEPS = 100
"""Most steps; Newton's take 5 to 10, and halving alone gives all digits in 60."""


def solve_increasing(
    function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    target: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Arguments [N] in [low, high] at which an increasing function is ``target``, to the rounding of float64.

    Newton's steps; where one leaves the interval that is known to hold the root, the interval is halved.

    Args:
        function: Gives values [N] and slopes [N] at x [N].
        target: [N]; where it lies beyond the function's values at an end, that end is the result.
        low: Lower ends of the intervals, [N] or numbers.
        high: Upper ends of the intervals, likewise.
    """
    low, high = (np.broadcast_to(end, target.shape).astype(float) for end in (low, high))
    x, size = 0.5 * (low + high), np.maximum(np.abs(low), np.abs(high))
    for _ in range(STEPS):
        value, slope = function(x)
        low, high = np.where(value <= target, x, low), np.where(value >= target, x, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            new = x - (value - target) / slope
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        done = ~(np.abs(new - x) > 2e-16 * size)  # NaN is done, too
        x = new
        if done.all():
            break
    return x


def solve_shortly(
    function: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    target: np.ndarray,
    high: float,
    halvings: int,
    steps: int,
) -> np.ndarray:
    """The root in [0, high] that a fixed number of halvings, then of Newton's steps, finds, in float32 [N]."""
    low, top = np.zeros_like(target), np.full_like(target, high)
    for _ in range(halvings):
        middle = np.float32(0.5) * (low + top)
        below = function(middle)[0] < target
        low, top = np.where(below, middle, low), np.where(below, top, middle)
    x = np.float32(0.5) * (low + top)
    for _ in range(steps):
        value, slope = function(x)
        x = x - (value - target) / slope
    return x
