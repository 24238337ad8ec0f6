"""Many meshes become one: joined, cropped, vertices nearer than a tolerance merged."""

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.errors import InputError
from varos_warp.scene.geometry.topology import chunks, compact, extents, first_equal, groups

MEDIAN_SAMPLE = 100_000
"""Faces, evenly taken from the list, from which the median edge is estimated."""


def join(meshes) -> tuple[np.ndarray, np.ndarray]:
    """One mesh (vertices float64 [V, 3], faces int32 [F, 3]) of many, nothing merged."""
    meshes = list(meshes)
    if not meshes:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    offsets = np.cumsum([0] + [len(v) for v, _ in meshes[:-1]])
    vertices = np.concatenate([np.asarray(v, float) for v, _ in meshes])
    faces = np.concatenate([np.asarray(f) + np.int64(o) for (_, f), o in zip(meshes, offsets, strict=True)])
    return vertices, faces.astype(np.int32, copy=False)


def crop(vertices, faces, region, key="preprocess"):
    """The faces whose bounding rectangle reaches into ``region`` (xmin, ymin, xmax, ymax [m])."""
    xmin, ymin, xmax, ymax = region
    inside = np.zeros(len(faces), bool)
    for part in chunks(len(faces)):
        low, high = extents(vertices[faces[part], :2])
        inside[part] = (high >= (xmin, ymin)).all(axis=1) & (low <= (xmax, ymax)).all(axis=1)
    if not inside.any():
        bounds = np.concatenate([vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)]).round(3).tolist()
        raise InputError(
            "lies beside the terrain", key=f"{key}.region", value=list(region), remedy=f"The terrain covers {bounds}."
        )
    return compact(vertices, faces[inside])


def median_edge(vertices, faces) -> float:
    """Median length of the edges of an even sample of the faces [m]; 0 without faces."""
    sample = faces[:: max(1, len(faces) // MEDIAN_SAMPLE)]
    edges = np.linalg.norm(np.diff(vertices[sample[:, [0, 1, 2, 0]]], axis=1), axis=2)
    return float(np.median(edges)) if len(faces) else 0.0


def merge_near(vertices, faces, tolerance: float | None, key="preprocess"):
    """Vertices nearer than ``tolerance`` [m] become one, at their mean; so do chains of such vertices.

    None: 1 mm, or a quarter of the median edge if that is less.

    Raises:
        InputError: A tolerance that was given is more than half of the median edge.
    """
    median = median_edge(vertices, faces)
    if tolerance is None:
        tolerance = min(0.001, median / 4.0)
    if tolerance > 0.5 * median and tolerance > 0.0 and median > 0.0:
        raise InputError(
            f"is more than half the mesh's median edge of {median:.3g} m",
            value=tolerance,
            key=f"{key}.merge_tolerance_m",
            remedy="Lower it, else the surface collapses.",
        )
    vertices, faces = merge_equal(vertices, faces)
    tree = cKDTree(vertices, balanced_tree=False, compact_nodes=False)  # as quick to search, quicker to build
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    if len(pairs) == 0:
        return vertices, faces
    label = groups(pairs, len(vertices))
    count = label.max() + 1
    centre = vertices.mean(axis=0)  # a mean of coordinates far from zero would lose digits
    total = np.column_stack([np.bincount(label, vertices[:, axis] - centre[axis], count) for axis in range(3)])
    merged = total / np.bincount(label, minlength=count)[:, None] + centre
    alone = np.bincount(label, minlength=count)[label] == 1
    merged[label[alone]] = vertices[alone]
    return merged, label.astype(np.int32)[faces]


def merge_equal(vertices, faces):
    """Vertices at exactly the same place become one."""
    first = first_equal((vertices + 0.0).view(np.int64))  # -0 becomes 0
    if (first == np.arange(len(vertices))).all():
        return vertices, faces
    return compact(vertices, first.astype(np.int32)[faces])
