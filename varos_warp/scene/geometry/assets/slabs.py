"""Slabs: plane outlines with holes, drawn out between two parallel faces, their edges rounded."""

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.geometry.assets.grids import area, fill_between
from varos_warp.scene.geometry.assets.lofts import SLENDER, Detail, band, circle_points, divided, outward, rounded


def slab(
    loops, low: float, high: float, bevel: float, detail: Detail, lean: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """A solid between the planes z = low and z = high.

    Args:
        loops: Outlines [m, 2], the outer one counter-clockwise, holes clockwise.
        low, high: Where its faces lie [m].
        bevel: Radius of the rounded edges between its faces and its walls [m], or what the outlines' own arcs and
            short sides allow; 0: sharp.
        detail: How fine it is; the outlines are divided as that asks for, and never moved.
        lean: How far the upper face is drawn in [m]; of outlines without holes only.
    """
    loops = [np.asarray(loop, float) for loop in loops]
    if detail.is_grid:
        loops = [divided(loop, detail.edge, closed=True) for loop in loops]
    bevel = min(bevel, *(0.6 * _room(loop) for loop in loops))
    far = 1e3 * (high - low)
    ends = np.array([(0.0, low), (lean, high)])
    if bevel > 0.0:
        ends = rounded([(far, low), (0.0, low), (lean, high), (far, high)], bevel, detail)[1:-1]
    deepest = ends[:, 0].max() if lean else ends[0, 0]
    detail.allow(2.0 * area(loops[0]) / detail.edge**2)
    try:
        loops, inner, triangles = fill_between(loops, detail.edge, lambda loops: [inset(x, deepest) for x in loops])
    except ValueError:
        raise InputError(
            "its measures make no solid: outlines would cross", key=detail.key, remedy="Change its measures."
        ) from None
    detail.allow(2 * len(triangles))
    walls = [_wall(loop, ends, detail) for loop in loops]
    starts = np.cumsum([0, *(wall[..., 0].size for wall in walls), len(inner)])
    numbers = [
        start + np.arange(wall[..., 0].size).reshape(wall.shape[:2]) for start, wall in zip(starts, walls, strict=False)
    ]
    faces = [band(number) for number in numbers]
    for end, start, order in ((0, starts[-2], -1), (-1, starts[-1], 1)):
        points = np.concatenate([*(number[end] for number in numbers), start + np.arange(len(inner))])
        faces.append(points[triangles][:, ::order])
    lids = [np.column_stack([inner, np.full(len(inner), z)]) for z in (low, high)]
    return outward(np.concatenate([*(wall.reshape(-1, 3) for wall in walls), *lids]), np.concatenate(faces))


def _wall(loop, ends, detail):
    """Rings [R, m, 3] of an outline's wall along ``ends`` [R, 2]: how far drawn in, and z."""
    if detail.is_grid:
        longest = np.linalg.norm(np.roll(loop, -1, axis=0) - loop, axis=1).max()
        ends = divided(ends, min(detail.edge, SLENDER * longest))
    detail.allow(2 * len(ends) * len(loop))
    return np.stack([np.column_stack([inset(loop, depth), np.full(len(loop), z)]) for depth, z in ends])


def box(low, high, bevel: float, detail: Detail) -> tuple[np.ndarray, np.ndarray]:
    """A box between two corners [3], its edges rounded by ``bevel`` [m]."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return slab([rounded(rectangle((x0, y0), (x1, y1)), 2.0 * bevel, detail, closed=True)], z0, z1, bevel, detail)


def rectangle(low, high) -> np.ndarray:
    """Corners [4, 2] of a rectangle, counter-clockwise."""
    return np.array([low, (high[0], low[1]), high, (low[0], high[1])], float)


def circle(radius: float, detail: Detail, centre=(0.0, 0.0)) -> np.ndarray:
    """Points [m, 2] around a circle, counter-clockwise."""
    angles = 2.0 * np.pi / (count := circle_points(radius, detail)) * np.arange(count)
    return np.asarray(centre) + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def inset(outline, depth: float) -> np.ndarray:
    """An outline [m, 2] drawn in to its left by ``depth`` [m]."""
    return outline - depth * mitred(outline) if depth else outline


def _room(outline) -> float:
    """How far an outline may be drawn in until a side of it has no length left [m]."""
    sides, corners = np.roll(outline, -1, axis=0) - outline, mitred(outline)
    lengths = np.linalg.norm(sides, axis=1)
    lost = np.einsum("ij,ij->i", np.roll(corners, -1, axis=0) - corners, sides) / lengths  # for each metre
    return float(np.min(lengths[lost > 1e-9] / lost[lost > 1e-9], initial=np.inf))


def mitred(outline) -> np.ndarray:
    """Mitred outward normals [N, 2] of a closed outline that runs counter-clockwise."""
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1, keepdims=True)
    mean = normals + np.roll(normals, 1, axis=0)
    return 2.0 * mean / np.sum(mean**2, axis=1, keepdims=True)
