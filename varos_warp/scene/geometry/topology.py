"""Edges, pieces and outlines of a triangle list, by sorting keys: in bounded memory for tens of millions."""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from varos_warp.device.launch import in_tiles

CHUNK = 1 << 20
"""Triangles processed at once, where temporary arrays are larger than the triangles."""
FARTHEST = 1e15
"""A coordinate beyond is no place but a fault: a million kilometres in micrometres."""


def chunks(count: int, size: int = CHUNK) -> Iterator[slice]:
    """Slices that cover ``count`` things, ``size`` at a time."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def area_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Normals [F, 3], as long as twice the area, float64."""
    normals = np.empty((len(faces), 3))

    def fill(tile):
        a, b, c = (np.asarray(vertices[faces[tile, i]], float) for i in range(3))
        (x, y, z), (u, v, w), out = (b - a).T, (c - a).T, normals[tile].T
        out[0], out[1], out[2] = y * w - z * v, z * u - x * w, x * v - y * u

    in_tiles(fill, len(faces))
    return normals


def largest(values: np.ndarray) -> np.ndarray:
    """The largest [F] of three values each [F, 3]; ``max`` along so short an axis takes ten times as long."""
    return np.maximum(np.maximum(values[:, 0], values[:, 1]), values[:, 2])


def edge_lengths(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Lengths [F, 3] of the edges 01, 12, 20 of faces."""
    size = np.empty(faces.shape)

    def fill(tile):
        corners = [vertices[faces[tile, i]] for i in (0, 1, 2, 0)]
        for i in range(3):
            x, y, z = (corners[i] - corners[i + 1]).T
            size[tile, i] = np.sqrt(x * x + y * y + z * z)

    in_tiles(fill, len(faces))
    return size


def extents(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest coordinates [F, k] of triangles [F, 3, k]; ``min`` and ``max`` take five times as long."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def compact(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh without the vertices that no face uses."""
    used = np.zeros(len(vertices), bool)
    used[faces.ravel()] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    return vertices[used], number[faces].reshape(-1, 3)


def first_equal(rows: np.ndarray) -> np.ndarray:
    """Number of the first row that equals each of the rows [N, k], int [N]."""
    order = np.lexsort(rows.T)  # stable: of equal rows the first comes first
    new = np.ones(len(rows), bool)
    for part in chunks(len(rows) - 1):
        new[1:][part] = (rows[order[1:][part]] != rows[order[:-1][part]]).any(axis=1)
    result = np.empty(len(rows), int)
    result[order] = order[np.maximum.accumulate(np.where(new, np.arange(len(rows)), 0))]
    return result


def edge_keys(faces: np.ndarray, directed: bool = False) -> np.ndarray:
    """Every face's edges 01, 12, 20 as one int64 [F, 3] each: equal for the same pair of vertices."""
    a, b = faces.astype(np.int64), np.roll(faces, -1, axis=1)
    if not directed:
        a, b = np.minimum(a, b), np.maximum(a, b)
    a <<= 32
    a |= b
    return a


def distinct(keys: np.ndarray) -> np.ndarray:
    """The different ones of whole numbers, ascending, [K]; ``np.unique`` hashes them: it takes four times as long."""
    ordered = np.sort(keys, axis=None)
    new = np.ones(len(ordered), bool)
    new[1:] = ordered[1:] != ordered[:-1]
    return ordered[new]


def is_among(keys: np.ndarray, ordered: np.ndarray) -> np.ndarray:
    """Which of some keys [N] are among others in ascending order."""
    if not len(ordered):
        return np.zeros(len(keys), bool)
    return ordered[np.minimum(np.searchsorted(ordered, keys), len(ordered) - 1)] == keys


def next_corner(corner: np.ndarray) -> np.ndarray:
    """The corner after each in its face; corner i of face f is number 3 f + i, as its half-edge is."""
    return corner - corner % 3 + (corner + 1) % 3


def edge_uses(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keys of the edges that are not shared by two faces: of those used once, and of those used three times or more."""
    keys, uses = np.unique(edge_keys(faces), return_counts=True)
    return keys[uses == 1], keys[uses > 2]


def paired_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The two halves [E] of every edge with exactly two faces; half-edge 3 f + i runs from corner i of face f."""
    keys = edge_keys(faces).ravel()
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    starts = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]]))
    two = starts[np.diff(starts, append=len(keys)) == 2]
    return order[two], order[two + 1]


def boundary_edges(faces: np.ndarray) -> np.ndarray:
    """Edges [E, 2] with one face only, in the direction in which that face runs through them."""
    (once, _), keys = edge_uses(faces), edge_keys(faces)
    found = np.zeros(keys.shape, bool)
    for part in chunks(len(keys)):
        found[part] = np.isin(keys[part], once)
    face, corner = np.nonzero(found)
    return np.column_stack([faces[face, corner], faces[face, (corner + 1) % 3]])


def outlines(vertices: np.ndarray, edges: np.ndarray):
    """What boundary edges [E, 2] join to: their vertices [U], their ends among these [E, 2], outlines and middles.

    Returns:
        ``used`` int [U], ``ends`` int [E, 2], the outline of every vertex used, int [U], and the mean of the vertices
        of every outline, float64 [L, 3].
    """
    used, ends = np.unique(edges, return_inverse=True)
    ends = ends.reshape(-1, 2)
    outline = groups(ends, len(used))
    middle = np.column_stack([np.bincount(outline, vertices[used, i] - vertices[0, i]) for i in range(3)])
    return used, ends, outline, middle / np.bincount(outline)[:, None] + vertices[0]


def is_consistent(faces: np.ndarray) -> bool:
    """Return whether no two faces run through an edge in the same direction."""
    keys = np.sort(edge_keys(faces, directed=True).ravel())
    return not (keys[1:] == keys[:-1]).any()


def groups(edges: np.ndarray, count: int) -> np.ndarray:
    """Label [count] of the connected group of every vertex, by edges [E, 2]."""
    graph = coo_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def pieces(faces: np.ndarray, count: int) -> np.ndarray:
    """Label [F] of the connected piece of every face of ``count`` vertices."""
    return groups(np.concatenate([faces[:, :2], faces[:, 1:]]), count)[faces[:, 0]]


def incidence(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The faces at every vertex: int32 [count + 1] where each list starts, and int32 [3 F] the lists."""
    starts = np.arange(0, 3 * len(faces) + 1, 3, dtype=np.int32)
    columns = csr_matrix((np.ones(3 * len(faces), np.int8), faces.ravel(), starts), shape=(len(faces), count)).tocsc()
    return columns.indptr.astype(np.int32, copy=False), columns.indices.astype(np.int32, copy=False)


def subdivide(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Every triangle becomes four, cut at the middles of its edges; new vertices are numbered from ``count``.

    Returns:
        The edges [E, 2] at whose middles the new vertices lie, and the faces int32 [4 F, 3].
    """
    keys, middle = np.unique(edge_keys(faces), return_inverse=True)
    edges = np.column_stack([keys >> 32, keys & 0xFFFFFFFF]).astype(np.int32)
    (a, b, c), (ab, bc, ca) = faces.T, (middle.reshape(-1, 3) + count).astype(np.int32).T
    quarters = (a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)
    return edges, np.concatenate([np.column_stack(corners) for corners in quarters])
