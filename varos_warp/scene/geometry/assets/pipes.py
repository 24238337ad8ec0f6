"""Pipes and what belongs to them: straight pipe, elbow, flange, support and valve."""

import numpy as np
import trimesh
from scipy.spatial import Delaunay

from varos_warp.errors import InputError
from varos_warp.scene.description.world import Elbow, Flange, Pipe, PipeSupport, Valve
from varos_warp.scene.geometry.assets.lofts import (
    SUPPORT,
    Detail,
    arc_steps,
    band,
    circle_points,
    divided,
    lathe,
    loft,
    outward,
    rounded,
)
from varos_warp.scene.geometry.assets.slabs import circle, mitred, slab
from varos_warp.scene.geometry.assets.structures.hardware import studs
from varos_warp.scene.geometry.assets.structures.pieces import ALONG_X, FACING, placed
from varos_warp.scene.geometry.joining import join

DEFAULT = Detail(1e-4)
CRADLE = np.pi - 0.4
"""Angle over which the groove of a support holds its pipe, where none is given [rad]."""
WALL = 0.08
"""Thickness of a pipe's wall, as a share of its radius, where none is given."""
RIM = 0.25
"""Radius of the rounded rims, as a share of the wall."""

FLANGES_MM = {
    15: (21.3, 95, 65, 14, 4, 14),
    20: (26.9, 105, 75, 14, 4, 16),
    25: (33.7, 115, 85, 14, 4, 16),
    32: (42.4, 140, 100, 18, 4, 18),
    40: (48.3, 150, 110, 18, 4, 18),
    50: (60.3, 165, 125, 18, 4, 20),
    65: (76.1, 185, 145, 18, 8, 20),
    80: (88.9, 200, 160, 18, 8, 20),
    100: (114.3, 220, 180, 18, 8, 22),
    125: (139.7, 250, 210, 18, 8, 22),
    150: (168.3, 285, 240, 22, 8, 24),
    200: (219.1, 340, 295, 22, 12, 26),
    250: (273.0, 405, 355, 26, 12, 29),
    300: (323.9, 460, 410, 26, 12, 32),
    350: (355.6, 520, 470, 26, 16, 35),
    400: (406.4, 580, 525, 30, 16, 38),
    500: (508.0, 715, 650, 33, 20, 46),
    600: (610.0, 840, 770, 36, 20, 55),
}
"""EN 1092-1, PN 16, type 01 (plate), by DN: outer diameters of pipe and flange, diameters of bolt circle and holes,
number of holes, thickness [mm]."""
GASKET = 0.06
"""Thickness of the gasket between two flanges, in those of one."""
BORE = 1.012
"""Bore of a flange over the pipe's outer diameter; 1.01 to 1.015 in the standard."""


def pipe(block: Pipe, key: str = "pipe", detail: Detail = DEFAULT):
    """A tube along z, centred, with rounded rims; a rod where the wall is as thick as the radius."""
    r, half = block.radius, 0.5 * block.length
    wall = WALL * r if block.wall is None else block.wall
    return lathe(_tube(r, wall, -half, half, detail), detail, circle_points(r, detail), closed=wall < r)


def elbow(block: Elbow, key: str = "elbow", detail: Detail = DEFAULT):
    """A tube bent in the xz plane from the origin along +z towards +x, with rounded rims; a full turn is a torus."""
    r, R, angle = block.radius, block.bend_radius, np.radians(block.angle_deg)
    if R <= r:
        raise InputError(
            f"must exceed the pipe's radius of {r} m",
            key=f"{key}.bend_radius",
            value=R,
            remedy="The inside of the bend would cross itself.",
        )
    wall = min(WALL * r if block.wall is None else block.wall, r)
    # half of the error around, half along: at the middle of a quad they add up; 25 degrees a step are smoothed over
    least = int(np.ceil(block.angle_deg / 25.0))
    around, steps = circle_points(r, detail.finer(0.5)), arc_steps(R + r, angle, detail.finer(0.5), least)
    detail.allow(2 * around * steps)
    if block.angle_deg == 360.0:
        steps = max(steps, circle_points(R + r, detail.finer(0.5)))
        rings = [_bend_ring(R, r, a, around) for a in np.linspace(0.0, angle, steps, endpoint=False)]
        return loft(rings, detail, closed=True)
    profile = divided(_tube(r, wall, 0.0, R * angle, detail), R * angle / steps, closed=wall < r)
    if detail.is_grid:
        profile = divided(profile, detail.edge, closed=wall < r)
    return loft([_bend_ring(R, radius, along / R, around) for radius, along in profile], detail, closed=wall < r)


