"""Parametric man-made objects and boulders (paper 3.1.1): closed solids with bevelled edges, outward normals.

Every solid is a loft: a stack of closed rings with equally many points, joined by quads, and either capped or closed
to a torus. Sharp edges are bevelled, since a perfectly sharp edge reflects no highlight (paper, section 3.1.1).
"""

import numpy as np
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.description import Bolt, Boulder, Elbow, Nut, ParametricObject, Pipe, PipeSupport, Valve
from varos_warp.scene.terrain import join

SEGMENTS = 48
"""Points around a pipe."""

HEX_SIZES_MM = {
    "M5": (8.0, 3.5, 4.7), "M6": (10.0, 4.0, 5.2), "M8": (13.0, 5.3, 6.8), "M10": (16.0, 6.4, 8.4),
    "M12": (18.0, 7.5, 10.8), "M14": (21.0, 8.8, 12.8), "M16": (24.0, 10.0, 14.8), "M18": (27.0, 11.5, 15.8),
    "M20": (30.0, 12.5, 18.0), "M22": (34.0, 14.0, 19.4), "M24": (36.0, 15.0, 21.5), "M27": (41.0, 17.0, 23.8),
    "M30": (46.0, 18.7, 25.6), "M33": (50.0, 21.0, 28.7), "M36": (55.0, 22.5, 31.0), "M42": (65.0, 26.0, 34.0),
    "M48": (75.0, 30.0, 38.0),
}
"""Width across flats s and head height k of ISO 4014 bolts, height m of ISO 4032 nuts [mm] (nominal, or the maximum).

The same s in both standards (and in ISO 272). No threads are modelled.
"""


def make_asset(block: ParametricObject, key: str = "object") -> tuple[np.ndarray, np.ndarray]:
    """Vertices float64 [V, 3] [m] and faces int32 [F, 3] of a parametric object, in its own axes.

    Raises:
        InputError: An unknown bolt size, or measures that make no solid.
    """
    return _MAKERS[type(block)](block, key)


def pipe(block: Pipe, key: str = "pipe"):
    """A tube along z, centred, with bevelled rims; a rod where the wall is as thick as the radius."""
    r, half = block.radius, 0.5 * block.length
    wall = 0.08 * r if block.wall is None else block.wall
    b = 0.25 * min(wall, r, block.length)
    if wall >= r:
        return _lathe([(0.0, -half), (r - b, -half), (r, b - half), (r, half - b), (r - b, half), (0.0, half)])
    inner = r - wall
    return _lathe([(inner + b, -half), (r - b, -half), (r, b - half), (r, half - b), (r - b, half), (inner + b, half),
                   (inner, half - b), (inner, b - half)], closed=True)


def elbow(block: Elbow, key: str = "elbow"):
    """A tube bent in the xz plane from the origin along +z towards +x, with bevelled rims."""
    r, R, angle = block.radius, block.bend_radius, np.radians(block.angle_deg)
    if R <= r:
        raise InputError(f"must exceed the pipe's radius of {r} m", key=f"{key}.bend_radius", value=R,
                         remedy="The inside of the bend would cross itself.")
    wall = min(0.08 * r if block.wall is None else block.wall, r)
    steps = max(4, int(np.ceil(angle / np.radians(5.0))))
    if block.angle_deg == 360.0:
        path = [(r, a) for a in np.linspace(0.0, angle, steps, endpoint=False)]
        return _loft([_bend_ring(R, radius, a) for radius, a in path], closed=True)
    b = 0.25 * min(wall, r, R * angle)
    bevel = b / R
    outside = [(r - b, 0.0)] + [(r, a) for a in np.linspace(bevel, angle - bevel, steps)] + [(r - b, angle)]
    if wall >= r:
        return _loft([_bend_ring(R, radius, a) for radius, a in outside])
    inner = r - wall
    inside = [(inner + b, angle)] + [(inner, a) for a in np.linspace(angle - bevel, bevel, steps)] + [(inner + b, 0.0)]
    return _loft([_bend_ring(R, radius, a) for radius, a in outside + inside], closed=True)


