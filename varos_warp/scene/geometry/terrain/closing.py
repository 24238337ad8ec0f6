"""A sheet closed along its outline: by a skirt down to a level below it, and by a bottom.

Watertight, for a sheet, means that its outline is its only boundary; with skirt and bottom, that it has none.
"""

import numpy as np

from varos_warp.scene.geometry.topology import boundary_edges, compact, outlines

DEPTH = 0.02
"""How far the skirt reaches below the lowest vertex, as a share of the longer side."""


def skirt_level(vertices) -> float:
    """Height of the lower end of the skirt [m]."""
    return float(vertices[:, 2].min() - DEPTH * np.ptp(vertices, axis=0).max())


def add_skirt(vertices, faces):
    """Walls from the outline straight down to ``skirt_level``."""
    edges = boundary_edges(faces)
    if len(edges) == 0:
        return vertices, faces
    rim, corners = np.unique(edges, return_inverse=True)
    feet = vertices[rim] * [1.0, 1.0, 0.0] + [0.0, 0.0, skirt_level(vertices)]
    a, b = edges.T
    a_foot, b_foot = (corners.reshape(-1, 2) + len(vertices)).astype(faces.dtype).T
    walls = np.concatenate([np.column_stack([b, a, a_foot]), np.column_stack([b, a_foot, b_foot])])
    return np.concatenate([vertices, feet]), np.concatenate([faces, walls])


def close(vertices, faces, how: str):
    """A sheet closed by ``skirt``, by skirt and bottom (``solid``), or not at all (``none``)."""
    if how != "none":
        vertices, faces = add_skirt(vertices, faces)
    return add_bottom(vertices, faces) if how == "solid" else (vertices, faces)


def without_skirt(vertices, faces, level: float):
    """The sheet alone: the faces with no vertex at the level of the skirt's feet."""
    low = vertices[:, 2] < level + 0.5 * DEPTH * np.ptp(vertices, axis=0).max()
    return compact(vertices, faces[~low[faces].any(axis=1)])


def add_bottom(vertices, faces):
    """A bottom: fans from below the middle of every outline, all but flat.

    Where an outline is not star-shaped from there, they overlap. They are not quite flat so that none has no area.
    """
    edges = boundary_edges(faces)
    if len(edges) == 0:
        return vertices, faces
    _, ends, outline, middle = outlines(vertices, edges)
    middle[:, 2] -= 0.05 * DEPTH * np.ptp(vertices, axis=0).max()
    fans = np.column_stack([edges[:, ::-1], outline[ends[:, 0]] + len(vertices)]).astype(faces.dtype)
    return np.concatenate([vertices, middle]), np.concatenate([faces, fans])