def flange(block: Flange, key: str = "flange", detail: Detail = DEFAULT):
    """A plate flange around z from z = 0 up, with the proportions of the DN whose pipe is nearest in radius."""
    outer, middle, hole, count, thickness = flange_measures(block.radius)
    b = 0.04 * thickness
    inner = BORE * block.radius
    angles = 2.0 * np.pi / count * (0.5 + np.arange(count))
    if detail.is_grid:
        holes = [circle(hole, detail, middle * np.array([np.cos(a), np.sin(a)])) for a in angles]
        outlines = [circle(outer, detail), circle(inner, detail)[::-1], *(around[::-1] for around in holes)]
        return slab(outlines, 0.0, thickness, b, detail)
    longest = 1.8 * (min(outer - middle - hole, middle - inner - hole) - 2.0 * SUPPORT * b)
    rim = [(middle, thickness), (outer, thickness), (outer, 0.0), (middle, 0.0)]
    bore = [(middle, 0.0), (inner, 0.0), (inner, thickness), (middle, thickness)]
    eye = [(middle, 0.0), (hole, 0.0), (hole, thickness), (middle, thickness)]
    walls = [_wall(rim, 0.0, b, detail, longest), _wall(bore, 0.0, b, detail, longest)]
    walls += [_wall(eye, middle * np.exp(1j * angle), b, detail, longest) for angle in angles]
    return _plate(walls)


def flange_measures(radius: float) -> tuple[float, float, float, int, float]:
    """Radii of flange, bolt circle and holes, number of holes, thickness [m] for a pipe of outer ``radius`` [m]."""
    nearest = min(FLANGES_MM.values(), key=lambda row: abs(np.log(row[0] / (2e3 * radius))))
    pipe_diameter, outer, circle, hole, count, thickness = nearest
    scale = radius / pipe_diameter
    return outer * scale, circle * scale, hole * scale, count, 2.0 * thickness * scale


def pipe_support(block: PipeSupport, key: str = "pipe_support", detail: Detail = DEFAULT):
    """A saddle under a pipe along y: a half-round groove in a block that widens to its foot."""
    r = block.radius
    height = 2.0 * r if block.height is None else block.height
    if height < 1.15 * r:
        raise InputError(
            f"the foot must lie at least {1.15 * r:.4g} m below the pipe's axis",
            key=f"{key}.height",
            value=height,
            remedy="Leave it out for twice the radius.",
        )
    half, b = 0.6 * r if block.length is None else 0.5 * block.length, 0.03 * r
    cradle = CRADLE if block.cradle_deg is None else np.deg2rad(block.cradle_deg)
    batter = None if block.batter_deg is None else np.tan(np.deg2rad(block.batter_deg))
    outline, cap = _saddle(r, height, cradle, batter, detail)
    if detail.is_grid:
        vertices, faces = slab([outline], -half, half, b, detail)
        return outward(_battered(vertices[:, [0, 2, 1]], half, batter), faces)
    normals = mitred(outline)
    ends = rounded([(r, -half), (0.0, -half), (0.0, half), (r, half)], b, detail)[1:-1]
    rings = [outline - inset * normals for inset, _ in ends]
    vertices, faces = loft(
        [
            np.column_stack([ring[:, 0], np.full(len(ring), y), ring[:, 1]])
            for ring, (_, y) in zip(rings, ends, strict=True)
        ],
        detail,
        cap=cap,
    )
    return _battered(vertices, half, batter), faces


