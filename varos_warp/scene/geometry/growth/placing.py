"""Places of copies on a host: a Poisson process on its triangles, denser where they cluster."""

from dataclasses import dataclass, field, replace

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description.growth import Growth
from varos_warp.scene.geometry.growth.chance import key_of, mixed, poisson_counts, uniform
from varos_warp.scene.geometry.growth.clumps import Crowding, crowding
from varos_warp.scene.geometry.growth.hosts import REACH_M, Host
from varos_warp.scene.geometry.growth.kinds import KINDS, Kind
from varos_warp.scene.geometry.growth.room import Filling, filling, grown_to, most_laid, share_above, sizes
from varos_warp.scene.geometry.relief.density import Footprint

MOST_COPIES = 1_000_000
"""Most copies of one block on one host."""
LEAST_PIXELS = 1.5
"""Smaller copies are left out, by the nearest view of them."""
BATCH = 1 << 19
"""Candidates that are looked at together; the copies do not depend on it."""


@dataclass(frozen=True)
class Wanted:
    """What a block asks for, with what its kind has by default."""

    block: Growth
    key: str
    """Key of the block in the scene file, such as ``growth.0``."""
    seed: int
    """Seed of the scene."""
    surface_depth_m: float
    kind: Kind = field(init=False)
    per_m2: float = field(init=False)
    cluster: float = field(init=False)
    up: tuple[float, float] = field(init=False)
    size_m: tuple[float, float] = field(init=False)

    def __post_init__(self):
        kind = KINDS[self.block.kind]
        object.__setattr__(self, "kind", kind)
        for name in ("per_m2", "cluster", "up", "size_m"):
            given = getattr(self.block, name)
            object.__setattr__(self, name, getattr(kind, name) if given is None else given)

    def sizes(self, u: np.ndarray) -> np.ndarray:
        """Sizes [N] [m] of uniform numbers [N], by the law of the kind."""
        return sizes(self.kind, self.size_m, u)

    def share_above(self, size: np.ndarray) -> np.ndarray:
        """Share [N] of the copies that are larger than sizes [N] [m], but for those that are smaller in their clump."""
        return share_above(self.kind, self.size_m, size)

    def crowding(self, host: str) -> Crowding:
        """How the copies keep together on a host of this name: clumps are as full as bodies make them.

        Fewer a square metre are fewer clumps, no looser ones, and more are more clumps, no fuller ones.
        """
        kind = self.kind
        own = key_of(self.seed, self.block.seed, self.block.kind, host)
        shared = key_of(self.seed, host) if kind.scars else None
        if self.filling is None:
            return crowding(1.0, kind.clump_m, own, None)
        how = self.filling
        return crowding(how.times, kind.clump_m, own, shared, kind.territory, kind.stray, how.left)

    @property
    def filling(self) -> Filling | None:
        """How full the block's clumps are; None: it has no clumps."""
        if self.cluster == 0.0 or self.per_m2 == 0.0:
            return None
        return filling(self.block.kind, self.size_m, self.per_m2, self.cluster)


@dataclass(frozen=True)
class Rooted:
    """Copies on one host, or on several."""

    host: np.ndarray
    """int32 [N]: number of the host."""
    points: np.ndarray
    """float64 [N, 3]: roots, on the surface [m]."""
    normals: np.ndarray
    """float64 [N, 3]: smoothed normals of the surface at the roots."""
    size: np.ndarray
    """float64 [N]: sizes of the copies [m]."""
    keys: np.ndarray
    """uint64 [N]: keys of all other random choices of each copy."""
    pixels: np.ndarray
    """float64 [N]: how large they are in the nearest view [px]."""
    clump: np.ndarray
    """uint64 [N]: key of the clump that each is in; its own where it stands alone."""
    too_small: float = 0.0
    """Expected number of copies that were left out as smaller than `LEAST_PIXELS`."""

    def of(self, chosen: np.ndarray) -> "Rooted":
        """Some of the copies."""
        return Rooted(*(getattr(self, name)[chosen] for name in COLUMNS), self.too_small)


COLUMNS = ("host", "points", "normals", "size", "keys", "pixels", "clump")
NOTHING = Rooted(
    np.zeros(0, np.int32),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    np.zeros(0),
    np.zeros(0, np.uint64),
    np.zeros(0),
    np.zeros(0, np.uint64),
)


def joined(some: list[Rooted]) -> Rooted:
    """All copies of several hosts."""
    return Rooted(
        *(np.concatenate([getattr(each, name) for each in [NOTHING, *some]]) for name in COLUMNS),
        sum(each.too_small for each in some),
    )


