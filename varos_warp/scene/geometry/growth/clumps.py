"""How copies keep together: patches of metres, in them clumps of decimetres, and in these bodies that touch.

Clumps are balls of space about points by chance (a Boolean model; Chiu et al. 2013, Stochastic Geometry, ch. 3): where
a surface passes through one, it is settled, and nearer to the middle of the ball it is older.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.spatial import cKDTree
from scipy.special import ndtr, ndtri

from varos_warp.scene.geometry.growth.chance import Field, field_of, mixed, poisson_counts, uniform
from varos_warp.scene.geometry.relief.recipes.blending import smoothstep

GROUPS = ((50.0, 0.8), (16.0, 0.6))
"""Wavelengths of a kind's own patches, in the radius of its clumps, and shares of the noise's deviation."""
TERRITORY_M, TERRITORY = 0.9, 0.92
"""Wavelength [m] of the field by which kinds divide a host, and its share beside that of own patches."""
LEAST_CROWDED = 1.06
"""Were all in clumps, at least so many times ``per_m2`` would be left."""
STRAY = 0.015
"""Share of the copies that stand alone, by default."""
BARE_BELOW, FULL_ABOVE = -0.7, -0.1
"""Values of a field of variance 1: below the first are scars, where next to nothing grows; above the second growth is
as elsewhere."""
IN_SCARS = 0.04
"""Share of growth that scars have."""
SPREAD, TAIL = 0.6, 0.02
"""Deviation of the logarithm of clumps' radii, and the share of them at either end that there is none of."""
FULL_TO, EMPTY_FROM, HALO, HALO_TO = 0.6, 1.2, 0.06, 1.5
"""Distances over a clump's radius to which it is full and at which it ends, then the share of settlers around it, which
are few, and how far these reach."""
OUTLINE, OUTLINE_MOST = 0.42, 1.5
"""Deviation of the logarithm of a clump's reach from place to place, and its bound, in deviations."""
OUTLINES = ((2.6, 0.8), (0.8, 0.6))
"""Wavelengths of that noise, in the radius of clumps, and shares of its deviation: lobes of large ones, and fringes."""
SMOOTH_OUTLINES = ((0.9, 1.0),)
"""`OUTLINES` of clumps that are no patches: on the small planes where room is measured, lobes would be few."""
WIDER, WIDEST = 0.25, 0.5
"""Logarithm by which clumps reach farther where a place is liked, for each deviation of the noise, and its bound."""
PATCHY, PATCH_EDGE = 2.2, 0.6
"""Patches have so many times the area of the clumps in them; over how much of the noise they begin."""
LEAST_PATCHES = 0.25
"""Share of a surface that patches have at least."""


@dataclass(frozen=True)
class Crowd:
    """How crowded some places are."""

    weight: np.ndarray
    """float64 [N]: density of copies, over ``per_m2``."""
    depth: np.ndarray
    """float64 [N]: 0 at the rim of a clump and outside, 1 in the middle of one."""
    clump: np.ndarray
    """uint64 [N]: key of the clump; 0 outside of all."""


