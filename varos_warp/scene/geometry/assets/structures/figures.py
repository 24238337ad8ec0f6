"""Raised letters and figures, of the outlines of DejaVu Sans Bold, which matplotlib brings along."""

from functools import cache
from pathlib import Path

import numpy as np

from varos_warp.scene.geometry.assets.grids import area
from varos_warp.scene.geometry.assets.lofts import Detail
from varos_warp.scene.geometry.assets.slabs import slab

CAPITAL = 0.729
"""Height of capitals and figures of the font, over its size."""


def raised(text: str, height: float, low: float, high: float, detail: Detail) -> list[tuple[np.ndarray, np.ndarray]]:
    """Solids of a text's letters in the xy plane, between z = low and z = high: from x = 0 on, their feet in y = 0.

    Args:
        text: Capitals and figures.
        height: Of a capital [m].
        low, high: Where their backs and faces lie [m].
        detail: How fine they are.
    """
    return [
        slab(loops, low, high, min(0.12 * (high - low), 0.01 * height), detail)
        for loops in _letters(text, height, detail.chord_error)
    ]


@cache
def _letters(text, height, chord_error):
    """Loops of every letter: its outline, counter-clockwise, and those of its holes, clockwise."""
    import matplotlib
    from matplotlib.font_manager import FontProperties
    from matplotlib.path import Path as Outline
    from matplotlib.textpath import TextPath

    font = Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans-Bold.ttf"
    path = TextPath((0.0, 0.0), text, size=height / CAPITAL, prop=FontProperties(fname=str(font)))
    loops = _flattened(path, Outline, chord_error)
    way = int(np.sign(max(map(area, loops), key=abs)))  # fonts of some formats run the other way round
    loops = [loop[::way] for loop in loops]
    outer, holes = [loop for loop in loops if area(loop) > 0.0], [loop for loop in loops if area(loop) < 0.0]
    return [[around, *(hole for hole in holes if Outline(around).contains_point(hole[0]))] for around in outer]


def _flattened(path, codes, chord_error):
    """Loops [m, 2] of a path of lines and quadratic curves, these as chords within ``chord_error`` [m]."""
    loops: list[list[np.ndarray]] = []
    for points, code in path.iter_segments(simplify=False):
        if code == codes.MOVETO:
            loops.append([points])
        elif code == codes.LINETO:
            loops[-1].append(points)
        elif code == codes.CURVE3:
            a, b, c = loops[-1][-1], points[:2], points[2:]
            steps = max(2, int(np.ceil(np.sqrt(np.linalg.norm(a - 2.0 * b + c) / 4.0 / chord_error))))
            t = np.linspace(0.0, 1.0, steps + 1)[1:, None]
            loops[-1].extend((1.0 - t) ** 2 * a + 2.0 * t * (1.0 - t) * b + t**2 * c)
    return [_without_repeats(np.array(loop)) for loop in loops]


def _without_repeats(loop):
    """An outline without points where the one before lies."""
    return loop[np.linalg.norm(loop - np.roll(loop, 1, axis=0), axis=1) > 1e-9]
