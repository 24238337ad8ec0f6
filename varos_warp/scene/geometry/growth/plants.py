"""Plants: kelp and seagrass, ribbons that stand in the water."""

import numpy as np

from varos_warp.scene.geometry.growth.solids import Form, Strip
from varos_warp.scene.geometry.normals import UP


def kelp(rng: np.random.Generator) -> Form:
    """A stipe with a blade cut into straps that hang over (Laminaria); of unit height."""
    s = np.linspace(0.0, 1.0, 10)
    lean = rng.normal(0.0, 0.18, 2)
    stipe = np.column_stack([np.outer(s**2, 0.4 * lean), 0.55 * s - 0.02])
    strips = [Strip(stipe, np.linspace(0.014, 0.008, 10), np.tile([0.05, 0.037, 0.018], (10, 1)), sides=6)]
    top = stipe[-1]
    for angle in np.linspace(-1.1, 1.1, rng.integers(5, 9)) + rng.uniform(0.0, 6.3):
        length, droop = rng.uniform(0.45, 0.8), rng.uniform(0.75, 1.45)
        u = np.linspace(0.0, 1.0, 14)
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        path = top + np.outer(0.55 * length * u, out) + np.outer(length * (0.95 * u - droop * u**2), UP)
        path[:, 2] += 0.014 * np.sin(13.0 * u + rng.uniform(0.0, 6.3)) * u
        across = np.cross(out, UP) + 0.4 * rng.standard_normal() * UP
        across /= np.linalg.norm(across)
        turn = (0.7 * u * np.sin(9.0 * u + rng.uniform(0.0, 6.3)))[:, None]  # straps are wavy
        width = 0.032 * np.sin(np.pi * (0.1 + 0.895 * u)) ** 0.6
        shade = rng.uniform(0.8, 1.2) * (0.75 + 0.4 * u)
        strips.append(
            Strip(
                path,
                width,
                np.outer(shade, [0.06, 0.047, 0.022]),
                np.cos(turn) * across + np.sin(turn) * np.cross(out, across),
            )
        )
    return Form(None, tuple(strips))


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
