"""Fewer triangles by quadric edge collapse (Garland and Heckbert 1997, SIGGRAPH), in bounded memory."""

import fast_simplification
import numpy as np

from varos_warp.scene.geometry.joining import join, merge_equal
from varos_warp.scene.geometry.terrain.closing import add_skirt, close, skirt_level, without_skirt
from varos_warp.scene.geometry.terrain.repair import clean, fill_holes
from varos_warp.scene.geometry.topology import boundary_edges, compact, edge_uses

TILE = 4_000_000
"""Most triangles decimated at once: the library takes about 350 bytes for each."""

SPARE = 4
"""A tile keeps this many times its share of the target, for the last pass over the whole to choose from."""


AGGRESSIVENESS = (5.0, 7.0, 10.0)
"""How quickly the library lets its error bound grow, raised until the target is met. 5 errs less than its default 7."""

SIDE = 200.0
"""Longer side of what the library sees: its error bounds are absolute, and the result shall not depend on the unit."""

MOST_MENDED = 0.01
"""Edges of more than two faces, as a share of the faces, beyond which they are the model's own and stay."""

FIRST = 4.0
"""Vertices, as a share of the number asked, from which the last of the decimation starts."""

TRIALS = 4

CLOSE_ENOUGH = 0.002
"""Share of the number of vertices asked that may be missing."""

MENDINGS = 8
"""Most rounds of cutting out edges of more than two faces and filling the holes."""


def decimate(vertices, faces, target_vertices: int, progress=lambda share: None):
    """About ``target_vertices`` vertices. Large meshes are first thinned out tile by tile, seams untouched."""
    target = max(4, round(len(faces) * target_vertices / len(vertices)))
    centre = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))  # quadrics of large coordinates lose digits
    scale = SIDE / max(np.ptp(vertices, axis=0).max(), 1e-30)
    vertices = (vertices - centre) * scale
    if len(faces) > TILE and SPARE * target < len(faces):
        vertices, faces = _thin_out(vertices, faces, SPARE * target / len(faces), progress)
    vertices, faces = clean(*_simplify(vertices, faces, target))
    vertices, faces = _mend(vertices, faces)
    return vertices / scale + centre, faces


def decimate_closed(vertices, faces, most: int, how: str, sheet: bool, progress=lambda share: None):
    """A mesh that has ``most`` vertices or hardly fewer once it is closed: ``how`` as for ``closing.close``.

    How many vertices an outline needs is known only afterwards, so the last of the decimation is tried a few times. If
    all have more, the smallest is returned.
    """
    vertices, faces = _under_skirt(vertices, faces, round(FIRST * most), sheet, progress)
    ask, tried = most, {}
    for _ in range(TRIALS):
        mesh = _under_skirt(vertices, faces, ask, sheet)
        count = len(close(*mesh, how)[0]) if len(mesh[1]) else 0
        tried[count] = mesh
        if 0 <= most - count <= CLOSE_ENOUGH * most or ask == (ask := max(4, ask + most - count)):
            break
    return tried[max((count for count in tried if count <= most), default=min(tried))]


def _under_skirt(vertices, faces, target_vertices, sheet, progress=lambda share: None):
    """A mesh decimated to about so many vertices; under a wrapped sheet stands a skirt, which holds its outline."""
    if target_vertices >= len(vertices):
        return vertices, faces
    if not sheet:
        return decimate(vertices, faces, target_vertices, progress)
    level, count = skirt_level(vertices), len(vertices)
    vertices, faces = add_skirt(vertices, faces)
    vertices, faces = decimate(vertices, faces, round(target_vertices * len(vertices) / count), progress)
    return without_skirt(vertices, faces, level)


def _simplify(vertices, faces, target, **options):
    """Reduce a mesh to at most about ``target`` triangles."""
    for aggressiveness in AGGRESSIVENESS:
        if target < len(faces):
            vertices, faces = fast_simplification.simplify(
                vertices, faces, target_count=target, agg=aggressiveness, **options
            )
    return vertices, np.asarray(faces, np.int32)


def _mend(vertices, faces):
    """Cut out edges to which the library gave more than two faces, with the faces around them, and fill the holes.

    It collapses edges without checking what they join; this happens a few times in a million.
    """
    for _ in range(MENDINGS):
        many = edge_uses(faces)[1]
        if len(many) == 0 or len(many) > MOST_MENDED * len(faces):
            break
        ends = np.unique([many >> 32, many & 0xFFFFFFFF])
        kept = faces[~np.isin(faces, ends).any(axis=1)]
        rims = boundary_edges(faces[np.isin(faces, ends).any(axis=1)])
        widest = 2.0 * np.linalg.norm(np.ptp(vertices[rims], axis=1), axis=1).sum()
        vertices, faces = clean(*fill_holes(vertices, kept, widest)[0])
    return vertices, faces


def _thin_out(vertices, faces, share, progress):
    """Every tile decimated to a share of its triangles; its rim stays as it is, so that the tiles fit again."""
    thin, tiles = [], _tiles(vertices, faces, np.arange(len(faces), dtype=np.int32))
    for number, tile in enumerate(tiles):
        part = compact(vertices, faces[tile])
        thin.append(_simplify(*part, max(4, round(share * len(tile))), preserve_border=True))
        progress(0.8 * (number + 1) / len(tiles))
    return merge_equal(*join(thin))


def _tiles(vertices, faces, members):
    """Lists of neighbouring faces, none longer than ``TILE``: halves of halves along the longest side."""
    if len(members) <= TILE:
        return [members]
    corner = faces[members, 0]
    axis = int(np.argmax(np.ptp(vertices[corner], axis=0)))
    place = vertices[corner, axis]
    left = place < np.median(place)
    if not left.any():
        return [members]
    return _tiles(vertices, faces, members[left]) + _tiles(vertices, faces, members[~left])
