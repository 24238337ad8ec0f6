"""Surfaces, lights and waters from which the scenes are built."""

import numpy as np
import trimesh

from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

PAPER = {
    "coefficients": {"sigma_s": [0.00175, 0.01825, 0.043125], "sigma_a": [0.12325, 0.039739, 0.0], "phase": {"g": 0.8}}
}
"""Table 1 of the VAROS paper."""
SAND = Diffuse(reflectance=(0.45, 0.40, 0.32))
GREY = Diffuse(reflectance=(0.5, 0.5, 0.5))
RED = Diffuse(reflectance=(0.6, 0.15, 0.08))
BLUE = Diffuse(reflectance=(0.1, 0.2, 0.5))
DARK = Diffuse(reflectance=(0.08, 0.08, 0.08))


def water(sigma_t: float, g: float, albedo=(0.62, 0.81, 0.75)) -> dict:
    """Water of one extinction [1/m] in all channels; by default of the albedo of coastal water."""
    albedo = np.broadcast_to(np.asarray(albedo, float), 3)
    return {
        "coefficients": {
            "sigma_s": (sigma_t * albedo).tolist(),
            "sigma_a": (sigma_t * (1.0 - albedo)).tolist(),
            "phase": {"g": g},
        }
    }


# -------------------------------------------------------------------------------------------------------------- lights


def spot(position, direction=(0, 1, 0), cone_deg=65.0, blend=0.15, intensity=(100.0, 100.0, 100.0)) -> dict:
    """A spot light, in axes of the vehicle."""
    return {
        "kind": "spot",
        "position": tuple(position),
        "direction": tuple(direction),
        "cone_deg": cone_deg,
        "blend": blend,
        "intensity": tuple(intensity),
    }


def paper_lamps() -> list[dict]:
    """The paper's two."""
    return [spot((x, -0.1, 0.0)) for x in (-0.15, 0.15)]


def soft_lamps(colours=None) -> list[dict]:
    """Four with soft edges, tilted down and inwards."""
    places = [(-0.4, 0.0, 0.25), (0.4, 0.0, 0.25), (-0.3, 0.05, -0.15), (0.3, 0.05, -0.15)]
    colours = colours or [(60.0, 60.0, 60.0)] * 4
    return [
        spot(place, (-0.4 * place[0], 1.0, -0.25 * (place[2] > 0)), 70.0, 0.5, colour)
        for place, colour in zip(places, colours, strict=True)
    ]


# ----------------------------------------------------------------------------------------------------------- surfaces


def part(name: str, mesh: trimesh.Trimesh, material=GREY) -> Part:
    """A mesh as a piece of the world."""
    return Part(name, np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), material)


def sheet(name: str, corner, u, v, material=GREY) -> Part:
    """A parallelogram without thickness."""
    corner, u, v = (np.asarray(a, float) for a in (corner, u, v))
    corners = np.array([corner, corner + u, corner + u + v, corner + v])
    return Part(name, corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), material)


def box(name: str, extents, centre, material=GREY, turn_deg=0.0) -> Part:
    """A block, turned about the vertical."""
    mesh = trimesh.creation.box(extents)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(turn_deg), (0, 0, 1)))
    return part(name, mesh.apply_translation(centre), material)


def pole(name: str, start, end, radius=0.03, material=GREY) -> Part:
    """A round bar."""
    return part(name, trimesh.creation.cylinder(radius, segment=np.array([start, end], float), sections=24), material)


def rough_sheet(name: str, corner, u, v, relief=0.1, cells=40, seed=1, material=SAND) -> Part:
    """A parallelogram with bumps of a few cells, ``relief`` [m] in standard deviation, along u x v."""
    corner, u, v = (np.asarray(a, float) for a in (corner, u, v))
    a, b = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1), indexing="ij")
    up = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    height = relief * _bumps(a, b, cells, seed)
    vertices = corner + a[..., None] * u + b[..., None] * v + height[..., None] * up
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    p, q, r, s = (i.ravel() for i in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])
    return Part(name, vertices.reshape(-1, 3), faces.astype(np.int32), material)


def _bumps(a, b, cells: int, seed: int, waves: int = 24):
    """Sum of random waves, of standard deviation 1."""
    random = np.random.default_rng(seed)
    frequency = random.uniform(0.5, cells / 4, (waves, 2)) * random.choice([-1, 1], (waves, 2))
    phase = random.uniform(0, 2 * np.pi, waves)
    weight = 1.0 / (1.0 + np.linalg.norm(frequency, axis=1))
    values = sum(
        w * np.sin(2 * np.pi * (f[0] * a + f[1] * b) + p) for w, f, p in zip(weight, frequency, phase, strict=True)
    )
    return values / np.sqrt(np.sum(weight**2) / 2)


def boxes() -> list[Part]:
    """What lies on the ground three metres ahead."""
    return [
        box("box.0", (0.6, 0.5, 0.5), (-0.7, 2.6, 0.25), RED, 20.0),
        box("box.1", (0.4, 0.4, 0.9), (0.6, 3.2, 0.45)),
        box("box.2", (0.3, 0.8, 0.3), (0.2, 2.1, 0.15), BLUE, -35.0),
        box("box.3", (1.2, 0.3, 0.6), (0.1, 4.4, 0.3)),
    ]


def ground(half=12.0, height=0.0, relief=0.08, seed=1, cells=60) -> Part:
    """A rough sea floor around the origin."""
    corner = (-half, -half, height)
    return rough_sheet("ground", corner, (2 * half, 0, 0), (0, 2 * half, 0), relief, cells, seed)


def room(low, high, material=GREY, hole=None) -> list[Part]:
    """Six sheets around a box; ``hole`` = x0, x1, z0, z1 is cut out of the one at the greatest y."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    x, y, z = (x1 - x0, 0, 0), (0, y1 - y0, 0), (0, 0, z1 - z0)
    walls = [
        sheet("bottom", low, x, y, SAND),
        sheet("top", (x0, y0, z1), x, y, material),
        sheet("left", low, y, z, RED),
        sheet("right", (x1, y0, z0), y, z, BLUE),
        sheet("back", low, x, z, material),
    ]
    if hole is None:
        return [*walls, sheet("front", (x0, y1, z0), x, z, material)]
    a0, a1, c0, c1 = hole
    pieces = [(x0, a0, z0, z1), (a1, x1, z0, z1), (a0, a1, z0, c0), (a0, a1, c1, z1)]
    return walls + [
        sheet(f"front.{i}", (p, y1, r), (q - p, 0, 0), (0, 0, s - r), material) for i, (p, q, r, s) in enumerate(pieces)
    ]
