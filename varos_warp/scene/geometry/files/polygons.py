"""Polygons become triangles: fans where they are convex, ears clipped where they are not, bridges to their holes."""

from collections.abc import Sequence

import numpy as np

TOLERANCE = 1e-6
"""Areas that agree to this share of a polygon's are the same: positions of single precision allow no less."""


def triangulate(points: np.ndarray, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Triangles of many polygons, in their order.

    Args:
        points: float64 [C, 3], the corners of all polygons one after another.
        starts: int [P + 1], where each begins, and the number of corners.

    Returns:
        Corners of the triangles int64 [T, 3], the polygon of each int64 [T], and how many polygons cross themselves:
        what fills these is not their area.
    """
    counts = np.diff(starts)
    found, of, crossed = [], [], 0
    for n in np.unique(counts[counts >= 3]):
        chosen = np.flatnonzero(counts == n)
        corners = starts[chosen, None] + np.arange(n)
        convex = np.ones(len(chosen), bool) if n == 3 else is_convex(points[corners])
        fan = corners[convex]
        for i in range(1, n - 1):
            found.append(fan[:, [0, i, i + 1]])
            of.append(chosen[convex])
        for polygon, ring in zip(chosen[~convex], corners[~convex], strict=True):
            triangles, sound = fill(points[ring])
            found.append(ring[triangles])
            of.append(np.full(len(triangles), polygon))
            crossed += not sound
    if not found:
        return np.zeros((0, 3), np.int64), np.zeros(0, np.int64), 0
    polygon = np.concatenate(of)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate(found)[order].astype(np.int64), polygon[order].astype(np.int64), crossed


def strip(corners: np.ndarray) -> np.ndarray:
    """Triangles [T, 3] of a strip of corners [C], every other one turned, so that all look to one side."""
    i = np.arange(max(len(corners) - 2, 0))
    return corners[np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)]


def area_vectors(rings: np.ndarray) -> np.ndarray:
    """Vector areas [..., 3] of polygons [..., n, 3] (Newell): twice the area, along the normal."""
    spokes = rings - rings[..., :1, :]
    return np.cross(spokes[..., 1:-1, :], spokes[..., 2:, :]).sum(axis=-2)


def is_convex(rings: np.ndarray) -> np.ndarray:
    """Return whether each polygon [P, n, 3], seen along its normal, is convex and goes around once."""
    normal = area_vectors(rings)
    edges = np.roll(rings, -1, axis=1) - rings
    turns = np.cross(np.roll(edges, 1, axis=1), edges)
    bend = (turns * normal[:, None]).sum(axis=-1)
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    ahead = (np.roll(edges, 1, axis=1) * edges).sum(axis=-1)
    around = np.arctan2(bend / np.maximum(size, 1e-300), ahead).sum(axis=1)
    flat = np.abs(bend) <= TOLERANCE * size**2  # three corners in line
    return ((bend >= 0.0) | flat).all(axis=1) & (around < 3.0 * np.pi)


def fill(outline: np.ndarray, holes: Sequence[np.ndarray] = ()) -> tuple[np.ndarray, bool]:
    """Triangles of one polygon by ear clipping, and whether they fill just its area.

    Args:
        outline: Its corners float64 [n, 3].
        holes: The corners of its holes, each [m, 3].

    Returns:
        int64 [T, 3], turned as the outline is, corners numbered through outline and holes in their order.
    """
    import mapbox_earcut  # not everybody has such polygons

    normal = area_vectors(outline)
    u, v = _plane(outline, normal)
    rings = [outline, *holes]
    corners = np.concatenate(rings)
    flat = np.ascontiguousarray((corners - corners[0]) @ np.stack([u, v], axis=1))
    if not np.isfinite(flat).all():
        return np.zeros((0, 3), np.int64), True  # the caller refuses such vertices
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    triangles = mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = np.moveaxis(flat[triangles], 1, 0)
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[doubled < 0.0] = triangles[doubled < 0.0][:, ::-1]
    wanted = np.linalg.norm(normal) - sum(np.linalg.norm(area_vectors(hole)) for hole in holes)
    return triangles, bool(abs(np.abs(doubled).sum() - wanted) <= TOLERANCE * np.linalg.norm(normal))


def _plane(outline, normal):
    """Two axes [3] each of the plane of a polygon, right-handed with its normal."""
    if np.linalg.norm(normal) <= TOLERANCE * np.ptp(outline, axis=0).max() ** 2 and np.isfinite(outline).all():
        _, _, axes = np.linalg.svd(outline - outline.mean(axis=0))  # its loops cancel, as those of a bow tie do
        return axes[0], axes[1]
    n = normal / np.linalg.norm(normal)
    u = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
    u /= np.linalg.norm(u)
    return u, np.cross(n, u)
