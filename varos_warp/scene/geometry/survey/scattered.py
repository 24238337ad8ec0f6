"""Points of a survey become a surface: those of a grid as a grid, others by a Delaunay triangulation from above."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay, QhullError

from varos_warp.cache import cached, code_hash, digest
from varos_warp.errors import InputError, counted
from varos_warp.limits import limit
from varos_warp.scene.geometry.survey.content import Raster
from varos_warp.scene.geometry.survey.grid import Holes
from varos_warp.scene.geometry.topology import compact, first_equal

ON_A_NODE = 1e-4
"""Share of the spacing by which points of a grid may be off its nodes."""
FULL = 0.25
"""Share of the nodes of a grid that must have a point for points to count as a grid."""
MEDIAN_EDGES = 5.0
"""Longest edge between scattered points, in median edges."""
KEPT_POINTS = 100_000
"""A triangulation of so many points or more is kept in the user's cache: of a million it takes ten seconds."""


def grid_of(points: np.ndarray) -> Raster | None:
    """Find the grid, along x and y, whose nodes points [N, 3] are; None if there is none.

    The spacing is the least step between neighbouring x, or y; all points must lie on multiples of it, no two on one
    node, on at least a quarter of the nodes and on all four of some cell.
    """
    axes = [_steps(points[:, i]) for i in (0, 1)]
    if any(axis is None for axis in axes):
        return None
    (column, x, dx), (row, y, dy) = axes
    columns, rows = column.max() + 1, row.max() + 1
    if len(points) < FULL * columns * rows or len(points) > columns * rows:
        return None
    values = np.full((rows, columns), np.nan)
    values[rows - 1 - row, column] = points[:, 2]  # from the north
    there = ~np.isnan(values)
    if there.sum() < len(points) or not (there[1:, 1:] & there[1:, :-1] & there[:-1, 1:] & there[:-1, :-1]).any():
        return None
    return Raster(values, np.array([[dx, 0.0, x], [0.0, -dy, y + dy * (rows - 1)]]))


def _steps(values: np.ndarray) -> tuple[np.ndarray, float, float] | None:
    """The number of the step that each value lies on, int [N], the first value and the step; None without."""
    distinct = np.unique(values)
    gaps = np.diff(distinct)
    rounding = 8.0 * np.spacing(np.abs(distinct).max())
    gaps = gaps[gaps > max(rounding, 1e-6 * np.ptp(distinct) / max(len(gaps), 1))]
    if len(gaps) == 0:
        return None
    count = int(np.rint(np.ptp(distinct) / gaps.min()))
    step = np.ptp(distinct) / count
    if count > len(values):
        return None
    number = (values - distinct[0]) / step
    nearest = np.rint(number)
    on = np.abs(number - nearest).max() <= ON_A_NODE
    return (nearest.astype(int), float(distinct[0]), float(step)) if on else None


def block_means(points: np.ndarray, size: float) -> np.ndarray:
    """The mean of the points in each square of side ``size``, whose corners are multiples of it, [M, 3]."""
    square = np.floor(points[:, :2] / size)
    order = np.lexsort(square.T)
    square = square[order]
    new = np.ones(len(points), bool)
    new[1:] = (square[1:] != square[:-1]).any(axis=1)
    start = np.flatnonzero(new)
    centre = points.mean(axis=0)
    total = np.add.reduceat(points[order] - centre, start, axis=0)
    return total / np.diff(np.append(start, len(points)))[:, None] + centre


def merge_stacked(points: np.ndarray) -> np.ndarray:
    """Replace points at the same x and y by one at their mean height."""
    first = first_equal(points[:, :2])
    kept, group = np.unique(first, return_inverse=True)
    if len(kept) == len(points):
        return points
    merged = points[kept].copy()
    merged[:, 2] = np.bincount(group, points[:, 2]) / np.bincount(group)
    return merged


