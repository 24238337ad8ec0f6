"""Plants: kelp and seagrass, ribbons that stand in the water."""

import numpy as np

from varos_warp.scene.geometry.growth.solids import Form, Strip
from varos_warp.scene.geometry.normals import UP

STIPE, BLADE = (0.05, 0.037, 0.018), np.array([0.05, 0.034, 0.013])
OVERGROWN = np.array([0.05, 0.05, 0.042])
"""What bryozoans and silt add to the old ends of a blade."""


def kelp(rng: np.random.Generator) -> Form:
    """A stiff stipe and a blade that is torn into limp straps (Laminaria); of about unit height."""
    s = np.linspace(0.0, 1.0, 10)
    lean = rng.normal(0.0, 0.15, 2)
    stipe = np.column_stack([np.outer(s**2, lean), 0.75 * s - 0.02])
    strips = [Strip(stipe, np.linspace(0.016, 0.008, 10), np.tile(STIPE, (10, 1)), sides=6)]
    downstream, side = _frame(rng.uniform(0.0, 2.0 * np.pi))
    count = rng.integers(8, 13)
    for spread in np.linspace(-1.0, 1.0, count) + rng.normal(0.0, 0.1, count):
        strips.append(_strap(rng, stipe[-1], downstream, side, spread))
    return Form(None, tuple(strips))


def _frame(heading):
    out = np.array([np.cos(heading), np.sin(heading), 0.0])
    return out, np.cross(UP, out)


def _strap(rng, root, downstream, side, spread):
    """One strap of a blade: from a flat fan it rises a little, then hangs, each a little otherwise, and ruffled."""
    u = np.linspace(0.0, 1.0, 16)
    length = rng.uniform(0.5, 0.85) * (1.0 - 0.25 * spread**2)
    rise, hang, limp = rng.uniform(0.2, 0.8), rng.uniform(0.9, 1.5), rng.uniform(0.12, 0.3)
    pitch = rise - (rise + hang) * (1.0 - np.exp(-((u / limp) ** 1.5)))
    drift = np.cumsum(rng.normal(0.0, 0.1, len(u)))
    way = np.cos(spread + drift)[:, None] * downstream + np.sin(spread + drift)[:, None] * side
    along = np.cos(pitch)[:, None] * way + np.sin(pitch)[:, None] * UP
    path = root + np.vstack([np.zeros(3), np.cumsum(along[1:], axis=0) * length / (len(u) - 1)])
    flat = np.cross(along, np.sin(pitch)[:, None] * -way + np.cos(pitch)[:, None] * UP)
    one, two, three = rng.uniform(0.0, 2.0 * np.pi, 3)
    turn = (u * (0.7 * np.sin(6.0 * u + one) + 0.3 * np.sin(14.0 * u + two)))[:, None]
    width = 0.036 * np.minimum(1.0, 0.4 + 2.5 * u) * (1.0 - u**4) ** 0.5 * (1.0 + 0.12 * np.sin(11.0 * u + three))
    patchy = rng.standard_normal(len(u))
    overgrown = np.clip(1.6 * u - rng.uniform(0.9, 2.4) + 0.1 * patchy, 0.0, 1.0)[:, None]
    colours = rng.uniform(0.7, 1.25) * (0.75 + 0.35 * u + 0.05 * patchy)[:, None] * BLADE + overgrown * OVERGROWN
    ruffled = np.cos(turn) * flat + np.sin(turn) * np.cross(along, flat)
    return Strip(path, np.maximum(width, 1e-4), colours, ruffled)


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