def pipe_support(block: PipeSupport, key: str = "pipe_support"):
    """A saddle under a pipe along y: a half-round groove in a block that widens to its foot."""
    r = block.radius
    height = 2.0 * r if block.height is None else block.height
    if height <= 1.05 * r:
        raise InputError(f"the foot must lie below the pipe's underside at {r} m", key=f"{key}.height", value=height,
                         remedy="Leave it out for twice the radius.")
    groove = np.linspace(np.pi, 2.0 * np.pi, SEGMENTS // 2 + 1)
    top = np.vstack([[-1.4 * r, 0.0], r * np.column_stack([np.cos(groove), np.sin(groove)]), [1.4 * r, 0.0]])
    foot = np.column_stack([np.linspace(-1.6 * r, 1.6 * r, len(top)), np.full(len(top), -height)])
    outline = np.vstack([foot, top[::-1]])
    half, b = 0.6 * r, 0.05 * r
    inset = outline - b * _outward(outline)
    rings = [(inset, -half), (outline, b - half), (outline, half - b), (inset, half)]
    return _loft([np.column_stack([ring[:, 0], np.full(len(ring), y), ring[:, 1]]) for ring, y in rings], cap="strip")


def bolt(block: Bolt, key: str = "bolt"):
    """Hexagon head bolt after ISO 4014: the head from z = 0 to k, the shank above it; no thread."""
    d, s, k, _ = hex_measures(block.size, f"{key}.size")
    length = 4.0 * d if block.length is None else block.length
    c = 0.08 * min(d, length)
    head = [_hexagon(0.47 * s, 0.0, round_off=0.5 * s), _hexagon(0.5 * s, 0.15 * k), _hexagon(0.5 * s, 0.95 * k),
            _hexagon(0.49 * s, k)]
    shank = [_circle(0.5 * d, k), _circle(0.5 * d, k + length - c), _circle(0.5 * d - c, k + length)]
    return _loft(head + shank)


def nut(block: Nut, key: str = "nut"):
    """Hexagon nut after ISO 4032, centred, around z, with chamfered bore; no thread."""
    d, s, _, m = hex_measures(block.size, f"{key}.size")
    half, c = 0.5 * m, 0.06 * d
    rings = [_hexagon(0.47 * s, -half, round_off=0.5 * s), _hexagon(0.5 * s, -0.8 * half),
             _hexagon(0.5 * s, 0.8 * half), _hexagon(0.47 * s, half, round_off=0.5 * s),
             _circle(0.5 * d + c, half), _circle(0.5 * d, half - c), _circle(0.5 * d, c - half),
             _circle(0.5 * d + c, -half)]
    return _loft(rings, closed=True)


def valve(block: Valve, key: str = "valve"):
    """Two flanges and a body on a pipe along y, bonnet and stem along +z, a hand wheel with four spokes."""
    r = block.radius
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # z to -y

    def disc(radius, low, high):
        b = 0.15 * (high - low)
        return _lathe([(0.0, low), (radius - b, low), (radius, low + b), (radius, high - b), (radius - b, high),
                       (0.0, high)])

    along = [disc(1.6 * r, -2.0 * r, -1.7 * r), disc(1.6 * r, 1.7 * r, 2.0 * r), disc(1.02 * r, -1.9 * r, 1.9 * r),
             _lathe([(0.0, -1.2 * r), *[(1.4 * r * np.sin(a), -1.2 * r * np.cos(a)) for a in
                                       np.linspace(0.15, np.pi - 0.15, 16)], (0.0, 1.2 * r)])]
    upright = [disc(0.9 * r, r, 1.8 * r), disc(1.1 * r, 1.8 * r, 2.1 * r), disc(0.18 * r, 2.0 * r, 3.6 * r)]
    wheel = trimesh.creation.torus(1.3 * r, 0.12 * r, major_sections=SEGMENTS, minor_sections=16)
    spokes = [(_lathe([(0.0, -1.3 * r), (0.07 * r, -1.3 * r), (0.07 * r, 1.3 * r), (0.0, 1.3 * r)]), axis)
              for axis in (turn, np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))]
    lift = np.array([0.0, 0.0, 3.45 * r])
    pieces = [(v @ turn.T, f) for v, f in along] + upright
    pieces += [(np.asarray(wheel.vertices) + lift, np.asarray(wheel.faces))]
    pieces += [(v @ axis.T + lift, f) for (v, f), axis in spokes]
    return join(pieces)


