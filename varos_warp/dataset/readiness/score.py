"""How far an estimated course is from the true one."""

from typing import NamedTuple

import numpy as np

SEGMENT = 0.25
"""Of the whole path: length of the pieces whose drift is stated."""


class Score(NamedTuple):
    """Errors of one estimate."""

    ate_m: float
    """Root mean square distance after alignment [m]."""
    ate_share: float
    """The same over the length of the path."""
    drift: float
    """Mean error of the displacement over pieces of a quarter of the path, over their length."""


def aligned(estimate: np.ndarray, truth: np.ndarray, with_scale: bool) -> np.ndarray:
    """Points [N, 3] onto ``truth`` [N, 3] by least squares (Umeyama 1991): rotation, shift and, if asked, scale."""
    middle, target = estimate.mean(0), truth.mean(0)
    a, b = estimate - middle, truth - target
    U, S, Vt = np.linalg.svd(b.T @ a / len(a))
    sign = np.array([1.0, 1.0, np.linalg.det(U) * np.linalg.det(Vt)])
    R = (U * sign) @ Vt
    spread = (a**2).sum() / len(a)
    scale = float((S * sign).sum() / spread) if with_scale and spread > 0 else 1.0
    return scale * a @ R.T + target


def path_length(places: np.ndarray) -> float:
    """Metres of the way through places [N, 3]."""
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def score(estimate: np.ndarray, truth: np.ndarray, with_scale: bool) -> Score:
    """Errors of places [N, 3] of a camera; the way through ``truth`` must have a length."""
    moved, length = aligned(estimate, truth, with_scale), path_length(truth)
    ate = float(np.sqrt(((moved - truth) ** 2).sum(1).mean()))
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(truth, axis=0), axis=1)))
    end = np.searchsorted(way, way + SEGMENT * length * (1 - 1e-9))
    start = np.flatnonzero(end < len(way))
    end = end[start]
    off = np.linalg.norm((moved[end] - moved[start]) - (truth[end] - truth[start]), axis=1)
    return Score(ate, ate / length, float((off / (way[end] - way[start])).mean()))