def valve(block: Valve, key: str = "valve", detail: Detail = DEFAULT):
    """Two flanges and a body on a pipe along y, bonnet and stem along +z, a hand wheel with four spokes.

    Where it is ``bolted``, each flange is bolted to one of the pipe.
    """
    r = block.radius

    def disc(radius, low, high, bevel=0.12):
        profile = [(0.0, low), (radius, low), (radius, high), (0.0, high)]
        return lathe(rounded(profile, bevel * min(radius, high - low), detail), detail, circle_points(radius, detail))

    body = [
        (1.4 * r * np.sin(a), -1.2 * r * np.cos(a))
        for a in np.linspace(0.0, np.pi, arc_steps(1.4 * r, np.pi, detail, 8) + 1)[1:-1]
    ]
    plate = flange(Flange(kind="flange", radius=r), key, detail)
    flip = np.diag([1.0, -1.0, -1.0])
    lying = [disc(1.03 * r, -1.95 * r, 1.95 * r, 0.02), lathe(body, detail, circle_points(1.4 * r, detail))]
    for joint in _joint(r, plate, detail) if block.bolted else [plate]:
        lying += [placed(joint, None, (0.0, 0.0, -2.0 * r)), placed(joint, flip, (0.0, 0.0, 2.0 * r))]
    upright = [disc(0.9 * r, r, 1.8 * r), disc(1.1 * r, 1.8 * r, 2.1 * r), disc(0.18 * r, 2.0 * r, 3.6 * r)]
    wheel = trimesh.creation.torus(
        1.3 * r,
        0.12 * r,
        major_sections=circle_points(1.42 * r, detail.finer(0.5)),
        minor_sections=circle_points(0.12 * r, detail.finer(0.5)),
    )
    spoke = disc(0.07 * r, -1.3 * r, 1.3 * r)
    lift = np.array([0.0, 0.0, 3.45 * r])
    pieces = [placed(mesh, FACING) for mesh in lying] + upright
    pieces += [(np.asarray(wheel.vertices) + lift, np.asarray(wheel.faces))]
    return join(pieces + [placed(spoke, axis, lift) for axis in (FACING, ALONG_X)])


def _joint(r, plate, detail):
    """A flange from z = 0 up, the pipe's below it, the gasket between them and the bolts, each a closed solid."""
    _, middle, hole, count, thickness = flange_measures(r)
    gap, core = GASKET * thickness, middle - 1.2 * hole
    # a core within both flanges, of which the gap shows a ring
    seal = [
        (0.0, -gap - 0.8 * thickness),
        (core, -gap - 0.8 * thickness),
        (core, 0.8 * thickness),
        (0.0, 0.8 * thickness),
    ]
    gasket = lathe(rounded(seal, 0.2 * gap, detail), detail, circle_points(middle, detail))
    bolts = studs(middle, hole, count, thickness + 0.5 * gap, detail)
    lower = placed(plate, None, (0.0, 0.0, -thickness - gap))
    return [plate, lower, gasket, *(placed(bolt, None, (0.0, 0.0, -0.5 * gap)) for bolt in bolts)]


# ---------------------------------------------------------------------------------------------------------------- tubes


def _tube(r, wall, low, high, detail):
    """Rounded profile [P, 2] of (radius, place along the pipe); that of a rod ends at the rims, not on the axis."""
    bevel = RIM * min(wall, r, high - low)
    if wall >= r:
        return rounded([(0.0, low), (r, low), (r, high), (0.0, high)], bevel, detail)[1:-1]
    return rounded([(r, low), (r, high), (r - wall, high), (r - wall, low)], bevel, detail, closed=True)


def _bend_ring(bend_radius, radius, angle, count):
    """Circle of a pipe bend at ``angle`` [rad] along it: the centre is (R (1 - cos), 0, R sin)."""
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    outwards = bend_radius - radius * np.cos(around)
    return np.column_stack([bend_radius - outwards * np.cos(angle), radius * np.sin(around), outwards * np.sin(angle)])


# --------------------------------------------------------------------------------------------------------------- plates


def _wall(profile, centre, bevel, detail, longest):
    """Rings [R, m, 3] of a rounded edge around a ``centre`` (complex), from one face of a plate to the other.

    No edge of a ring is longer than ``longest``, twice the gap to the next ring at most: then the circle around it
    holds no other point, and the Delaunay triangulation of the faces keeps it (Gabriel and Sokal 1969).
    """
    line = rounded(profile, bevel, detail)[1:-1]
    radius = line[:, 0].max()
    count = max(circle_points(radius, detail), 4 * int(np.ceil(0.5 * np.pi * radius / longest)))
    around = centre + line[:, :1] * np.exp(2j * np.pi / count * np.arange(count))
    return np.stack([around.real, around.imag, np.broadcast_to(line[:, 1:], around.shape)], axis=-1)


