"""Soft animals: anemones, hydroids and starfish."""

import itertools
from dataclasses import replace

import numpy as np

from varos_warp.scene.geometry.growth.solids import (
    Form,
    Strip,
    around,
    grid_faces,
    revolved,
    solid,
    waves,
)
from varos_warp.scene.geometry.normals import UP


def anemone(rng: np.random.Generator) -> Form:
    """A plumose anemone (Metridium): a leaning column and a crown of thin tentacles, or drawn in; of unit height."""
    open_ = rng.random() < 0.75
    z = np.array([-0.05, 0.0, 0.05, 0.2, 0.4, 0.55, 0.66, 0.72, 0.70, 0.68])
    r = np.array([0.34, 0.36, 0.31, 0.22, 0.19, 0.21, 0.27, 0.31, 0.24, 0.02])
    if not open_:
        z, r = z * 0.55, r * np.array([1, 1, 1, 1.2, 1.3, 1.2, 0.85, 0.45, 0.25, 0.3])
    column = revolved(r, z, 1.0 + 0.05 * np.cos(2.0 * around(18) + rng.uniform(0.0, 6.0)))
    column += 0.008 * waves(column, 0.15, rng)[:, None]
    shade = np.repeat(np.interp(z, [-0.05, 0.1, 0.5, 0.75], [0.5, 0.7, 1.0, 1.1]), 18) * rng.uniform(0.9, 1.1, 180)
    tentacles = [_tentacle(rng) for _ in range(44 if open_ else 0)]
    lean = rng.normal(0.0, 0.25, 2)
    body = solid(_leaning(column, lean), grid_faces(10, 18), np.outer(shade, [0.15, 0.1, 0.065]))
    return Form(body, tuple(replace(each, path=_leaning(each.path, lean)) for each in tentacles))


def _leaning(points, lean):
    """Points [N, 3] moved aside by the square of their height."""
    return points + np.maximum(points[:, 2:], 0.0) ** 2 * [*lean, 0.0]


def _tentacle(rng):
    t, start = rng.uniform(0.0, 2.0 * np.pi), 0.3 * np.sqrt(rng.uniform(0.15, 1.0))
    length, out = rng.uniform(0.2, 0.36), rng.uniform(0.4, 1.1) * start / 0.3
    s, outwards = np.linspace(0.0, 1.0, 5)[:, None], np.array([np.cos(t), np.sin(t), 0.0])
    path = (
        [0.0, 0.0, 0.69]
        + outwards * (start + length * out * s)
        + UP * (length * (s - 0.6 * out * s**2))
        + 0.012 * np.cumsum(rng.standard_normal((5, 3)), axis=0)
    )
    colours = np.tile([0.2, 0.155, 0.11], (5, 1)) * rng.uniform(0.8, 1.15)
    return Strip(path, np.linspace(0.02, 0.006, 5), colours, sides=4)


def hydroid(rng: np.random.Generator) -> Form:
    """A tuft of feathers that bend with the current, along y, as of Plumularia or Halecium; of unit height."""
    strips = []
    for _ in range(rng.integers(10, 13)):
        length, away = rng.uniform(0.4, 1.0), rng.normal(0.0, [0.28, 0.2])
        root = np.append(rng.normal(0.0, 0.12, 2), -0.05)
        s, bend = np.linspace(0.0, 1.0, 7)[:, None], rng.uniform(0.25, 0.75)
        path = root + length * (s * [*away, 1.0] + s**2 * [0.0, bend, -0.35 * bend])
        path = path + 0.012 * np.cumsum(rng.standard_normal((7, 3)), axis=0)
        tone, side = rng.uniform(0.6, 1.4), rng.standard_normal(3) * [1.0, 1.0, 0.2]
        side /= np.linalg.norm(side)
        strips.append(_blade(path, 0.008, 0.8 * tone, rng))
        for k, way in itertools.product(range(2, 7), (-1.0, 1.0)):
            out = way * side + 0.8 * (path[k] - path[k - 1]) / np.linalg.norm(path[k] - path[k - 1])
            out += 0.25 * rng.standard_normal(3)
            reach = length * 0.24 * (1.0 - 0.7 * ((k - 3) / 4) ** 2) * rng.uniform(0.7, 1.2)
            tip = np.array([0.0, 0.6, 1.0])[:, None] * reach * out + np.array([0.0, 0.0, 0.15 * reach])[:, None] * UP
            strips.append(_blade(path[k] + tip[:2] / 0.6, 0.012, 1.1 * tone, rng))
    return Form(None, tuple(strips))


def turf(rng: np.random.Generator) -> Form:
    """A cushion of short fine algae, full of silt: a lumpy mat with blades that lean every way; of unit height."""
    strips = []
    for _ in range(26):
        t, foot = rng.uniform(0.0, 2.0 * np.pi), 0.6 * np.sqrt(rng.uniform())
        root = [foot * np.cos(t), foot * np.sin(t), 0.1 - 0.2 * foot]
        away = t + rng.normal(0.0, 0.9)
        length, out = rng.uniform(0.35, 0.9) * (1.1 - 0.6 * foot), rng.uniform(0.15, 0.9)
        s = np.array([0.0, 0.5, 1.0])[:, None]
        path = root + (length + 0.05) * (out * s**1.5 * [np.cos(away), np.sin(away), 0.0] + (s - 0.3 * out * s**2) * UP)
        path[1:] += 0.05 * rng.standard_normal((2, 3))
        across = np.cross(path[-1] - path[0], rng.standard_normal(3))
        colours = rng.uniform(0.75, 1.25) * (np.array([0.1, 0.09, 0.065]) + s**1.5 * [0.06, 0.054, 0.04])
        width = 0.026 * np.array([1.0, 0.85, 0.35])
        strips.append(Strip(path, width, colours, np.tile(across / np.linalg.norm(across), (3, 1))))
    return Form(_cushion(rng), tuple(strips))


