"""Normals of triangle meshes: flat, and smoothed over edges that are not sharp (Blender's auto smooth)."""

import numpy as np

from varos_warp.cache import cached, code_hash, digest
from varos_warp.scene.geometry.topology import area_normals, groups, next_corner, paired_edges

UP = np.array([0.0, 0.0, 1.0])
"""Normal of a degenerate face, which no ray can hit."""
KEPT_FACES = 100_000
"""Normals of meshes of so many faces or more are kept in the user's cache: of a million they take over a second."""


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals float64 [F, 3], counter-clockwise faces seen from outside; degenerate faces get +z."""
    normals = area_normals(vertices, faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0.0, normals / np.where(length > 0.0, length, 1.0), UP)


def corner_normals(vertices: np.ndarray, faces: np.ndarray, angle: float) -> np.ndarray:
    """Normals per face corner, smoothed over edges whose faces meet at no more than ``angle`` (paper, image type C).

    The corners around a vertex that are joined through smooth edges share one normal: the mean of their faces'
    normals, weighted with the corner's angle (Thuermer and Wuethrich 1998). Edges of one face only, of more than two,
    or of two that disagree about their outside, are sharp.

    Args:
        vertices: float64 [V, 3].
        faces: int [F, 3].
        angle: Largest angle between the normals of two faces that are smoothed over [rad].

    Returns:
        Unit vectors, float64 [F, 3, 3]: face, corner, axis.
    """
    faces = np.asarray(faces)
    vertices = np.asarray(vertices, float)
    if len(faces) == 0:
        return np.zeros((0, 3, 3))
    flat = face_normals(vertices, faces)
    weights = _corner_angles(vertices, faces)
    group = _smooth_groups(faces, flat, weights.any(axis=1), angle)
    total = np.empty((group.max() + 1, 3))
    for axis in range(3):
        total[:, axis] = np.bincount(group, (weights * flat[:, None, axis]).ravel(), minlength=len(total))
    smooth = total[group].reshape(-1, 3, 3)
    length = np.linalg.norm(smooth, axis=2, keepdims=True)
    # Opposite faces of a fin cancel, and degenerate faces weigh nothing: those corners stay flat.
    return np.where(length > 1e-12, smooth / np.maximum(length, 1e-12), flat[:, None, :])


def kept_corner_normals(vertices: np.ndarray, faces: np.ndarray, angle: float) -> np.ndarray:
    """`corner_normals`; of large meshes from the user's cache, where they were computed before."""

    def compute():
        return {"normals": corner_normals(vertices, faces, angle)}

    if len(faces) < KEPT_FACES:
        return compute()["normals"]
    code = code_hash(__name__, (__name__, "varos_warp.scene.geometry.topology"))
    depends_on = {"mesh": digest(vertices, faces), "angle": float(angle), "code": code}
    return cached("normals", depends_on, compute)["normals"]


def _corner_angles(vertices, faces):
    """Inner angles [F, 3]; zero in degenerate faces."""
    corners = vertices[faces]
    to_next = corners[:, [1, 2, 0]] - corners
    to_previous = -to_next[:, [2, 0, 1]]
    double_area = np.linalg.norm(np.cross(to_next[:, 0], to_previous[:, 0]), axis=1, keepdims=True)
    angles = np.arctan2(double_area, np.einsum("fij,fij->fi", to_next, to_previous))
    return np.where(double_area > 0.0, angles, 0.0)


def _smooth_groups(faces, flat, has_area, angle):
    """Label [3 F] of the smooth fan that each corner belongs to; corner i of face f is number 3 f + i."""
    start = faces.ravel()
    end = faces[:, [1, 2, 0]].ravel()
    one, two = paired_edges(faces)
    agree = start[one] == end[two]  # about their outside
    one, two = one[agree], two[agree]
    face_one, face_two = one // 3, two // 3
    # A tolerance of 1e-7 rad, so that an edge of exactly ``angle`` is smooth whatever the rounding.
    cosine = np.einsum("ij,ij->i", flat[face_one], flat[face_two])
    sine = np.linalg.norm(np.cross(flat[face_one], flat[face_two]), axis=1)
    smooth = (np.arctan2(sine, cosine) <= angle + 1e-7) & has_area[face_one] & has_area[face_two]
    one, two = one[smooth], two[smooth]
    # Half-edge k runs from corner k to the face's next corner; its twin runs the other way.
    rows, columns = np.concatenate([one, next_corner(one)]), np.concatenate([next_corner(two), two])
    return groups(np.column_stack([rows, columns]), len(start))
