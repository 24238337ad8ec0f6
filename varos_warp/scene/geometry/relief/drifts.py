"""What stands in the ground shapes it: a bank of sediment against its foot, and a moat where the current scours.

After the shapes that flow around a body on sand leaves (Whitehouse, "Scour at Marine Structures", 1998): a horseshoe
scour before it and along its sides, and a tail in its lee. Banks lean on what is there as fillets, steep at the wall,
with a toe that thins out.
"""

from functools import partial

import numpy as np

from varos_warp.device.launch import in_threads
from varos_warp.scene.geometry.noise import fbm
from varos_warp.scene.geometry.parts import Instances, Moving, Part
from varos_warp.scene.geometry.relief.recipes.blending import smoothstep
from varos_warp.scene.geometry.surface import Surface

SMALLEST_M, LARGEST_M = 0.03, 1.5
"""Sizes of bodies that drifts are made for [m]; those of larger ones are as high as of the largest."""
BANK, BANK_WIDTH = 0.15, 0.60
"""Height of the bank against the foot, and how far it reaches, as shares of the body's size."""
APRON, APRON_WIDTH = 0.03, 0.60
"""Height of what lies about it widely, and where that falls to 1 / e, as shares of the body's size."""
MOAT, MOAT_AT, MOAT_WIDTH = 0.08, 0.75, 0.30
"""Depth of the moat, where it is deepest and how wide it is, as shares of the body's size."""
REACH = 1.6
"""Beyond this many sizes from a body the ground knows nothing of it."""
UNEVEN, UNEVEN_CYCLES = 1.2, 1.4
"""How much banks and moats differ along a body, over the noise, and cells of the noise over a size."""
WHOLE_M = 0.2
"""Distances from bodies smaller than this [m] count as so much longer: what lies about a stone and where ripples end at
it are in proportion to it."""
UNLIKE = 0.6
"""How much more or less sediment than on average a body has at most, as a share: some are scoured, others banked up."""
BESIDE_M = 0.1
"""How far from a body the ground still tells whether it stands in it [m]."""
TURNS = 36
"""Directions in which the width of a body is measured."""


