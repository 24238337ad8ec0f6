"""Silt that has settled on what grows."""

from dataclasses import replace

import numpy as np

from varos_warp.scene.geometry.growth.solids import Solid, waves
from varos_warp.scene.geometry.relief.form import vertex_normals

SILT = np.array([0.175, 0.159, 0.123])
FROM = np.array([0.0, 0.6, 0.8])
"""Direction that silt comes from: copies with silt have their y axis up along their host."""
MOST, ALL_OVER, RAGGED = 0.75, 0.1, 0.22
"""The most that silt hides, what of it lies on all sides, and by how much it differs from place to place."""


def dusted(clean: Solid, thin: bool) -> Solid:
    """A solid with silt on its upper side, or on both sides of what is ``thin``, such as blades."""
    facing = vertex_normals(clean.vertices, clean.faces) @ FROM
    facing = np.abs(facing) if thin else np.maximum(facing, 0.0)
    ragged = waves(clean.vertices, 0.3, np.random.default_rng(len(clean.faces)))
    lies = np.clip(ALL_OVER + (0.45 if thin else 0.75) * facing + RAGGED * ragged, 0.0, MOST)[:, None]
    return replace(clean, colours=clean.colours + lies * (SILT - clean.colours))
