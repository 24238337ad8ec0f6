"""A stud-link mooring chain, straight or hanging in a catenary."""

import numpy as np
from scipy.optimize import brentq

from varos_warp.scene.description.structures import MooringChain
from varos_warp.scene.geometry.assets.lofts import SLENDER, Detail, arc_steps, circle_points, lathe, loft
from varos_warp.scene.geometry.assets.structures.pieces import Piece, placed

STEEL = (0.11, 0.08, 0.06)
LENGTH, WIDTH, PITCH = 6.0, 3.6, 4.0
"""Outer length and width of a common link (ISO 1704), and what it takes of a chain, all in diameters of its bar."""
STUD, STUD_FOOT = 0.3, 0.45
"""Radius of the stud in its middle and at its feet, in the bars: drawn from catalogues, the standard leaves it free."""
TURN_DEG = 4.0
"""Standard deviation of the small turns of links about the chain [degrees]."""


def mooring_chain(block: MooringChain, key: str, detail: Detail) -> list[Piece]:
    """Links, each a bar and a stud."""
    link = _link(block.link_m, detail)
    detail.allow(block.links * sum(len(faces) for _, faces in link))
    nodes = chain_nodes(block)
    turns = np.radians(
        block.roll_deg
        - 90.0 * (np.arange(block.links) % 2)
        + TURN_DEG * np.random.default_rng(block.seed).standard_normal(block.links)
    )
    pieces = []
    for start, end, turn in zip(nodes[:-1], nodes[1:], turns, strict=True):
        axes = _axes(end - start, turn)
        pieces += [Piece("links", STEEL, *placed(mesh, axes, 0.5 * (start + end))) for mesh in link]
    return pieces


def chain_nodes(block: MooringChain) -> np.ndarray:
    """Places [links + 1, 3] where links meet: on the chain's line, a link's share of it apart."""
    s = PITCH * block.link_m * np.arange(block.links + 1)
    if block.end is None and not block.sag_m:
        return np.column_stack([s, np.zeros((len(s), 2))])
    if block.end is None:
        half, h = 0.5 * s[-1], block.sag_m
        a = (half**2 - h**2) / (2.0 * h)
        across, up, level = 2.0 * a * np.arcsinh(half / a), 0.0, np.array([1.0, 0.0])
    else:
        across, up = float(np.hypot(*block.end[:2])), block.end[2]
        level = np.array(block.end[:2]) / across
        a = _parameter(across, up, s[-1])
    # y = a cosh((x - x0) / a); the slope at the start is sinh(-x0 / a), from the chord's and the length's
    middle = 0.5 * across - a * np.arctanh(up / s[-1])
    start = np.sinh(-middle / a)
    x = middle + a * np.arcsinh(start + s / a)
    z = a * (np.cosh((x - middle) / a) - np.cosh(middle / a))
    return np.column_stack([x[:, None] * level, z])


def _parameter(across, up, length):
    """Parameter a [m] of the catenary of a length between two points: sinh(u) / u = sqrt(S^2 - V^2) / H, u = H / 2a."""
    ratio = np.sqrt(length**2 - up**2) / across
    u = brentq(lambda u: np.sinh(u) / u - ratio, 1e-4, 20.0, xtol=1e-14)
    return across / (2.0 * u)


def _axes(chord, turn):
    """Axes [3, 3] of a link along a chord: its width turned about it from the level."""
    x = chord / np.linalg.norm(chord)
    level = np.cross([0.0, 0.0, 1.0], x) if abs(x[2]) < 0.999 else np.array([0.0, 1.0, 0.0])
    level /= np.linalg.norm(level)
    y = np.cos(turn) * level + np.sin(turn) * np.cross(x, level)
    return np.column_stack([x, y, np.cross(x, y)])


def _link(d, detail):
    """Bar and stud of a link along x, its width along y."""
    bend = 0.5 * (WIDTH - 1.0) * d
    straight = LENGTH * d - d - 2.0 * bend
    half = detail.finer(0.5)
    around = circle_points(0.5 * d, half)
    step = min(detail.edge, SLENDER * np.pi * d / around)
    pieces = int(np.ceil(straight / step)) if detail.is_grid else 1
    turns = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 2 * arc_steps(bend + 0.5 * d, 0.5 * np.pi, half, 4) + 1)
    line = [(0.5 * straight + bend * np.cos(a), bend * np.sin(a), a) for a in turns]
    line += [(x, bend, 0.5 * np.pi) for x in np.linspace(0.5, -0.5, pieces + 1)[1:-1] * straight]
    x, y, angle = np.array(line).T
    x, y, angle = np.concatenate([x, -x]), np.concatenate([y, -y]), np.concatenate([angle, angle + np.pi])
    ring = 2.0 * np.pi / around * np.arange(around)
    out = 0.5 * d * np.cos(ring)
    rings = np.stack(
        [
            x[:, None] + np.cos(angle)[:, None] * out,
            y[:, None] + np.sin(angle)[:, None] * out,
            np.broadcast_to(0.5 * d * np.sin(ring), (len(x), around)),
        ],
        axis=-1,
    )
    reach = bend - 0.2 * d
    y = np.linspace(-1.0, 1.0, 2 * arc_steps(reach, 2.0, half, 6) + 1)
    radius = d * (STUD + (STUD_FOOT - STUD) * y**2)
    profile = np.column_stack([radius, reach * y])
    stud = lathe(profile, detail, circle_points(STUD_FOOT * d, half))
    return [loft(rings, detail, closed=True), placed(stud, [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])]