def _cushion(rng):
    """A low lumpy dome, darker in its hollows, that thins out at its border."""
    height, sides = rng.uniform(0.26, 0.42), 10
    radius, z = np.array([0.6, 0.54, 0.4, 0.2, 0.02]), height * np.array([-0.45, 0.05, 0.6, 0.95, 1.0])
    t = around(sides)
    girth = 1.0 + sum(rng.normal(0.0, 0.1) * np.cos(k * t + rng.uniform(0.0, 6.3)) for k in (2, 3, 4))
    dome = revolved(radius, z, np.clip(girth, 0.7, 1.3))
    lumps = waves(dome, 0.45, rng)
    dome[:, 2] += 0.07 * lumps * np.repeat([0.0, 0.4, 1.0, 1.0, 1.0], sides)
    shade = np.clip(1.0 + 0.18 * lumps + 0.1 * rng.standard_normal(len(dome)), 0.5, 1.5)
    return solid(dome, grid_faces(len(radius), sides), np.outer(shade, [0.145, 0.13, 0.097]))


def _blade(path, half_width, tone, rng):
    """A ribbon that narrows to its tip."""
    across = np.cross(path[-1] - path[0], rng.standard_normal(3))
    across /= max(np.linalg.norm(across), 1e-9)
    s = np.linspace(0.0, 1.0, len(path))
    return Strip(
        path,
        half_width * (1.0 - 0.7 * s),
        np.outer(tone * (0.55 + 0.6 * s), [0.16, 0.135, 0.095]),
        np.tile(across, (len(path), 1)),
    )


def starfish(rng: np.random.Generator) -> Form:
    """Five arms that taper from a small disk, one or two of them bent (Asterias); of unit width."""
    rings, half = 11, 11
    t, reach = _star(half)
    s, out = np.linspace(0.0, 1.0, rings)[:, None], np.clip((reach - 0.15) / 0.35, 0.0, 1.0)
    reach = reach * (1.0 + 0.12 * np.cos(t + rng.uniform(0.0, 6.0)))
    bend = rng.uniform(-0.5, 0.5) * s**2 * np.cos(t + rng.uniform(0.0, 6.0)) * out
    x, y = s * reach * np.cos(t + bend), s * reach * np.sin(t + bend)
    z = 0.08 * np.sqrt(np.maximum(1.0 - s**2, 0.0)) * (1.0 - 0.45 * s * out) - 0.012
    spines = rng.random((rings, len(t))) ** 3 * (1.0 - s**4)
    vertices = np.stack([x, y, z + 0.014 * spines], -1).reshape(-1, 3)
    mottle = np.clip(waves(vertices, 0.12, rng), -1.5, 1.5)[:, None]
    shade = 0.75 + 0.13 * mottle + 0.25 * np.repeat(s, len(t), axis=0)
    pale = np.clip(mottle - 0.4, 0.0, 0.8) * [0.04, 0.042, 0.035]
    whole = solid(vertices, grid_faces(rings, len(t))[:, ::-1], shade * [0.13, 0.07, 0.045] + pale)
    tips, notches = np.arange(half - 1, len(t), 2 * half), np.arange(2 * half - 1, len(t), 2 * half)
    corners, flanks = np.union1d(tips, notches), np.union1d(tips - 6, tips + 6)
    return Form(
        whole,
        coarser=tuple(
            _some(whole, len(t), [0, rings // 2, rings - 1], columns)
            for columns in (np.union1d(corners, flanks), corners)
        ),
    )


def _some(whole, sides, rows, columns):
    """A closed grid of some rows and columns of another."""
    chosen = (np.array(rows)[:, None] * sides + columns).ravel()
    return solid(whole.vertices[chosen], grid_faces(len(rows), len(columns))[:, ::-1], whole.colours[chosen])


def _star(half):
    """Directions [rad] and distances of the border of a star of radius 0.5, ``half`` points on each side of an arm."""
    r = np.linspace(0.13, 0.5, 400)
    aside = np.arcsin(np.minimum(0.115 * (1.0 - (r / 0.5) ** 1.6) ** 0.6 / r, 1.0))
    chosen = np.linspace(np.searchsorted(-aside, -np.pi / 5.0), len(r) - 1, half + 1).astype(int)[1:]
    one = np.concatenate([-aside[chosen], aside[chosen[-2::-1]], [np.pi / 5.0]])
    notch = r[np.searchsorted(-aside, -np.pi / 5.0)]
    reach = np.concatenate([r[chosen], r[chosen[-2::-1]], [notch]])
    return (one + 2.0 * np.pi / 5.0 * np.arange(5)[:, None]).ravel(), np.tile(reach, 5)
