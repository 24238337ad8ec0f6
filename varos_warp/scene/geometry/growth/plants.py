"""Plants: kelp (Laminaria), a stipe on a holdfast and a leathery blade that is split into limp straps; and seagrass."""

from dataclasses import dataclass

import numpy as np

from varos_warp.scene.geometry.growth.solids import Form, Sheet, Strip, around, waves
from varos_warp.scene.geometry.normals import UP
from varos_warp.scene.geometry.relief.recipes.blending import smoothstep

STIPE, BLADE = np.array([0.034, 0.024, 0.013]), np.array([0.034, 0.021, 0.0075])
WORN, LACE, FUZZ = np.array([0.066, 0.046, 0.022]), np.array([0.095, 0.09, 0.072]), np.array([0.056, 0.046, 0.032])
"""Old ends that have been grazed and bleached, crusts of bryozoans, and hydroids with what they catch."""
WEED = np.array([0.028, 0.012, 0.009])
"""Red algae on stipes."""
ROWS = 112
"""Places along the longest strap."""
COLUMN = 0.009
"""Widths of the columns of a strap, about."""
FREE = 0.16
"""Share of a blade's length over which a strap comes free behind its split."""


@dataclass(frozen=True)
class Blade:
    """What the straps of one plant have in common."""

    top: np.ndarray
    """float64 [3]: where it sits on the stipe."""
    length: float
    """Length of the longest strap, over the height of the stipe."""
    fan: tuple[float, float]
    """Angles by which its rims part [rad]: at its base, and far from there."""
    droop: tuple[float, float, float]
    """Angles by which it rises from the stipe, and hangs at last [rad], and the share of its length between both."""
    cupped: float
    """Angle by which the blade's rims hang lower than its middle [rad]."""
    tone: np.ndarray
    """float64 [3]: its colour where it is clean."""
    age: tuple[float, float, float]
    """How far the blade is bleached, crusted with bryozoans and overgrown by hydroids, about 0 to 1 each."""

    def along(self, u: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Heading and pitch [rad] of the fibres at shares of the length and of the half width, -1 to 1."""
        rise, hang, limp = self.droop
        base, far = self.fan
        heading = t * (far + (base - far) * np.exp(-u / 0.22))
        fall = 1.0 - np.exp(-((u / limp) ** 1.5))
        return heading, rise - (rise + hang) * fall - self.cupped * t**2 * np.exp(-((u - 0.3) ** 2) / 0.08)


def kelp(rng: np.random.Generator) -> Form:
    """A plant of its own age and state, that hangs with the current, along y; of about unit height."""
    s = np.linspace(0.0, 1.0, 30)
    lean, bow = rng.normal((0.0, 0.1), 0.13), rng.normal(0.0, 0.04, 2)
    stipe = np.column_stack([np.outer(s**2, lean) + np.outer(np.sin(np.pi * s), bow), 0.95 * s - 0.02])
    thick = rng.uniform(0.75, 1.2) * np.linspace(0.019, 0.008, 30) * rng.normal(1.0, 0.06, 30)
    crust = np.clip(0.5 - 1.6 * s + 0.3 * rng.standard_normal(30), 0.0, 0.7)[:, None]
    colours = STIPE * rng.normal(1.0, 0.16, (30, 1)) + crust * [0.024, 0.013, 0.012]
    strips: list[Strip] = [Strip(stipe, thick, colours, sides=7)]
    strips += [_root(rng, angle) for angle in around(11) + rng.normal(0.0, 0.25, 11)]
    for _ in range(int(rng.choice([0, 3, 8]))):
        strips += _tuft(rng, stipe[int(len(stipe) * rng.uniform(0.3, 0.97) ** 0.7)])
    return Form(None, (*strips, *_straps(rng, _blade(rng, stipe[-1]))))


def _blade(rng, top):
    """A blade by chance."""
    length, base, far, rise, hang, limp, cupped = rng.uniform(
        (0.8, 1.1, 0.25, 0.3, 0.8, 0.25, 0.0), (1.35, 1.45, 0.6, 1.2, 1.45, 0.55, 0.8)
    )
    tone = BLADE * np.exp(rng.uniform(-0.7, 0.25)) * [1.0, rng.uniform(0.9, 1.08), rng.uniform(0.8, 1.3)]
    return Blade(top, length, (base, far), (rise, hang, limp), cupped, tone, tuple(rng.uniform(0.0, 1.0, 3)))


def _root(rng, angle):
    """One of the roots by which a holdfast grips."""
    u, out = np.linspace(0.0, 1.0, 5), np.array([np.cos(angle), np.sin(angle), 0.0])
    reach, high, thick = rng.uniform((0.035, 0.03, 0.7), (0.075, 0.075, 1.1))
    path = np.outer(reach * u, out) + np.outer(high * (1.0 - u) ** 2 - 0.012 * u, UP)
    path += 0.004 * rng.standard_normal((5, 3)) * u[:, None]
    return Strip(path, thick * np.linspace(0.009, 0.004, 5), rng.normal(1.0, 0.15, (5, 1)) * STIPE, sides=4)


def _tuft(rng, root):
    """Small red algae on the upper part of a stipe."""
    u, strips = np.linspace(0.0, 1.0, 4), []
    for _ in range(rng.integers(4, 9)):
        out = rng.standard_normal(3) * [1.0, 1.0, 0.5] + [0.0, 0.4, -0.2]
        out *= rng.uniform(0.015, 0.05) / np.linalg.norm(out)
        foot = root + 0.012 * rng.standard_normal(3) * [0.3, 0.3, 1.0]
        path = foot + np.outer(u, out) - np.outer(0.012 * u**2, UP) + 0.003 * rng.standard_normal((4, 3))
        across = np.cross(out, rng.standard_normal(3))
        width = rng.uniform(0.003, 0.008) * np.array([0.5, 1.0, 1.1, 0.5])
        colours = rng.uniform(0.6, 1.5) * (0.8 + 0.4 * u)[:, None] * WEED
        strips.append(Strip(path, width, colours, np.tile(across / np.linalg.norm(across), (4, 1))))
    return strips


def _straps(rng, blade):
    """The straps of a blade: unlike in width, split deep or not, whole or torn off."""
    count = int(rng.integers(7, 16))
    rims = np.concatenate([[0.0], np.cumsum(rng.uniform(0.6, 1.4, count))])
    rims = 2.0 * rims / rims[-1] - 1.0
    splits = np.concatenate([[0.04], rng.uniform(0.14, 0.5, count - 1), [0.04]])
    ends = rng.uniform(0.72, 1.0, count) * (1.0 - 0.15 * (rims[:-1] + rims[1:]) ** 2 / 4.0)
    torn = rng.random(count) < rng.choice([0.05, 0.15, 0.5])
    ends = np.where(torn, np.minimum(ends, np.maximum(splits[:-1], splits[1:]) + rng.uniform(0.04, 0.4, count)), ends)
    field = int(rng.integers(1 << 30))
    return [_strap(rng, blade, rims[k : k + 2], splits[k : k + 2], (ends[k], torn[k]), field) for k in range(count)]


def _strap(rng, blade, rims, splits, end, field):
    """A strap between two rims of a blade, of which it is a part up to its splits."""
    last, torn = end
    u = np.linspace(0.0, 1.0, ROWS)[: int(np.ceil(last * (ROWS - 1))) + 1]
    tau = np.linspace(-1.0, 1.0, 2 * int(np.clip(0.2 * blade.length * np.ptp(rims) / COLUMN, 2.0, 9.0)) + 1)
    t = rims.mean() + 0.5 * np.ptp(rims) * tau
    free = smoothstep(0.0, FREE, u[:, None] - np.interp(tau, (-1.0, 1.0), splits))
    path, along, aside = _middle(rng, blade, u, rims.mean(), splits)
    shared = np.stack([_fibre(blade, u, one) for one in t], axis=1)
    wide = np.linalg.norm(shared[:, -1] - shared[:, 0], axis=1) / 2.0
    k = min(np.searchsorted(u, splits.mean() + 0.5 * FREE), len(u) - 1)
    wide[k:] = wide[k] * np.interp(u[k:] - u[k], [0.0, 0.2, 0.7], [1.0, 1.2, 0.85])
    off, lift = _rims(rng, u, last, torn, tau)
    own = path[:, None] + (wide[:, None] * off)[..., None] * aside[:, None]
    own += (wide[:, None] * lift)[..., None] * np.cross(aside, along)[:, None]
    points = shared + free[..., None] * (own - shared)
    points = _ragged(rng, points, torn)
    colours = _colours(rng, blade, u / last, u[:, None] * blade.length, t, field)
    return Sheet(path, wide, colours.mean(axis=1), aside, points=points, tones=colours)


def _fibre(blade, u, t):
    """The line of a fibre of a blade that is not split."""
    heading, pitch = blade.along(u, t)
    return _line(blade, u, heading, pitch)[0] + 0.012 * t * np.array([1.0, 0.0, 0.0])


def _line(blade, u, heading, pitch):
    """The line along directions from a blade's foot, and the directions."""
    along = np.column_stack([np.cos(pitch) * np.sin(heading), np.cos(pitch) * np.cos(heading), np.sin(pitch)])
    steps = 0.5 * (along[1:] + along[:-1]) * (np.diff(u) * blade.length)[:, None]
    return blade.top + np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), along


