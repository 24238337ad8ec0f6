"""A section of a ship's hull: dented plating with weld seams, stiffeners, bilge keel and draught marks."""

from itertools import pairwise

import numpy as np

from varos_warp.scene.description.structures import HullSection
from varos_warp.scene.geometry.assets.grids import area
from varos_warp.scene.geometry.assets.lofts import Detail, arc_steps, loft, rounded
from varos_warp.scene.geometry.assets.slabs import rectangle, slab
from varos_warp.scene.geometry.assets.structures.figures import raised
from varos_warp.scene.geometry.assets.structures.pieces import ALONG_X, FACING, Piece, chosen, placed

ANTIFOULING, PRIMER, WHITE = (0.15, 0.035, 0.028), (0.13, 0.1, 0.08), (0.5, 0.5, 0.48)
SEAM = 0.014
"""Width of a weld seam [m]: the cap of a butt weld in plates of 14 mm is about as wide as they are thick."""
BULB, FRAME = 0.2, 0.45
"""Height of the bulb flats (HP 200 x 10, EN 10067) and depth of the web frames [m], at most."""
FIGURE, EACH = 0.1, 0.2
"""Draught figures are 10 cm high, their feet 20 cm apart, which is what the marks of merchant ships measure [m]."""
RAISED = 0.005
"""Thickness of the figures on the plates [m]."""


def hull_section(block: HullSection, key: str, detail: Detail) -> list[Piece]:
    """Pieces of a hull section, each a closed solid; its plates end in sharp cuts."""
    pieces = {
        "plating": [(ANTIFOULING, _plating(block, detail))],
        "stiffeners": [
            (ANTIFOULING if block.stiffeners == "outside" else PRIMER, mesh) for mesh in _stiffeners(block, detail)
        ],
        "bilge_keel": [(ANTIFOULING, mesh) for mesh in _bilge_keel(block, detail)],
        "marks": [(WHITE, mesh) for mesh in _marks(block, detail)],
    }
    return chosen(pieces, block.only)


def section_at(block: HullSection, s) -> tuple[np.ndarray, np.ndarray]:
    """Places (y, z) [..., 2] and outward normals of the outer surface, ``s`` [m] along it from the top of the side."""
    r, side = block.bilge_radius_m, block.height_m - block.bilge_radius_m
    angle = np.clip((np.asarray(s) - side) / r, 0.0, 0.5 * np.pi)
    normal = np.stack([-np.cos(angle), -np.sin(angle)], axis=-1)
    down, over = np.minimum(s, side), np.maximum(s - side - 0.5 * np.pi * r, 0.0)
    return r + r * normal + np.stack([over, side - down], axis=-1), normal


def seams(block: HullSection) -> tuple[np.ndarray, np.ndarray]:
    """Places of the weld seams: ``s`` of the longitudinal ones, and x of the transverse ones [m]."""
    total = _girth(block)
    along = np.arange(0.6 * block.strake_m, total, block.strake_m)
    across = block.butt_m * (
        np.arange(np.ceil(-0.5 * block.length_m / block.butt_m) - 1, 0.5 * block.length_m / block.butt_m + 1) + 0.5
    )
    clear = SEAM
    return (along[(along > clear) & (along < total - clear)], across[np.abs(across) < 0.5 * block.length_m - clear])


# -------------------------------------------------------------------------------------------------------------- plating


def _girth(block):
    """Length of the section [m]."""
    return block.height_m + block.breadth_m - (2.0 - 0.5 * np.pi) * block.bilge_radius_m


