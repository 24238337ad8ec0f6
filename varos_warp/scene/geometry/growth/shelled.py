"""Animals with shells: barnacles, mussels, tube worms, and empty valves on the ground."""

import numpy as np

from varos_warp.scene.geometry.growth.solids import Form, Solid, Strip, around, grid_faces, revolved, solid, waves

PLATES, SIDES = 6, 30
DEAD = 0.3
"""Share of the shapes of barnacles that are empty."""


def barnacle(rng: np.random.Generator) -> Form:
    """A truncated cone of six ribbed plates about a sunken mouth, or the open shell of a dead one; of unit width."""
    dead = rng.random() < DEAD
    height, mouth = rng.uniform(0.22, 0.62), rng.uniform(0.3, 0.36) if dead else rng.uniform(0.17, 0.26)
    s, t = np.array([0.0, 0.25, 0.55, 0.8, 1.0]), around(SIDES)
    radius = np.concatenate([[0.53], 0.51 + (mouth - 0.51) * s**0.8, [0.84 * mouth, 0.75 * mouth, 0.4 * mouth, 0.01]])
    inner = [0.92, 0.3, 0.1, 0.08] if dead else [0.92, 0.45, 0.55, 0.62]
    z = np.concatenate([[-0.06], height * s, height * np.array(inner)])
    phase = rng.uniform(0.0, 2.0 * np.pi)
    oval = 1.0 + rng.uniform(0.03, 0.16) * np.cos(2.0 * t + phase)
    oval = oval + sum(rng.normal(0.0, 0.035) * np.cos(k * t + rng.uniform(0.0, 6.3)) for k in (3, 4, 5))
    seam = np.exp(-((np.sin(0.5 * PLATES * t + phase) / 0.3) ** 2))
    ribs = 0.05 * np.cos(2.5 * PLATES * t + 1.0)
    outside = np.array([1, 1, 1, 1, 0.7, 0.3, 0, 0, 0, 0])[:, None]
    girth = oval * (1.0 + outside * (ribs - 0.14 * seam))
    vertices = revolved(radius, z, girth)
    vertices[:, :2] += np.outer(np.maximum(vertices[:, 2], 0.0), rng.normal(0.0, 0.22, 2))  # neighbours press it aside
    # the rim is ragged: tips of the plates between the seams, of dead ones broken
    broken = 1.0 - (0.8 if dead else 0.25) * np.clip(np.cos(t + rng.uniform(0.0, 6.3)), 0.0, 1.0)
    tips = np.outer([0, 0, 0, 0.3, 0.7, 1, 1, 0, 0, 0], 0.16 * height * (0.4 - seam) * rng.uniform(0.6, 1.4))
    tips -= np.outer([0, 0, 0, 0.1, 0.5, 1, 1, 0, 0, 0], 0.35 * height * (1.0 - broken))
    vertices[:, 2] += tips.ravel()
    shade = np.array([0.35, 0.5, 0.75, 0.9, 1.0, 1.05, 0.6, 0.09, 0.14, 0.2])[:, None] * (1.0 - 0.45 * outside * seam)
    shade = shade.ravel() * rng.uniform(0.9, 1.1, len(vertices)) * (1.25 if dead else rng.uniform(0.7, 1.05))
    colours = np.outer(shade, [0.27, 0.25, 0.205])
    film = np.clip(rng.uniform(0.0, 0.5) + 0.3 * waves(vertices, 0.5, rng), 0.0, 0.75)[:, None]
    return Form(solid(vertices, grid_faces(len(radius), SIDES), colours * (1.0 - film * [0.5, 0.52, 0.6])))


def tube_worm(rng: np.random.Generator) -> Form:
    """A chalky tube that winds over the ground and lifts its mouth (Spirobranchus); of unit length."""
    count = 22
    bend = np.cumsum(rng.normal(0.0, 0.3, count)) + np.linspace(0.0, rng.uniform(-3.5, 3.5), count)
    flat = np.cumsum(np.column_stack([np.cos(bend), np.sin(bend)]), axis=0) / count
    s = np.linspace(0.0, 1.0, count)
    path = np.column_stack([flat - flat.mean(axis=0), 0.01 + 0.05 * s**7])
    shade = 0.7 + 0.3 * rng.random(count)
    shade[-1] *= 0.25
    return Form(None, (Strip(path, 0.01 + 0.024 * s, np.outer(shade, [0.3, 0.275, 0.23]), sides=7),))


def valve(rng: np.random.Generator, width: float, depth: float, rings: float) -> Solid:
    """One valve of a bivalve, hollow side down, with growth rings; of unit length along y, its hinge at -y."""
    a, b = 20, 14
    u, w = np.linspace(-1.0, 1.0, a), np.linspace(0.03, 1.0, b)[:, None]
    r = w * (1.0 - 0.12 * u**2 + 0.01 * np.cos(9.0 * u + rng.uniform(0.0, 6.0)))
    x, y = r * np.sin(1.2 * u) * width, r * np.cos(1.2 * u) - 0.5
    z = depth * np.sin(0.92 * np.pi * w) ** 0.7 * np.cos(1.35 * u) ** 0.8 + 0.006 * np.cos(2.0 * np.pi * rings * w) * w
    shade = (0.85 + 0.15 * np.cos(2.0 * np.pi * (1.3 * rings) * w)) * np.ones(a) * rng.uniform(0.9, 1.1, (b, a))
    vertices = np.stack([x, y * np.ones_like(x), z - 0.02], -1).reshape(-1, 3)
    return solid(vertices, grid_faces(b, a, closed=False), shade.reshape(-1, 1) * np.ones(3))


