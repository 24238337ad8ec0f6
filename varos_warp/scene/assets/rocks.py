"""Boulders from a seed."""

import numpy as np
import trimesh

from varos_warp.scene.description import Boulder


def boulder(block: Boulder, key: str = "boulder", chord_error: float = 1e-3):
    """A ball with planes cut off and seeded noise: as angular as a broken rock, smooth as a weathered one.

    ``chord_error`` is that of the ball's triangles, before it is broken.
    """
    rng = np.random.default_rng(block.seed)
    # an icosphere's edges span 1.11 / 2^n rad, so that its faces come within 0.205 / 4^n radii of the ball
    subdivisions = int(np.clip(np.ceil(np.log(0.205 * 0.5 * block.diameter / chord_error) / np.log(4.0)), 2, 7))
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