def _plating(block, detail):
    """The plates, as a grid of lines along and around the ship, closer where seams are."""
    along, across = seams(block) if block.seam_m else (np.zeros(0), np.zeros(0))
    side, girth = block.height_m - block.bilge_radius_m, _girth(block)
    bent = 1.0 / block.bilge_radius_m
    dented = [0.5 * block.dent_m * (2.0 * np.pi / width) ** 2 for width in (block.spacing_m, block.frame_m)]
    marks = np.array([0.0, side, side + 0.5 * np.pi * block.bilge_radius_m, girth])
    s = _lines(marks, along, block.seam_m, lambda at: dented[0] + bent * (marks[1] < at < marks[2]), detail)
    x = _lines(0.5 * block.length_m * np.array([-1.0, 1.0]), across, block.seam_m, lambda at: dented[1], detail)
    detail.allow(4.0 * len(s) * len(x))
    place, normal = section_at(block, s)
    bead = np.maximum(_bead(s, along, block.seam_m)[:, None], _bead(x, across, block.seam_m))
    dent = _dents(block, s, x)
    sheets = [place[:, None] + height[..., None] * normal[:, None] for height in (bead - dent, -block.plate_m - dent)]
    rings = np.concatenate([sheets[0], sheets[1][::-1]]).swapaxes(0, 1)  # [X, 2 S, 2]
    rings = np.concatenate([np.broadcast_to(x[:, None, None], (*rings.shape[:2], 1)), rings], axis=-1)
    a, b = np.arange(len(s) - 1), 2 * len(s) - 1 - np.arange(len(s) - 1)
    return loft(rings, detail, cap=np.concatenate([np.column_stack([a, a + 1, b]), np.column_stack([a + 1, b - 1, b])]))


def _lines(ends, seams_at, height, curvature, detail):
    """Places of grid lines: at ``ends``, over the caps of seams, and between as close as curvature asks for."""
    cap = np.linspace(-0.5, 0.5, 2 * max(2, _steps(0.5 * SEAM, 8.0 * height / SEAM**2, detail)) + 1) * SEAM
    caps = (np.asarray(seams_at)[:, None] + cap).ravel()
    stops = np.unique(np.concatenate([[end for end in ends if not (np.abs(seams_at - end) < 0.51 * SEAM).any()], caps]))
    lines = []
    for a, b in pairwise(stops):
        count = 1 if b - a < 1.01 * (cap[1] - cap[0]) else _steps(b - a, curvature(0.5 * (a + b)), detail)
        lines.append(a + (b - a) * np.arange(count) / count)
    return np.concatenate([*lines, stops[-1:]])


def _steps(length, curvature, detail):
    """Chords for a curve of a curvature [1/m] within half of the chord error: the other half is the other way's."""
    chord = np.sqrt(4.0 * detail.chord_error / curvature) if curvature else np.inf
    return int(np.ceil(length / min(chord, detail.edge) - 1e-9)) or 1


def _bead(at, seams_at, height):
    """Height of weld caps [m], parabolas across the seams."""
    away = np.abs(np.asarray(at)[:, None] - seams_at).min(axis=1, initial=np.inf)
    return height * np.maximum(1.0 - (2.0 * np.minimum(away, SEAM) / SEAM) ** 2, 0.0)


def _dents(block, s, x):
    """How far the plates are dented inwards [S, X] [m]: in every field between stiffeners and frames otherwise."""
    side, end = block.height_m - block.bilge_radius_m, block.height_m - (1.0 - 0.5 * np.pi) * block.bilge_radius_m
    flat = np.where(s < side, (side - s) / block.spacing_m, np.maximum(s - end, 0.0) / block.spacing_m)
    column = x / block.frame_m
    depth = np.random.default_rng(block.seed).uniform(0.3, 1.0, (2, 600, 300))  # [m] of the largest girths and lengths
    row = np.minimum(np.floor(flat).astype(int), 599)
    share = depth[(s >= side).astype(int)[:, None], row[:, None], np.floor(column).astype(int) + 150]
    return block.dent_m * share * np.sin(np.pi * flat[:, None]) ** 2 * np.sin(np.pi * column) ** 2


# ------------------------------------------------------------------------------------------------------------- the rest


