"""Plants: kelp and seagrass, ribbons that stand in the water."""

import numpy as np

from varos_warp.scene.geometry.growth.solids import UP, Form, Strip


def kelp(rng: np.random.Generator) -> Form:
    """A stipe with a blade cut into straps that hang over (Laminaria); of unit height."""
    s = np.linspace(0.0, 1.0, 10)
    lean = rng.normal(0.0, 0.18, 2)
    stipe = np.column_stack([np.outer(s**2, 0.4 * lean), 0.55 * s - 0.02])
    strips = [Strip(stipe, np.linspace(0.014, 0.008, 10), np.tile([0.07, 0.05, 0.022], (10, 1)), sides=6)]
    top = stipe[-1]
    for angle in np.linspace(-1.1, 1.1, rng.integers(5, 9)) + rng.uniform(0.0, 6.3):
        length, droop = rng.uniform(0.4, 0.75), rng.uniform(0.35, 0.9)
        u = np.linspace(0.0, 1.0, 14)
        out = np.array([np.cos(angle), np.sin(angle), 0.0])
        path = top + np.outer(0.55 * length * u, out) + np.outer(length * (0.95 * u - droop * u**2), UP)
        path[:, 2] += 0.012 * np.sin(16.0 * u + rng.uniform(0.0, 6.3)) * u
        across = np.cross(out, UP) + 0.4 * rng.standard_normal() * UP
        width = 0.035 * np.sin(np.pi * np.clip(0.12 + 0.85 * u, 0.0, 1.0)) ** 0.6
        shade = rng.uniform(0.8, 1.2) * (0.75 + 0.4 * u)
        strips.append(Strip(path, width, np.outer(shade, [0.105, 0.072, 0.024]), across / np.linalg.norm(across)))
    return Form(None, tuple(strips))


def seagrass(rng: np.random.Generator) -> Form:
    """A shoot of long narrow leaves that bend one way (Zostera); of unit height."""
    strips, sway = [], rng.uniform(0.0, 6.3)
    for _ in range(rng.integers(4, 8)):
        length, bend, angle = rng.uniform(0.5, 1.0), rng.uniform(0.1, 0.7), sway + rng.normal(0.0, 0.7)
        u, out = np.linspace(0.0, 1.0, 9), np.array([np.cos(angle), np.sin(angle), 0.0])
        root = np.append(rng.normal(0.0, 0.02, 2), -0.02)
        path = root + np.outer(bend * length * u**2, out) + np.outer(length * (u - 0.3 * bend * u**2), UP)
        across = np.cross(out, UP) + 0.3 * rng.standard_normal(3)
        width = 0.012 * (1.0 - 0.6 * u**3)
        shade = rng.uniform(0.75, 1.2) * (0.6 + 0.5 * u)
        strips.append(Strip(path, width, np.outer(shade, [0.06, 0.085, 0.03]), across / np.linalg.norm(across)))
    return Form(None, tuple(strips))
