"""A mesh made sound: no vertices that are not finite, no degenerate or repeated faces, holes filled, faces up.

Every function returns the mesh and counts of what it removed or added.
"""

import numpy as np

from varos_warp.scene.geometry import topology
from varos_warp.scene.geometry.surface import Surface

HOLE_EDGES = 10.0
"""Holes up to this many median edges across are filled by default."""

VOTERS = 20_000
"""Rays cast down on a model to tell its front from its back."""

SMALLEST_M, LARGEST_M = 0.05, 20_000.0
"""Longer side of a model [m] beyond which its unit is probably not the metre."""


def drop_not_finite(vertices, faces):
    """A mesh without vertices that are NaN, infinite or too far out for any unit of length, and without their faces."""
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(vertices) < topology.FARTHEST).all(axis=1)
    if not bad.any():
        return (vertices, faces), {"not_finite_vertices": 0, "faces_at_them": 0}
    kept = faces[~bad[faces].any(axis=1)]
    counts = {"not_finite_vertices": int(bad.sum()), "faces_at_them": len(faces) - len(kept)}
    return topology.compact(vertices, kept), counts


def drop_useless(vertices, faces):
    """A mesh without faces of no area, faces with the same corners as another, and vertices that no face uses."""
    area = np.empty(len(faces), bool)
    for part in topology.chunks(len(faces)):
        area[part] = (topology.area_normals(vertices, faces[part]) != 0.0).any(axis=1)
    kept = faces[area]
    corners = np.sort(kept, axis=1).astype(np.int64)
    rows = np.column_stack([corners[:, 0] << 32 | corners[:, 1], corners[:, 2]])
    single = kept[topology.first_equal(rows) == np.arange(len(kept))]
    result = topology.compact(vertices, single)
    return result, {
        "degenerate_faces": len(faces) - len(kept),
        "repeated_faces": len(kept) - len(single),
        "unused_vertices": len(vertices) - len(result[0]),
    }


def clean(vertices, faces):
    """The mesh that ``drop_useless`` leaves."""
    return drop_useless(vertices, faces)[0]


def fill_holes(vertices, faces, widest: float):
    """Close holes by a fan to the mean of their rim: right for small ones; wide, winding ones are the shrinkwrap's.

    A hole is a closed loop of edges that have one face each, at most ``widest`` [m] across (the diagonal of its
    bounding box) and less than half as wide as the piece that it is in: the outline of a sheet is no hole. Loops that
    touch themselves or each other stay open.
    """
    edges = topology.boundary_edges(faces)
    if len(edges) == 0:
        return (vertices, faces), {"holes_filled": 0, "holes_left": 0, "faces_added": 0}
    used, corners, loop, middle = topology.outlines(vertices, edges)
    degree = np.bincount(corners.ravel(), minlength=len(used))
    outgoing = np.bincount(corners[:, 0], minlength=len(used))
    simple = np.bincount(loop, (degree != 2) | (outgoing != 1)) == 0
    size = _extent(vertices[used], loop)
    fill = simple & (size <= widest)
    if fill.any():
        piece = topology.groups(np.concatenate([faces[:, :2], faces[:, 1:]]), len(vertices))
        whole = np.zeros(len(size))
        whole[loop] = _extent(vertices, piece)[piece[used]]
        fill &= size < 0.5 * whole
    apex = np.cumsum(fill) - 1 + len(vertices)
    wanted = fill[loop[corners[:, 0]]]
    fans = np.column_stack([edges[wanted][:, ::-1], apex[loop[corners[wanted, 0]]]]).astype(np.int32)
    counts = {"holes_filled": int(fill.sum()), "holes_left": int((~fill).sum()), "faces_added": len(fans)}
    return (np.concatenate([vertices, middle[fill]]), np.concatenate([faces, fans])), counts


def _extent(points, label):
    """Diagonal [L] of the bounding box of every group of points."""
    order = np.argsort(label, kind="stable")
    starts = np.flatnonzero(np.diff(label[order], prepend=-1))
    high, low = (ufunc.reduceat(points[order], starts, axis=0) for ufunc in (np.maximum, np.minimum))
    return np.linalg.norm(high - low, axis=1)


def orient(vertices, faces, device="cpu"):
    """Turn faces so that neighbours agree and what is seen from above faces up.

    Every piece votes: rays from above that meet its front against those that meet its back. Pieces that nothing is
    seen of, such as the underside of an overhang, stay as they are.
    """
    faces = faces.copy()
    turned = np.zeros(len(faces), bool)
    if not topology.is_consistent(faces):
        turned = _disagreeing(faces)
        faces[turned] = faces[turned, ::-1]
    backward = _seen_from_behind(vertices, faces, device)
    faces[backward] = faces[backward, ::-1]
    return (vertices, faces), {"turned_faces": int((turned ^ backward).sum())}


def _disagreeing(faces):
    """Faces [F] to turn so that neighbours agree, as many as possible staying as they are.

    Every face stands twice in a graph, as it is and turned; edges join what agrees. A piece then falls into two halves
    that mirror each other, and each half is a consistent orientation. A Moebius strip does not, and stays.
    """
    count = len(faces)
    forward = (faces < np.roll(faces, -1, axis=1)).ravel()
    one, other = topology.paired_edges(faces)
    f, g, agree = one // 3, other // 3, forward[one] != forward[other]
    as_is, turned = np.where(agree, g, g + count), np.where(agree, g + count, g)
    label = topology.groups(
        np.concatenate([np.column_stack([f, as_is]), np.column_stack([f + count, turned])]), 2 * count
    )
    as_is, mirrored = label[:count], label[count:]
    votes = np.bincount(as_is, minlength=label.max() + 1)
    fewer = (votes[as_is] < votes[mirrored]) | ((votes[as_is] == votes[mirrored]) & (as_is > mirrored))
    return fewer & (as_is != mirrored)


def _seen_from_behind(vertices, faces, device):
    """Faces [F] of pieces of which more back than front is seen from above."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    rng = np.random.default_rng(1)
    corners = vertices[faces[rng.integers(len(faces), size=VOTERS)]]
    weights = rng.dirichlet(np.ones(3), VOTERS)
    points = np.einsum("ni,nij->nj", weights, corners)
    points[:, 2] = high[2] + max(np.ptp([low, high]) * 0.1, 1e-3)
    face, side = Surface(vertices, faces, device).first_hits(points, (0.0, 0.0, -1.0))
    hit = face >= 0
    if not (side[hit] < 0.0).any():
        return np.zeros(len(faces), bool)
    label = topology.pieces(faces, len(vertices))
    votes = np.bincount(label[face[hit]], side[hit], minlength=label.max() + 1)
    return votes[label] < 0.0


def suspicious_size(vertices) -> str | None:
    """A warning if the model is so large or small that its unit is probably not the metre."""
    longer = float(np.ptp(vertices, axis=0).max())
    if longer > LARGEST_M:
        return f"the model is {longer:.4g} m long: if it is in millimetres, give scale 0.001"
    if longer < SMALLEST_M:
        return (
            f"the model is only {longer:.3g} m long: if it is in kilometres or metres taken for millimetres, "
            f"give scale 1000"
        )
    return None