@dataclass(frozen=True)
class Crowding:
    """How much more or less than ``per_m2`` there is at places of one host: 1 in the mean over all seeds."""

    full: float
    """Density of copies in clumps without scars, over ``per_m2``; 1: there are no clumps, copies fall like rain."""
    radius: float
    """Median of the radii of clumps [m]."""
    stray: float
    """Share of the copies that stand outside of clumps."""
    left: float
    """Share of what clumps would have that scars leave and that finds room there, in the mean."""
    key: np.uint64
    patches: tuple[tuple[Field, float], ...]
    """Noise fields of the patches, each with its share; the squares of the shares sum to 1."""
    outline: tuple[tuple[Field, float], ...]
    """Noise fields of the clumps' outlines, each with its share, as for ``patches``."""
    scars: Field | None

    @property
    def peak(self) -> float:
        """Largest density of copies that there can be, over ``per_m2``."""
        return self.full

    @property
    def kept(self) -> float:
        """Share of what scars leave of clumps that finds room."""
        return self.left / self._bare

    @property
    def _bare(self):
        return 1.0 if self.scars is None else left_by_scars()

    @property
    def _law(self):
        return _law_of(self.full, self.stray, self.left, len(self.patches) > 0)

    def may(self, points: np.ndarray, above: np.ndarray) -> np.ndarray:
        """Whether weights of points [N, 3] may be above numbers [N], by scars alone, bool [N]: what is quick to say."""
        if self.scars is None:
            return np.ones(len(points), bool)
        return self.full * _left_by_scars(self.scars(points)) >= above

    def __call__(self, points: np.ndarray, liking: np.ndarray | float = 0.0, above: np.ndarray | float = 0.0) -> Crowd:
        """How crowded it is at points [N, 3] from the host's own origin [m].

        ``liking`` is added to the noise of patches, of variance 1: more than 0 where there is to be more than
        elsewhere. Clumps reach farther there. Weights that cannot be ``above`` numbers [N] may be told too low.
        """
        n = len(points)
        if self.full == 1.0:
            return Crowd(np.ones(n), np.ones(n), np.zeros(n, np.uint64))
        law = self._law
        gate = law.gate(_noise(self.patches, points) + liking)
        scars = np.ones(n) if self.scars is None else _left_by_scars(self.scars(points))
        some = np.flatnonzero((gate > 0.0) & (self.full * scars >= above))
        share, depth, clump = np.zeros(n), np.zeros(n), np.zeros(n, np.uint64)
        wider = np.clip(WIDER * np.broadcast_to(liking, n)[some], -WIDEST, WIDEST)
        share[some], depth[some], clump[some] = self._in_clumps(points[some], gate[some], wider)
        stray = self.stray / self._bare  # scars take of them too
        return Crowd((stray + (self.full - stray) * share) * scars, depth, clump)

    def _in_clumps(self, points, gate, wider):
        """How full [N], how deep [N] and in which clump [N] points [N, 3] are; 0 outside of all."""
        n = len(points)
        empty, deepest, clump = np.zeros(n), np.zeros(n), np.zeros(n, np.uint64)
        if n == 0:
            return empty, deepest, clump
        reach = np.exp(OUTLINE * np.clip(_noise(self.outline, points), -OUTLINE_MOST, OUTLINE_MOST) + wider)
        middle, radius, keys = self._clumps(points)
        site, at, x = _near(middle, radius, points, reach)
        inside = uniform(keys, 5)[site] < gate[at]
        site, at, x = site[inside], at[inside], x[inside]
        empty = np.bincount(at, _in_steps(np.log1p(-np.minimum(_profile(x), 1.0 - 1e-12))), n)
        nearest = np.full(n, EMPTY_FROM)
        np.minimum.at(nearest, at, x)
        own = np.flatnonzero((x == nearest[at]) & (x < EMPTY_FROM))
        own = own[np.argsort(keys[site[own]])]  # of two as near, the higher key
        deepest[at[own]], clump[at[own]] = np.clip(1.0 - x[own] ** 2, 0.0, 1.0), keys[site[own]] | np.uint64(1)
        return -np.expm1(empty), deepest, clump

    def _clumps(self, points):
        """Middles [C, 3], radii [C] and keys [C] of all clumps that may reach to points."""
        side = HALO_TO * np.exp(OUTLINE * OUTLINE_MOST + WIDEST) * _radius(1.0) * self.radius
        cells = cells_around(np.floor(points / side).astype(np.int64))
        own = mixed(self.key, *cells.T.astype(np.uint64))
        rate = self._law.covered / (_ball() * _radius_cubed() * self.radius**3)
        counts = poisson_counts(uniform(own, 0), np.full(len(own), rate * side**3))
        cell = np.repeat(np.arange(len(own)), counts)
        turn = np.arange(len(cell)) - np.repeat(np.cumsum(counts) - counts, counts)
        keys = mixed(own[cell], turn.astype(np.uint64) + np.uint64(1))
        middle = side * (cells[cell] + np.column_stack([uniform(keys, axis) for axis in (1, 2, 3)]))
        return middle, self.radius * _radius(uniform(keys, 4)), keys


