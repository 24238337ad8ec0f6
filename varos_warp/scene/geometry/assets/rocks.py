"""Boulders from a seed."""

import numpy as np
import trimesh

from varos_warp.scene.description.world import Boulder
from varos_warp.scene.geometry.assets.lofts import Detail
from varos_warp.scene.geometry.noise import fbm_vector

DEFAULT = Detail(1e-3)
WIDEST = 0.42
"""Edges of a ball that is not subdivided, over its diameter, less what hewing takes of them on average."""

LEVELS = {2: 0.06, 3: 0.024, 4: 0.0115, 5: 0.0047, 6: 0.0019, 7: 0.0009}
"""Distance of a boulder of this many subdivisions from the finest one, as a share of its radius: the largest distance
measured on 24 of them, and a seventh more."""
JOINT_LEVELS = {2: 0.123, 3: 0.048, 4: 0.0183, 5: 0.0044, 6: 0.0012, 7: 0.0006}
"""Distances as in `LEVELS`, for a boulder between joints."""
CHIPS = 9
"""Corners that are broken off a boulder between joints."""
FARTHEST = 1.15
"""No corner is farther from the middle, in radii, before the block is stretched."""
ROUNDING = 16
"""Exponent of the norm that joins its faces: its edges are round over a 16th of its radius or so."""


def boulder(block: Boulder, key: str = "boulder", detail: Detail = DEFAULT):
    """A boulder as fine as its chord error asks for, compared with the finest there is, and as its grid asks for."""
    jointed = block.form == "joints"
    wanted = detail.chord_error / (0.5 * block.diameter)
    levels = JOINT_LEVELS if jointed else LEVELS
    subdivisions = next((n for n, share in levels.items() if share <= wanted), max(levels))
    if detail.is_grid:
        subdivisions = max(subdivisions, int(np.ceil(np.log2(WIDEST * block.diameter / detail.edge))))
        detail.allow(20.0 * 4.0**subdivisions)
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    p, rng = np.asarray(ball.vertices), np.random.default_rng(block.seed)
    p = _between_joints(p, rng, block.seed) if jointed else _rounded(p, rng)
    return 0.5 * block.diameter * p, np.asarray(ball.faces, np.int32)


def _rounded(p: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A ball with planes cut off and seeded noise: as angular as a broken rock, smooth as a weathered one."""
    normals = rng.standard_normal((18, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for n, offset in zip(normals, rng.uniform(0.6, 0.95, len(normals)), strict=True):
        p = p - 0.94 * np.maximum(p @ n - offset, 0.0)[:, None] * n
    noise = np.zeros(len(p))
    for octave in range(2, 6):
        waves = rng.standard_normal((6, 3)) * 2.0**octave
        noise += np.cos(p @ waves.T + rng.uniform(0.0, 2.0 * np.pi, 6)).sum(axis=1) * 0.02 * 0.55**octave
    return p * (1.0 + noise)[:, None] * rng.uniform([0.8, 0.8, 0.55], [1.0, 1.0, 0.8])


def _between_joints(d: np.ndarray, rng: np.random.Generator, seed: int) -> np.ndarray:
    """A block between three sets of joints: r(d) = (sum over its faces of max(0, d.n / o)^16)^(-1/16).

    The faces are two of each set, which is nearly at right angles to the others, and chips; directions are bent by
    noise, so that no face is a plane.
    """
    sets = np.linalg.qr(rng.standard_normal((3, 3)))[0].T
    normals = np.vstack([sets, -sets, rng.standard_normal((CHIPS, 3))]) + 0.18 * rng.standard_normal((6 + CHIPS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = np.concatenate([rng.uniform(0.62, 0.95, 6), rng.uniform(0.82, 1.05, CHIPS)])
    bent = d + 0.10 * fbm_vector(d, 1.7, 3, seed)
    faces = (np.maximum(bent @ normals.T / offsets, 0.0) ** ROUNDING).sum(axis=1)
    inverse = (faces + FARTHEST**-ROUNDING) ** (1.0 / ROUNDING)  # as if a ball had been cut
    return d / inverse[:, None] * rng.uniform([0.85, 0.85, 0.6], [1.05, 1.05, 0.85])
