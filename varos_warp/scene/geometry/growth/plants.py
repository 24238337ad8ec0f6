"""Plants: kelp and seagrass, ribbons that stand in the water."""

import numpy as np

from varos_warp.scene.geometry.growth.solids import Form, Strip, around
from varos_warp.scene.geometry.normals import UP

STIPE, BLADE = (0.05, 0.037, 0.018), np.array([0.05, 0.034, 0.013])
OVERGROWN = np.array([0.05, 0.05, 0.042])
"""What bryozoans and silt add to the old ends of a blade."""


def kelp(rng: np.random.Generator) -> Form:
    """A stiff stipe on a holdfast, and a blade that is torn into limp straps (Laminaria); of about unit height."""
    s = np.linspace(0.0, 1.0, 10)
    lean = rng.normal((0.0, 0.1), 0.12)
    stipe = np.column_stack([np.outer(s**2, lean), 0.95 * s - 0.02])
    strips = [Strip(stipe, np.linspace(0.021, 0.01, 10), np.tile(STIPE, (10, 1)), sides=6)]
    strips += [_root(rng, angle) for angle in around(7) + rng.normal(0.0, 0.25, 7)]
    count = rng.integers(8, 13)
    for spread in np.linspace(-1.0, 1.0, count) + rng.normal(0.0, 0.15, count):
        strips += _strap(rng, stipe[-1], spread)
    return Form(None, tuple(strips))


def _root(rng, angle):
    """One of the roots by which a holdfast grips."""
    u, out = np.linspace(0.0, 1.0, 5), np.array([np.cos(angle), np.sin(angle), 0.0])
    path = np.outer(rng.uniform(0.04, 0.07) * u, out) + np.outer(0.045 * (1.0 - u) ** 2 - 0.012 * u, UP)
    return Strip(path, np.linspace(0.009, 0.005, 5), np.tile(STIPE, (5, 1)), sides=4)


def _strap(rng, root, spread):
    """Both halves of a strap, that from a flat fan rises a little, then hangs with the current, along y."""
    u = np.linspace(0.0, 1.0, 26)
    length = rng.uniform(0.55, 1.05) * (1.0 - 0.2 * spread**2)
    rise, hang, limp, bob = rng.uniform((0.1, 0.55, 0.12, 0.0), (0.8, 1.45, 0.4, 6.3))
    pitch = rise - (rise + hang) * (1.0 - np.exp(-((u / limp) ** 1.5))) + 0.15 * u * np.sin(9.0 * u + bob)
    heading = 0.9 * spread + np.cumsum(rng.normal(0.0, 0.09, len(u)))
    way = np.column_stack([np.sin(heading), np.cos(heading), np.zeros(len(u))])
    along = np.cos(pitch)[:, None] * way + np.sin(pitch)[:, None] * UP
    path = root + np.vstack([np.zeros(3), np.cumsum(along[1:], axis=0) * length / (len(u) - 1)])
    flat = np.cross(along, np.cos(pitch)[:, None] * UP - np.sin(pitch)[:, None] * way)
    roll = 0.9 * u * np.sin(4.0 * u + rng.uniform(0.0, 6.3))
    look = rng.uniform((0.7, 0.9), (1.25, 2.4))
    return [_half(rng, path, flat, np.cross(along, flat), roll, side, look) for side in (-1.0, 1.0)]


def _half(rng, path, flat, up, roll, side, look):
    """Half of a strap on one side of its middle, its rim ruffled and its old end overgrown."""
    u, (tone, fade) = np.linspace(0.0, 1.0, len(path)), look
    often, shift = rng.uniform((17.0, 0.0), (27.0, 6.3))
    turn = (roll + side * (0.35 + 0.6 * u**0.5 * np.sin(often * u + shift)))[:, None]
    across = np.cos(turn) * flat + np.sin(turn) * up
    width = 0.022 * np.minimum(1.0, 0.4 + 2.5 * u) * (1.0 - u**6) ** 0.5
    width = np.maximum(width * (1.0 + 0.15 * u * rng.standard_normal(len(u))), 1e-4)
    patchy = rng.standard_normal(len(u))
    overgrown = np.clip(1.6 * u - fade + 0.25 * patchy, 0.0, 1.0)[:, None]
    colours = tone * (0.75 + 0.35 * u + 0.13 * patchy)[:, None] * BLADE + overgrown * OVERGROWN
    return Strip(path + side * width[:, None] * across, width, colours, across)


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
