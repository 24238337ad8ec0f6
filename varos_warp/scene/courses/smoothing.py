"""The noise of recorded poses: smoothing splines (Reinsch 1967), as a low-pass filter that is stated in seconds.

The cubic spline s minimises the integral of (y - s)^2 + (T / 2 pi)^4 (s'')^2. Of an oscillation with the period P it
leaves 1 / (1 + (T / P)^4) without any delay, and a straight line at constant speed as it is, up to its ends.
It is `scipy.interpolate.make_smoothing_spline` at its own times, with one factorisation for all columns and without the
spline: a million places take a second and 220 MB, where SciPy 1.17 takes 49 s and 330 MB.
"""

import numpy as np
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation


def smoothed(seconds: np.ndarray, values: np.ndarray, period_s: float) -> np.ndarray:
    """Values [N, k] of the smoothing spline at the times [N] [s] of the values that it smooths [N, k].

    Each value weighs as the time that it stands for, so that the filter does not depend on how densely they lie.
    """
    if len(seconds) < 3:
        return values
    h = np.diff(seconds)
    weight = 0.5 * (np.r_[h, 0.0] + np.r_[0.0, h])
    strength = (period_s / (2.0 * np.pi)) ** 4
    start = values - values[0]
    before, after = 1.0 / h[:-1], 1.0 / h[1:]
    second = np.stack([before, -before - after, after])  # Q: row i makes a second difference of i, i + 1, i + 2
    inverse = strength / weight
    # R + strength Q^T W^-1 Q, of which the upper half has three bands
    bands = np.zeros((3, len(h) - 1))
    bands[2] = (h[:-1] + h[1:]) / 3.0 + (second**2 * np.stack([inverse[:-2], inverse[1:-1], inverse[2:]])).sum(axis=0)
    bands[1, 1:] = h[1:-1] / 6.0 + (
        second[1, :-1] * second[0, 1:] * inverse[1:-2] + second[2, :-1] * second[1, 1:] * inverse[2:-1]
    )
    bands[0, 2:] = second[2, :-2] * second[0, 2:] * inverse[2:-2]
    right = second[0, :, None] * start[:-2] + second[1, :, None] * start[1:-1] + second[2, :, None] * start[2:]
    curvature = solveh_banded(bands, right)
    change = np.zeros_like(start)
    for k in range(3):
        change[k : len(start) - 2 + k] += second[k, :, None] * curvature
    return values - inverse[:, None] * change


def smoothed_attitudes(seconds: np.ndarray, turned: Rotation, period_s: float) -> Rotation:
    """Attitudes whose quaternions are smoothed, with signs that make neighbours alike, and made unit again.

    A turn at constant rate stays as it is, but near its ends; a small oscillation is filtered as one of the place.
    """
    q = turned.as_quat()
    flips = np.sign((q[1:] * q[:-1]).sum(axis=1))
    q = q * np.cumprod(np.r_[1.0, np.where(flips < 0.0, -1.0, 1.0)])[:, None]
    return Rotation.from_quat(smoothed(seconds, q, period_s))