def _stiffeners(block, detail):
    """Bulb flats along the side and the bottom, and web frames with face plates across."""
    if block.stiffeners == "none":
        return []
    inside = block.stiffeners == "inside"
    r, plate = block.bilge_radius_m, block.plate_m
    h = min(BULB, 0.35 * block.spacing_m)
    t, sunk = 0.05 * h, 0.5 * plate
    bulb = np.array([(0.0, -sunk), (t, -sunk), (t, 0.8 * h), (t + 0.13 * h, 0.9 * h), (t + 0.13 * h, h), (0.0, h)])
    bulb = rounded(bulb, h * np.array([0.0, 0.0, 0.06, 0.05, 0.04, 0.02]), detail, closed=True)
    flat = slab([bulb], -0.5 * block.length_m, 0.5 * block.length_m, 0.0, detail)
    foot, sign = (plate, 1.0) if inside else (0.0, -1.0)
    # axes of a bulb flat (across, away from the plate, along the ship) on the side and on the bottom
    on_side = np.array([[0.0, 0.0, 1.0], [0.0, sign, 0.0], [-sign, 0.0, 0.0]])
    on_bottom = np.array([[0.0, 0.0, 1.0], [sign, 0.0, 0.0], [0.0, sign, 0.0]])
    meshes = [
        placed(flat, on_side, (0.0, sign * foot, r + z))
        for z in np.arange(0.0, block.height_m - r - 0.02, block.spacing_m)
    ]
    meshes += [
        placed(flat, on_bottom, (0.0, r + y, sign * foot))
        for y in np.arange(0.0, block.breadth_m - r - 0.02, block.spacing_m)
    ]
    return meshes + _frames(block, inside, detail)


def _frames(block, inside, detail):
    """Web frames: plates 10 mm thick, with face plates of 150 by 12 mm along their free edges."""
    depth = min(FRAME, 0.4 * min(block.height_m, block.breadth_m))
    near, far, face = (
        (0.5 * block.plate_m, block.plate_m + depth, 0.012) if inside else (0.5 * block.plate_m, -depth, -0.012)
    )
    web = np.concatenate([_contour(block, near, detail), _contour(block, far, detail)[::-1]])
    rim = np.concatenate([_contour(block, far - 0.5 * face, detail), _contour(block, far + 0.5 * face, detail)[::-1]])
    reach = int(0.5 * (block.length_m - 0.16) / block.frame_m)
    webs = [
        slab([outline[:: 1 if area(outline) > 0.0 else -1]], -0.5 * width, 0.5 * width, 0.0015, detail)
        for outline, width in ((web, 0.01), (rim, 0.15))
    ]
    return [placed(mesh, ALONG_X, (x, 0.0, 0.0)) for x in block.frame_m * np.arange(-reach, reach + 1) for mesh in webs]


def _contour(block, depth, detail):
    """Line (y, z) [m, 2] that runs ``depth`` [m] inside the outer surface, from the top to the bottom's edge."""
    r = block.bilge_radius_m
    radius = r - depth
    if radius < 0.02:
        bend = np.array([[depth, depth]])
    else:
        angle = np.linspace(0.0, 0.5 * np.pi, arc_steps(radius, 0.5 * np.pi, detail, 4) + 1)
        bend = r - radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([[(depth, block.height_m)], bend, [(block.breadth_m, depth)]])


def _bilge_keel(block, detail):
    """A flat bar that stands on the middle of the bilge, over eight tenths of the length."""
    if block.bilge_keel_m is None:
        return []
    bar = rounded(rectangle((-0.006, -0.5 * block.plate_m), (0.006, block.bilge_keel_m)), 0.0055, detail, closed=True)
    place, normal = section_at(block, block.height_m - block.bilge_radius_m * (1.0 - 0.25 * np.pi))
    (ny, nz), (y, z) = normal, place
    axes = np.array([[0.0, 0.0, 1.0], [nz, ny, 0.0], [-ny, nz, 0.0]])  # across, outwards, along
    return [placed(slab([bar], -0.4 * block.length_m, 0.4 * block.length_m, 0.002, detail), axes, (0.0, y, z))]


def _marks(block, detail):
    """Draught figures on the side: whole metres with an M, between them the decimetres, at 0.2 m from foot to foot."""
    if not block.marks:
        return []
    sunk = -(block.dent_m + 0.5 * (block.plate_m - min(block.dent_m, block.plate_m)))
    low, high = np.ceil(block.bilge_radius_m / EACH - 1e-9), np.floor((block.height_m - FIGURE - 0.02) / EACH + 1e-9)
    meshes = []
    for step in range(int(low), int(high) + 1):
        metres, decimetres = divmod(2 * step, 10)
        text = f"{metres}M" if decimetres == 0 else str(decimetres)
        meshes += [placed(mesh, FACING, (0.0, 0.0, EACH * step)) for mesh in raised(text, FIGURE, sunk, RAISED, detail)]
    return meshes
