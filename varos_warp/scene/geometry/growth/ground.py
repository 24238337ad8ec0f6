"""What lies on the ground or is part of it: pebbles, and crusts of coralline algae."""

import numpy as np
import trimesh

from varos_warp.scene.geometry.growth.solids import Form, around, grid_faces, solid, waves


def pebble(rng: np.random.Generator) -> Form:
    """A flat worn stone with blunt edges, about half of it in the ground, silt on it and at its foot; of unit width.

    Silt lies in thin patches: a cap of the ground's own tone would leave only a dark ring of its flanks. Stones are of
    several rocks, darker and paler than sand.
    """
    ball = trimesh.creation.icosphere(subdivisions=2)
    p = np.asarray(ball.vertices)
    n = rng.standard_normal((9, 3))
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    # soft-edged: the high norm of the distances to planes
    reach = (np.maximum(p @ n.T / rng.uniform(0.62, 1.0, 9), 0.1) ** 10).sum(axis=1) ** -0.1
    p = p * np.minimum(reach, 1.15)[:, None] * (1.0 + 0.03 * waves(p, 0.9, rng))[:, None]
    p = p * [1.0, rng.uniform(0.6, 1.0), rng.uniform(0.3, 0.55)]
    p /= np.ptp(p[:, :2], axis=0).max()
    p[:, 2] += np.ptp(p[:, 2]) * rng.uniform(-0.08, 0.2)
    shade = 1.0 + 0.12 * waves(p, 0.5, rng) + 0.1 * rng.standard_normal(len(p))
    colours = np.outer(np.clip(shade, 0.5, 1.5), rng.uniform(0.6, 2.0) * np.array([0.105, 0.098, 0.085]))
    up, ragged = np.asarray(ball.vertices)[:, 2], waves(p, 0.35, rng)
    dust = rng.uniform(0.0, 0.3) * np.clip(0.4 + 0.6 * up + 0.9 * ragged, 0.0, 1.0)
    foot = 0.8 * np.clip(1.0 - p[:, 2] / 0.11 + 0.35 * ragged, 0.0, 1.0)
    silted = np.maximum(dust, foot)[:, None]
    return Form(solid(p, np.asarray(ball.faces), colours + silted * ([0.125, 0.115, 0.095] - colours)))


def coralline(rng: np.random.Generator) -> Form:
    """A thin crust with a lobed rim and holes in its tone; of unit width."""
    rings, sides = 9, 44
    t, s = around(sides), np.linspace(0.02, 1.0, rings)[:, None]
    rim = 1.0 + sum(rng.normal(0.0, 0.16 / k**0.7) * np.cos(k * t + rng.uniform(0.0, 6.3)) for k in range(2, 9))
    rim = np.clip(rim, 0.35, 1.4)
    x, y = 0.42 * s * rim * np.cos(t), 0.42 * s * rim * np.sin(t)
    z = 0.022 * (1.0 - s**6) - 0.012 + 0.0 * x
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    mottle = waves(vertices, 0.22, rng)
    vertices[:, 2] += 0.003 * mottle * np.repeat(1.0 - s.ravel() ** 4, sides)
    tone = 0.8 + 0.16 * mottle + 0.35 * np.repeat(s.ravel() ** 5, sides)  # the growing edge is pale
    colours = np.outer(np.clip(tone, 0.3, 1.5), [0.135, 0.092, 0.088])
    return Form(solid(vertices, grid_faces(rings, sides)[:, ::-1], colours))
