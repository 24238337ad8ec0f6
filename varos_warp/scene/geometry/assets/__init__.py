"""Parametric man-made objects and boulders (paper 3.1.2): closed solids with rounded edges, outward normals."""

import numpy as np

from varos_warp.scene.description import world
from varos_warp.scene.geometry.assets.fasteners import HEX_SIZES_MM, bolt, hex_measures, nut
from varos_warp.scene.geometry.assets.pipes import FLANGES_MM, elbow, flange, flange_measures, pipe, pipe_support, valve
from varos_warp.scene.geometry.assets.rocks import boulder

__all__ = ["DETAIL", "FLANGES_MM", "HEX_SIZES_MM", "bolt", "boulder", "default_chord_error", "elbow", "flange",
           "flange_measures", "hex_measures", "make_asset", "nut", "pipe", "pipe_support", "valve"]

DETAIL = 0.002
"""Chord error by default, as a share of the radius: 52 points around a pipe."""
FINEST_DEFAULT = 5e-5
"""No default is finer [m]: half a pixel, 10 cm before a camera of 1000 pixels focal length."""
COARSEST_DEFAULT = 25.0 / 65535
"""No default is coarser [m]: one step of image D at its default range."""

_MAKERS = {world.Pipe: pipe, world.Elbow: elbow, world.Flange: flange, world.PipeSupport: pipe_support,
           world.Bolt: bolt, world.Nut: nut, world.Valve: valve, world.Boulder: boulder}


def make_asset(block: world.ParametricObject, key: str = "object") -> tuple[np.ndarray, np.ndarray]:
    """Vertices float64 [V, 3] [m] and faces int32 [F, 3] of a parametric object, in its own axes, before its scale.

    Its triangles lie within ``chord_error_m`` of the true surface in the world, that is after its scale; absent:
    ``default_chord_error``. No less than 4e-6 of the radius is made of it.

    Args:
        block: The object.
        key: Where it stands in the scene file, for messages.

    Raises:
        InputError: An unknown bolt size, or measures that make no solid.
    """
    wanted = block.chord_error_m or default_chord_error(block, key)
    return _MAKERS[type(block)](block, key, wanted / np.max(block.scale))


def default_chord_error(block: world.ParametricObject, key: str = "object") -> float:
    """Chord error in the world [m] where the object gives none: by its radius, from 0.05 to 0.38 mm.

    A boulder has no true surface to come near to: an 80th of its radius is fine enough.
    """
    if isinstance(block, world.Boulder):
        return float(block.diameter / 160.0 * np.max(block.scale))
    if isinstance(block, world.Bolt | world.Nut):
        radius = 0.5 * hex_measures(block.size, f"{key}.size")[0]
    else:
        radius = block.radius
    return float(np.clip(DETAIL * radius * np.max(block.scale), FINEST_DEFAULT, COARSEST_DEFAULT))
