"""Hexagon bolts and nuts by metric size, with the dimensions of ISO 4014, ISO 4032, ISO 888 and ISO 261."""

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description.world import Bolt, Nut
from varos_warp.scene.geometry.assets.lofts import Detail, arc_steps, divided, rounded, turned

DEFAULT = Detail(1e-4)
HEX_SIZES_MM = {
    "M3": (5.5, 2.0, 2.4, 0.5),
    "M3.5": (6.0, 2.4, 2.8, 0.6),
    "M4": (7.0, 2.8, 3.2, 0.7),
    "M5": (8.0, 3.5, 4.7, 0.8),
    "M6": (10.0, 4.0, 5.2, 1.0),
    "M8": (13.0, 5.3, 6.8, 1.25),
    "M10": (16.0, 6.4, 8.4, 1.5),
    "M12": (18.0, 7.5, 10.8, 1.75),
    "M14": (21.0, 8.8, 12.8, 2.0),
    "M16": (24.0, 10.0, 14.8, 2.0),
    "M18": (27.0, 11.5, 15.8, 2.5),
    "M20": (30.0, 12.5, 18.0, 2.5),
    "M22": (34.0, 14.0, 19.4, 2.5),
    "M24": (36.0, 15.0, 21.5, 3.0),
    "M27": (41.0, 17.0, 23.8, 3.0),
    "M30": (46.0, 18.7, 25.6, 3.5),
    "M33": (50.0, 21.0, 28.7, 3.5),
    "M36": (55.0, 22.5, 31.0, 4.0),
    "M39": (60.0, 25.0, 33.4, 4.0),
    "M42": (65.0, 26.0, 34.0, 4.5),
    "M45": (70.0, 28.0, 36.0, 4.5),
    "M48": (75.0, 30.0, 38.0, 5.0),
    "M52": (80.0, 33.0, 42.0, 5.0),
    "M56": (85.0, 35.0, 45.0, 5.5),
    "M60": (90.0, 38.0, 48.0, 5.5),
    "M64": (95.0, 40.0, 51.0, 6.0),
}
"""Width across flats s (ISO 272), head height k of ISO 4014 bolts (nominal), height m of ISO 4032 nuts (maximum) and
coarse pitch P (ISO 261) [mm]."""
BEVEL = 0.02
"""Radius of the rounded edges, as a share of s."""
FACE = 0.475
"""Radius of the flat circle on top of a head, as a share of s; from there the chamfer falls at 30 degrees."""
WASHER_FACE = 0.47
"""Radius of the bearing face under a head, as a share of s: dw of ISO 4014 is 0.93 to 0.94 s from M8 on."""


def hex_measures(size: str, key: str = "size") -> tuple[float, float, float, float]:
    """Thread diameter d, width across flats s, head height k, nut height m [m] of a metric size such as ``M24``."""
    if size not in HEX_SIZES_MM:
        raise InputError("unknown bolt size", key=key, value=size, remedy=f"Known sizes: {', '.join(HEX_SIZES_MM)}.")
    s, k, m, _ = HEX_SIZES_MM[size]
    return float(size[1:]) / 1e3, s / 1e3, k / 1e3, m / 1e3


def bolt(block: Bolt, key: str = "bolt", detail: Detail = DEFAULT):
    """Hexagon head bolt after ISO 4014: the head from z = 0 to k, the shank above it, its thread as rings."""
    d, s, k, _ = hex_measures(block.size, f"{key}.size")
    length = 4.0 * d if block.length is None else block.length
    pitch = HEX_SIZES_MM[block.size][3] / 1e3
    angles, flats = _hexagon(s, d, detail)
    chamfer = min(0.6134 * pitch, 0.3 * length)
    thread = _thread(
        d, pitch, -0.6134, k + max(length - _thread_length(d, length), pitch), k + length - chamfer, detail
    )
    step = _washer_face(d)
    washer = [(WASHER_FACE * s, k - step), (WASHER_FACE * s, k)] if step > detail.chord_error else [(0.5 * d, k)]
    head = [
        (FACE * s, 0.0),
        (flats, (flats - FACE * s) * np.tan(np.pi / 6.0)),
        (flats, k - step * (len(washer) - 1)),
        *washer,
        *([(0.5 * d, k)] if len(washer) == 2 else []),
    ]
    shank = [*thread, (0.5 * d, k + length - chamfer), (0.5 * d - chamfer, k + length)]
    radii = [BEVEL * s] * len(head) + [0.0] * len(shank)
    profile = _profile([(0.0, 0.0), *head, *shank, (0.0, k + length)], len(angles))
    return turned(rounded(profile, [0.0, *radii, 0.0], detail)[:, 1:-1], angles, detail)