def crowding(
    full: float,
    radius: float,
    own: np.uint64,
    host: np.uint64 | None,
    territory: float = 0.0,
    stray: float = STRAY,
    left: float | None = None,
    patchy: bool = True,
) -> Crowding:
    """Crowding of a kind on a host.

    Args:
        full: How many times the mean its clumps have where there are no scars.
        radius: Median of the radii of its clumps [m].
        own: Key of the kind, the host and the seeds.
        host: Key of the host alone, or None for what leaves no scars and has no territory.
        territory: Where the kind has it, in turns of the host's field.
        stray: Share of the copies that stand outside of clumps.
        left: Share of that which scars leave and which finds room, in the mean; the mean of what is left is 1. None:
            all find room.
        patchy: Whether clumps keep together in patches.
    """
    full = float(full)
    if full == 1.0:
        return Crowding(1.0, radius, 0.0, 1.0, own, (), (), None)
    some = [(field_of(mixed(own, np.uint64(k)), times * radius), share) for k, (times, share) in enumerate(GROUPS)]
    if host is not None:
        some = [
            (some[1][0], np.sqrt(1.0 - TERRITORY**2)),
            (field_of(mixed(host, np.uint64(1)), TERRITORY_M, territory), TERRITORY),
        ]
    if left is None:
        left = 1.0 if host is None else left_by_scars()
    return Crowding(
        full,
        radius,
        stray,
        left,
        own,
        tuple(some) if patchy else (),
        tuple(
            (field_of(mixed(own, np.uint64(9 + k)), times * radius), share)
            for k, (times, share) in enumerate(OUTLINES if patchy else SMOOTH_OUTLINES)
        ),
        None if host is None else field_of(host, 0.7),
    )


@dataclass(frozen=True)
class _Law:
    """What makes the mean of what finds room 1."""

    covered: float
    """Mean number of clumps that a point is in, within patches."""
    rim: float
    """Noise at which patches begin."""

    def gate(self, noise):
        """Share of the clumps that there are at places of such a noise."""
        return np.ones(np.shape(noise)) if np.isinf(self.rim) else smoothstep(0.0, 1.0, (noise - self.rim) / PATCH_EDGE)


def share_of(full: float, stray: float, left: float) -> float:
    """Share of a surface that clumps have, by how full they are, so that the mean of what is left is 1.

    Where no share makes it so, nearly all.
    """
    return (1.0 - stray) / (max(full * left, LEAST_CROWDED) - stray)


def patches_of(share: float) -> float:
    """Share of a surface that is in patches, by that which is in clumps."""
    return min(max(PATCHY * share, LEAST_PATCHES), 1.0)


@lru_cache
def _law_of(full: float, stray: float, left: float, patchy: bool) -> _Law:
    """Expectations over normal variables: of a Boolean model's share of space, 1 - exp(-covered)."""
    z = np.linspace(-8.0, 8.0, 401)
    density = np.exp(-0.5 * z * z)
    density /= density.sum()
    share = share_of(full, stray, left)
    patches = patches_of(share) if patchy else 1.0
    law = _Law(0.0, -np.inf if patches >= 1.0 else float(-ndtri(patches)) - 0.5 * PATCH_EDGE)
    wider = np.exp(3.0 * OUTLINE * np.clip(z, -OUTLINE_MOST, OUTLINE_MOST))
    most = np.outer(wider, law.gate(z))

    def excess(covered):
        return float(density @ -np.expm1(-covered * most) @ density) - share

    return replace(law, covered=brentq(excess, 0.0, 200.0))


def cells_around(cells: np.ndarray) -> np.ndarray:
    """Cells [C, 3] and all that touch them, each once, int64 [D, 3]."""
    low = cells.min(axis=0) - 1
    shape = tuple(np.ptp(cells, axis=0) + 3)
    found = np.unique(np.ravel_multi_index(tuple((cells - low).T), shape))
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    around = np.stack(np.unravel_index(found, shape), -1) + steps
    found = np.unique(np.ravel_multi_index(tuple(np.moveaxis(around.reshape(-1, 3), 1, 0)), shape))
    return np.stack(np.unravel_index(found, shape), -1) + low