def rooted(wanted: Wanted, host: Host, number: int, footprint: Footprint) -> Rooted:
    """Copies of a block on a host, some of which may overlap.

    Raises:
        InputError: There would be too many.
    """
    own = key_of(wanted.seed, wanted.block.seed, wanted.block.kind, host.name)
    crowd = wanted.crowding(host.name)
    area, up = host.area_and_up
    may = np.flatnonzero((area > 0.0) & (up >= wanted.up[0]) & (up <= wanted.up[1]))
    mean = wanted.per_m2 * area[may]
    least = LEAST_PIXELS * footprint.angle * host.gap[may]
    shows = least <= wanted.size_m[1]
    if (expected := (mean * wanted.share_above(least))[shows].sum()) > MOST_COPIES:
        raise InputError(
            f"puts about {expected:.3g} copies on {host.name} within {REACH_M:g} m of the course; "
            f"{MOST_COPIES} are the most",
            key=f"{wanted.key}.per_m2",
            value=wanted.per_m2,
            remedy="Lower it, or choose a smaller surface, a range of depth_m or of up.",
        )
    if wanted.filling is None:
        mean = mean * min(1.0, most_laid(wanted.block.kind, wanted.size_m) / max(wanted.per_m2, 1e-9))
    small = mean[~shows].sum()
    may, mean = may[shows], mean[shows]
    face_keys = mixed(own, host.keys[may])
    counts = poisson_counts(uniform(face_keys, 0), crowd.peak * mean)
    some = []
    ends = np.cumsum(counts)
    starts = np.searchsorted(ends, np.arange(0, int(counts.sum()) + 1, BATCH), side="right")
    for begin, end in zip(starts, [*starts[1:], len(may)], strict=True):
        faces = np.repeat(np.arange(begin, end), counts[begin:end])
        turn = np.arange(len(faces)) - np.repeat(np.cumsum(counts[begin:end]) - counts[begin:end], counts[begin:end])
        some.append(
            _kept(
                wanted,
                host,
                number,
                may[faces],
                mixed(face_keys[faces], turn.astype(np.uint64) + np.uint64(1)),
                crowd,
                footprint,
            )
        )
    found = joined(some)
    return replace(found, too_small=found.too_small + small)


def _kept(wanted, host, number, faces, keys, crowd, footprint):
    """The candidates, given by triangles and keys [N], that chance, depth and size in pixels leave."""
    size = wanted.sizes(uniform(keys, 3))
    # what no view shows goes first: it is most
    few = np.flatnonzero(size >= LEAST_PIXELS * footprint.angle * host.gap[faces])
    too_small = (len(keys) - len(few)) / crowd.peak
    faces, keys, size = faces[few], keys[few], size[few]
    weights, points = _within(host.corners[faces], keys)
    chance = uniform(keys, 4) * crowd.peak
    may = np.flatnonzero(crowd.may(points - host.origin, chance))
    faces, keys, size, weights, points, chance = (each[may] for each in (faces, keys, size, weights, points, chance))
    there = crowd(points - host.origin, _liking(wanted, host, faces, weights, points), chance)
    keep = chance < there.weight
    if wanted.block.depth_m is not None:
        below = wanted.surface_depth_m - points[:, 2]
        keep &= (below >= wanted.block.depth_m[0]) & (below <= wanted.block.depth_m[1])
    kept = np.flatnonzero(keep)
    kept = kept[footprint.distance(points[kept]) <= REACH_M]
    clump = np.where(there.clump[kept] > 0, there.clump[kept], keys[kept])
    size = np.maximum(size[kept] * grown_to(wanted.kind, there.depth[kept], clump), wanted.size_m[0])
    pixels = size / footprint(points[kept])
    wide = pixels >= LEAST_PIXELS
    few = kept[wide]
    return Rooted(
        np.full(len(few), number, np.int32),
        points[few],
        _normals(host, faces[few], weights[few]),
        size[wide],
        keys[few],
        pixels[wide],
        clump[wide],
        too_small + crowd.kept * np.count_nonzero(~wide),
    )


def _normals(host, faces, weights):
    """Smoothed normals [N, 3] at places of triangles, not of unit length."""
    a, b, c = np.moveaxis(host.corners[faces], 1, 0)
    flat = np.cross(b - a, c - a)  # where corners' normals cancel
    return np.einsum("ni,nij->nj", weights, host.normals[faces]) + 1e-6 * flat / np.linalg.norm(
        flat, axis=1, keepdims=True
    )


def _liking(wanted, host, faces, weights, points):
    """What the noise of patches is raised by at places [N] that a kind prefers: edges, undersides or tops."""
    kind = wanted.kind
    if not len(points) or wanted.cluster == 0.0 or kind.edges == kind.under == 0.0:
        return 0.0  # and no edges are looked for
    liking = kind.edges * host.edges(points - host.origin) if kind.edges else 0.0
    if kind.under:
        normals = _normals(host, faces, weights)
        liking = liking - kind.under * normals[:, 2] / np.linalg.norm(normals, axis=1)
    return liking


def _within(corners, keys):
    """Barycentric weights [N, 3], and points [N, 3], of places by chance in triangles [N, 3, 3]."""
    u, v = uniform(keys, 1), uniform(keys, 2)
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    a, b, c = np.moveaxis(corners, 1, 0)
    return np.column_stack([1.0 - u - v, u, v]), a + u[:, None] * (b - a) + v[:, None] * (c - a)
