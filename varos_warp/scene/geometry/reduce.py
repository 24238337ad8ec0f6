"""Triangles taken away from a mesh for as long as its surface stays within a tolerance that varies from place to place.

The faces are divided into bands of similar tolerance and each band is decimated with its rim held fast. What was made
is a map from vertices to fewer vertices, so it opens no cracks. It is measured against the original, both ways; where
it lies too far off, the vertices that were merged there are taken apart again, until all of it is within the
tolerance. Bands of later rounds are offset, so that the rims of the first lie inside the bands of the next.
"""

from collections.abc import Callable
from dataclasses import dataclass

import fast_simplification
import numpy as np
import trimesh
import warp as wp

from varos_warp.kernels.conventions import FAR
from varos_warp.kernels.mesh.project import find_nearest
from varos_warp.scene.geometry.normals import face_normals
from varos_warp.scene.geometry.terrain import Surface

BAND = 2.0
"""Ratio of the tolerances at the two ends of a band."""
FINEST = 2.0**-14
"""Tolerances below this share of the largest are not worth a band: such faces are kept."""
ROUNDS = (0.0, 0.5)
"""By how much of a band the bands of each round are offset."""
EAGERNESS = 3.5
"""Root of the quadric error up to which edges are collapsed, in units of a band's least tolerance. The quadric sums
squares over planes, and their accumulated error is some ten times the distance found afterwards; less leaves more
triangles, and so does more, since more has to be taken apart again."""
KEPT = -1000
"""The band of faces that are kept."""
LARGEST = 0.25
"""No larger quadric error is used, in units of a band's extent: nothing would be left."""
FEWEST = 32
"""Bands of fewer faces are left as they are."""
SPACING = 0.5
"""Of the points along edges from which crossings are found, in units of the original's median edge."""
MARGIN = 0.97
"""Share of the tolerance that may be found where it is measured; on rough terrain one in a million random points still
lies beyond the tolerance, by up to 18 %, beside edges that were missed."""
FACING = 0.5
"""Least cosine between a face and the original under its middle; slivers across the surface have less."""
ROUNDING = 1e-6
"""Of float32 coordinates: distances that are so near to a tolerance, in units of the mesh's size, are taken anew."""

Tolerance = Callable[[np.ndarray], np.ndarray]
"""From points [N, 3] to the distances [N] that the surface may lie off there."""


def reduce_mesh(vertices: np.ndarray, faces: np.ndarray, tolerance: Tolerance) -> tuple[np.ndarray, np.ndarray]:
    """A mesh with fewer triangles that lies within ``tolerance`` of the given one, and the given one of it.

    Edges of one face only stay exactly as they are, and no new ones appear: a closed mesh stays closed. The same input
    gives the same mesh. Faces that are there twice count once, whichever way they look. Quadric edge collapses
    (Garland and Heckbert 1997) by fast-simplification.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
        tolerance: How far the surface may move, by place [m].

    Returns:
        Vertices float64 [v, 3] and faces int32 [f, 3].
    """
    if len(faces) < FEWEST or not tolerance(vertices).max() > 0.0:
        return vertices, faces
    faces = _distinct(faces)
    original = Surface(vertices, faces)
    spacing = SPACING * edge_length(original)
    for offset in ROUNDS:
        vertices, faces = _reduce_once(original, spacing, vertices, faces, tolerance, offset)
    return vertices, faces


@dataclass(frozen=True)
class Deviation:
    """Distances between a mesh and the original, both ways, at the places where they can be largest."""

    points: np.ndarray
    """float64 [N, 3]"""
    distance: np.ndarray
    """float64 [N] [m]"""
    limit: np.ndarray
    """Tolerance there, float64 [N] [m]."""
    face: np.ndarray
    """Face of the mesh that each belongs to, int [N]; first those of the original's vertices."""
    turned: np.ndarray
    """Whether a face looks elsewhere than the original under it, bool; one for each face asked about."""