def triangulate(points: np.ndarray, longest: float | None, key: str) -> tuple[np.ndarray, np.ndarray, Holes, float]:
    """Join scattered points by edges no longer than ``longest`` seen from above [m].

    Returns:
        Vertices float64 [V, 3], faces int32 [F, 3], counter-clockwise seen from above, the holes, and the median edge.

    Raises:
        InputError: The points are too many or on a line, or no triangle is left.
    """
    if len(points) > (most := limit("SCATTERED_POINTS")):
        wide = float(np.sqrt(2.0 * np.ptp(points[:, :2], axis=0).prod() / most))
        raise InputError(
            f"{len(points)} scattered points are more than the limit of {most}",
            key=f"{key}.resolution_m",
            remedy=f"Thin them: resolution_m: {wide:.2g}; or raise the limit: "
            f"VAROS_WARP_MAX_SCATTERED_POINTS={len(points)}.",
        )
    local = points[:, :2] - np.round(points[:, :2].mean(axis=0))
    faces, neighbours = _delaunay(local, key)
    corners = local[faces]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    median = float(np.median(sides))
    area = _areas(corners)
    faces = np.where(area[:, None] < 0.0, faces[:, ::-1], faces)
    longest = MEDIAN_EDGES * median if longest is None else longest
    kept = (sides.max(axis=1) <= longest) & (np.abs(area) > 0.0)
    if not kept.any():
        raise InputError(
            f"no triangle has edges as short as {longest:.3g} m",
            key=f"{key}.longest_edge_m",
            remedy=f"Half of the edges are longer than {median:.3g} m.",
        )
    vertices, faces = compact(points, faces[kept])
    return vertices, faces, _holes(kept, neighbours, np.abs(area)), median


def _areas(corners: np.ndarray) -> np.ndarray:
    """The areas [F] of triangles [F, 3, 2], positive if they run counter-clockwise."""
    (ax, ay), (bx, by) = (corners[:, i].T - corners[:, 0].T for i in (1, 2))
    return 0.5 * (ax * by - ay * bx)


def _delaunay(local: np.ndarray, key: str) -> tuple[np.ndarray, np.ndarray]:
    """Faces int32 [F, 3] and for each side of them the face beyond it, -1 for none, [F, 3]."""

    def compute():
        try:
            found = Delaunay(local)
        except (QhullError, ValueError) as error:
            raise InputError(
                f"{counted(len(local), 'point')} make no surface",
                key=f"{key}.file",
                remedy="There are too few, or they lie on a line.",
            ) from error
        return {"faces": found.simplices.astype(np.int32), "neighbours": found.neighbors.astype(np.int32)}

    if len(local) < KEPT_POINTS:
        made = compute()
    else:
        made = cached(
            "survey",
            {"points": digest(local), "code": code_hash(__name__, (__name__,))},
            compute,
            what=f"the surface of {len(local)} points",
        )
    return made["faces"], made["neighbours"]


def _holes(kept: np.ndarray, neighbours: np.ndarray, area: np.ndarray) -> Holes:
    """Count the groups of triangles that were left out and do not reach the outline."""
    out = np.flatnonzero(~kept)
    if len(out) == 0:
        return Holes(0, 0.0)
    beyond = neighbours[out]
    face = np.repeat(out, 3)[(beyond.ravel() >= 0) & ~kept[beyond.ravel()]]
    other = beyond.ravel()[(beyond.ravel() >= 0) & ~kept[beyond.ravel()]]
    count, label = connected_components(
        coo_matrix((np.ones(len(face), bool), (face, other)), (len(kept),) * 2), directed=False
    )
    inner = np.zeros(count, bool)
    inner[label[out]] = True
    inner[label[out[(beyond < 0).any(axis=1)]]] = False
    size = np.bincount(label[out], area[out], minlength=count) * inner
    return Holes(int(np.count_nonzero(size)), float(size.sum()))
