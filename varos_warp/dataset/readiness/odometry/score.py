"""How far an estimated course is from the true one."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

SEGMENT = 0.25
"""Length of the pieces whose drift is stated, as a share of the whole path."""


WRONG_WAY, WRONG_TURN = np.radians(15.0), np.radians(1.0)
"""A step fails whose translation is off in direction, or whose rotation is off, by more."""
STANDS = 0.25
"""Share of the median step below which a step's direction does not count, for there is hardly any."""


class Score(NamedTuple):
    """Errors of one estimate."""

    ate_m: float
    """Root mean square distance after alignment [m]."""
    ate_share: float
    """Root mean square distance after alignment, over the length of the path."""
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


def failed(T_c_w: np.ndarray, lost: np.ndarray, T_w_c: np.ndarray) -> np.ndarray:
    """Return whether the step from each frame to the next failed, bool [N - 1]; the scale of a step does not count.

    It fails if the next frame is ``lost`` [N], or its translation points more than `WRONG_WAY` [rad] elsewhere than the
    true one (whatever its scale, it is then off by a quarter of the step or more; not asked of steps shorter than
    `STANDS`), or its rotation is off by more than `WRONG_TURN` [rad]. Poses [N, 4, 4] are ``T_c_w``, estimated, and
    ``T_w_c``, true.
    """
    found, true = T_c_w[1:] @ np.linalg.inv(T_c_w[:-1]), np.linalg.inv(T_w_c[1:]) @ T_w_c[:-1]
    length = np.linalg.norm(true[:, :3, 3], axis=1)
    astray = (_angle(found[:, :3, 3], true[:, :3, 3]) > WRONG_WAY) & (length >= STANDS * np.median(length))
    return (
        lost[1:]
        | astray
        | (Rotation.from_matrix(found[:, :3, :3] @ true[:, :3, :3].transpose(0, 2, 1)).magnitude() > WRONG_TURN)
    )


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the angles between vectors [N, 3] [rad]."""
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(1))
