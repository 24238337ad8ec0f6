"""Parametric man-made objects and boulders (paper 3.1.2): closed solids with rounded edges, outward normals."""

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import world
from varos_warp.scene.geometry.assets.fasteners import HEX_SIZES_MM, bolt, hex_measures, nut
from varos_warp.scene.geometry.assets.grids import split_long
from varos_warp.scene.geometry.assets.lofts import Detail
from varos_warp.scene.geometry.assets.pipes import FLANGES_MM, elbow, flange, flange_measures, pipe, pipe_support, valve
from varos_warp.scene.geometry.assets.rocks import boulder
from varos_warp.scene.geometry.assets.structures.anode import anode
from varos_warp.scene.geometry.assets.structures.chain import mooring_chain
from varos_warp.scene.geometry.assets.structures.fitted import concrete_block, flange_joint, hand_wheel
from varos_warp.scene.geometry.assets.structures.hull import hull_section
from varos_warp.scene.geometry.assets.structures.panel import BUCKET, wellhead_panel
from varos_warp.scene.geometry.assets.structures.quay import quay_wall
from varos_warp.scene.geometry.assets.structures.rov import rov
from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.topology import area_normals

__all__ = [
    "DETAIL",
    "FLANGES_MM",
    "HEX_SIZES_MM",
    "bolt",
    "boulder",
    "default_chord_error",
    "elbow",
    "flange",
    "flange_measures",
    "hex_measures",
    "make_asset",
    "nut",
    "pipe",
    "pipe_support",
    "valve",
]

DETAIL = 0.002
"""Chord error by default, as a share of the radius: 52 points around a pipe."""
FINEST_DEFAULT = 5e-5
"""No default is finer [m]: half a pixel, 10 cm before a camera of 1000 pixels focal length."""
COARSEST_DEFAULT = 25.0 / 65535
"""No default is coarser [m]: one step of image D at its default range."""

QUAD = np.sqrt(2.0) * 1.0001
"""Longest edge of a square of two triangles, over its side."""

_MAKERS: dict = {
    world.Pipe: pipe,
    world.Elbow: elbow,
    world.Flange: flange,
    world.PipeSupport: pipe_support,
    world.Bolt: bolt,
    world.Nut: nut,
    world.Valve: valve,
    world.Boulder: boulder,
}
_RADII: dict = {
    world.HullSection: lambda block: block.bilge_radius_m,
    world.MooringChain: lambda block: 0.5 * block.link_m,
    world.QuayWall: lambda block: block.pile_depth_m,
    world.WellheadPanel: lambda block: BUCKET,
    world.Anode: lambda block: block.pipe_radius_m or block.thick_m,
    world.ConcreteBlock: lambda block: 0.1,
    world.Rov: lambda block: block.lamp_radius_m,
}
"""What stands for the radius of an object that has none, for its chord error [m]."""
_STRUCTURES: dict = {
    world.HullSection: hull_section,
    world.MooringChain: mooring_chain,
    world.QuayWall: quay_wall,
    world.WellheadPanel: wellhead_panel,
    world.Rov: rov,
    world.Anode: anode,
    world.FlangeJoint: flange_joint,
    world.HandWheel: hand_wheel,
    world.ConcreteBlock: concrete_block,
}


def make_asset(
    block: world.ParametricObject, key: str = "object", *, max_edge_m: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices float64 [V, 3] [m] and faces int32 [F, 3] of a parametric object, in its own axes, before its scale.

    Its triangles lie within ``chord_error_m`` of the true surface in the world, that is after its scale; absent:
    ``default_chord_error``. No less than 4e-6 of the radius is made of it.

    Args:
        max_edge_m: Longest edge in the world [m], instead of the block's own: it is made of even grids then, whose
            triangles are no slivers on smooth walls. None: the block's own; absent there, too: no longest edge.

    Raises:
        InputError: An unknown bolt size, measures that make no solid, or more than 20 million triangles.
    """
    return make_coloured(block, key, max_edge_m=max_edge_m)[:2]


def make_coloured(
    block: world.ParametricObject, key: str = "object", *, max_edge_m: float | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return what `make_asset` does, and the linear reflectances of the faces, float32 [F, 3]; None if it has none."""
    scale = float(np.max(block.scale))
    chord_error = (block.chord_error_m or default_chord_error(block, key)) / scale
    longest = block.max_edge_m if max_edge_m is None else max_edge_m
    longest = np.inf if longest is None else longest / scale
    detail = Detail(chord_error, longest / QUAD, key)
    if detail.is_grid:
        coarsest = _pieces(block, key, Detail(1e3 * chord_error, key=key))
        area = 0.5 * sum(np.linalg.norm(area_normals(mesh[0], mesh[1]), axis=1).sum() for mesh, _ in coarsest)
        detail.allow(area / (0.25 * np.sqrt(3.0) * longest**2))  # equilateral ones
    pieces = [(split_long(*mesh, longest), colour) for mesh, colour in _pieces(block, key, detail)]
    detail.allow(sum(len(faces) for (_, faces), _ in pieces))
    colours = [np.broadcast_to(np.float32(colour), (len(faces), 3)) for (_, faces), colour in pieces]
    return *join(mesh for mesh, _ in pieces), np.concatenate(colours) if has_colours(block) else None


def _pieces(block, key, detail):
    """Meshes of an object, each with its colour: of one without colours the one, and black."""
    if not has_colours(block):
        return [(_MAKERS[type(block)](block, key, detail), (0.0, 0.0, 0.0))]
    pieces = _STRUCTURES[type(block)](block, key, detail)
    if not pieces:
        raise InputError(
            "names nothing that this object has",
            key=f"{key}.only",
            value=getattr(block, "only", None),
            remedy="Name other pieces, or leave it out for all of them.",
        )
    return [((piece.vertices, piece.faces), piece.colour) for piece in pieces]


def has_colours(block: object) -> bool:
    """Return whether an object has colours of its own."""
    return type(block) in _STRUCTURES


def default_chord_error(block: world.ParametricObject, key: str = "object") -> float:
    """Chord error in the world [m] where the object gives none: by its radius, from 0.05 to 0.38 mm.

    A boulder has no true surface to come near to: an 80th of its radius is fine enough.
    """
    if isinstance(block, world.Boulder):
        return float(block.diameter / 160.0 * np.max(block.scale))
    if isinstance(block, world.Bolt | world.Nut):
        radius = 0.5 * hex_measures(block.size, f"{key}.size")[0]
    else:
        radius = _RADII[type(block)](block) if type(block) in _RADII else block.radius
    return float(np.clip(DETAIL * radius * np.max(block.scale), FINEST_DEFAULT, COARSEST_DEFAULT))
