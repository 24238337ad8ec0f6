"""Triangles of even size: plane regions filled between their outlines, and edges that are too long halved."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, cKDTree

from varos_warp.scene.geometry.topology import edge_keys

CLEAR = 0.7
"""Points inside a region keep so far from its outline, in edges: the outline's edges are then among the triangles'."""
FLAT = 1e-9
"""A triangle of points in line has less area than this, over the square of a side."""
MOST_HALVED = 50
"""How many times as many points outlines may get until they can be filled; those that need more are taken to cross."""


def fill(loops: list[np.ndarray], edge: float = np.inf) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fill the plane between outlines with triangles, counter-clockwise.

    Args:
        loops: Outlines [m, 2], the outer one counter-clockwise, holes clockwise.
        edge: How far apart points inside are [m], no further than those of the outlines are at most; inf: there are
            none.

    Returns:
        Points inside [K, 2]; triangles int [F, 3] of the outlines' points, one after the other, and of these; and
        which edges of the outlines are not among theirs, bool for each point that one starts from.
    """
    outline = np.concatenate(loops)
    following = _following(loops)
    inner = _lattice(outline, following, edge) if np.isfinite(edge) else np.zeros((0, 2))
    points = np.vstack([outline, inner])
    delaunay = Delaunay(points)
    a, b, c = np.moveaxis(points[delaunay.simplices], 1, 0)
    twice = cross(b - a, c - a)
    flat = np.abs(twice) < FLAT * np.maximum(np.sum((b - a) ** 2, axis=1), np.sum((c - b) ** 2, axis=1))
    turned = twice < 0.0
    triangles = np.where(turned[:, None], delaunay.simplices[:, ::-1], delaunay.simplices)
    neighbours = np.where(turned[:, None], delaunay.neighbors[:, ::-1], delaunay.neighbors)
    inside, missing = _inside(triangles, neighbours, flat, following, len(points))
    triangles = triangles[inside]
    used = np.zeros(len(points), bool)
    used[triangles] = True
    used[: len(outline)] = True
    number = np.cumsum(used) - 1
    return inner[used[len(outline) :]], number[triangles], missing


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross products [...] of vectors [..., 2]."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def area(loop: np.ndarray) -> float:
    """Area of an outline [m, 2] [m^2], negative where it runs clockwise."""
    return 0.5 * float(np.sum(cross(loop, np.roll(loop, -1, axis=0))))


