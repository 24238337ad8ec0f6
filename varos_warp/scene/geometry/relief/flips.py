"""Needles of a mesh made rounder: edges inside of plane places are flipped where that makes them Delaunay.

Halving the edges of a needle makes four needles; flipped in between, its new vertices join into round triangles.
"""

import numpy as np

from varos_warp.scene.geometry.topology import (
    area_normals,
    edge_keys,
    edge_lengths,
    is_among,
    largest,
    next_corner,
    paired_edges,
)

NEEDLE = 4.0
"""Longest over shortest edge beyond which a triangle is a needle."""
PLANE = 1.0 - 1e-5
"""Cosine of the angle between faces above which they lie in one plane."""
MOST_PASSES = 4


def flip_needles(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Faces int32 [F, 3] with edges between needles and their plane neighbours flipped while they are not Delaunay.

    An edge is not where the angles opposite to it add up to more than half a turn (Delaunay 1934). Edges stay that
    have one face, more than two, or faces in different planes.
    """
    needles = _is_needle(vertices, faces)
    if not needles.any():
        return faces
    touched = np.zeros(len(vertices), bool)
    touched[faces[needles].ravel()] = True
    near = touched[faces].sum(axis=1) >= 2
    part = faces[near]
    for _ in range(MOST_PASSES):
        changed = _flip_once(vertices, part, _is_needle(vertices, part))
        if changed is None:
            break
        part = changed
    return np.concatenate([faces[~near], part])


def _is_needle(vertices, faces):
    size = edge_lengths(vertices, faces)
    return largest(size) > -NEEDLE * largest(-size)


def _flip_once(vertices, faces, needles):
    """The faces with those edges flipped that share no face; None where none is to be."""
    one, two = paired_edges(faces)
    some = needles[one // 3] | needles[two // 3]
    one, two = one[some], two[some]
    if not len(one):
        return None
    a, c = faces.ravel()[one], faces.ravel()[next_corner(next_corner(one))]
    b, d = faces.ravel()[next_corner(one)], faces.ravel()[next_corner(next_corner(two))]
    normals = area_normals(vertices, faces)
    plane = _cosine(normals[one // 3], normals[two // 3]) > PLANE
    may = np.flatnonzero((faces.ravel()[two] == b) & plane)
    one, two, a, b, c, d = (column[may] for column in (one, two, a, b, c, d))
    excess = _angle(vertices, c, a, b) + _angle(vertices, d, a, b) - np.pi
    wanted = np.flatnonzero((excess > 1e-6) & _convex(vertices, a, b, c, d, normals[one // 3]))
    if len(wanted):
        wanted = wanted[~is_among(_key(c, d)[wanted], np.sort(edge_keys(faces), axis=None))]
    if not len(wanted):
        return None
    chosen = wanted[_first_of_each(one[wanted] // 3, two[wanted] // 3, _key(c, d)[wanted], excess[wanted], len(faces))]
    flipped = faces.copy()
    flipped[one[chosen] // 3] = np.column_stack([a[chosen], d[chosen], c[chosen]])
    flipped[two[chosen] // 3] = np.column_stack([d[chosen], b[chosen], c[chosen]])
    return flipped


def _first_of_each(one, two, key, excess, count):
    """Numbers of the pairs of faces whose excess is the largest for both faces; of equal pairs the first."""
    order = np.lexsort((key, -excess))
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    best = np.full(count, len(order))
    for faces in (one, two):
        np.minimum.at(best, faces, rank)
    chosen = np.flatnonzero((best[one] == rank) & (best[two] == rank))
    return chosen[np.unique(key[chosen], return_index=True)[1]]


def _convex(vertices, a, b, c, d, normal):
    """Whether both triangles after a flip, adc and dbc, have area and face as before."""
    least = 1e-9 * np.einsum("ij,ij->i", normal, normal)
    one, two = (np.cross(vertices[q] - vertices[p], vertices[r] - vertices[p]) for p, q, r in ((a, d, c), (d, b, c)))
    return (np.einsum("ij,ij->i", one, normal) > least) & (np.einsum("ij,ij->i", two, normal) > least)


def _angle(vertices, at, a, b):
    u, v = vertices[a] - vertices[at], vertices[b] - vertices[at]
    return np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.einsum("ij,ij->i", u, v))


def _cosine(u, v):
    size = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1)
    return np.einsum("ij,ij->i", u, v) / np.maximum(size, 1e-300)


def _key(a, b):
    return (np.minimum(a, b).astype(np.int64) << 32) | np.maximum(a, b)