def shell(rng: np.random.Generator) -> Form:
    """An empty valve on the ground, now and then upside down, or a piece of one."""
    whole = valve(rng, rng.uniform(0.5, 0.66), rng.uniform(0.18, 0.3), rng.uniform(4.0, 8.0))
    vertices, faces = whole.vertices.copy(), whole.faces
    if rng.random() < 0.3:
        vertices[:, 1:] *= -1.0
    if rng.random() < 0.35:  # broken off
        middle = vertices[faces].mean(axis=1)
        faces = faces[middle @ [np.cos(a := rng.uniform(0, 6.28)), np.sin(a), 0.0] < rng.uniform(0.0, 0.25)]
    used, faces = np.unique(faces, return_inverse=True)
    vertices[:, 2] -= vertices[used, 2].min() + rng.uniform(0.05, 0.14)
    return Form(solid(vertices[used], faces.reshape(-1, 3), whole.colours[used] * [0.27, 0.245, 0.2]))


def mussel(rng: np.random.Generator) -> Form:
    """A blue mussel (Mytilus): a wedge of two closed valves, its narrow end down among the byssus; of unit length."""
    rows, sides = 15, 24
    s, t = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, rows)), around(sides)
    wide = np.interp(s, [0, 0.04, 0.15, 0.4, 0.65, 0.85, 0.96, 1], [0.01, 0.07, 0.15, 0.235, 0.26, 0.22, 0.12, 0.01])
    thick = np.interp(s, [0, 0.04, 0.15, 0.35, 0.6, 0.9, 1], [0.01, 0.06, 0.13, 0.18, 0.16, 0.06, 0.005])
    thick = thick * rng.uniform(0.85, 1.1)
    keel = np.abs(np.sin(t)) ** 1.25 * np.sign(np.sin(t))  # valves meet in an edge
    across, through = np.outer(wide, np.cos(t)), np.outer(thick, keel)
    bow = (0.1 * np.sin(np.pi * s) * rng.uniform(0.6, 1.4))[:, None]
    x, y, z = (each.ravel() for each in (across + bow, np.repeat(s[:, None], sides, 1), through))
    rings = 1.0 + 0.16 * np.sin(np.hypot(x, 1.1 * y) * rng.uniform(55.0, 75.0)) * np.clip(2.0 * y, 0.0, 1.0)
    shade = (rings * rng.uniform(0.85, 1.15, rows * sides))[:, None] * [0.0165, 0.017, 0.02] * rng.uniform(0.7, 1.5)
    worn = np.clip(1.0 - y / rng.uniform(0.15, 0.5), 0.0, 1.0)[:, None] * rng.uniform(0.3, 1.0)  # down to the chalk
    seam = np.repeat(0.5 * np.exp(-((np.sin(t) / 0.2) ** 2))[None], rows, axis=0).reshape(-1, 1)
    colours = shade + worn * [0.085, 0.078, 0.08] + seam * [0.024, 0.018, 0.011]
    spots = np.clip(waves(np.column_stack([x, y, z]), 0.14, rng) - rng.uniform(1.3, 2.4), 0.0, 0.8)[:, None]
    colours = colours + spots * [0.17, 0.157, 0.128]  # young barnacles
    lean, turn = rng.uniform(0.7, 1.4), rng.uniform(-0.9, 0.9)
    x, z = x * np.cos(turn) - z * np.sin(turn), x * np.sin(turn) + z * np.cos(turn)
    stood = np.column_stack([x, y * np.cos(lean) - z * np.sin(lean), y * np.sin(lean) + z * np.cos(lean)])
    stood[:, 1] -= 0.4 * np.cos(lean)
    stood[:, 2] -= stood[:, 2].min() + rng.uniform(0.1, 0.42)  # some are on top of the bed, some deep in it
    patchy = np.clip(0.5 + 0.7 * waves(stood, 0.25, rng), 0.0, 1.0)
    # silt and byssus fill what is between them; what stands out is clean, but for some on what looks up
    up = np.clip(np.sin(t + turn) * np.cos(lean), 0.0, 1.0)
    between = 0.85 * np.clip(1.0 - stood[:, 2] / rng.uniform(0.25, 0.45), 0.0, 1.0)
    dust = np.maximum(between, 0.45 * rng.uniform(0.0, 1.0) * patchy * np.tile(up, rows))[:, None]
    return Form(solid(stood, grid_faces(rows, sides)[:, ::-1], colours + dust * ([0.05, 0.044, 0.033] - colours)))
