"""Coarser versions of prototypes, for copies that are few pixels large in the nearest view."""

from dataclasses import replace

import fast_simplification
import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.geometry.growth.solids import Form, Solid, Strip, together
from varos_warp.scene.geometry.topology import area_normals

LEVELS = ((15.0, 100), (5.0, 32))
"""Copies of fewer pixels than the first number have about as many triangles as the second, if their kind has more."""
WORTH = 1.5
"""There is a coarser level where the one before has this many times its triangles, or more."""
FEW_STRIPS = 3
"""Tubes stay round where there are no more of them; of a tuft they become ribbons."""


def level_of(pixels: np.ndarray) -> np.ndarray:
    """The level [N] of copies that are so many pixels large [N]: 0 is the whole prototype."""
    return sum((pixels < limit).astype(int) for limit, _ in LEVELS)


def levels(form: Form) -> tuple[Solid, ...]:
    """The whole of a form, and one coarser mesh for each of `LEVELS`."""
    made = [form.whole()]
    if form.coarser:
        return (*made, *form.coarser)
    for _, triangles in LEVELS:
        made.append(coarser(form, triangles) if len(made[-1].faces) >= WORTH * triangles else made[-1])
    return tuple(made)


def coarser(form: Form, triangles: int) -> Solid:
    """About as many triangles with the outline and the mean colours of a form.

    Bodies lose edges by quadrics (Garland and Heckbert 1997). Of strips the longest stay and become as wide as all of
    them were together (Cook et al. 2007, stochastic simplification of aggregate detail).
    """
    if form.body is None:
        return together([strip.solid() for strip in thinned(form.strips, triangles)])
    if not form.strips:
        return decimated(form.body, triangles)
    half = triangles // 2
    return together([decimated(form.body, half), *(strip.solid() for strip in thinned(form.strips, half))])


def decimated(body: Solid, triangles: int) -> Solid:
    """A mesh with about so many triangles, each vertex of the mean colour of those that it stands for."""
    vertices, faces = fast_simplification.simplify(body.vertices, body.faces, target_count=triangles)
    vertices[:, 2] += body.vertices[:, 2].min() - vertices[:, 2].min()  # as deep in its host
    _, stands_for = cKDTree(vertices).query(body.vertices)
    area = np.linalg.norm(area_normals(body.vertices, body.faces), axis=1)
    weight = np.bincount(body.faces.ravel(), np.repeat(area, 3), len(body.vertices))
    total = np.bincount(stands_for, weight, len(vertices))
    colours = np.column_stack([np.bincount(stands_for, weight * channel, len(vertices)) for channel in body.colours.T])
    bare = total <= 0.0
    colours[bare] = body.colours[cKDTree(body.vertices).query(vertices[bare])[1]]
    return Solid(vertices, faces.astype(np.int32), colours / np.where(bare, 1.0, total)[:, None])


def thinned(strips: tuple[Strip, ...], triangles: int) -> list[Strip]:
    """The longest of some strips, of fewer rows, with the surface and the mean colour of all of them."""
    round_ = len(strips) <= FEW_STRIPS
    each = triangles / len(strips) / (6 if round_ else 2)
    rows = max(int(each) + 1, 3 if triangles >= 60 else 2)
    length = [np.linalg.norm(np.diff(strip.path, axis=0), axis=1).sum() for strip in strips]
    most = max(int(triangles / (2 * (rows - 1) * (3 if round_ else 1))), 1)
    longest = np.sort(np.argsort(length, kind="stable")[::-1][:most])
    kept = [_shorter(strips[k], rows, round_) for k in longest]
    wider = sum(strip.surface for strip in strips) / sum(strip.surface for strip in kept)
    kept = [replace(strip, radius=wider * strip.radius) for strip in kept]
    tint = _mean_colour(strips) / _mean_colour(kept)
    return [replace(strip, colours=np.clip(tint * strip.colours, 0.0, 0.9)) for strip in kept]


def _mean_colour(strips):
    """The mean of a surface's colours, [3]."""
    whole = together([strip.solid() for strip in strips])
    area = np.linalg.norm(area_normals(whole.vertices, whole.faces), axis=1)
    return np.average(whole.corners.mean(axis=1), axis=0, weights=area)


def _shorter(strip, rows, round_):
    """A strip of fewer rows; a tube with three sides, or as a ribbon."""
    chosen = np.linspace(0, len(strip.path) - 1, min(rows, len(strip.path))).round().astype(int)
    across = None if strip.across is None else strip.across[chosen]
    if across is None and not round_:
        one = np.cross(strip.path[-1] - strip.path[0], [0.31, 0.52, 0.79])
        across = np.tile(one / np.linalg.norm(one), (len(chosen), 1))
    return Strip(strip.path[chosen], strip.radius[chosen], strip.colours[chosen], across, min(strip.sides, 3))