def nut(block: Nut, key: str = "nut", detail: Detail = DEFAULT):
    """Hexagon nut after ISO 4032, centred, around z, both sides chamfered, the thread of its bore as rings."""
    d, s, _, m = hex_measures(block.size, f"{key}.size")
    pitch, half = HEX_SIZES_MM[block.size][3] / 1e3, 0.5 * m
    angles, flats = _hexagon(s, d, detail)
    fall = (flats - FACE * s) * np.tan(np.pi / 6.0)
    outside = [(FACE * s, -half), (flats, fall - half), (flats, half - fall), (FACE * s, half)]
    sink = 0.54 * d  # da of ISO 4032: up to 1.08 d
    thread = _thread(d, pitch, -0.5413, 0.04 * d - half, half - 0.04 * d, detail)[::-1]
    bore = [(sink, half), (0.5 * d, half - 0.04 * d), *thread, (0.5 * d, 0.04 * d - half), (sink, -half)]
    radii = [BEVEL * s] * 5 + [0.0] * (len(bore) - 2) + [BEVEL * s]
    profile = _profile([*outside, *bore], len(angles))
    return turned(rounded(profile, radii, detail, closed=True), angles, detail, closed=True)


# ---------------------------------------------------------------------------------------------------------------- parts


def _hexagon(s, d, detail):
    """Polar angles [n] and radii [n] of a hexagon across flats s, its corners rounded; two flats face along x.

    The angles are close enough for a circle of diameter d, too.
    """
    corners = np.pi / 6.0 + np.pi / 3.0 * np.arange(6)
    outline = s / np.sqrt(3.0) * np.column_stack([np.cos(corners), np.sin(corners)])
    outline = rounded(outline, 2.0 * BEVEL * s, detail, closed=True)
    outline = divided(outline, np.pi * s / arc_steps(0.5 * d, 2.0 * np.pi, detail, 18), closed=True)
    return np.arctan2(outline[:, 1], outline[:, 0]), np.linalg.norm(outline, axis=1)


def _profile(points, count):
    """Profiles [count, P, 2] of points whose radius and height are each one number, or one for every angle."""
    return np.stack([np.column_stack([np.broadcast_to(x, count) for x in point]) for point in points], axis=1)


def _thread(d, pitch, depth, low, high, detail):
    """Profile of thread rings between two heights: 60 degrees, outside d, ``depth`` in pitches (ISO 68-1).

    The crests of a bolt, the roots of a nut, are an eighth of the pitch wide. None where the chord error is as large.
    """
    count = int((high - low) / pitch - 0.1)
    if count < 1 or 0.25 * abs(depth) * pitch <= detail.chord_error:
        return []
    flank = abs(depth) * np.tan(np.pi / 6.0)
    ring = np.array([[0.0, 0.0], [0.0, 0.125], [depth, 0.125 + flank], [depth, 1.0 - flank]]) * pitch
    starts = low + (high - low - count * pitch) / 2.0 + pitch * np.arange(count)
    points = np.array([0.5 * d, 0.0]) + ring + np.array([0.0, 1.0]) * starts[:, None, None]
    return [*map(tuple, points.reshape(-1, 2)), (0.5 * d, starts[-1] + pitch)]


def _thread_length(d, length):
    """Length b of the thread of a bolt [m] (ISO 888)."""
    return 2.0 * d + (0.006 if length <= 0.125 else 0.012 if length <= 0.2 else 0.025)


def _washer_face(d):
    """Height c of the bearing face under a bolt's head [m] (ISO 4014, maximum)."""
    return 1e-3 * (0.4 if d < 0.0045 else 0.5 if d < 0.007 else 0.6 if d < 0.015 else 0.8 if d < 0.04 else 1.0)
