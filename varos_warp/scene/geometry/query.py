"""Queries of triangle meshes: crossings of vertical lines and insides, in float64; clearances; how far rays go."""

from collections.abc import Callable, Container

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.parts import Grown, Instances, Moving, Part
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import compact, extents


def crossings(vertices: np.ndarray, faces: np.ndarray, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Crossings of vertical lines through the points ``xy`` [N, 2] with the mesh: numbers of line and face, height z.

    They are sorted by line, then by height [m]. A line through an edge or a vertex crosses one of the faces that meet
    there (half-open edges), so that the number of crossings above a point tells inside from outside. Triangles are
    sorted into trees by size, so that few large ones do not spoil the search among many small ones.
    """
    xy = np.atleast_2d(np.asarray(xy, float))
    around = _around(vertices, faces, xy, 0.0)
    triangles = np.asarray(vertices, float)[faces[around]]
    low, high = extents(triangles[..., :2])
    centre, radius = 0.5 * (low + high), 0.5 * np.linalg.norm(high - low, axis=1)
    size = np.frexp(radius)[1]
    line, face = [np.zeros(0, int)], [np.zeros(0, int)]
    for exponent in np.unique(size):
        members = np.flatnonzero(size == exponent)
        near = cKDTree(centre[members]).query_ball_point(xy, radius[members].max() + 1e-6)  # more than rounding
        line.append(np.repeat(np.arange(len(xy)), [len(found) for found in near]))
        face.append(members[np.concatenate([*near, []]).astype(int)])
    line, face = np.concatenate(line), np.concatenate(face)
    covers = _covers(triangles[face], *xy[line].T)
    line, face = line[covers], face[covers]
    a, b, c = np.moveaxis(triangles[face], 1, 0)
    n, (x, y) = np.cross(b - a, c - a), xy[line].T
    z = a[:, 2] - (n[:, 0] * (x - a[:, 0]) + n[:, 1] * (y - a[:, 1])) / n[:, 2]
    order = np.lexsort((z, line))
    return line[order], around[face[order]], z[order]


def heights_at(vertices: np.ndarray, faces: np.ndarray, xy: np.ndarray) -> list[np.ndarray]:
    """Heights z [m] at which vertical lines through the points ``xy`` [N, 2] cross the mesh, ascending, per point."""
    count = len(np.atleast_2d(xy))
    line, _, z = crossings(vertices, faces, xy)
    return np.split(z, np.searchsorted(line, np.arange(1, count)))


def is_inside(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, box: np.ndarray | None = None) -> np.ndarray:
    """Return whether points [N, 3] lie in a closed mesh or under open terrain, bool [N], by parity of what is above.

    ``box`` holds the mesh's least and greatest coordinates [2, 3], where they are known.
    """
    points = np.atleast_2d(points)
    inside = np.zeros(len(points), bool)
    low, high = _box_of(vertices) if box is None else box
    maybe = np.flatnonzero((points[:, :2] >= low[:2]).all(axis=1) & (points <= high).all(axis=1))
    if len(maybe):
        overhead = heights_at(vertices, faces, points[maybe, :2])
        inside[maybe] = [np.count_nonzero(z > p) % 2 for z, p in zip(overhead, points[maybe, 2], strict=True)]
    return inside


def clearance(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, reach: float, box: np.ndarray | None = None
) -> np.ndarray:
    """Distance [N] from points [N, 3] to the mesh where it is below ``reach`` [m]; infinite elsewhere.

    Only the part of the mesh around the points is looked at. ``box`` is as for `is_inside`.
    """
    points = np.atleast_2d(np.asarray(points, float))
    low, high = _box_of(vertices) if box is None else box
    around = np.zeros(0, int)
    if (low <= points.max(axis=0) + reach).all() and (high >= points.min(axis=0) - reach).all():
        around = _around(vertices, faces, points, reach)
    if not len(around):
        return np.full(len(points), np.inf)
    surface = Surface(*compact(vertices, faces[around]))
    rounding = 1e-6 * max(reach, np.abs(points - surface.origin).max())
    distance, _ = surface.nearest(points, reach + rounding)
    return np.where(distance < reach, distance, np.inf)


def _box_of(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates [3] of vertices."""
    return vertices.min(axis=0), vertices.max(axis=0)


def _around(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, margin: float) -> np.ndarray:
    """Numbers of the faces whose boxes meet the box around points [N, k], which has a margin, along the first k axes.

    Which sides of that box a vertex is beyond is a byte; a face that all its vertices are beyond one of is not around.
    """
    if not len(points):
        return np.zeros(0, int)
    beyond = np.zeros(len(vertices), np.uint8)
    for axis, (low, high) in enumerate(zip(points.min(axis=0) - margin, points.max(axis=0) + margin, strict=True)):
        beyond |= (vertices[:, axis] > high).view(np.uint8) << np.uint8(2 * axis)
        beyond |= (vertices[:, axis] < low).view(np.uint8) << np.uint8(2 * axis + 1)
    a, b, c = faces.T
    return np.flatnonzero((beyond[a] & beyond[b] & beyond[c]) == 0)


def _covers(triangles, x, y):
    """Even-odd rule in the horizontal plane; each edge is evaluated from its lower end, alike for both its faces.

    ``x`` and ``y`` are a point for every triangle, [n].
    """
    inside = np.zeros(len(triangles), bool)
    for i in range(3):
        a, b = triangles[:, i, :2], triangles[:, (i + 1) % 3, :2]
        swap = (a[:, 1] > b[:, 1]) | ((a[:, 1] == b[:, 1]) & (a[:, 0] > b[:, 0]))
        a, b = np.where(swap[:, None], b, a), np.where(swap[:, None], a, b)
        spans = (a[:, 1] <= y) & (y < b[:, 1])
        rise = np.where(spans, b[:, 1] - a[:, 1], 1.0)
        inside ^= spans & (x < a[:, 0] + (y - a[:, 1]) / rise * (b[:, 0] - a[:, 0]))
    return inside


def ranges(parts: list[Part | Instances], points: np.ndarray, directions: np.ndarray, reach: float) -> np.ndarray:
    """Distance [N] along rays to the first surface, float64 [m]; infinite where there is none within ``reach`` [m].

    Args:
        points: Where the rays start, float64 [N, 3] [m], world axes.
        directions: Unit vectors [N, 3].
    """
    return Solids(parts).first_met(points, directions, reach, {})[0]


class Solids:
    """Everything solid, for rays from here and there: each BVH is built when first asked for, and kept.

    Args:
        grown: Whether what grows on them counts; beams of sound are wider than it.
    """

    def __init__(self, parts: list[Part | Instances], grown: bool = False):
        self.parts = [part for part in parts if grown or not isinstance(part, Grown)]
        self._surfaces: dict[tuple, Surface] = {}

    def first_met(
        self, points: np.ndarray, directions: np.ndarray, reach: float, T_w_o: dict[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What `ranges` gives, and which of ``T_w_o`` each ray meets, int [N]: its place there.

        -1 is what stands still, or nothing.
        """
        t = self._to_standing(points, directions, T_w_o)
        met, places = np.full(len(points), -1), {name: k for k, name in enumerate(T_w_o)}
        for group in self.parts:
            if group.name in T_w_o:
                there = self._to_moving(group, points, directions, T_w_o[group.name])
                met[there < np.minimum(t, reach)] = places[group.name]
                t = np.minimum(t, there)
            if isinstance(group, Instances):
                there = self._to_copies(group, points, directions, np.minimum(t, reach))
                met[there < t] = -1
                t = np.minimum(t, there)
        return np.where(t <= reach, t, np.inf), met

    def _surface(self, key: tuple, mesh: Callable[[], tuple[np.ndarray, np.ndarray]]) -> Surface:
        """The BVH of a mesh, made at the first call with this key."""
        if key not in self._surfaces:
            self._surfaces[key] = Surface(*mesh())
        return self._surfaces[key]

    def _to_standing(self, points: np.ndarray, directions: np.ndarray, moving: Container[str]) -> np.ndarray:
        """Distance [N] along rays to terrain and objects but those that are ``moving``."""
        single = [part for part in self.parts if isinstance(part, Part) and part.name not in moving]
        if not single:
            return np.full(len(points), np.inf)
        surface = self._surface(
            ("standing", *(part.name for part in single)),
            lambda: join([(part.vertices, part.faces) for part in single]),
        )
        return surface.distances(points, directions)

    def _to_moving(self, part: Moving, points: np.ndarray, directions: np.ndarray, T_w_o: np.ndarray) -> np.ndarray:
        """Distance [N] along rays to an object at its pose for each of them [N, 4, 4]."""
        R_o_w = T_w_o[:, :3, :3].swapaxes(1, 2)
        start, d = (np.einsum("nij,nj->ni", R_o_w, x) for x in (points - T_w_o[:, :3, 3], directions))
        surface = self._surface(("moving", part.name), lambda: ((part.vertices - part.origin) @ part.R_w_o, part.faces))
        return surface.distances(start, d)

    def _to_copies(self, group: Instances, points: np.ndarray, directions: np.ndarray, reach: np.ndarray) -> np.ndarray:
        """Distance [N] along rays to the first of the copies; only those near to a ray's way [N] are looked at."""
        t, (ray, copy) = np.full(len(points), np.inf), _near(group, points, directions, reach)
        if len(ray):
            # directions are not normalised in the copy's axes, so that t stays in units of the world
            R = np.linalg.inv(group.T_w_o[copy, :3, :3])
            start, d = points[ray] - group.T_w_o[copy, :3, 3], directions[ray]
            surface = self._surface(("copies", id(group)), lambda: (group.vertices, group.faces))
            np.minimum.at(t, ray, surface.distances(*((R @ x[..., None])[..., 0] for x in (start, d))))
        return t


def _near(
    group: Instances, points: np.ndarray, directions: np.ndarray, reach: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a ray's and a copy's number where the ray's way passes the sphere about the copy."""
    if not len(group) or not len(points):
        return np.zeros(0, int), np.zeros(0, int)
    radius = group.scale * np.linalg.norm(group.vertices, axis=1).max() * (1.0 + 1e-6)
    centre, half = group.T_w_o[:, :3, 3], 0.5 * reach
    found = cKDTree(centre).query_ball_point(points + half[:, None] * directions, half + radius.max())
    ray = np.repeat(np.arange(len(points)), [len(copies) for copies in found])
    copy = np.concatenate([*found, []]).astype(int)
    off = centre[copy] - points[ray]
    along = np.clip((off * directions[ray]).sum(axis=1), 0.0, reach[ray])
    passes = np.linalg.norm(off - along[:, None] * directions[ray], axis=1) <= radius[copy]
    return ray[passes], copy[passes]