def fill_ring(ring: np.ndarray, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Fill a plane ring [m, 3]: points inside [K, 3], and triangles of its points and of these, turning as it does."""
    centre = ring.mean(axis=0)
    arms = ring - centre
    normal = np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0)
    normal /= np.linalg.norm(normal)
    u = arms[0] - (arms[0] @ normal) * normal
    u /= np.linalg.norm(u)
    axes = np.stack([u, np.cross(normal, u)])
    inner, triangles, _ = fill([arms @ axes.T], edge)
    return inner @ axes + centre, triangles


def fill_between(loops: list[np.ndarray], edge: float, seen=lambda loops: loops):
    """Fill the plane between outlines, and halve those of their edges that no triangle would have, again and again.

    Args:
        seen: Where the outlines are filled, if not at their own place: takes and returns outlines.

    Returns:
        The outlines, points inside [K, 2] and triangles [F, 3] as of `fill`.

    Raises:
        ValueError: Edges are still missing with `MOST_HALVED` times as many points: outlines cross.
    """
    most = MOST_HALVED * sum(map(len, loops))
    while sum(map(len, loops)) <= most:
        inner, triangles, missing = fill(seen(loops), edge)
        if not missing.any():
            return loops, inner, triangles
        starts = np.cumsum([0, *(len(loop) for loop in loops)])
        loops = [_halved(loop, missing[start : start + len(loop)]) for loop, start in zip(loops, starts, strict=False)]
    raise ValueError("outlines cross")


def split_long(vertices: np.ndarray, faces: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Halve edges until none is longer than ``longest``: those first that no edge of their faces exceeds."""
    if not np.isfinite(longest):
        return vertices, faces
    done = []
    while True:
        lengths = np.linalg.norm(vertices[faces[:, [1, 2, 0]]] - vertices[faces], axis=2)
        long = (lengths > longest).any(axis=1)  # all faces of an edge that is too long are among them
        done.append(faces[~long])
        if not long.any():
            return vertices, np.concatenate(done).astype(np.int32)
        vertices, faces = _halved_longest(vertices, faces[long], longest)


# ---------------------------------------------------------------------------------------------------------------- parts


def _following(loops):
    """Number of the next point on the same outline, for every point of all outlines, one outline after the other."""
    starts = np.cumsum([0, *(len(loop) for loop in loops)])
    return np.concatenate(
        [start + np.roll(np.arange(len(loop)), -1) for loop, start in zip(loops, starts, strict=False)]
    )


def _lattice(outline, following, edge):
    """Points [K, 2] of a triangular lattice over the outlines, clear of them."""
    sides = outline[following] - outline
    lengths = np.linalg.norm(sides, axis=1)
    step = min(edge, 1.2 * lengths.max())
    low, high = outline.min(axis=0), outline.max(axis=0)
    x = np.arange(low[0], high[0] + step, step)
    y = np.arange(low[1], high[1] + step, 0.5 * np.sqrt(3.0) * step)
    points = np.stack(np.meshgrid(x, y), axis=-1)
    points[1::2, :, 0] += 0.5 * step
    points = points.reshape(-1, 2)
    parts = np.maximum(np.ceil(2.0 * lengths / step), 1).astype(int)
    share = np.concatenate([np.arange(n) / n for n in parts])
    dense = np.repeat(outline, parts, axis=0) + share[:, None] * np.repeat(sides, parts, axis=0)
    away, _ = cKDTree(dense).query(points, distance_upper_bound=CLEAR * step)
    return points[np.isinf(away)]


def _inside(triangles, neighbours, flat, following, count):
    """Which triangles lie between the outlines, bool [F], and which of the outlines' edges are no edges of theirs.

    Neighbours are joined unless an outline runs between them; inside is what an outline's edge has on its left. Flat
    ones, of points of the outline in line, are no part of it.
    """
    keys = triangles[:, [1, 2, 0]].astype(np.int64) * count + triangles[:, [2, 0, 1]]  # opposite corner 0, 1, 2
    first = np.arange(len(following), dtype=np.int64)
    ahead, back = first * count + following, following * count + first
    wall = np.isin(keys, ahead) & ~flat[:, None]
    open_ = ~wall & ~np.isin(keys, back) & (neighbours >= 0) & ~flat[:, None] & ~flat[neighbours]
    face, corner = np.nonzero(open_)
    graph = coo_matrix((np.ones(len(face), np.int8), (face, neighbours[face, corner])), shape=(len(triangles),) * 2)
    label = connected_components(graph, directed=False)[1]
    return np.isin(label, label[wall.any(axis=1)]), ~np.isin(ahead, keys[~flat])


def _halved_longest(vertices, faces, longest):
    """The mesh with those edges halved that are longer than ``longest`` and the longest ones of all of their faces."""
    keys, edge_of = np.unique(edge_keys(faces), return_inverse=True)
    edge_of = edge_of.reshape(-1, 3)
    ends = np.column_stack([keys >> 32, keys & 0xFFFFFFFF])
    length = np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)
    rank = np.empty(len(keys), int)
    rank[np.argsort(length, kind="stable")] = np.arange(len(keys))  # so that no two edges are equally long
    top = np.argmax(rank[edge_of], axis=1)
    most = np.take_along_axis(edge_of, top[:, None], axis=1)[:, 0]
    is_top = np.bincount(most, minlength=len(keys)) == np.bincount(edge_of.ravel(), minlength=len(keys))
    chosen = (length > longest) & is_top
    number = np.cumsum(chosen) - 1 + len(vertices)
    cut = np.flatnonzero(chosen[most])
    a, b, c = np.take_along_axis(faces[cut], (top[cut, None] + np.arange(3)) % 3, axis=1).T
    m = number[most[cut]]
    vertices = np.vstack([vertices, vertices[ends[chosen]].mean(axis=1)])
    halves = np.column_stack([a, m, c]), np.column_stack([m, b, c])
    return vertices, np.concatenate([np.delete(faces, cut, axis=0), *halves])


def _halved(loop, some):
    """An outline [m, 2] with points in the middle of some of its edges, bool [m]."""
    middle = 0.5 * (loop + np.roll(loop, -1, axis=0))
    return np.insert(loop, np.flatnonzero(some) + 1, middle[some], axis=0)
