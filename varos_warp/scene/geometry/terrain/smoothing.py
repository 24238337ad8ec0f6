"""Noise of a survey smoothed away without shrinking what is larger (Taubin 1995, SIGGRAPH)."""

import numpy as np
import trimesh
from scipy.sparse import coo_matrix, diags_array

from varos_warp.scene.geometry.topology import boundary_edges, edge_keys

ROUGH_DEG = 25.0
"""Mean angle between neighbouring faces beyond which a sheet decimates to shards."""


def smooth(vertices: np.ndarray, faces: np.ndarray, rounds: int) -> np.ndarray:
    """Vertices [V, 3] after a number of rounds, each of which moves them towards their neighbours' mean and back.

    A wave whose length is k edges keeps a share of about (1 - (pi / k)^4)^rounds. On its outline a sheet moves only up
    and down, by the neighbours on the outline.
    """
    rim = np.unique(boundary_edges(faces))
    keys = np.unique(edge_keys(faces))
    a, b = keys >> 32, keys & 0xFFFFFFFF
    on_rim = np.zeros(len(vertices), bool)
    on_rim[rim] = True
    i, j = np.concatenate([a, b]), np.concatenate([b, a])
    counts = ~on_rim[i] | on_rim[j]
    weights = coo_matrix((np.ones(counts.sum()), (i[counts], j[counts])), shape=(len(vertices),) * 2).tocsr()
    mean = diags_array(1.0 / np.maximum(np.asarray(weights.sum(axis=1)).ravel(), 1.0)) @ weights
    centre = vertices.mean(axis=0)  # far from the origin, differences of coordinates lose digits
    mesh = trimesh.Trimesh(vertices - centre, faces, process=False)
    trimesh.smoothing.filter_taubin(mesh, iterations=2 * rounds, laplacian_operator=mean)
    result = np.array(mesh.vertices) + centre
    result[rim, :2] = vertices[rim, :2]
    return result


def roughness_deg(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Mean angle between the normals of neighbouring faces [deg]; 0 where there are none."""
    angles = trimesh.Trimesh(vertices, faces, process=False).face_adjacency_angles
    return float(np.degrees(angles.mean())) if len(angles) else 0.0
