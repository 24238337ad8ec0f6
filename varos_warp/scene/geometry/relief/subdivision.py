"""Conforming refinement of triangle meshes: edges that are too long are halved, for all of their faces alike.

No T-junctions arise, so what is watertight stays so. On the right triangles of a grid this makes a restricted quadtree:
neighbours differ by one level at most. Where a surface is smooth, new vertices lie on the curve that its normals tell
(Vlachos et al., "Curved PN Triangles", 2001), so that facets of a coarse mesh do not show.
"""

from collections.abc import Callable

import numpy as np

from varos_warp.scene.geometry.relief.flips import NEEDLE, flip_needles
from varos_warp.scene.geometry.topology import distinct, edge_keys, edge_lengths, is_among, largest

SLIVER = 0.6
"""An edge shorter than this share of the longest that is too long in its face waits, so that slivers become round."""
MOST_ROUNDS = 100

Lengths = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""The longest edge [N] [m] that is wanted at points [N, 3] with normals [N, 3], zero where they are not known."""


def refine(
    vertices: np.ndarray, faces: np.ndarray, wanted: Lengths, normals: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Halve edges until none is longer than is wanted at either of its ends.

    Args:
        vertices: float64 [V, 3] [m].
        faces: int32 [F, 3].
        wanted: Longest edges at points; asked once for every vertex.
        normals: Unit vectors [V, 3] where the surface is smooth, zeros elsewhere; absent: it is smooth nowhere.

    Returns:
        Vertices float64 [V + M, 3], the given ones first; faces int32; and what was wanted at the vertices [V + M].
    """
    vertices, faces = np.asarray(vertices, float), np.asarray(faces, np.int32)
    normals = np.zeros(vertices.shape) if normals is None else normals
    length, finished, count = wanted(vertices, normals), [], len(vertices)
    for _ in range(MOST_ROUNDS):
        size, long = _long_edges(vertices, faces, length)
        active = largest(long)  # an edge is long for both of its faces: no other face will ever be cut
        finished.append(faces[~active])
        if not active.any():
            break
        halved = _to_halve(size, long, edge_keys(faces))
        faces = faces[active]
        middles, turned = _middles(vertices, normals, halved >> 32, halved & 0xFFFFFFFF)
        faces = split(faces, _numbers(edge_keys(faces), halved, count))
        vertices, normals, length = (
            _with_more(values, count, more)
            for values, more in ((vertices, middles), (normals, turned), (length, wanted(middles, turned)))
        )
        count, faces = count + len(middles), flip_needles(vertices, faces)
    else:
        finished.append(faces)
    return vertices[:count], np.concatenate(finished), length[:count]


def _with_more(values, count, more):
    """An array that begins with ``count`` values and ``more``; it grows by doubling, as most rounds add few."""
    if count + len(more) > len(values):
        values = np.concatenate([values[:count], np.empty((max(count, len(more)), *values.shape[1:]))])
    values[count : count + len(more)] = more
    return values


def _middles(vertices, normals, a, b):
    """The middles [M, 3] of edges between vertices a and b, on the cubic of a PN triangle, and their normals."""
    way, na, nb = vertices[b] - vertices[a], normals[a], normals[b]
    smooth = (na.any(axis=1) & nb.any(axis=1))[:, None]
    bulge = (np.einsum("ij,ij->i", way, nb)[:, None] * nb - np.einsum("ij,ij->i", way, na)[:, None] * na) / 8.0
    mean = na + nb
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    return vertices[a] + 0.5 * way + np.where(smooth, bulge, 0.0), np.where(smooth, mean, 0.0)


def _long_edges(vertices, faces, length):
    """Lengths of edges 01, 12, 20 of faces [F, 3], and which are longer than is wanted at either end."""
    size, at = edge_lengths(vertices, faces), length[faces]
    return size, size > np.minimum(at, at[:, [1, 2, 0]])


def _to_halve(size, long, keys):
    """Keys of the long edges that no face wants to wait for a longer one: needles for all others, other faces for few.

    Edges that are the longest of both their faces are among them, so it goes on until none is long (Rivara 1997: with
    Delaunay flips this makes needles round).
    """
    longest = largest(np.where(long, size, 0.0))
    needle = largest(size) > -NEEDLE * largest(-size)
    now = long & (size >= (np.where(needle, 1.0 - 1e-9, SLIVER) * longest)[:, None])
    halved = distinct(keys[now])
    return halved[~is_among(halved, np.sort(keys[long & ~now]))]


def _numbers(keys, halved, count):
    """The number of the new vertex on each edge of faces [F, 3], -1 where there is none, by the edges' keys."""
    place = np.searchsorted(halved, keys)
    found = halved[np.minimum(place, len(halved) - 1)] == keys
    return np.where(found, count + place, -1).astype(np.int32)


def split(faces: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Faces [F, 3] cut at new vertices ``middle`` [F, 3] on their edges 01, 12, 20 (-1: none); int32 [G, 3]."""
    cut = middle >= 0
    count = cut.sum(axis=1)
    one, two, three = (np.flatnonzero(count == n) for n in (1, 2, 3))
    parts = [faces[count == 0]]
    a, b, c, ab, _, _ = _turned(faces, middle, one, cut[one].argmax(axis=1))
    parts += [_rows(a, ab, c), _rows(ab, b, c)]
    a, b, c, _, bc, ca = _turned(faces, middle, two, cut[two].argmin(axis=1))
    parts += [_rows(c, ca, bc), _rows(ca, a, bc), _rows(a, b, bc)]
    a, b, c, ab, bc, ca = _turned(faces, middle, three, np.zeros(len(three), int))
    parts += [_rows(a, ab, ca), _rows(ab, b, bc), _rows(bc, c, ca), _rows(ab, bc, ca)]
    return np.concatenate(parts)


def _turned(faces, middle, chosen, first):
    """Corners a, b, c and middles ab, bc, ca of some faces, each begun at its corner ``first``."""
    order = (first[:, None] + np.arange(3)) % 3
    return *faces[chosen[:, None], order].T, *middle[chosen[:, None], order].T


def _rows(*corners):
    return np.column_stack(corners).astype(np.int32, copy=False)
