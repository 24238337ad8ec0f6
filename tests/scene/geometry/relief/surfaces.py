"""Meshes and looks to try recipes on."""

from dataclasses import dataclass

import numpy as np
import trimesh

from varos_warp.scene.geometry.normals import area_normals
from varos_warp.scene.geometry.relief.recipes.sites import Sites


@dataclass(frozen=True)
class Look:
    """What recipes read of a material block."""

    paint: tuple[float, float, float] | None = None
    wear: float = 0.3
    silt: float = 0.5
    film: float = 0.4
    seed: int = 1


def ball(radius: float, subdivisions: int):
    """Vertices, faces and unit normals of a ball."""
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions)
    return radius * np.asarray(mesh.vertices), np.asarray(mesh.faces), np.asarray(mesh.vertices)


def sheet(count: int, step: float, height=lambda x, y: 0.0 * x):
    """Vertices, faces and unit normals of a height field, count x count vertices."""
    x, y = (v.ravel() for v in np.meshgrid(*2 * [step * (np.arange(count) - 0.5 * (count - 1))]))
    p = np.stack([x, y, height(x, y)], axis=1)
    n = np.arange(count * count).reshape(count, count)
    a, b, c, d = (v.ravel() for v in (n[:-1, :-1], n[:-1, 1:], n[1:, 1:], n[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return p, faces, vertex_normals(p, faces)


def vertex_normals(p, faces):
    """Unit normals [N, 3]."""
    flat = area_normals(p, faces)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(flat[:, k], 3), len(p)) for k in range(3)], axis=1)
    return total / np.linalg.norm(total, axis=1, keepdims=True)


def mean_edge(p, faces) -> float:
    """Mean length of edges [m]."""
    return float(np.linalg.norm(p[faces] - p[np.roll(faces, -1, axis=1)], axis=2).mean())


def sites_of(p, faces, n, **others) -> Sites:
    """The vertices of a mesh that nothing stands near to."""
    edge = np.full(len(p), mean_edge(p, faces))
    size = float(np.linalg.norm(np.ptp(p, axis=0)))
    given = {
        "p": p,
        "n": n,
        "edge": edge,
        "size": size,
        "height": p[:, 2] - p[:, 2].min(),
        "clear": np.full(len(p), np.inf),
    } | others
    return Sites(**given)