def boulder(block: Boulder, key: str = "boulder"):
    """A sphere with planes cut off and seeded noise: as angular as a broken rock, smooth as a weathered one."""
    rng = np.random.default_rng(block.seed)
    ball = trimesh.creation.icosphere(subdivisions=4)
    p = np.asarray(ball.vertices)
    normals = rng.standard_normal((18, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for n, offset in zip(normals, rng.uniform(0.6, 0.95, len(normals)), strict=True):
        p = p - 0.94 * np.maximum(p @ n - offset, 0.0)[:, None] * n
    noise = np.zeros(len(p))
    for octave in range(2, 6):
        waves = rng.standard_normal((6, 3)) * 2.0**octave
        noise += np.cos(p @ waves.T + rng.uniform(0.0, 2.0 * np.pi, 6)).sum(axis=1) * 0.02 * 0.55**octave
    p = p * (1.0 + noise)[:, None] * rng.uniform([0.8, 0.8, 0.55], [1.0, 1.0, 0.8])
    return 0.5 * block.diameter * p, np.asarray(ball.faces, np.int32)


def hex_measures(size: str, key: str = "size") -> tuple[float, float, float, float]:
    """Thread diameter d, width across flats s, head height k, nut height m [m] of a metric size such as ``M24``."""
    if size not in HEX_SIZES_MM:
        raise InputError("unknown bolt size", key=key, value=size, remedy=f"Known sizes: {', '.join(HEX_SIZES_MM)}.")
    s, k, m = HEX_SIZES_MM[size]
    return float(size[1:]) / 1e3, s / 1e3, k / 1e3, m / 1e3


_MAKERS = {Pipe: pipe, Elbow: elbow, PipeSupport: pipe_support, Bolt: bolt, Nut: nut, Valve: valve, Boulder: boulder}


# -------------------------------------------------------------------------------------------------------- rings, lofts

_FLAT = np.radians(np.linspace(-26.0, 26.0, 8))
_HEX_ANGLES = np.concatenate([_FLAT + np.pi / 3.0 * side for side in range(6)])
"""Polar angles of hexagon and circle rings alike: eight points a side, the corners cut 4 degrees to each side."""


def _hexagon(half_width, z, round_off=None):
    """Hexagon ring with cut corners; ``round_off`` limits its radius, as the chamfer of a bolt head does."""
    radius = half_width / np.cos(np.tile(_FLAT, 6))
    if round_off is not None:
        radius = np.minimum(radius, round_off)
    return np.column_stack([radius * np.cos(_HEX_ANGLES), radius * np.sin(_HEX_ANGLES), np.full(len(radius), z)])


def _circle(radius, z):
    return np.column_stack([radius * np.cos(_HEX_ANGLES), radius * np.sin(_HEX_ANGLES), np.full(len(_HEX_ANGLES), z)])


def _lathe(profile, closed=False):
    """Solid of revolution around z of a profile of (radius, z); open profiles start and end on the axis."""
    angles = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(SEGMENTS, z)])
             for r, z in profile if r > 0.0]
    return _loft(rings, closed=closed)


def _bend_ring(bend_radius, radius, angle):
    """Circle of a pipe bend at ``angle`` [rad] along it: the centre is (R (1 - cos), 0, R sin)."""
    around = np.linspace(0.0, 2.0 * np.pi, SEGMENTS, endpoint=False)
    outwards = bend_radius - radius * np.cos(around)
    return np.column_stack([bend_radius - outwards * np.cos(angle), radius * np.sin(around), outwards * np.sin(angle)])


def _outward(outline):
    """Mitred outward normals [N, 2] of a closed outline that runs counter-clockwise."""
    edges = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1, keepdims=True)
    mean = normals + np.roll(normals, 1, axis=0)
    return 2.0 * mean / np.sum(mean**2, axis=1, keepdims=True)


def _loft(rings, closed=False, cap="fan"):
    """Join rings [m, 3] by quads; closed to a torus, or capped by fans (strips, for outlines of two matching halves).

    The faces are turned so that the volume is positive, which makes the normals point outwards.
    """
    rings = np.asarray(rings)
    count, m = rings.shape[:2]
    number = np.arange(count * m).reshape(count, m)
    a = number if closed else number[:-1]
    b = np.roll(number, -1, axis=0) if closed else number[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    faces = [np.stack([a, a_next, b_next], -1).reshape(-1, 3), np.stack([a, b_next, b], -1).reshape(-1, 3)]
    vertices = rings.reshape(-1, 3)
    if not closed and cap == "strip":
        faces += [_strip(number[0])[:, ::-1], _strip(number[-1])]
    elif not closed:
        centres = np.stack([rings[0].mean(axis=0), rings[-1].mean(axis=0)])
        faces += [_fan(number[0], len(vertices))[:, ::-1], _fan(number[-1], len(vertices) + 1)]
        vertices = np.vstack([vertices, centres])
    faces = np.concatenate(faces).astype(np.int32)
    volume = np.einsum("fi,fi->", vertices[faces[:, 0]], np.cross(vertices[faces[:, 1]], vertices[faces[:, 2]]))
    return vertices, faces if volume > 0.0 else faces[:, ::-1].copy()


def _fan(ring, centre):
    return np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), centre)])


def _strip(ring):
    """Triangles between an outline's first half and its second half run backwards."""
    half = len(ring) // 2
    low, high = ring[:half], ring[half:][::-1]
    return np.concatenate([np.column_stack([low[:-1], low[1:], high[1:]]),
                           np.column_stack([low[:-1], high[1:], high[:-1]])])
