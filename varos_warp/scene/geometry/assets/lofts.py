"""Lofts: closed solids from stacks of rings, with rounded edges and as many points as a chord error asks for.

Every solid is a stack of rings with equally many points, joined by quads, and either capped or closed to a torus.
Edges are rounded, since a perfectly sharp edge reflects no highlight (paper, section 3.1.2). Beside each rounding
there is one more ring on the flat face, so that smoothed normals bend in the rounding and nowhere else.
"""

from dataclasses import dataclass

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.geometry.assets.grids import fill_ring

LEAST_AROUND = 16
"""Points around a circle: 22.5 degrees from face to face are still smoothed by default."""
FINEST = 4e-6
"""Smallest chord error, as a share of a radius: 1100 points around; finer ones make millions of triangles."""
SUPPORT = 1.5
"""Distance from the edge to the ring beside a rounding, in tangent lengths."""


MOST_TRIANGLES = 20_000_000
"""Most triangles of an object; they take 5 GB on a device."""
SLENDER = 1.4
"""How many times longer than wide the quads of a grid are at most, where rings have as many points as another needs."""


@dataclass(frozen=True)
class Detail:
    """How finely a solid is made."""

    chord_error: float
    """How far its triangles may lie from the true surface [m]."""
    edge: float = np.inf
    """Sides of the quads of its grids are no longer [m]; inf: as long as the chord error lets them be."""
    key: str = "object"
    """Key of the object in the scene file."""

    @property
    def is_grid(self) -> bool:
        """True if it is made of even grids."""
        return bool(np.isfinite(self.edge))

    def finer(self, share: float) -> "Detail":
        """Return this detail with only a share of its chord error."""
        return Detail(share * self.chord_error, self.edge, self.key)

    def allow(self, triangles: float) -> None:
        """Refuse an object of more triangles than there may be.

        Raises:
            InputError: There are more than `MOST_TRIANGLES`.
        """
        if triangles > MOST_TRIANGLES:
            key = "max_edge_m" if self.is_grid else "chord_error_m"
            raise InputError(
                f"makes {triangles / 1e6:.4g} million triangles or more; an object has "
                f"{MOST_TRIANGLES // 10**6} million at most",
                key=f"{self.key}.{key}",
                remedy="Raise it, or make the object smaller.",
            )


def arc_steps(radius: float, angle: float, detail: Detail, least: int = 1) -> int:
    """Chords for an arc of ``angle`` [rad] that come within the chord error of it, r (1 - cos(step / 2)) <= e.

    In a grid they are no longer than its edges, either.
    """
    share = np.clip(detail.chord_error / radius, FINEST, 1.0)
    steps = max(angle / (2.0 * np.arccos(1.0 - share)), radius * angle / detail.edge)
    detail.allow(steps)
    return max(least, int(np.ceil(steps - 1e-9)))


