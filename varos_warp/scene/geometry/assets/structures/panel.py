"""A panel with interfaces for ROVs: torque receptacles, hot-stab receptacles, handles, valve stems and labels.

API 17H and ISO 13628-8 say which interfaces there are and how they look. Their measures are not reproduced here: those
below are rounded, as manufacturers' drawings of such parts have them, and no part would pass a gauge.
"""

import numpy as np

from varos_warp.scene.description.structures import WellheadPanel
from varos_warp.scene.geometry.assets.fasteners import hex_measures
from varos_warp.scene.geometry.assets.lofts import Detail, circle_points, divided, lathe, rounded
from varos_warp.scene.geometry.assets.slabs import box, circle, rectangle, slab
from varos_warp.scene.geometry.assets.structures.figures import raised
from varos_warp.scene.geometry.assets.structures.hardware import hexagon, rod
from varos_warp.scene.geometry.assets.structures.pieces import FACING, Mesh, Piece, chosen, placed

YELLOW, GREY, BARE, ORANGE = (0.42, 0.26, 0.02), (0.16, 0.17, 0.17), (0.3, 0.3, 0.29), (0.42, 0.11, 0.015)
WHITE, BLACK = (0.48, 0.48, 0.46), (0.025, 0.025, 0.025)
BUCKET, BUCKET_DEPTH, BUCKET_RIM = 0.077, 0.14, 0.112
"""Inner radius and depth of a torque receptacle (class 1 to 4), radius of its front ring [m]."""
SLOT, SLOT_WIDTH = 0.018, 0.038
"""How deep and wide the slots are that keep a torque tool from turning [m]."""
SQUARE = 0.0286
"""Width across flats of a receptacle's drive, class 3 [m]."""
FUNNEL, STAB_BORE, STAB_BODY = 0.055, 0.0175, 0.036
"""Radii of a hot-stab receptacle: mouth of its funnel, bore, body [m]."""
BAR = 0.0125
"""Radius of the bars of handles [m]."""
BOLTS = 0.28
"""Distance of the bolts that hold the plate to its frame [m]."""
PADDLE = 0.24
"""Length of the paddle on a valve's stem [m]."""
Coloured = tuple[tuple[float, float, float], Mesh]


def wellhead_panel(block: WellheadPanel, key: str, detail: Detail) -> list[Piece]:
    """Pieces of a panel, each a closed solid; drawn in x, z and towards the viewer, then stood up.

    What takes longest, the plate and the labels, is made only where it is asked for.
    """
    wanted = ("panel", "marks") if block.only is None else block.only
    pieces: dict[str, list[Coloured]] = {
        "panel": _plate(block, detail) if "panel" in wanted else [],
        "receptacles": [],
        "stems": [],
        "handles": [],
        "marks": [],
    }
    made = {name: maker(detail) for name, maker in _FITTINGS.items()}
    for label, fitting, at in places(block):
        for name, meshes in made[fitting].items():
            pieces[name] += [(colour, placed(mesh, None, (*at, 0.0))) for colour, mesh in meshes]
        if block.marks and "marks" in wanted:
            pieces["marks"] += [(colour, placed(mesh, None, (*at, 0.0))) for colour, mesh in _label(label, detail)]
    return [
        Piece(name, colour, *placed((vertices, faces), FACING))
        for name, colour, vertices, faces in chosen(pieces, block.only)
    ]


def places(block: WellheadPanel) -> list[tuple[str, str, tuple[float, float]]]:
    """Label, kind and place (x, z) [m] of every fitting; rows are A, B ... from above, numbers run from the left."""
    found = []
    high = block.height_m / len(block.fittings)
    for row, kinds in enumerate(block.fittings):
        wide = block.width_m / len(kinds)
        z = 0.5 * block.height_m - (row + 0.5) * high + 0.02
        found += [
            (f"{chr(ord('A') + row)}{i + 1}", kind, (-0.5 * block.width_m + (i + 0.5) * wide, z))
            for i, kind in enumerate(kinds)
            if kind != "none"
        ]
    return found


def _plate(block, detail) -> list[Coloured]:
    """The plate with a hole behind each receptacle, its face in z = 0, and a frame of square tubes behind it."""
    half = np.array([0.5 * block.width_m, 0.5 * block.height_m])
    outline = rounded(rectangle(-half, half), 0.04, detail, closed=True)
    radius = {"bucket": BUCKET + 0.012, "hot_stab": STAB_BODY + 0.002}
    holes = [circle(radius[kind], detail, at)[::-1] for _, kind, at in places(block) if kind in radius]
    meshes = [slab([outline, *holes], -block.plate_m, 0.0, min(0.003, 0.2 * block.plate_m), detail)]
    (x, z), back, w = half - 0.03, -block.plate_m + 0.001, 0.06
    bars = [((-x, s - 0.5 * w), (x, s + 0.5 * w)) for s in (-z + 0.5 * w, z - 0.5 * w)]
    bars += [((s - 0.5 * w, -z + 0.9 * w), (s + 0.5 * w, z - 0.9 * w)) for s in (-x + 0.5 * w, x - 0.5 * w)]
    meshes += [box((*low, back - w), (*high, back), 0.006, detail) for low, high in bars]
    return [(YELLOW, mesh) for mesh in meshes] + [
        (BARE, _bolt_head("M12", detail, 0.0, at)) for at in _around(half - 0.03, BOLTS)
    ]


def _around(half, apart):
    """Places [N, 2] around a rectangle of half sides ``half`` [2], about ``apart`` [m] from each other."""
    corners = half * np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
    return divided(corners, apart, closed=True)


