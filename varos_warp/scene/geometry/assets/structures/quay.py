"""A quay wall: U-shaped sheet piles under a concrete coping, with rubber fenders and a ladder."""

from itertools import pairwise

import numpy as np

from varos_warp.scene.description.structures import QuayWall
from varos_warp.scene.geometry.assets.lofts import Detail, arc_steps, lathe, rounded
from varos_warp.scene.geometry.assets.slabs import box, circle, slab
from varos_warp.scene.geometry.assets.structures.pieces import ALONG_X, Mesh, Piece, chosen, placed

STEEL, CONCRETE, RUBBER, GALVANISED = (0.1, 0.065, 0.045), (0.16, 0.15, 0.13), (0.03, 0.03, 0.03), (0.2, 0.2, 0.2)
FLANGE = 0.55
"""Width of a pile's outer face over that of the pile: of U-piles of 600 mm it is 0.5 to 0.6."""
LOCK, LOCK_WIDTH = 0.014, 0.05
"""How far the interlocks, in the middle of the webs, stand out on both sides, and their width [m]."""
OVERHANG, BEHIND = 0.15, 0.25
"""How far the coping reaches before and behind the piles [m]."""
JOINT, BAY = 0.02, 5.0
"""Width of the joints of the coping, and the greatest distance between them [m]."""
FENDER, BORE = 0.3, 0.075
"""Width and depth of a D-fender, and the radius of its bore [m]."""
LADDER, RUNG, EACH = 0.4, 0.015, 0.3
"""Clear width of the ladder, radius of its rungs, and the distance between them [m]."""


def quay_wall(block: QuayWall, key: str, detail: Detail) -> list[Piece]:
    """Pieces of a quay wall, each a closed solid."""
    pieces = {
        "piles": [(STEEL, _piles(block, detail))],
        "coping": [(CONCRETE, mesh) for mesh in _coping(block, detail)],
        "fenders": [mesh for x in fender_places(block) for mesh in _fender(block, x, detail)],
        "ladder": [(GALVANISED, mesh) for mesh in _ladder(block, detail)],
    }
    return chosen(pieces, block.only)


def pile_count(block: QuayWall) -> int:
    """How many whole piles come nearest to the length."""
    return max(2, round(block.length_m / block.pile_width_m))


def fender_places(block: QuayWall) -> np.ndarray:
    """Places x of the fenders [m]: before the outer faces that are nearest to even distances."""
    if block.fender_m is None:
        return np.zeros(0)
    half = 0.5 * pile_count(block) * block.pile_width_m
    faces = -half + block.pile_width_m * (0.5 + np.arange(0, pile_count(block), 2))
    wanted = np.arange(-half + 0.5 * block.fender_m, half, block.fender_m)
    return np.unique(faces[np.abs(faces[:, None] - wanted).argmin(axis=0)]) if len(wanted) else faces[:1]


def _piles(block, detail):
    """All piles as one folded plate that stands upright: outer faces in y = 0, every second pile turned."""
    w, deep, t = block.pile_width_m, block.pile_depth_m, block.pile_plate_m
    count = pile_count(block)
    line, widths = [], []
    for i in range(count + 1):
        middle = np.array([i * w, 0.5 * deep])
        rise = (0.5 * deep - 0.5 * t) * (1.0 if i % 2 else -1.0)  # from this lock to the next pile's outer face
        web = np.array([0.5 * (1.0 - FLANGE) * w, rise])
        along = LOCK_WIDTH * np.array([web[0], rise]) / np.hypot(*web)
        sides = [-1.0, 1.0] if 0 < i < count else [1.0] if i == 0 else [-1.0]
        # the web before a lock rises to it as the one after goes on: locks lie in the middle of straight webs
        for share in [s * f for s in (-1.0, 1.0) if s in sides for f in ((0.5, 0.3) if s < 0 else (0.3, 0.5))]:
            line.append(middle + share * along)
            widths.append(0.5 * t + (LOCK if abs(share) < 0.4 else 0.0))
        if i < count:
            line += [middle + web, middle + [w - web[0], rise]]
            widths += [0.5 * t, 0.5 * t]
    line, widths = np.array(line) - [0.5 * count * w, 0.0], np.array(widths)
    bend = np.where(np.isin(np.round(np.abs(line[:, 1] - 0.5 * deep), 9), np.round(0.5 * (deep - t), 9)), 0.03, 0.0)
    normal = _line_normals(line)
    outline = np.concatenate([line - widths[:, None] * normal, (line + widths[:, None] * normal)[::-1]])
    outline = rounded(
        outline, np.concatenate([bend, bend[::-1]]) + 0.002 * (np.concatenate([bend, bend]) == 0.0), detail, closed=True
    )
    return slab([outline], 0.0, block.height_m - block.coping_m + 0.1, 0.001, detail)