def _plate(walls):
    """A plate between two parallel faces from its walls: the outer one first, from the top down; holes upwards."""
    starts = np.cumsum([0] + [wall[..., 0].size for wall in walls])
    numbers = [
        start + np.arange(wall[..., 0].size).reshape(wall.shape[:2]) for start, wall in zip(starts, walls, strict=False)
    ]
    faces = [band(number) for number in numbers]
    for low in (True, False):  # outer walls end below, holes begin there
        edges = [number[-1 if low == (i == 0) else 0] for i, number in enumerate(numbers)]
        hole = np.concatenate([np.full(len(edge), i) for i, edge in enumerate(edges)])
        points = np.concatenate([wall[-1 if low == (i == 0) else 0, :, :2] for i, wall in enumerate(walls)])
        triangles = Delaunay(points).simplices
        of = hole[triangles]
        triangles = triangles[(of[:, 0] == 0) | (of != of[:, :1]).any(axis=1)]  # none across a hole
        filled = np.concatenate(edges)[triangles]
        faces.append(filled if low else filled[:, ::-1])
    return outward(np.concatenate([wall.reshape(-1, 3) for wall in walls]), np.concatenate(faces))


# -------------------------------------------------------------------------------------------------------------- saddles


def _battered(vertices, half, batter):
    """Vertices [N, 3] of a support whose ends y = +-``half`` lean by a tangent; None: upright."""
    if batter is None:
        return vertices
    below = vertices[:, 2].max() - vertices[:, 2]
    return vertices * np.column_stack([np.ones(len(below)), 1.0 + batter * below / half, np.ones(len(below))])


def _saddle(r, height, cradle, batter, detail):
    """Outline [2 n, 2] of a support, seen along the pipe, and the triangles between its lower and its upper half.

    ``cradle`` is the angle that the groove holds the pipe over [rad]; beyond it goes on along its tangents. The sides
    lean by the tangent ``batter``.
    """
    ease, on = 0.5 * (np.pi - cradle), r * np.tan(0.2)
    lip, rim = r * np.cos(ease) + on * np.sin(ease), -r * np.sin(ease) + on * np.cos(ease)
    arc = np.linspace(ease - np.pi, -ease, arc_steps(r, cradle, detail, 9) + 1)
    groove = [(-lip, rim), *(r * np.column_stack([np.cos(arc), np.sin(arc)])), (lip, rim)]
    shoulder = 1.4 * r
    sole = 1.6 * r if batter is None else shoulder + batter * (height + rim)
    top = np.array([(-sole, -height), (-shoulder, rim), *groove, (shoulder, rim), (sole, -height)])
    top = rounded(top, r * np.array([0.0, 0.1, 0.06, *np.zeros(len(arc)), 0.06, 0.1, 0.0]), detail)[1:-1]
    foot = np.array([(-shoulder, rim), (-sole, -height), (sole, -height), (shoulder, rim)])
    foot = rounded(foot, 0.1 * r, detail)[1:-1]
    corner = len(foot) // 2
    between = np.column_stack([sole / shoulder * top[corner:-corner, 0], np.full(len(top) - 2 * corner, -height)])
    outline = np.vstack([foot[:corner], between, foot[corner:], top[::-1]])
    return outline, _strip(np.arange(len(top)), 2 * len(top) - 1 - np.arange(len(top)))


def _strip(lower, upper):
    """Triangles between two lines of point numbers, from left to right, of which the first two may be in one line."""
    l, u = lower[2:-2], upper[2:-2]
    left = np.concatenate([lower[1::-1], upper[:3]])
    right = np.concatenate([lower[-2:], upper[:-4:-1]])
    triangles = [
        (l[:-1], l[1:], u[1:]),
        (l[:-1], u[1:], u[:-1]),
        (np.full(4, l[0]), left[1:], left[:-1]),
        (np.full(4, l[-1]), right[:-1], right[1:]),
    ]
    return np.concatenate([np.column_stack(corners) for corners in triangles])
