"""The parts of a world as plain arrays: what mesh loading, terrain and assets make, and the device scene uploads."""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.description import Material


@dataclass(frozen=True)
class Part:
    """One connected-by-name piece of the world, in world coordinates."""

    name: str
    """Key in the scene file: ``terrain`` or ``objects.3``."""
    vertices: np.ndarray
    """float64 [V, 3] [m]."""
    faces: np.ndarray
    """int32 [F, 3], counter-clockwise seen from outside."""
    material: Material
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The object's position [m]; seeds its procedural material."""
    smooth_angle: float = np.pi / 6
    """[rad]"""
    smooth_shading: bool = False
    """Whether A and B are lit with the smoothed normals."""