def _noise(fields, points):
    """The sum of fields by their shares, at points [N, 3]."""
    return sum((share * field(points) for field, share in fields), np.zeros(len(points)))


def _near(middle, radius, points, reach):
    """Clumps and points that they reach to, int [P] each, and how far these are from the middle [P], in radii there.

    A clump reaches to a point ``reach`` [N] times as far as its radius [C] says. Both are sorted by size, so that few
    pairs are looked at in vain.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    farthest = HALO_TO * reach.max() * radius[:, None]
    may = np.flatnonzero(((middle + farthest >= low) & (middle - farthest <= high)).all(axis=1))
    trees = [(balls, cKDTree(middle[balls])) for balls in _of_a_size(radius, may)]
    some = [(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))]
    for these in _of_a_size(reach, np.arange(len(points))):
        tree = cKDTree(points[these], balanced_tree=False)  # as quick to search, quicker to build
        for balls, around in trees:
            far = HALO_TO * reach[these].max() * radius[balls].max()
            pairs = around.sparse_distance_matrix(tree, far, output_type="ndarray")
            x = pairs["v"] / (radius[balls][pairs["i"]] * reach[these][pairs["j"]])
            near = np.flatnonzero(x < HALO_TO)
            some.append((balls[pairs["i"][near]], these[pairs["j"][near]], x[near]))
    return tuple(map(np.concatenate, zip(*some, strict=True)))


def _of_a_size(size, which):
    """Numbers of ``which`` whose sizes lie within a factor of the square root of 2, one array for each such range."""
    bins = np.ceil(2.0 * np.log2(size[which]))
    return [which[bins == k] for k in np.unique(bins)]


def _in_steps(x):
    """Logarithms in steps so coarse that sums of them above -128 are exact, in whichever order a tree gives them."""
    return np.ldexp(np.rint(np.ldexp(x, 46)), -46)


def _profile(x):
    """How full a clump is so many radii from its middle."""
    return np.maximum(smoothstep(EMPTY_FROM, FULL_TO, x), HALO * smoothstep(HALO_TO, 1.0, x))


def _radius(u):
    """Radii of clumps over their median, of uniform numbers: a log-normal law without its ends."""
    return np.exp(SPREAD * ndtri(TAIL + (1.0 - 2.0 * TAIL) * u))


@lru_cache
def _radius_cubed() -> float:
    return float(np.mean(_radius((np.arange(10_000) + 0.5) / 10_000) ** 3))


@lru_cache
def _ball() -> float:
    """Volume of a clump of radius 1, by how full it is."""
    x = (np.arange(10_000) + 0.5) * HALO_TO / 10_000
    return float(4.0 * np.pi * np.sum(_profile(x) * x * x) * HALO_TO / 10_000)


def _left_by_scars(noise):
    return IN_SCARS + (1.0 - IN_SCARS) * smoothstep(BARE_BELOW, FULL_ABOVE, noise)


def scars() -> tuple[np.ndarray, np.ndarray]:
    """What scars leave of growth [6], and shares of a surface [6] where they leave it.

    Means of what follows smoothly from the first are sums with the second: all of what is in scars, all beyond, and
    Gauss's nodes at their rims.
    """
    x, weight = np.polynomial.legendre.leggauss(4)
    half = 0.5 * (FULL_ABOVE - BARE_BELOW)
    z = BARE_BELOW + half * (1.0 + x)
    rims = half * weight * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    leaves = np.array([IN_SCARS, *_left_by_scars(z), 1.0])
    return leaves, np.array([ndtr(BARE_BELOW), *rims, ndtr(-FULL_ABOVE)])


@lru_cache
def left_by_scars() -> float:
    """What scars leave of growth, in the mean."""
    return float(np.dot(*scars()))
