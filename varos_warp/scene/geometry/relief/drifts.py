"""What stands in the ground shapes it: a bank of sediment against its foot, and a moat where the current scours.

After the shapes that flow around a body on sand leaves (Whitehouse, "Scour at Marine Structures", 1998): a horseshoe
scour before it and along its sides, and a tail in its lee.
"""

import itertools

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.geometry.parts import Instances, Moving, Part
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import chunks

SMALLEST_M, LARGEST_M = 0.05, 2.5
"""Widths of bodies that drifts are made for [m]; those of wider ones are as high as of the widest."""
BANK, BANK_WIDTH = 0.07, 0.16
"""Height of the bank against the foot, and where it falls to 1 / e, as shares of the body's width."""
MOAT, MOAT_AT, MOAT_WIDTH = 0.035, 0.40, 0.20
"""Depth of the moat, where it is deepest and how wide it is, likewise."""
REACH = 1.2
"""Beyond this many widths from a body the ground knows nothing of it."""
FOOT = 0.8
"""Radius of the circle that a copy fills on the ground, over its largest radius seen from above."""
COPIES = 6
"""Copies that shape one place, at most, the nearest."""


def surroundings(points: np.ndarray, parts: list[Part | Instances], current: np.ndarray
                 ) -> tuple[np.ndarray, np.ndarray]:
    """What the ground knows of all that stands near: objects by their surfaces, copies by the circles that they fill.

    Args:
        points: float64 [N, 3], of the ground.
        parts: All else; what moves leaves no trace.
        current: float64 [2]: the current's horizontal direction; zeros: it comes from everywhere alike.

    Returns:
        Distance [N] from the nearest [m], infinite where nothing is near, and the height [N] that all together add [m].
    """
    clear, height = np.full(len(points), np.inf), np.zeros(len(points))
    groups = [part for part in parts if isinstance(part, Instances)]
    objects = [part for part in parts if not isinstance(part, Instances | Moving)]
    found = itertools.chain(*(_near_object(points, part) for part in objects), _near_copies(points, groups))
    for chosen, distance, width, aside in found:
        clear[chosen] = np.minimum(clear[chosen], distance)
        height[chosen] += drift(distance, width, aside @ current)
    return clear, height


def drift(distance: np.ndarray, width: np.ndarray | float, lee: np.ndarray | float) -> np.ndarray:
    """Height [N] [m] that a body adds to the ground beside it.

    Args:
        distance: From its surface [N] [m].
        width: Of the body [m].
        lee: Cosine [N] of the angle between the current and the direction from the body's middle; 0 without current.
    """
    x = distance / width
    bank = BANK * np.exp(-np.square(x / BANK_WIDTH)) * (0.7 + 0.3 * lee)
    moat = MOAT * np.exp(-np.square((x - MOAT_AT) / MOAT_WIDTH)) * (0.5 - 0.5 * lee)
    return np.where(x < REACH, width * (bank - moat), 0.0)


def flow_direction(velocity: tuple[float, float, float]) -> np.ndarray:
    """Horizontal unit vector [2] of a current, zeros where there is none."""
    return _directions(np.asarray(velocity, float)[None, :2])[0]


def _near_object(points, part):
    """Points near to an object: their numbers, distances, the object's width, and directions from its middle."""
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    width = float(np.clip((high - low)[:2].min(), SMALLEST_M, LARGEST_M))
    reach = REACH * width
    near = np.flatnonzero(((points > low - reach) & (points < high + reach)).all(axis=1))
    if len(near):
        distance, _ = Surface(part.vertices, part.faces).nearest(points[near], reach)
        there = np.isfinite(distance)
        yield near[there], distance[there], width, _directions(points[near[there], :2] - 0.5 * (low + high)[:2])


def _near_copies(points, groups):
    """Likewise of the nearest few copies, one after the other."""
    if not groups:
        return
    foot = np.concatenate([FOOT * np.linalg.norm(group.vertices[:, :2], axis=1).max() * group.scale
                           for group in groups])
    width = np.clip(2.0 * foot, SMALLEST_M, LARGEST_M)
    middle = np.concatenate([group.T_w_o[:, :2, 3] for group in groups])
    tree, most = cKDTree(middle), min(COPIES, len(middle))
    for part in chunks(len(points)):
        off, copy = tree.query(points[part, :2], k=np.arange(1, most + 1), workers=-1,
                               distance_upper_bound=float((foot + REACH * width).max()))
        for k in range(most):
            near = np.flatnonzero(np.isfinite(off[:, k]))
            of, chosen = copy[near, k], part.start + near
            yield (chosen, np.maximum(off[near, k] - foot[of], 0.0), width[of],
                   _directions(points[chosen, :2] - middle[of]))


def _directions(vectors):
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > 1e-9, vectors / np.maximum(size, 1e-9), 0.0)