def circle_points(radius: float, detail: Detail) -> int:
    """Points around a circle of ``radius``, a multiple of 4."""
    return 4 * -(-arc_steps(radius, 2.0 * np.pi, detail, LEAST_AROUND) // 4)


def rounded(line, radius, detail: Detail, closed: bool = False) -> np.ndarray:
    """A polyline with arcs in place of its corners.

    Args:
        line: float64 [..., P, 2]; along the leading axes the same corners, a little elsewhere.
        radius: Of the arcs [m], one or [P]; where 0, and at the ends of an open line, the corner stays. An arc and
            the points beside it take no more than 0.45 of the shorter edge.
        detail: An arc whose bevel would be as near as the chord error becomes one bevel; else it turns by 25 degrees
            or less a step, and has a point on the edges before and after it.
        closed: Whether the last point is followed by the first.

    Returns:
        float64 [..., Q, 2], with the same Q along the leading axes.
    """
    line = np.asarray(line, float)
    radius = np.broadcast_to(np.asarray(radius, float), line.shape[-2]).copy()
    if not closed:
        radius[[0, -1]] = 0.0
    before, after = line - np.roll(line, 1, axis=-2), np.roll(line, -1, axis=-2) - line
    pieces = [
        _corner(line[..., i, :], before[..., i, :], after[..., i, :], radius[i], detail) for i in range(line.shape[-2])
    ]
    return np.concatenate(pieces, axis=-2)


def _corner(corner, before, after, radius, detail):
    """Points [..., Q, 2] in place of one corner, between the edges ``before`` and ``after`` it."""
    if radius == 0.0:
        return corner[..., None, :]
    lengths = np.linalg.norm(before, axis=-1), np.linalg.norm(after, axis=-1)
    u, v = before / lengths[0][..., None], after / lengths[1][..., None]
    turn = np.arccos(np.clip(np.sum(u * v, axis=-1), -1.0, 1.0))
    tangent = np.minimum(radius * np.tan(0.5 * turn), 0.3 * np.minimum(*lengths))
    radius = tangent / np.tan(0.5 * turn)
    bevelled = np.max(radius * (1.0 - np.cos(0.5 * turn))) <= detail.chord_error
    smooth = int(np.ceil(np.degrees(turn.max()) / 25.0))
    steps = 1 if bevelled else arc_steps(radius.max(), turn.max(), detail, smooth)
    inwards = (v - u * np.cos(turn)[..., None]) / np.sin(turn)[..., None]
    angle = turn[..., None] * np.linspace(0.0, 1.0, steps + 1)
    arc = np.sin(angle)[..., None] * u[..., None, :] + (1.0 - np.cos(angle))[..., None] * inwards[..., None, :]
    arc = (corner - tangent[..., None] * u)[..., None, :] + radius[..., None, None] * arc
    if bevelled:
        return arc
    reach = SUPPORT * tangent[..., None]
    return np.concatenate([(corner - reach * u)[..., None, :], arc, (corner + reach * v)[..., None, :]], axis=-2)


def divided(line, longest: float, closed: bool = False) -> np.ndarray:
    """A polyline [P, 2] whose edges longer than ``longest`` are divided evenly."""
    following = np.roll(line, -1, axis=0)
    pieces = []
    for a, b in zip(line, following, strict=True):
        steps = max(1, int(np.ceil(np.linalg.norm(b - a) / longest - 1e-9)))
        pieces.append(a + np.linspace(0.0, 1.0, steps, endpoint=False)[:, None] * (b - a))
    return np.concatenate(pieces if closed else [*pieces[:-1], line[-1:]])


def graded(profiles, detail: Detail, closed: bool = False) -> np.ndarray:
    """Profiles [n, P, 2] of (radius, z) of a grid with n points around: divided so that its quads are no slivers.

    Pieces are no longer than the detail's edge, nor than `SLENDER` times the widest step around the axis there. The
    same division serves all of the profiles.
    """
    profiles = np.asarray(profiles, float)
    ends = np.roll(profiles, -1, axis=1) if closed else profiles[:, 1:]
    along = np.linspace(0.0, 1.0, 65)
    pieces = []
    for a, b in zip(np.moveaxis(profiles, 1, 0), np.moveaxis(ends, 1, 0), strict=False):
        radius = np.max(a[:, :1] + (b - a)[:, :1] * along, axis=0)  # [65], the widest of all profiles
        step = np.minimum(detail.edge, SLENDER * 2.0 * np.pi * np.maximum(radius, 1e-12) / len(profiles))
        length = np.linalg.norm(b - a, axis=1).max()
        count = np.concatenate([[0.0], np.cumsum(0.5 * (1.0 / step[1:] + 1.0 / step[:-1]))]) * length / 64.0
        detail.allow(2.0 * count[-1] * len(profiles))
        pieces_here = max(1, int(np.ceil(count[-1] - 1e-9)))
        places = np.interp(np.linspace(0.0, count[-1], pieces_here, endpoint=False), count, along)
        pieces.append(a[:, None] + places[:, None] * (b - a)[:, None])
    return np.concatenate(pieces if closed else [*pieces, profiles[:, -1:]], axis=1)


def lathe(profile, detail: Detail, count: int, closed: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Solid of revolution around z of a profile [P, 2] of (radius, z); an open one starts and ends on the axis."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    profile = np.asarray(profile, float)
    detail.allow(2 * count * len(profile))
    return turned(np.tile(profile[profile[:, 0] > 0.0], (count, 1, 1)), angles, detail, closed)


def turned(profiles, angles, detail: Detail, closed: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A solid around z with a profile [n, P, 2] of (radius, z) for each of n angles [rad]; capped, or closed.

    In a grid the points of its narrow rings are evenly apart, whatever the angles of the wide ones are.
    """
    if detail.is_grid:
        profiles = graded(profiles, detail, closed)
    rings = np.swapaxes(profiles, 0, 1)
    if detail.is_grid:
        even = angles[0] + 2.0 * np.pi / len(angles) * np.arange(len(angles))
        widest = rings[..., 0].max(axis=1, keepdims=True)
        share = np.clip((0.82 - widest / widest.max()) / 0.22, 0.0, 1.0)
        angles = angles + share * (even - np.unwrap(angles))
    x, y = rings[..., 0] * np.cos(angles), rings[..., 0] * np.sin(angles)
    return loft(np.stack([x, y, rings[..., 1]], axis=-1), detail, closed)


def loft(rings, detail: Detail, closed: bool = False, cap: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Join rings [R, m, 3] to a solid with outward normals: closed to a torus, or capped.

    Args:
        detail: In a grid, caps are filled with points as far apart as its edges.
        cap: Triangles [F, 3] of one ring's points that fill it; absent: a fan around its centre.
    """
    rings = np.asarray(rings)
    count, m = rings.shape[:2]
    number = np.arange(count * m).reshape(count, m)
    vertices, faces = rings.reshape(-1, 3), [band(np.vstack([number, number[:1]]) if closed else number)]
    detail.allow(2 * len(vertices))
    if not closed and cap is None and detail.is_grid:
        for ring, order in ((0, -1), (-1, 1)):
            inner, triangles = fill_ring(rings[ring], detail.edge)
            numbers = np.concatenate([number[ring], len(vertices) + np.arange(len(inner))])
            vertices, faces = np.vstack([vertices, inner]), [*faces, numbers[triangles][:, ::order]]
    elif not closed and cap is None:
        centres = np.stack([rings[0].mean(axis=0), rings[-1].mean(axis=0)])
        faces += [_fan(number[0], len(vertices))[:, ::-1], _fan(number[-1], len(vertices) + 1)]
        vertices = np.vstack([vertices, centres])
    elif not closed:
        faces += [cap[:, ::-1], number[-1][cap]]
    return outward(vertices, np.concatenate(faces))


def band(number) -> np.ndarray:
    """Triangles [F, 3] between consecutive rings of point numbers [R, m]."""
    a, b = number[:-1], number[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate([np.stack(corners, -1).reshape(-1, 3) for corners in ((a, a_next, b_next), (a, b_next, b))])


def outward(vertices, faces) -> tuple[np.ndarray, np.ndarray]:
    """The mesh with its faces turned so that its volume is positive: then the normals of a solid point outwards."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volume = np.einsum("fi,fi->", a, np.cross(b, c))
    return vertices, np.ascontiguousarray(faces if volume > 0.0 else faces[:, ::-1], dtype=np.int32)


def _fan(ring, centre):
    return np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), centre)])