def _line_normals(line):
    """Mitred normals [N, 2] of an open line, to its left."""
    sides = np.diff(line, axis=0)
    across = np.column_stack([-sides[:, 1], sides[:, 0]]) / np.linalg.norm(sides, axis=1, keepdims=True)
    mean = np.concatenate([across[:1], 0.5 * (across[1:] + across[:-1]), across[-1:]])
    return mean / np.sum(mean**2, axis=1, keepdims=True)


def _coping(block, detail):
    """Bays of a concrete beam over the heads of the piles."""
    length, (low, high) = pile_count(block) * block.pile_width_m, (block.height_m - block.coping_m, block.height_m)
    front, back = -OVERHANG, block.pile_depth_m + BEHIND
    corners = np.array([(front, low), (back, low), (back, high), (front, high)])
    section = rounded(corners, [0.03, 0.03, 0.03, 0.06], detail, closed=True)
    bays = int(np.ceil(length / BAY))
    edges = np.linspace(-0.5 * length, 0.5 * length, bays + 1)
    return [
        placed(slab([section], a + 0.5 * JOINT, b - 0.5 * JOINT, 0.015, detail), ALONG_X) for a, b in pairwise(edges)
    ]


def _fender(block, x, detail) -> list[tuple[tuple[float, float, float], Mesh]]:
    """A D-shaped fender with its bore, on a steel plate; below the coping brackets hold it off the piles."""
    half, front = 0.5 * FENDER, -OVERHANG - 0.012
    turns = np.linspace(np.pi, 2.0 * np.pi, 2 * arc_steps(half, 0.5 * np.pi, detail, 4) + 1)
    nose = np.array([0.0, front - half]) + half * np.column_stack([np.cos(turns), np.sin(turns)])
    outline = np.concatenate([[(-half, front)], nose, [(half, front)]])
    outline = rounded(outline, [0.02, *np.zeros(len(nose)), 0.02], detail, closed=True)
    top, low = block.height_m - 0.2, block.height_m - 0.2 - block.fender_length_m
    bore = circle(BORE, detail, (0.0, front - half))
    rubber = slab([outline, bore[::-1]], low, top, 0.01, detail)
    meshes = [(RUBBER, placed(rubber, None, (x, 0.0, 0.0)))]
    plate = box((-half - 0.04, front, low - 0.05), (half + 0.04, front + 0.014, top + 0.05), 0.003, detail)
    meshes.append((STEEL, placed(plate, None, (x, 0.0, 0.0))))
    for z in np.arange(low + 0.2, block.height_m - block.coping_m - 0.1, 1.0):
        bracket = box((-0.1, front + 0.007, z), (0.1, 0.5 * block.pile_plate_m, z + 0.1), 0.003, detail)
        meshes.append((STEEL, placed(bracket, None, (x, 0.0, 0.0))))
    return meshes


def _ladder(block, detail):
    """Two flat bars with round rungs before the coping, and brackets that hold them, down to 1 m over the foot."""
    if block.ladder_m is None:
        return []
    top, front = block.height_m - 0.05, -OVERHANG - 0.15
    low = min(1.0, 0.25 * block.height_m)
    meshes = []
    for side in (-0.5 * LADDER - 0.012, 0.5 * LADDER):
        meshes.append(box((side, front, low), (side + 0.012, front + 0.065, top), 0.003, detail))
        for z in np.arange(low + 0.25, top - 0.1, 1.5):
            wall = -OVERHANG + 0.05 if z > block.height_m - block.coping_m - 0.05 else 0.5 * block.pile_depth_m
            meshes.append(box((side + 0.012, front + 0.02, z), (side + 0.022, wall, z + 0.065), 0.002, detail))
    length = LADDER + 0.02
    profile = rounded(
        [(0.0, -0.5 * length), (RUNG, -0.5 * length), (RUNG, 0.5 * length), (0.0, 0.5 * length)], 0.002, detail
    )
    rung = lathe(profile, detail, max(16, len(circle(RUNG, detail))))
    axes = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    meshes += [placed(rung, axes, (0.0, front + 0.0325, z)) for z in np.arange(low + 0.15, top - 0.05, EACH)]
    return [placed(mesh, None, (block.ladder_m, 0.0, 0.0)) for mesh in meshes]
