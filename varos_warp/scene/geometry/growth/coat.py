"""What covers a host at the feet of what grows on it, so that this fades into it: crust, holdfasts and their catch."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from varos_warp.scene.geometry.growth.chance import field_of, key_of, uniform
from varos_warp.scene.geometry.growth.kinds import Kind
from varos_warp.scene.geometry.growth.placing import Rooted
from varos_warp.scene.geometry.parts import Instances, Part

NEIGHBOURS = 4
"""Copies about a place that coat it."""
LEAST_M, MOST_M = 0.008, 0.05
"""How far the coat of a copy reaches at least and at most [m]."""
RAGGED, RAGGED_M = 1.5, 0.022
"""How ragged the borders of coats are, and how far their lobes are apart [m]."""
TONES = (0.75, 1.25)
"""Tones of the darkest and the lightest coats of clumps."""


@dataclass(frozen=True)
class Placed:
    """The copies of a block."""

    names: list[str]
    """Names of the hosts that the copies stand on."""
    silt: np.ndarray
    """float64 [H]: how much silt lies on each of them."""
    copies: Rooted


def coated(parts: list[Part | Instances], blocks: Iterable[tuple[Kind, Placed]]) -> list[Part | Instances]:
    """Parts in the colours that they have where copies stand on them.

    Only what has a colour at every corner is coated: surfaces with relief, and meshes with colours.

    Args:
        parts: Hosts and others.
        blocks: Kinds and copies, in the order of the scene file: later coats lie over earlier ones.
    """
    coats: dict[str, list] = {}
    for kind, placed in blocks:
        if kind.coat is not None:
            for number, name in enumerate(placed.names):
                coats.setdefault(name, []).append((kind, placed.copies.of(placed.copies.host == number)))
    return [_coated(part, coats[part.name]) if part.name in coats and _takes_coat(part) else part for part in parts]


def _takes_coat(part):
    return isinstance(part, Part) and part.skin is not None and not part.skin.pages and part.skin.spectra is None


def _coated(part, coats):
    """A part under its coats."""
    corners, own = part.skin.corners, part.faces.ravel()
    colours = np.zeros((len(part.vertices), 3), np.float32)
    colours[own] = corners.reshape(-1, 3)
    touched = np.zeros(len(part.vertices), bool)
    for kind, copies in coats:
        if len(copies.size):
            at, share, tone = _over(part.vertices, copies, kind)
            colours[at] += share[:, None] * (tone[:, None] * kind.coat.colour - colours[at])
            touched[at] = True
    some = touched[part.faces]
    corners = np.where(some[..., None], colours[part.faces], corners)
    return replace(part, skin=replace(part.skin, corners=corners))


def _over(vertices, copies, kind):
    """Which vertices a coat covers [M], how much of each [M], and how light it is there [M]."""
    reach = np.clip(kind.coat.reach * copies.size, LEAST_M, MOST_M)
    far = 2.0 * float(reach.max())
    low, high = copies.points.min(axis=0) - far, copies.points.max(axis=0) + far
    near = np.flatnonzero(((vertices >= low) & (vertices <= high)).all(axis=1))
    gap, which = cKDTree(copies.points).query(vertices[near], NEIGHBOURS, distance_upper_bound=far, workers=-1)
    some = np.flatnonzero(np.isfinite(gap[:, 0]))
    near, gap, which = near[some], gap[some], np.minimum(which[some], len(reach) - 1)
    cover = 1.0 - np.prod(1.0 - np.exp(-((gap / reach[which]) ** 2)), axis=1)
    ragged = field_of(key_of("coat"), RAGGED_M)(vertices[near] - low)
    cover = np.clip(cover + RAGGED * ragged * cover * (1.0 - cover), 0.0, 1.0)
    dark, light = TONES
    return near, kind.coat.share * cover, dark + (light - dark) * uniform(copies.clump[which[:, 0]], 11)
