"""An inspection ROV: a float of foam over a frame of two plates, a housing with a dome, lamps, thrusters in ducts."""

import numpy as np

from varos_warp.scene.description.structures import Rov
from varos_warp.scene.geometry.assets.lofts import Detail, circle_points, lathe, loft, rounded
from varos_warp.scene.geometry.assets.slabs import box, rectangle, slab
from varos_warp.scene.geometry.assets.structures.pieces import ALONG_X, Mesh, Piece, chosen, placed

YELLOW, BLACK, GREY, BARE = (0.36, 0.23, 0.02), (0.035, 0.035, 0.037), (0.14, 0.145, 0.15), (0.26, 0.26, 0.25)
CABLE = (0.30, 0.14, 0.02)
GLASS, PANE = (0.03, 0.032, 0.035), (0.45, 0.45, 0.43)
ALONG_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Turns a drawing's axes (right, up, towards the viewer) to x, -z, y: what is turned about z lies along y."""
PLATE_M = 0.012
"""Thickness of the side plates."""
TETHER_RADIUS_M, TETHER_STEP_M = 0.0075, 0.02
"""Radius of the tether, and the largest distance between the rings that it is made of."""


def rov(block: Rov, key: str, detail: Detail) -> list[Piece]:
    """Pieces of an ROV, each a closed solid."""
    pieces = {
        "foam": _foam(block, detail),
        "frame": _frame(block, detail),
        "housings": _housings(block, detail),
        "lamps": [part for at in block.lamps for part in _lamp(block, at, detail)],
        "thrusters": [part for x in (-1.0, 1.0) for part in _thruster(block, x, detail)],
        "tether": [(CABLE, _tether(block, detail))] if block.tether_m else [],
    }
    return chosen(pieces, block.only)


def _foam(block, detail):
    """Two halves of a float with a gap between them for a lifting eye."""
    x, y, top = 0.5 * block.width_m, 0.5 * block.length_m, 0.5 * block.height_m
    low, bevel = 0.18 * block.height_m, 0.1 * block.height_m
    eye = lathe(
        rounded(_ring(0.03, 0.008), 0.003, detail, closed=True), detail, circle_points(0.04, detail), closed=True
    )
    halves = [box((a, -y, low), (b, 0.94 * y, top), bevel, detail) for a, b in ((-x, -0.02), (0.02, x))]
    return [*((YELLOW, half) for half in halves), (BARE, placed(eye, ALONG_X, (0.0, 0.0, top - 0.01)))]


def _frame(block, detail):
    """Side plates with windows, skids and bars across."""
    x, y, z = 0.5 * block.width_m - PLATE_M, 0.5 * block.length_m, 0.5 * block.height_m
    outline = np.array([(-y, -z), (0.86 * y, -z), (y, -0.6 * z), (y, 0.2 * z), (0.8 * y, 0.45 * z), (-y, 0.45 * z)])
    holes = [
        rounded(rectangle((a * y, -0.62 * z), (b * y, 0.1 * z)), 0.2 * z, detail, closed=True)[::-1]
        for a, b in ((-0.82, -0.1), (0.06, 0.74))
    ]
    plate = slab([rounded(outline, 0.1 * z, detail, closed=True), *holes], 0.0, PLATE_M, 0.002, detail)
    bar = 0.011
    across = [
        placed(_rod(bar, -x - 0.002, x + 0.002, detail), ALONG_X, (0.0, a * y, b * z))
        for a, b in ((-0.9, -0.85), (0.8, -0.85), (0.9, 0.0), (-0.9, 0.2))
    ]
    skids = [
        box((s - 0.022, -1.04 * y, -z - 0.022), (s + 0.022, 1.0 * y, -z + 0.002), 0.006, detail)
        for s in (-x - 0.5 * PLATE_M, x + 0.5 * PLATE_M)
    ]
    return [
        *((BLACK, placed(plate, ALONG_X, (s, 0.0, 0.0))) for s in (-x - PLATE_M, x)),
        *((GREY, mesh) for mesh in across),
        *((BLACK, mesh) for mesh in skids),
    ]


def _housings(block, detail):
    """A pressure housing with end caps and a dome before its camera, and a bottle for the electronics below."""
    r, y = 0.16 * block.height_m, 0.5 * block.length_m
    tube = _turned([(0.0, -0.7 * y), (r, -0.7 * y), (r, 0.72 * y), (0.0, 0.72 * y)], 0.08 * r, detail)
    caps = [
        _turned([(0.0, a), (1.18 * r, a), (1.18 * r, a + 0.03), (0.0, a + 0.03)], 0.006, detail)
        for a in (-0.72 * y, 0.70 * y)
    ]
    turn = np.linspace(0.0, 0.5 * np.pi, 9)[:-1]
    dome = _turned(
        [
            (0.0, 0.7 * y),
            *zip(0.95 * r * np.cos(turn), 0.78 * y + 0.95 * r * np.sin(turn), strict=True),
            (0.0, 0.78 * y + 0.95 * r),
        ],
        0.0,
        detail,
    )
    bottle = _turned([(0.0, -0.6 * y), (0.7 * r, -0.6 * y), (0.7 * r, 0.5 * y), (0.0, 0.5 * y)], 0.15 * r, detail)
    return [
        *((GREY, placed(mesh, ALONG_Y)) for mesh in (tube, *caps)),
        (GLASS, placed(dome, ALONG_Y)),
        (BARE, placed(bottle, ALONG_Y, (0.0, 0.0, -0.32 * block.height_m))),
    ]


