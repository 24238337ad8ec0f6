"""Rows of vectors turned and multiplied, each to the byte as it would be among others."""

import numpy as np
from scipy.spatial.transform import Rotation


def applied(rotation: Rotation, vectors: np.ndarray) -> np.ndarray:
    """Vectors [N, 3] (or [3], the same for all) turned by N rotations, each to the byte as it would be among others.

    For a single row NumPy adds in another order than for several, so one is turned twice.
    """
    if len(rotation) != 1:
        return rotation.apply(vectors)
    return rotation[[0, 0]].apply(np.repeat(np.atleast_2d(vectors), 2, axis=0))[:1]


def product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Rows [N, n] times a matrix [n, m], each to the byte as it would be among others: see `applied`."""
    return rows @ matrix if len(rows) != 1 else (np.repeat(rows, 2, axis=0) @ matrix)[:1]


# Differences of evenly spaced samples, by which what sensors read is held against the poses.


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
