"""Seagrass, ribbons that stand in the water."""

import numpy as np

from varos_warp.scene.geometry.growth.solids import Form, Strip
from varos_warp.scene.geometry.normals import UP


def seagrass(rng: np.random.Generator) -> Form:
    """A shoot of long narrow leaves that bend one way (Zostera); of unit height."""
    strips, sway = [], rng.uniform(0.0, 6.3)
    for _ in range(rng.integers(4, 8)):
        length, bend, angle = rng.uniform(0.5, 1.0), rng.uniform(0.2, 1.0), sway + rng.normal(0.0, 0.7)
        u, out = np.linspace(0.0, 1.0, 9), np.array([np.cos(angle), np.sin(angle), 0.0])
        root = np.append(rng.normal(0.0, 0.02, 2), -0.02)
        path = root + np.outer(bend * length * u**2, out) + np.outer(length * (u - 0.3 * bend * u**2), UP)
        across = np.cross(out, UP) + 0.3 * rng.standard_normal(3)
        path += 0.025 * np.outer(u * np.sin(7.0 * u + rng.uniform(0.0, 6.3)), across / np.linalg.norm(across))
        width = 0.01 * (1.0 - 0.85 * u**6)
        old = np.clip(u - rng.uniform(0.2, 1.2), 0.0, 1.0)[:, None]  # tips are overgrown, and brown
        colours = rng.uniform(0.75, 1.2) * (0.6 + 0.5 * u)[:, None] * ([0.052, 0.07, 0.027] + old * [0.05, 0.01, 0.01])
        strips.append(Strip(path, width, colours, np.tile(across / np.linalg.norm(across), (9, 1))))
    return Form(None, tuple(strips))
