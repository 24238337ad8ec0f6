"""What stands in the ground shapes it: a bank of sediment against its foot, and a moat where the current scours.

After the shapes that flow around a body on sand leaves (Whitehouse, "Scour at Marine Structures", 1998): a horseshoe
scour before it and along its sides, and a tail in its lee.
"""

import itertools

import numpy as np
import trimesh
from scipy.spatial import cKDTree

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
FOOT = 0.8
"""Radius of the circle that a copy fills on the ground, over its largest radius seen from above."""
BESIDE_M = 0.1
"""How far from a body the ground still tells whether it stands in it [m]."""
TURNS = 36
"""Directions in which the width of a body is measured."""


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
        lee: Cosine [N] of the angle between the current and the direction from the body; 0 without current.
    """
    x = distance / width
    bank = BANK * np.exp(-np.square(x / BANK_WIDTH)) * (0.7 + 0.3 * lee)
    moat = MOAT * np.exp(-np.square((x - MOAT_AT) / MOAT_WIDTH)) * (0.5 - 0.5 * lee)
    return np.where(x < REACH, width * (bank - moat), 0.0)


def flow_direction(velocity: tuple[float, float, float]) -> np.ndarray:
    """Horizontal unit vector [2] of a current, zeros where there is none."""
    return _directions(np.asarray(velocity, float)[None, :2])[0]


def _near_object(points, part):
    """Points near to an object: their numbers, distances, the object's width, and directions from its surface."""
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    width = float(np.clip(_least_width(part.vertices[:, :2]), SMALLEST_M, LARGEST_M))
    reach = REACH * width
    near = np.flatnonzero(((points > low - reach) & (points < high + reach)).all(axis=1))
    if _stands(points[near], low, high):
        distance, face = Surface(part.vertices, part.faces).nearest(points[near], reach)
        there = np.isfinite(distance)
        place = trimesh.triangles.closest_point(part.vertices[part.faces[face[there]]], points[near[there]])
        yield near[there], distance[there], width, _directions(points[near[there], :2] - place[:, :2])


def _stands(points, low, high):
    """Whether a body between two corners stands in the ground: it neither hovers over it nor lies under it."""
    under = ((points[:, :2] >= low[:2] - BESIDE_M) & (points[:, :2] <= high[:2] + BESIDE_M)).all(axis=1)
    height = points[under if under.any() else slice(None), 2]
    return bool(((height >= low[2]) & (height <= high[2])).any())


def _least_width(places):
    """The least extent of places [N, 2] seen from above, whichever way they are turned."""
    turns = np.linspace(0.0, np.pi, TURNS, endpoint=False)
    return np.ptp(places @ np.stack([np.cos(turns), np.sin(turns)]), axis=0).min()


def _near_copies(points, groups):
    """Likewise of every copy, by the circle that it fills, and directions from its middle."""
    if not groups or not len(points):
        return
    tree = cKDTree(points[:, :2])
    for group in groups:
        foot = FOOT * np.linalg.norm(group.vertices[:, :2], axis=1).max() * group.scale
        width, middle = np.clip(2.0 * foot, SMALLEST_M, LARGEST_M), group.T_w_o[:, :2, 3]
        near = tree.query_ball_point(middle, foot + REACH * width, workers=-1)
        for chosen, where, radius, wide in zip(map(np.asarray, near), middle, foot, width, strict=True):
            if len(chosen):
                off = points[chosen, :2] - where
                distance = np.maximum(np.linalg.norm(off, axis=1) - radius, 0.0)
                yield chosen.astype(int), distance, wide, _directions(off)


def _directions(vectors):
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > 1e-9, vectors / np.maximum(size, 1e-9), 0.0)
