"""Boulders from a seed."""

import numpy as np
import trimesh

from varos_warp.scene.description.world import Boulder
from varos_warp.scene.geometry.assets.lofts import Detail

DEFAULT = Detail(1e-3)
WIDEST = 0.42
"""Edges of a ball that is not subdivided, over its diameter, less what hewing takes of them on average."""

LEVELS = {2: 0.06, 3: 0.024, 4: 0.0115, 5: 0.0047, 6: 0.0019, 7: 0.0009}
"""Distance of a boulder of this many subdivisions from the finest one, as a share of its radius: the largest distance
measured on 24 of them, and a seventh more."""


def boulder(block: Boulder, key: str = "boulder", detail: Detail = DEFAULT):
    """A ball with planes cut off and seeded noise: as angular as a broken rock, smooth as a weathered one.

    It is as fine as the chord error asks for, compared with the finest there is, and as its grid asks for.
    """
    wanted = detail.chord_error / (0.5 * block.diameter)
    subdivisions = next((n for n, share in LEVELS.items() if share <= wanted), max(LEVELS))
    if detail.is_grid:
        subdivisions = max(subdivisions, int(np.ceil(np.log2(WIDEST * block.diameter / detail.edge))))
        detail.allow(20.0 * 4.0**subdivisions)
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    return 0.5 * block.diameter * _hewn(np.asarray(ball.vertices), block.seed), np.asarray(ball.faces, np.int32)


def _hewn(p, seed):
    """Points [V, 3] of the unit ball where they lie on a boulder of this seed, 2 wide."""
    rng = np.random.default_rng(seed)
    normals = rng.standard_normal((18, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for n, offset in zip(normals, rng.uniform(0.6, 0.95, len(normals)), strict=True):
        p = p - 0.94 * np.maximum(p @ n - offset, 0.0)[:, None] * n
    noise = np.zeros(len(p))
    for octave in range(2, 6):
        waves = rng.standard_normal((6, 3)) * 2.0**octave
        noise += np.cos(p @ waves.T + rng.uniform(0.0, 2.0 * np.pi, 6)).sum(axis=1) * 0.02 * 0.55**octave
    return p * (1.0 + noise)[:, None] * rng.uniform([0.8, 0.8, 0.55], [1.0, 1.0, 0.8])