def _middle(rng, blade, u, t, splits):
    """The middle of a strap, its directions, and the way that it is wide there: free of others it hangs by itself."""
    heading, pitch = blade.along(u, t)
    free = smoothstep(0.0, 2.0 * FREE, u - splits.min())
    turn, fall, twist, wave = rng.normal((0.0, 0.1, 0.0, 0.0), (0.3, 0.3, 0.8, 0.35))
    often, shift = rng.uniform((5.0, 0.0), (13.0, 6.3))
    heading = heading + free * (turn + 0.25 * np.sin(5.0 * u + shift))
    pitch = np.maximum(pitch - free * (fall + wave * u * np.sin(often * u + shift)), -1.55)
    path, along = _line(blade, u, heading, pitch)
    flat = np.column_stack([np.cos(heading), -np.sin(heading), np.zeros(len(u))])
    roll = (free * twist * (np.sin(3.0 * u + 2.0 * shift) - np.sin(2.0 * shift)))[:, None]
    return path, along, np.cos(roll) * flat + np.sin(roll) * np.cross(along, flat)


def _rims(rng, u, last, torn, tau):
    """Places of a strap's columns across it, -1 to 1 [K, C], and off its plane [K, C]: rims are ruffled, with bites."""
    off = np.empty((len(u), len(tau)))
    lift = np.zeros_like(off)
    tip = 1.0 if torn else (1.0 - np.clip(u / last, 0.0, 1.0) ** 7) ** 0.6
    for side in (-1.0, 1.0):
        half = side * tau >= 0.0
        bites = np.clip(_smooth(rng, u, 0.13) - 1.5, 0.0, 0.5) + np.clip(_smooth(rng, u, 0.25) - 1.2, 0.0, 0.4)
        rim = (1.0 - bites * np.clip(3.0 * u, 0.0, 1.0)) * (1.0 + 0.08 * _smooth(rng, u, 0.1)) * tip
        off[:, half] = rim[:, None] * tau[half]
        steps = rng.uniform(0.5, 1.5, len(u)) * rng.uniform(28.0, 55.0) * (u[1] - u[0])
        ruffle = (
            np.minimum(2.5 * u, 1.0)
            * rng.uniform(0.1, 0.5)
            * (0.6 + 0.4 * _smooth(rng, u, 0.2))
            * np.sin(np.cumsum(steps))
        )
        bend = rng.normal(0.0, 0.35) + 0.3 * _smooth(rng, u, 0.25)
        lift[:, half] = ruffle[:, None] * np.abs(tau[half]) ** 2.5 + bend[:, None] * np.abs(tau[half]) ** 1.5
    return off, lift


