"""Differences of evenly spaced samples, by which what sensors read is held against their poses."""

import numpy as np


def slope(x: np.ndarray, h: float) -> np.ndarray:
    """First derivative at x[2:-2], of fourth order."""
    return (x[:-4] - 8 * x[1:-3] + 8 * x[3:-1] - x[4:]) / (12 * h)


def difference2(x: np.ndarray, h: float) -> np.ndarray:
    """Second derivative at x[2:-2], of fourth order."""
    return (-x[4:] + 16 * x[3:-1] - 30 * x[2:-2] + 16 * x[1:-3] - x[:-4]) / (12 * h * h)


def bend(x: np.ndarray) -> np.ndarray:
    """Length of the second difference at x[1:-1]."""
    return np.linalg.norm(x[2:] - 2 * x[1:-1] + x[:-2], axis=1)


def changes(x: np.ndarray) -> np.ndarray:
    """Largest change [N] between neighbours of x [N, 3] within three samples of each."""
    steps = np.pad(np.linalg.norm(np.diff(x, axis=0), axis=1), 3)
    return np.lib.stride_tricks.sliding_window_view(steps, 6)[: len(x)].max(-1)
