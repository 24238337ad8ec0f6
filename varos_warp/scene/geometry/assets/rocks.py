"""Boulders from a seed."""

import numpy as np
import trimesh

from varos_warp.scene.description.world import Boulder

LEVELS = {2: 0.06, 3: 0.024, 4: 0.0115, 5: 0.0047, 6: 0.0019, 7: 0.0009}
"""Distance of a boulder of this many subdivisions from the finest one, as a share of its radius: the largest distance
measured on 24 of them, and a seventh more."""


def boulder(block: Boulder, key: str = "boulder", chord_error: float = 1e-3):
    """A ball with planes cut off and seeded noise: as angular as a broken rock, smooth as a weathered one.

    It is as fine as ``chord_error`` asks for, compared with the finest there is.
    """
    rng = np.random.default_rng(block.seed)
    wanted = chord_error / (0.5 * block.diameter)
    subdivisions = next((n for n, share in LEVELS.items() if share <= wanted), max(LEVELS))
    ball = trimesh.creation.icosphere(subdivisions=subdivisions)
    p = np.asarray(ball.vertices)
    normals = rng.standard_normal((18, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for n, offset in zip(normals, rng.uniform(0.6, 0.95, len(normals)), strict=True):
        p = p - 0.94 * np.maximum(p @ n - offset, 0.0)[:, None] * n
    noise = np.zeros(len(p))
    for octave in range(2, 6):
        waves = rng.standard_normal((6, 3)) * 2.0**octave
        noise += np.cos(p @ waves.T + rng.uniform(0.0, 2.0 * np.pi, 6)).sum(axis=1) * 0.02 * 0.55**octave
    p = p * (1.0 + noise)[:, None] * rng.uniform([0.8, 0.8, 0.55], [1.0, 1.0, 0.8])
    return 0.5 * block.diameter * p, np.asarray(ball.faces, np.int32)