def _bucket(detail) -> dict[str, list[Coloured]]:
    """A torque receptacle: a ring with two slots, a cup behind it, the square end of the stem inside, ring bolts."""
    r, deep = BUCKET, BUCKET_DEPTH
    start = np.arcsin(0.5 * SLOT_WIDTH / r)
    arc = circle(r, detail)
    angle = np.arctan2(arc[:, 1], arc[:, 0])
    right = arc[np.abs(angle) < 0.5 * np.pi - start - 1e-3]
    right = right[np.argsort(np.arctan2(right[:, 1], right[:, 0]))]
    half, low, high = 0.5 * SLOT_WIDTH, r * np.cos(start), r + SLOT
    top = [(half, low), (half, high), (-half, high), (-half, low)]
    hole = np.concatenate([right, top, -right, -np.array(top)])
    ring = slab([circle(BUCKET_RIM, detail), hole[::-1]], -0.002, 0.016, 0.002, detail)
    profile = [(r, 0.0), (r, -deep), (0.01, -deep), (0.01, -deep - 0.012), (r + 0.01, -deep - 0.012), (r + 0.01, 0.0)]
    cup = lathe(rounded(profile, 0.002, detail, closed=True), detail, circle_points(r + 0.01, detail), closed=True)
    meshes = [(GREY, ring), (GREY, cup)]
    bolts = [
        _bolt_head("M10", detail, 0.016, (0.0975 * np.cos(a), 0.0975 * np.sin(a)))
        for a in np.pi / 4.0 + 0.5 * np.pi * np.arange(4)
    ]
    square = rounded(rectangle((-0.5 * SQUARE,) * 2, (0.5 * SQUARE,) * 2), 0.003, detail, closed=True)
    stem = [rod(0.024, -deep - 0.02, -0.06, detail), slab([square], -0.061, -0.025, 0.002, detail)]
    return {"receptacles": meshes + [(BARE, bolt) for bolt in bolts], "stems": [(BARE, mesh) for mesh in stem]}


def _hot_stab(detail) -> dict[str, list[Coloured]]:
    """A hot-stab receptacle: a body with a bore, a funnel before it that guides the stab, a collar with bolts."""
    profile = [
        (STAB_BORE, 0.012),
        (STAB_BORE, -0.12),
        (STAB_BODY, -0.12),
        (STAB_BODY, 0.012),
        (FUNNEL + 0.006, 0.07),
        (FUNNEL, 0.07),
    ]
    body = lathe(rounded(profile, 0.002, detail, closed=True), detail, circle_points(FUNNEL, detail), closed=True)
    collar = slab([circle(0.06, detail), circle(STAB_BODY - 0.002, detail)[::-1]], -0.001, 0.012, 0.002, detail)
    bolts = [
        _bolt_head("M8", detail, 0.012, (0.049 * np.cos(a), 0.049 * np.sin(a))) for a in np.pi / 3.0 * np.arange(6)
    ]
    return {"receptacles": [(BARE, body), (GREY, collar), *((BARE, bolt) for bolt in bolts)]}


def _t_bar(detail) -> dict[str, list[Coloured]]:
    """A T-bar that an ROV holds on to: a foot, a stem, and a level bar across."""
    foot = slab([circle(0.05, detail)], -0.001, 0.012, 0.002, detail)
    bar = placed(rod(BAR, -0.11, 0.11, detail), [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (0.0, 0.0, 0.13))
    return {"handles": [(ORANGE, foot), (ORANGE, rod(BAR, 0.0, 0.13, detail)), (ORANGE, bar)]}


def _valve_stem(detail) -> dict[str, list[Coloured]]:
    """A quarter-turn valve: a bonnet with four bolts, a stem with its nut, and a paddle for a manipulator."""
    profile = [(0.0, -0.001), (0.055, -0.001), (0.055, 0.016), (0.034, 0.02), (0.03, 0.045), (0.0, 0.045)]
    bonnet = lathe(rounded(profile, 0.003, detail), detail, circle_points(0.055, detail))
    bolts = [
        _bolt_head("M8", detail, 0.016, (0.045 * np.cos(a), 0.045 * np.sin(a)))
        for a in np.pi / 4.0 + 0.5 * np.pi * np.arange(4)
    ]
    half = 0.5 * PADDLE
    paddle = np.array(
        [
            (-0.022, -0.035),
            (0.022, -0.035),
            (0.02, half * 0.9),
            (0.034, half * 1.3),
            (-0.034, half * 1.3),
            (-0.02, half * 0.9),
        ]
    )
    paddle = rounded(paddle, 0.01, detail, closed=True)
    return {
        "receptacles": [(GREY, bonnet), *((BARE, bolt) for bolt in bolts)],
        "stems": [(BARE, rod(0.014, 0.04, 0.095, detail))],
        "handles": [(ORANGE, slab([paddle], 0.07, 0.082, 0.003, detail))],
    }


_FITTINGS = {"bucket": _bucket, "hot_stab": _hot_stab, "t_bar": _t_bar, "valve_stem": _valve_stem}


def _label(text, detail) -> list[Coloured]:
    """A white label under a fitting with raised black letters."""
    high, wide = 0.03, 0.026 * len(text) + 0.024
    plate = box((-0.5 * wide, -0.165, -0.001), (0.5 * wide, -0.165 + high + 0.014, 0.002), 0.001, detail)
    letters = raised(text, high, 0.001, 0.003, detail)
    width = max(vertices[:, 0].max() for vertices, _ in letters)
    return [(WHITE, plate), *((BLACK, placed(mesh, None, (-0.5 * width, -0.158, 0.0))) for mesh in letters)]


def _bolt_head(size, detail, low, at) -> Mesh:
    """The head of a hexagon bolt on a face at z = ``low``."""
    _, s, k, _ = hex_measures(size)
    return hexagon(s, low - 0.001, low + k, detail, at)
