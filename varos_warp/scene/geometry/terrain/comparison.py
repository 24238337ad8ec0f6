"""The error of a processed mesh: sampled distances and angles between two surfaces; and facts of a mesh."""

import numpy as np

from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.topology import area_normals, edge_uses, pieces

DISTANCE_SAMPLES = 200_000
"""Points on either surface; the largest distance found is exceeded on about 1 / samples of the area."""


def mesh_facts(vertices: np.ndarray, faces: np.ndarray) -> dict:
    """Counts, bounds [m], area [m^2], pieces, and edges that are not shared by two faces.

    ``watertight``: every edge has two faces. A sheet is ``watertight`` when closed by skirt and bottom; without them
    it is as good as it can be with ``boundary_edges`` along its outline only.
    """
    once, many = edge_uses(faces)
    label = pieces(faces, len(vertices)) if len(faces) else np.zeros(0, int)
    return {
        "vertices": len(vertices),
        "triangles": len(faces),
        "bounds_m": [vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()],
        "area_m2": mesh_area(vertices, faces),
        "pieces": len(np.unique(label)),
        "watertight": len(once) == 0 and len(many) == 0,
        "boundary_edges": len(once),
        "edges_of_many_faces": len(many),
    }


def mesh_area(vertices, faces) -> float:
    """Area of a mesh [m^2]."""
    return float(0.5 * np.linalg.norm(area_normals(vertices, faces), axis=1).sum())


def sample_surface(vertices, faces, samples: int, seed: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] spread evenly by area, and their faces [N]: one in each of N equal shares of the area."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(np.linalg.norm(area_normals(vertices, faces), axis=1))
    face = np.searchsorted(ends, (np.arange(samples) + rng.random(samples)) / samples * ends[-1], side="right")
    face = face.clip(max=len(faces) - 1)
    u, v = rng.random((2, samples))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    a, b, c = (vertices[faces[face, i]] for i in range(3))
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), face


def one_sided_distance(source, target, samples: int = DISTANCE_SAMPLES, *, device: str = "cpu", region=None) -> dict:
    """Distances [m] from one mesh (vertices, faces) to another: ``rms``, ``p95``, ``max``; and between their normals.

    ``normal_deg`` has ``mean``, ``p95`` and ``max`` of the angle between the normal at a sample and that of the
    nearest face.

    Args:
        region: Only points in xmin, ymin, xmax, ymax [m] count.
    """
    points, face = sample_surface(*source, samples)
    if region is not None:
        inside = ((points[:, :2] >= region[:2]) & (points[:, :2] <= region[2:])).all(axis=1)
        points, face = points[inside], face[inside]
    d, nearest = Surface(*target, device).nearest(points)
    n, m = area_normals(source[0], source[1][face]), area_normals(target[0], target[1][nearest])
    sine = np.linalg.norm(np.cross(n, m), axis=1)
    angle = np.degrees(np.arctan2(sine, np.einsum("ij,ij->i", n, m)))
    return {
        "samples": len(points),
        "rms": float(np.sqrt(np.mean(d**2))),
        "p95": float(np.quantile(d, 0.95)),
        "max": float(d.max()),
        "normal_deg": {"mean": float(angle.mean()), "p95": float(np.quantile(angle, 0.95)), "max": float(angle.max())},
    }


def compare(original, result, samples: int = DISTANCE_SAMPLES, *, device: str = "cpu", region=None) -> dict:
    """The error of a result against its original, both (vertices, faces).

    Returns:
        ``distance_to_result_m`` and ``distance_to_original_m`` as from ``one_sided_distance``, and ``symmetric_m``
        with ``hausdorff``, the larger of their maxima, and ``rms``, over the samples of both.
    """
    there = one_sided_distance(original, result, samples, device=device, region=region)
    back = one_sided_distance(result, original, samples, device=device)
    weights = [there["samples"], back["samples"]]
    rms = float(np.sqrt(np.average([there["rms"] ** 2, back["rms"] ** 2], weights=weights)))
    return {
        "distance_to_result_m": there,
        "distance_to_original_m": back,
        "symmetric_m": {"hausdorff": max(there["max"], back["max"]), "rms": rms},
    }
