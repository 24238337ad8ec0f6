"""What stands in the ground shapes it: a bank of sediment against its foot, and a moat where the current scours.

After the shapes that flow around a body on sand leaves (Whitehouse, "Scour at Marine Structures", 1998): a horseshoe
scour before it and along its sides, and a tail in its lee.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.parts import Instances, Moving, Part
from varos_warp.scene.geometry.surface import Surface

SMALLEST_M, LARGEST_M = 0.05, 2.5
"""Widths of bodies that drifts are made for [m]; those of wider ones are as high as of the widest."""
BANK, BANK_WIDTH = 0.07, 0.16
"""Height of the bank against the foot, and where it falls to 1 / e, as shares of the body's width."""
MOAT, MOAT_AT, MOAT_WIDTH = 0.035, 0.40, 0.20
"""Depth of the moat, where it is deepest and how wide it is, likewise."""
REACH = 1.2
"""Beyond this many widths from a body the ground knows nothing of it."""


@dataclass(frozen=True, eq=False)
class Neighbours:
    """What stands nearest to points of the ground."""

    distance: np.ndarray
    """float64 [N] [m]; infinite where nothing is near."""
    width: np.ndarray
    """float64 [N]: width of the body [m]."""
    aside: np.ndarray
    """float64 [N, 2]: horizontal unit vector from its middle."""


def neighbours(points: np.ndarray, parts: list[Part | Instances]) -> Neighbours:
    """What stands nearest to points [N, 3]: objects by their surface, copies by the circle that they fill."""
    found = Neighbours(np.full(len(points), np.inf), np.full(len(points), SMALLEST_M), np.zeros((len(points), 2)))
    objects = [part for part in parts if isinstance(part, Part) and not isinstance(part, Moving)]
    if objects:
        _nearest_objects(points, objects, found)
    for group in parts:
        if isinstance(group, Instances):
            _nearest_copies(points, group, found)
    return found


def _nearest_objects(points, objects, found):
    low, high = (np.array([f(part.vertices, axis=0) for part in objects]) for f in (np.min, np.max))
    width = np.clip((high - low)[:, :2].min(axis=1), SMALLEST_M, LARGEST_M)
    reach = REACH * width.max()
    near = np.flatnonzero(((points[:, None] > low - reach) & (points[:, None] < high + reach)).all(axis=2).any(axis=1)
                          if len(objects) * len(points) < 1 << 26 else np.ones(len(points), bool))
    number = np.repeat(np.arange(len(objects)), [len(part.faces) for part in objects])
    distance, face = Surface(*join([(part.vertices, part.faces) for part in objects])).nearest(points[near], reach)
    there = near[np.isfinite(distance)]
    of = number[face[np.isfinite(distance)]]
    found.distance[there], found.width[there] = distance[np.isfinite(distance)], width[of]
    found.aside[there] = _directions(points[there, :2] - 0.5 * (low + high)[of, :2])


def _nearest_copies(points, group, found):
    foot = np.linalg.norm(group.vertices[:, :2], axis=1).max() * 0.8
    width = np.clip(2.0 * foot * group.scale, SMALLEST_M, LARGEST_M)
    middle = group.T_w_o[:, :2, 3]
    off, copy = cKDTree(middle).query(points[:, :2], distance_upper_bound=foot * group.scale.max() + REACH * width.max(),
                                      workers=-1)
    near = np.flatnonzero(np.isfinite(off))
    distance = np.maximum(off[near] - (foot * group.scale)[copy[near]], 0.0)
    nearer = distance < found.distance[near]
    there, of = near[nearer], copy[near[nearer]]
    found.distance[there], found.width[there] = distance[nearer], width[of]
    found.aside[there] = _directions(points[there, :2] - middle[of])


def drift(found: Neighbours, current: np.ndarray) -> np.ndarray:
    """Height [N] that what stands near adds to the ground [m].

    Args:
        found: What stands near.
        current: float [2]: the current's horizontal direction; zeros: it comes from everywhere alike.
    """
    x = found.distance / found.width
    lee = found.aside @ current
    bank = BANK * np.exp(-np.square(x / BANK_WIDTH)) * (0.7 + 0.3 * lee)
    moat = MOAT * np.exp(-np.square((x - MOAT_AT) / MOAT_WIDTH)) * (0.5 - 0.5 * lee)
    return np.where(x < REACH, found.width * (bank - moat), 0.0)


def flow_direction(velocity) -> np.ndarray:
    """Horizontal unit vector [2] of a current, zeros where there is none."""
    return _directions(np.asarray(velocity, float)[None, :2])[0]


def _directions(vectors):
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > 1e-9, vectors / np.maximum(size, 1e-9), 0.0)