def surroundings(
    points: np.ndarray, parts: list[Part | Instances], current: np.ndarray, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """What the ground knows of all that stands near: objects and copies, by their surfaces.

    Args:
        parts: All else; what moves leaves no trace.
        current: float64 [2]: the current's horizontal direction; zeros: it comes from everywhere alike.

    Returns:
        Distance [N] from the nearest [m], longer from small ones in proportion, infinite where nothing is near, and
        the height [N] that all together add [m].
    """
    clear, height = np.full(len(points), np.inf), np.zeros(len(points))
    objects = [part for part in parts if not isinstance(part, Instances | Moving)]
    groups = [part for part in parts if isinstance(part, Instances)]
    reaches = [_reaches(group) for group in groups]
    if not len(points) or not (objects or groups):
        return clear, height
    squares = Squares(points[:, :2], max((float(reach.max()) for reach in reaches), default=LARGEST_M))
    near = [partial(_near_object, points, squares, part) for part in objects]
    near += _near_copies(points, squares, groups, reaches)

    def found(one):
        some, own = one
        trace = some()
        if trace is None:
            return None
        chosen, distance, size, aside = trace
        added = drift(distance, size, aside @ current, own + unevenness(points[chosen], size, seed))
        return chosen, distance * max(1.0, WHOLE_M / size), added

    unlike = np.random.default_rng([seed, 1]).uniform(-UNLIKE, UNLIKE, len(near))
    traces = in_threads(found, list(zip(near, unlike, strict=True)))
    for chosen, apart, added in filter(None, traces):  # in the order of the parts
        clear[chosen] = np.minimum(clear[chosen], apart)
        height[chosen] += added
    return clear, height


def drift(distance: np.ndarray, size: float, lee: np.ndarray | float, uneven: np.ndarray | float = 0.0) -> np.ndarray:
    """Height [N] [m] that a body adds to the ground beside it.

    Args:
        distance: From its surface [N] [m].
        size: Of the body [m].
        lee: Cosine [N] of the angle between the current and the direction from the body; 0 without current.
        uneven: How much more there is than on average, as a share.
    """
    x = distance / size
    more = np.clip(1.0 + np.asarray(uneven), 0.35, 1.9)
    fillet = BANK * more * np.square(np.clip(1.0 - x / (BANK_WIDTH * (0.5 + 0.5 * more)), 0.0, 1.0))
    bank = (fillet + APRON * np.exp(-np.square(x / APRON_WIDTH))) * (0.7 + 0.3 * lee)
    moat = MOAT * (2.0 - more) * np.exp(-np.square((x - MOAT_AT) / MOAT_WIDTH)) * (0.5 - 0.5 * lee)
    return size * (bank - moat) * (1.0 - smoothstep(0.7 * REACH, REACH, x))


def unevenness(points: np.ndarray, size: float, seed: int) -> np.ndarray:
    """How much more sediment than on average there is at points [N, 3] by a body of a size, as a share, [N]."""
    return UNEVEN * fbm(points, UNEVEN_CYCLES / size, 3, seed)


def flow_direction(velocity: tuple[float, float, float]) -> np.ndarray:
    """Horizontal unit vector [2] of a current, zeros where there is none."""
    return _directions(np.asarray(velocity, float)[None, :2])[0]


def _near_object(points, squares, part):
    """Points near to an object: their numbers, distances, the object's size, and directions from its surface.

    None where it does not stand in the ground.
    """
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    width = least_width(part.vertices[:, :2])
    reach = REACH * float(np.clip(width, SMALLEST_M, LARGEST_M))
    near = np.sort(squares.within(0.5 * (low + high)[:2], 0.5 * np.linalg.norm((high - low)[:2]) + 1.5 * reach))
    near = near[((points[near] > low - reach) & (points[near] < high + reach)).all(axis=1)]
    ground = _stands(points[near], low, high)
    if ground is None:
        return None
    size = size_of(width, high[2] - ground)
    distance, aside = _beside(Surface(part.vertices, part.faces), points[near], REACH * size)
    there = np.isfinite(distance)
    return near[there], distance[there], size, _directions(aside[there, :2])


def size_of(width: float, height: float) -> float:
    """What banks and moats go by [m]: the lesser of a body's width and of how far it stands out of the ground."""
    return float(np.clip(min(width, height), SMALLEST_M, LARGEST_M))


def _beside(surface, points, reach):
    """Distance [N] of points from a surface, infinite beyond a reach, and the way [N, 3] to them."""
    local = surface.local(points)
    place, face = surface.project(local, reach)
    way = (local - place).astype(float)
    return np.where(face >= 0, np.linalg.norm(way, axis=1), np.inf), way


def _stands(points, low, high):
    """Height of the ground [m] where a body between two corners stands in it; None: it hovers, or lies under it."""
    under = ((points[:, :2] >= low[:2] - BESIDE_M) & (points[:, :2] <= high[:2] + BESIDE_M)).all(axis=1)
    height = points[under if under.any() else slice(None), 2]
    inside = height[(height >= low[2]) & (height <= high[2])]
    return float(np.median(inside)) if len(inside) else None


def least_width(places: np.ndarray) -> float:
    """The least extent of places [N, 2] seen from above, whichever way they are turned [m]."""
    turns = np.linspace(0.0, np.pi, TURNS, endpoint=False)
    return float(np.ptp(places @ np.stack([np.cos(turns), np.sin(turns)]), axis=0).min())


def _near_copies(points, squares, groups, reaches):
    """Functions, one for each copy of some meshes, that find for it what `_near_object` finds for an object."""
    for group, reach in zip(groups, reaches, strict=True):
        mesh = Surface(group.vertices, group.faces), least_width(group.vertices[:, :2])
        for T, s, radius in zip(group.T_w_o, group.scale, reach, strict=True):
            yield partial(_near_copy, points, squares, mesh, T, s, radius)


def _reaches(group):
    """How far from the middles of copies [N] the ground may know of them [m]."""
    width, reach, scale = least_width(group.vertices[:, :2]), np.linalg.norm(group.vertices, axis=1).max(), group.scale
    return scale * (reach + REACH * np.clip(width, SMALLEST_M / scale, LARGEST_M / scale))


def _near_copy(points, squares, mesh, T, s, radius):
    (surface, width), near = mesh, squares.within(T[:2, 3], radius)
    corners = surface.vertices @ T[:3, :3].T + T[:3, 3]
    ground = _stands(points[near], corners.min(axis=0), corners.max(axis=0)) if len(near) else None
    if ground is None:
        return None
    size = size_of(width * s, corners[:, 2].max() - ground)
    own = (points[near] - T[:3, 3]) @ T[:3, :3] / s**2
    distance, aside = _beside(surface, own, REACH * size / s)
    there = np.isfinite(distance)
    return near[there], s * distance[there], size, _directions((aside[there] @ T[:3, :3].T)[:, :2])


class Squares:
    """Points of a plane by the squares of a grid that they lie in: which are near is told without a list of them.

    Args:
        side: Of the squares [m], about as long as radii will be.
    """

    def __init__(self, points: np.ndarray, side: float):
        self._points, self._low, self._side = points, points.min(axis=0), max(side, SMALLEST_M)
        cells = self._cells(points)
        self._across = int(cells[:, 0].max()) + 1
        keys = cells[:, 1] * self._across + cells[:, 0]
        self._order = np.argsort(keys, kind="stable")
        self._keys = keys[self._order]

    def within(self, middle: np.ndarray, radius: float) -> np.ndarray:
        """Numbers of the points that are no farther than a radius from a place [2]."""
        low, high = self._cells(np.stack([middle - radius, middle + radius]))
        left, right = np.clip([low[0], high[0]], 0, self._across - 1)
        rows = self._across * np.arange(low[1], high[1] + 1)
        starts, ends = np.searchsorted(self._keys, rows + left), np.searchsorted(self._keys, rows + right, "right")
        near = self._order[np.concatenate([np.arange(a, b) for a, b in zip(starts, ends, strict=True)])]
        apart = self._points[near] - middle
        return near[apart[:, 0] ** 2 + apart[:, 1] ** 2 <= radius * radius]

    def _cells(self, points):
        return np.floor((points - self._low) / self._side).astype(np.int64)


def _directions(vectors):
    size = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(size > 1e-9, vectors / np.maximum(size, 1e-9), 0.0)