def _ragged(rng, points, torn):
    """A strap whose last rows end at other places in each column; colours stay with their rows."""
    rows = min(len(points) - 2, 10 if torn else 6)
    back = np.cumsum(np.cumsum(rng.normal(0.0, 0.09, points.shape[1]))) + rng.uniform(0.0, 0.1, points.shape[1])
    back = np.clip(back - back.min(), 0.0, 0.93)
    at = np.clip(np.arange(-rows, 1.0) / rows + 1.0, 0.0, 1.0)[:, None] * (1.0 - back)
    tail = points[-rows - 1 :]
    k = np.minimum((rows * at).astype(int), rows - 1)
    rest, column = (rows * at - k)[..., None], np.arange(points.shape[1])[None]
    return np.concatenate([points[: -rows - 1], tail[k, column] * (1.0 - rest) + tail[k + 1, column] * rest])


def _smooth(rng, u, length):
    """Smooth noise of variance 1 along a strap, by its length over that of the blade."""
    return waves(np.column_stack([u, np.zeros((len(u), 2))]), length * 0.6, rng)


def _colours(rng, blade, done, along, t, field):
    """Colours [K, C, 3] of a strap: clean and dark at its base, mottled, then bleached, crusted and overgrown."""
    across = np.broadcast_to(0.35 * blade.length * t, (len(done), len(t)))
    places = np.stack([np.broadcast_to(along, across.shape), across, np.zeros(across.shape)], -1).reshape(-1, 3)
    of_plant = np.random.default_rng(field)

    def noise(wavelength, stretch=1.0):
        return waves(places / [stretch, 1.0, 1.0], wavelength, of_plant).reshape(across.shape)

    fine, old = rng.standard_normal(across.shape), done[:, None]
    tau = np.linspace(-1.0, 1.0, len(t))
    shade = 0.72 + 0.35 * np.minimum(3.0 * old, 1.0) + 0.13 * noise(0.16) + 0.09 * noise(0.05) + 0.1 * noise(0.02, 8.0)
    shade *= 1.0 + rng.uniform(-0.2, 0.2) * np.minimum(2.5 * old, 1.0) + 0.05 * fine
    shade = np.maximum(shade * (1.0 + 0.22 * np.abs(tau) ** 4), 0.3)
    colours = shade[..., None] * blade.tone
    bleached, crusted, fuzzy = blade.age
    layers = (
        (WORN, old**2 - 1.15 + 0.5 * bleached + 0.25 * noise(0.12) + 0.15 * noise(0.03), 0.8, 0.1),
        (FUZZ, 0.6 * old - 1.0 + 0.6 * fuzzy + 0.4 * noise(0.1) + 0.2 * noise(0.036), 0.7, 0.25),
        (LACE, 0.5 * old - 1.65 + 0.75 * crusted + 0.5 * noise(0.1) + 0.35 * noise(0.036), 0.7, 0.25),
    )
    for colour, more, most, mottle in layers:
        share = most * smoothstep(0.0, 0.3, more)[..., None] * np.clip(1.0 + mottle * fine[..., None], 0.0, 1.15)
        colours = colours + share * (colour - colours)
    return colours


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
