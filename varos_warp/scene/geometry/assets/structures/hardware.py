"""Small parts that structures are put together with: bars, bent bars, hexagons."""

import numpy as np

from varos_warp.scene.geometry.assets.lofts import (
    SLENDER,
    Detail,
    circle_points,
    divided,
    lathe,
    loft,
    rounded,
)
from varos_warp.scene.geometry.assets.slabs import slab
from varos_warp.scene.geometry.assets.structures.pieces import Mesh, placed

STUD = 0.9
"""Diameter of the studs, in that of their holes."""
ACROSS, NUT = 1.55, 0.85
"""Width across flats and height of their nuts, in their diameters (ISO 4032: 1.5 to 1.6 and 0.8 to 0.9)."""


def rod(radius: float, low: float, high: float, detail: Detail) -> Mesh:
    """A round bar along z with rounded ends."""
    profile = [(0.0, low), (radius, low), (radius, high), (0.0, high)]
    return lathe(rounded(profile, 0.15 * radius, detail), detail, circle_points(radius, detail))


def hexagon(across: float, low: float, high: float, detail: Detail, at=(0.0, 0.0)) -> Mesh:
    """A hexagon head or nut, ``across`` its flats wide [m], from z = ``low`` to ``high``."""
    corners = np.pi / 3.0 * np.arange(6)
    outline = across / np.sqrt(3.0) * np.column_stack([np.cos(corners), np.sin(corners)])
    return placed(
        slab([rounded(outline, 0.04 * across, detail, closed=True)], low, high, 0.05 * across, detail), None, (*at, 0.0)
    )


def studs(circle: float, hole: float, count: int, face: float, detail: Detail) -> list[Mesh]:
    """Stud bolts around z with a nut on each side, before faces at z = -face and face.

    Args:
        circle: Radius of the circle that they stand on [m].
        hole: Of their holes [m].
        count: How many there are.
        face: Half of the height of what they hold together [m].
        detail: How fine they are.
    """
    d = 2.0 * STUD * hole
    reach = face + (NUT + 0.35) * d
    meshes = [
        rod(0.5 * d, -reach, reach, detail),
        hexagon(ACROSS * d, face - 0.001, face + NUT * d, detail),
        hexagon(ACROSS * d, -face - NUT * d, 0.001 - face, detail),
    ]
    angles = 2.0 * np.pi / count * (0.5 + np.arange(count))
    return [placed(mesh, None, (circle * np.cos(a), circle * np.sin(a), 0.0)) for a in angles for mesh in meshes]


def bent_bar(line, bend: float, radius: float, detail: Detail) -> Mesh:
    """A round bar along a line [P, 2] (x, z) whose corners are bent by a radius ``bend`` of its middle, in y = 0."""
    half = detail.finer(0.5)
    line = rounded(line, bend, half)
    around = circle_points(radius, half)
    if detail.is_grid:
        line = divided(line, min(detail.edge, SLENDER * 2.0 * np.pi * radius / around))
    sides = np.diff(line, axis=0)
    sides /= np.linalg.norm(sides, axis=1, keepdims=True)
    along = np.concatenate([sides[:1], sides[1:] + sides[:-1], sides[-1:]])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turn = 2.0 * np.pi / around * np.arange(around)
    out = radius * np.cos(turn)
    # at a corner a ring lies in the plane that halves it, so it is wider there
    wide = np.concatenate([[1.0], 1.0 / np.sqrt(0.5 * (1.0 + np.einsum("ij,ij->i", sides[1:], sides[:-1]))), [1.0]])
    rings = np.stack(
        [
            line[:, :1] - (wide * along[:, 1])[:, None] * out,
            np.broadcast_to(radius * np.sin(turn), (len(line), around)),
            line[:, 1:] + (wide * along[:, 0])[:, None] * out,
        ],
        axis=-1,
    )
    return loft(rings, detail)


def ring(bend: float, radius: float, detail: Detail) -> Mesh:
    """A round bar of a radius bent to a ring around z, ``bend`` to its middle [m]."""
    half = detail.finer(0.5)
    steps = circle_points(bend + radius, half)
    angle = 2.0 * np.pi / steps * np.arange(steps)
    turn = 2.0 * np.pi / (around := circle_points(radius, half)) * np.arange(around)
    out = bend + radius * np.cos(turn)
    rings = np.stack(
        [
            np.cos(angle)[:, None] * out,
            np.sin(angle)[:, None] * out,
            np.broadcast_to(radius * np.sin(turn), (steps, around)),
        ],
        axis=-1,
    )
    return loft(rings, detail, closed=True)