def deviation(original: Surface, mesh: Surface, tolerance: Tolerance, vertices: np.ndarray | None = None,
              faces: np.ndarray | None = None, spacing: float | None = None) -> Deviation:
    """Distances between two meshes, both ways.

    Where one can be projected onto the other, two surfaces of flat triangles are farthest apart at a vertex of either
    or where an edge of one crosses an edge of the other. So the vertices of the original are measured to the mesh, and
    of the mesh its vertices, the middles of its faces and points along its edges: ``spacing`` apart, and then where
    they cross the edges of the original's faces that lie there.

    Args:
        original: The mesh as given.
        mesh: The mesh compared with it.
        tolerance: How far they may be apart. Distances near it and above are taken in float64, others in float32.
        vertices: Which vertices of ``original`` to measure, int [n]; absent: all.
        faces: Which faces of ``mesh``, int [f]; absent: all.
        spacing: Of the points along edges [m]; absent: ``SPACING`` times the original's edges.
    """
    there = original.vertices if vertices is None else original.vertices[vertices]
    faces = np.arange(len(mesh.faces)) if faces is None else faces
    corners = mesh.faces[faces]
    used, first = np.unique(corners, return_index=True)
    lines = Lines.along(mesh.vertices, corners, spacing or SPACING * edge_length(original))
    back = np.concatenate([mesh.vertices[corners].mean(axis=1), mesh.vertices[used], lines.points()])
    limit = tolerance(back)
    d_back, below = nearest(original, back, limit)
    looks = face_normals(mesh.vertices, corners)
    should = face_normals(original.vertices, original.faces[below[:len(faces)]])
    crossed, on_original = lines.crossings(looks, original, below[len(back) - len(lines.t):])
    there = np.concatenate([there, on_original])
    points = np.concatenate([there, crossed.points()])
    limits = tolerance(points)
    d_there, face_there = nearest(mesh, there, limits[:len(there)])
    d_crossed, _ = nearest(original, points[len(there):], limits[len(there):])
    owner = np.concatenate([crossed.face, np.arange(len(faces)), first // 3, lines.face])
    return Deviation(np.concatenate([points, back]), np.concatenate([d_there, d_crossed, d_back]),
                     np.concatenate([limits, limit]), np.concatenate([face_there, faces[owner]]),
                     np.einsum("ij,ij->i", looks, should) < FACING)


@dataclass(frozen=True)
class Lines:
    """Points on the edges of a mesh."""

    number: np.ndarray
    """Which edge each lies on, int [N]."""
    start: np.ndarray
    """float64 [N, 3]"""
    end: np.ndarray
    """float64 [N, 3]"""
    t: np.ndarray
    """Place on it, 0 to 1, float64 [N]."""
    face: np.ndarray
    """A face that has the edge, int [N]."""

    @classmethod
    def along(cls, vertices: np.ndarray, faces: np.ndarray, spacing: float, most: int = 256) -> "Lines":
        """Inner points of every edge, at most ``spacing`` [m] apart, one at least and ``most`` at most."""
        start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
        once = np.unique(_key(start, end), return_index=True)[1]
        a, b = vertices[start[once]], vertices[end[once]]
        inner = np.clip(np.ceil(np.linalg.norm(b - a, axis=1) / spacing), 2, most + 1).astype(int) - 1
        which = np.repeat(np.arange(len(once)), inner)
        step = np.arange(len(which)) - np.repeat(np.cumsum(inner) - inner, inner) + 1
        return cls(which, a[which], b[which], step / (inner[which] + 1), once[which] // 3)

    def points(self) -> np.ndarray:
        """Where they are, float64 [N, 3]."""
        return self.start + self.t[:, None] * (self.end - self.start)

    def crossings(self, normals: np.ndarray, other: Surface, below: np.ndarray) -> tuple["Lines", np.ndarray]:
        """Where these edges, seen along the ``normals`` of their faces, cross the edges of another mesh's faces.

        Returns these places on either: on these edges, and on those of the other mesh, float64 [n, 3].

        Args:
            normals: Of the faces, [f, 3].
            other: The other mesh.
            below: Its face at each point, int [N].
        """
        along = self.end - self.start
        across = np.cross(along, normals[self.face])
        found = []
        for i in range(3):
            p, q = (other.faces[below, j % 3] for j in (i, i + 1))
            a, b = other.vertices[p] - self.start, other.vertices[q] - self.start
            side_a, side_b = (np.einsum("ij,ij->i", x, across) for x in (a, b))
            hit = np.flatnonzero(side_a * side_b < 0.0)
            u = (side_a[hit] / (side_a[hit] - side_b[hit]))[:, None]
            x = a[hit] + u * (b[hit] - a[hit])
            t = np.einsum("ij,ij->i", x, along[hit]) / np.einsum("ij,ij->i", along[hit], along[hit])
            inside = (t > 0.0) & (t < 1.0)
            found.append((hit[inside], _key(p[hit], q[hit])[inside], t[inside], x[inside]))
        which, edge, t, x = map(np.concatenate, zip(*found, strict=True))
        edge = np.unique(edge, return_inverse=True)[1]
        once = np.unique(self.number[which] * (edge.max(initial=0) + 1) + edge, return_index=True)[1]
        which = which[once]
        lines = Lines(self.number[which], self.start[which], self.end[which], t[once], self.face[which])
        return lines, self.start[which] + x[once]


def nearest(surface: Surface, points: np.ndarray, limit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance float64 [N] and face int32 [N] of a mesh that are nearest to points [N, 3].

    Distances above ``limit`` [N], but for rounding, are exact; those below it are computed in float32.
    """
    face, place = (wp.empty(len(points), dtype=kind, device="cpu") for kind in (wp.int32, wp.vec3))
    local = surface.local(points)
    given = [0, surface.mesh.id, wp.array(local, dtype=wp.vec3, device="cpu"), FAR]
    wp.launch(find_nearest, dim=len(points), inputs=given, outputs=[face, place], device="cpu")
    face, distance = face.numpy(), np.linalg.norm(place.numpy() - local, axis=1).astype(float)
    near = np.flatnonzero(distance > limit - ROUNDING * np.abs(local).max(axis=1))
    triangles = surface.vertices[surface.faces[face[near]]]
    distance[near] = np.linalg.norm(trimesh.triangles.closest_point(triangles, points[near]) - points[near], axis=1)
    return distance, face


def edge_length(surface: Surface) -> float:
    """Median length of the first edges of the faces [m]."""
    a, b = surface.vertices[surface.faces[:, 0]], surface.vertices[surface.faces[:, 1]]
    return float(np.median(np.linalg.norm(a - b, axis=1)))


# ----------------------------------------------------------------------------------------------------------- one round


def _reduce_once(original, spacing, vertices, faces, tolerance, offset):
    """Decimate every band of a mesh, the bands offset by a share of their width."""
    least = tolerance(vertices)[faces].min(axis=1)
    highest = least.max()
    band = np.floor(np.log(np.maximum(least, FINEST * highest) / highest) / np.log(BAND) + offset).astype(int)
    band[least <= FINEST * highest] = KEPT
    on = nearest(Surface(vertices, faces), original.vertices, np.full(len(original.vertices), np.inf))[1]
    points, left = vertices.copy(), [faces[band == KEPT]]
    used_by = np.bincount(faces.ravel(), minlength=len(vertices))
    for number in np.unique(band[band != KEPT])[::-1]:
        inner = faces[band == number]
        if len(inner) < FEWEST:
            left.append(inner)
            continue
        error = EAGERNESS * max(least[band == number].min(), highest * BAND ** (number - offset))
        merged = _Merged(vertices, inner, error)
        merged.split(used_by > np.bincount(inner.ravel(), minlength=len(vertices)))
        here = np.flatnonzero(band[on] == number)
        _split_where_off(original, spacing, merged, here, faces[on[here]], tolerance)
        moved = merged.moved()
        points[moved] = merged.points[moved]
        left.append(merged.faces())
    return _compact(points, np.concatenate(left))


def _split_where_off(original, spacing, merged, points, home, tolerance):
    """Take apart what was merged where that moved the surface too far.

    Args:
        original: The mesh as given.
        spacing: Of the points along edges that are measured [m].
        merged: The vertices that were merged.
        points: Vertices of the original that lie on the faces that were merged, int [n].
        home: Corners [n, 3] of the face that each of them lies on, before the merging.
        tolerance: How far the surface may move.
    """
    under, moved = home.copy(), merged.moved()
    while moved.any():
        faces = merged.faces()
        stale, new = np.flatnonzero(moved[under].any(axis=1)), np.flatnonzero(moved[faces].any(axis=1))
        if len(faces) == 0:
            return merged.split(np.ones(len(moved), bool))
        found = deviation(original, Surface(merged.points, faces), tolerance, points[stale], new, spacing)
        off = found.distance > MARGIN * found.limit
        under[stale] = faces[found.face[:len(stale)]]
        bad = np.zeros(len(moved), bool)
        bad[faces[found.face[off]]] = True
        bad[home[stale[off[:len(stale)]]]] = True
        bad[faces[new[found.turned]]] = True
        bad[faces[_crowded(faces)]] = True
        moved = merged.split(bad)


class _Merged:
    """Which vertices of a mesh a decimation merged, and where to; a merged one can be taken apart again."""

    def __init__(self, vertices, inner, error):
        """Decimate the faces ``inner`` to about ``error`` [m], their rim held fast.

        With an aggressiveness of 0, the library collapses edges of a squared quadric error below 1e-9. Quadrics hold
        squares of coordinates, so these are taken from the middle.
        """
        self.vertices, self.inner, self.points = vertices, inner, vertices.copy()
        self.root = np.arange(len(vertices))
        used, renumbered = np.unique(inner, return_inverse=True)
        largest = LARGEST * np.linalg.norm(np.ptp(vertices[used], axis=0))
        scale, middle = np.sqrt(1e-9) / min(error, largest), vertices[used].mean(axis=0)
        points, _, collapses = fast_simplification.simplify(
            scale * (vertices[used] - middle), renumbered.reshape(-1, 3).astype(np.int32), target_count=1, agg=0.0,
            preserve_border=True, return_collapses=True)
        self.root[used[collapses[:, 1]]] = used[collapses[:, 0]]
        while (self.root[self.root] != self.root).any():
            self.root = self.root[self.root]
        left = np.unique(self._mapped())  # the library keeps the order
        if len(left) != len(points):
            raise RuntimeError("fast-simplification returned other vertices than its collapses leave")
        moved = self.moved()[left]
        self.points[left[moved]] = points[moved] / scale + middle

    def _mapped(self):
        faces = self.root[self.inner]
        a, b, c = faces.T
        return faces[(a != b) & (b != c) & (c != a)]

    def faces(self):
        """What is left of ``inner``, in the numbers of ``vertices``; pairs of faces with the same corners are gone."""
        faces = self._mapped()
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        if len(first) == len(faces):
            return faces
        return faces[np.sort(first[count % 2 == 1])]

    def moved(self):
        """Which vertices are merged with others, bool [V]."""
        return np.bincount(self.root, minlength=len(self.root))[self.root] > 1

    def split(self, bad):
        """Take apart what any of the vertices ``bad`` is merged with; returns which vertices that concerned."""
        hit = np.zeros(len(bad), bool)
        hit[self.root[bad]] = True
        apart = hit[self.root] & self.moved()
        self.root[apart] = np.flatnonzero(apart)
        self.points[apart] = self.vertices[apart]
        return apart


def _distinct(faces):
    """Faces without those that repeat the corners of another."""
    return faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]


def _crowded(faces):
    """Faces at edges that more than two of them share."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    _, which, uses = np.unique(_key(start, end), return_inverse=True, return_counts=True)
    return np.flatnonzero((uses[which] > 2).reshape(-1, 3).any(axis=1))


def _key(start, end):
    """One number for an edge, the same for both directions."""
    return np.minimum(start, end).astype(np.int64) << 32 | np.maximum(start, end)


def _compact(vertices, faces):
    used, renumbered = np.unique(faces, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3).astype(np.int32)
