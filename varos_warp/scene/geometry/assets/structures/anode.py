"""Sacrificial anodes: cast bars of trapezoid section on steel straps, and bracelets around pipes.

The proportions are those of makers' catalogues of hull and pipeline anodes; DNV-RP-B401 says which kinds there are.
"""

import numpy as np

from varos_warp.scene.description.fittings import Anode
from varos_warp.scene.geometry.assets.grids import area
from varos_warp.scene.geometry.assets.lofts import SLENDER, Detail, arc_steps, divided, loft, rounded
from varos_warp.scene.geometry.assets.slabs import box, inset, rectangle, slab
from varos_warp.scene.geometry.assets.structures.pieces import FACING, Mesh, Piece, chosen, placed

ZINC, STEEL = (0.25, 0.25, 0.24), (0.12, 0.085, 0.06)
DRAFT = 0.4
"""How much the sides of a bar lean, as a share of its thickness: that of the mould."""
STRAP, STRAP_THICK, STRAP_REACH = 0.04, 0.006, 0.11
"""Width and thickness of straps, and how far they reach beyond a bar [m]."""
GAP = 0.03
"""Gap between the half shells of a bracelet [m]."""
TAPER = 0.8
"""How far the ends of a bracelet lean, as a share of its thickness: for nets and stingers to slide over."""
OFF = 0.004
"""How far a bracelet stands off its pipe's coating [m]."""


def anode(block: Anode, key: str, detail: Detail) -> list[Piece]:
    """Pieces of an anode, each a closed solid."""
    zinc, straps = (_bar if block.form == "bar" else _bracelet)(block, detail)
    return chosen({"zinc": [(ZINC, mesh) for mesh in zinc], "straps": [(STEEL, mesh) for mesh in straps]}, block.only)


def _bar(block, detail) -> tuple[list[Mesh], list[Mesh]]:
    """The zinc, drawn from the plate up, and the strap through its foot with a fillet of weld at each end."""
    half = 0.5 * np.array([block.length_m, block.width_m])
    thick, lean = block.thick_m, min(DRAFT * block.thick_m, 0.13 * block.width_m)
    outline = rounded(rectangle(-half, half), 0.28 * block.width_m, detail, closed=True)  # what leans does not cross it
    zinc = slab([outline], 0.004, thick, 0.06 * thick, detail, lean=lean)
    wide, reach = min(0.5 * STRAP, 0.4 * block.width_m), half[0] + STRAP_REACH
    straps = [box((-reach, -wide, -0.001), (reach, wide, STRAP_THICK), 0.0015, detail)]
    straps += [
        box((x - 0.008, -wide - 0.006, -0.004), (x + 0.008, wide + 0.006, STRAP_THICK - 0.001), 0.004, detail)
        for x in (-reach, reach)
    ]
    return [placed(zinc, FACING)], [placed(mesh, FACING) for mesh in straps]


def _bracelet(block, detail) -> tuple[list[Mesh], list[Mesh]]:
    """Two half shells, and two straps over each gap between them."""
    inner = block.pipe_radius_m + OFF
    outer, half = inner + block.thick_m, 0.5 * block.length_m
    lean = min(TAPER * block.thick_m, 0.4 * half)
    corners = np.array([(inner, -half), (outer, lean - half), (outer, half - lean), (inner, half)])
    away = 0.5 * GAP / inner
    shells = [
        _shell(corners, middle - 0.5 * np.pi + away, middle + 0.5 * np.pi - away, 0.08 * block.thick_m, detail)
        for middle in (0.0, np.pi)
    ]
    low = inner + 0.35 * block.thick_m
    flat = np.array(
        [(low, -0.5 * STRAP), (low + STRAP_THICK, -0.5 * STRAP), (low + STRAP_THICK, 0.5 * STRAP), (low, 0.5 * STRAP)]
    )
    reach = away + 0.03 / low
    straps = [
        _shell(flat + [0.0, z], middle - reach, middle + reach, 0.0015, detail)
        for middle in (-0.5 * np.pi, 0.5 * np.pi)
        for z in (-0.5 * half, 0.5 * half)
    ]
    return shells, straps


def _shell(corners, start, end, bevel, detail) -> Mesh:
    """A section [P, 2] of (radius, z) turned around z from one angle to another, its edges rounded."""
    section = rounded(corners, bevel, detail, closed=True)
    radius = section[:, 0].max()
    half = detail.finer(0.5)
    steps = arc_steps(radius, end - start, half, 2)
    if detail.is_grid:
        section = divided(section, min(detail.edge, SLENDER * radius * (end - start) / steps), closed=True)
    section = section[:: 1 if area(section) > 0.0 else -1]
    cut = bevel / radius
    places = [(start, bevel), *((angle, 0.0) for angle in np.linspace(start + cut, end - cut, steps + 1)), (end, bevel)]
    profiles = [(angle, inset(section, 0.7 * depth)) for angle, depth in places]
    rings = [
        np.column_stack([line[:, 0] * np.cos(angle), line[:, 0] * np.sin(angle), line[:, 1]])
        for angle, line in profiles
    ]
    return loft(rings, detail)