def _lamp(block, at, detail):
    """A lamp behind its pane at a place: a body with cooling fins, a bezel, and the arm that holds it."""
    r = block.lamp_radius_m
    fins = [
        point
        for k in range(5)
        for point in (
            (0.9 * r, -(1.0 + 0.3 * k) * r),
            (0.7 * r, -(1.0 + 0.3 * k) * r),
            (0.7 * r, -(1.15 + 0.3 * k) * r),
            (0.9 * r, -(1.15 + 0.3 * k) * r),
        )
    ]
    body = _turned(
        [(0.0, -0.1 * r), (0.9 * r, -0.1 * r), *fins, (0.9 * r, -2.6 * r), (0.3 * r, -2.9 * r), (0.0, -2.9 * r)][::-1],
        0.03 * r,
        detail,
    )
    bezel = lathe(
        rounded([(0.8 * r, -0.5 * r), (r, -0.5 * r), (r, 0.1 * r), (0.8 * r, 0.1 * r)], 0.05 * r, detail, closed=True),
        detail,
        circle_points(r, detail),
        closed=True,
    )
    pane = _turned([(0.0, -0.2 * r), (0.82 * r, -0.2 * r), (0.82 * r, 0.0), (0.0, 0.0)], 0.0, detail)
    inner = np.sign(at[0]) * min(abs(at[0]), 0.5 * block.width_m - 0.5 * PLATE_M)
    back = 0.5 * block.length_m - 0.03
    low = (min(inner, at[0]) - 0.012, min(back, at[1] - 1.6 * r) - 0.012, at[2] - 0.014)
    high = (max(inner, at[0]) + 0.012, max(back, at[1] - 1.6 * r) + 0.012, at[2] + 0.014)
    arm = box(low, high, 0.003, detail)
    return [
        (BLACK, placed(body, ALONG_Y, at)),
        (BARE, placed(bezel, ALONG_Y, at)),
        (PANE, placed(pane, ALONG_Y, at)),
        (BLACK, arm),
    ]


def _thruster(block, side, detail):
    """A thruster at the stern: a duct, a hub, and blades."""
    r = 0.17 * block.height_m
    at = (side * 0.27 * block.width_m, -0.5 * block.length_m - 0.2 * r, -0.05 * block.height_m)
    duct = lathe(
        rounded(
            [(0.93 * r, -0.5 * r), (1.1 * r, -0.5 * r), (1.06 * r, 0.5 * r), (0.95 * r, 0.5 * r)],
            0.04 * r,
            detail,
            closed=True,
        ),
        detail,
        circle_points(r, detail),
        closed=True,
    )
    hub = _turned([(0.0, -0.7 * r), (0.3 * r, -0.5 * r), (0.3 * r, 1.6 * r), (0.0, 1.6 * r)], 0.08 * r, detail)
    blade = slab(
        [
            rounded(
                [(0.2 * r, -0.12 * r), (0.8 * r, -0.26 * r), (0.88 * r, 0.2 * r), (0.2 * r, 0.14 * r)],
                0.05 * r,
                detail,
                closed=True,
            )
        ],
        -0.02 * r,
        0.02 * r,
        0.0,
        detail,
    )
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(0.5), -np.sin(0.5)], [0.0, np.sin(0.5), np.cos(0.5)]])
    turns = [
        np.array([[np.cos(a), -np.sin(a), 0.0], [np.sin(a), np.cos(a), 0.0], [0.0, 0.0, 1.0]]) @ tilt
        for a in 2.0 * np.pi / 3.0 * np.arange(3)
    ]
    return [
        (BLACK, placed(duct, ALONG_Y, at)),
        (GREY, placed(hub, ALONG_Y, at)),
        *((BLACK, placed(placed(blade, turn), ALONG_Y, at)) for turn in turns),
    ]


def _tether(block, detail):
    """A cable from the stern up: it leans back and to the sides in bights, as slack lies in the water."""
    edge = min(TETHER_STEP_M, detail.edge)
    s = np.linspace(0.0, block.tether_m, 1 + max(8, int(np.ceil(block.tether_m / edge))))
    # angles from the vertical aft and to starboard; the slack grows from the clamp on
    aft = 0.25 + 0.75 * np.sin(1.1 * s + 0.3) * np.minimum(s, 1.0)
    side = 0.55 * np.sin(0.8 * s) * np.minimum(s, 1.0)
    along = np.stack([np.sin(side), -np.cos(side) * np.sin(aft), np.cos(side) * np.cos(aft)], axis=-1)
    middle = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * np.diff(s)[:, None] * (along[1:] + along[:-1]), axis=0)])
    middle += [0.0, -0.42 * block.length_m, 0.45 * block.height_m]
    up = np.cross(along, [1.0, 0.0, 0.0])
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    turn = 2.0 * np.pi * np.arange(count := circle_points(TETHER_RADIUS_M, detail)) / count
    across = np.cos(turn)[:, None] * np.cross(up, along)[:, None] + np.sin(turn)[:, None] * up[:, None]
    return loft(middle[:, None] + TETHER_RADIUS_M * across, detail)


def _ring(radius, thick):
    return [(radius - thick, -thick), (radius + thick, -thick), (radius + thick, thick), (radius - thick, thick)]


def _rod(radius, low, high, detail) -> Mesh:
    """A round bar along z."""
    return _turned([(0.0, low), (radius, low), (radius, high), (0.0, high)], 0.15 * radius, detail)


def _turned(profile, bevel, detail) -> Mesh:
    """A solid around z of a profile (radius, z) from axis to axis, its corners rounded."""
    profile = np.asarray(profile, float)
    line = rounded(profile, bevel, detail) if bevel else profile
    return lathe(line, detail, circle_points(profile[:, 0].max(), detail))
