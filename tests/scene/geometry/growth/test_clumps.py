"""Growth in clumps: how many there are, how large, how near to each other; and what it does to its hosts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import kstest

from varos_warp.scene.description.growth import Growth
from varos_warp.scene.geometry.growth import clumps, room
from varos_warp.scene.geometry.growth.chance import key_of, uniform
from varos_warp.scene.geometry.growth.clumps import (
    EMPTY_FROM,
    LEAST_CROWDED,
    OUTLINE,
    OUTLINE_MOST,
    OUTLINES,
    SPREAD,
    _left_by_scars,
    crowding,
    left_by_scars,
    scars,
    share_of,
)
from varos_warp.scene.geometry.growth.coat import Placed, coated
from varos_warp.scene.geometry.growth.dust import FROM, SILT, dusted
from varos_warp.scene.geometry.growth.grow import CURRENT, _poses, _silted, _which
from varos_warp.scene.geometry.growth.hosts import Host
from varos_warp.scene.geometry.growth.kinds import KINDS, prototypes
from varos_warp.scene.geometry.growth.placing import Rooted, Wanted, joined, rooted
from varos_warp.scene.geometry.growth.room import (
    HIGH,
    LOW,
    filling,
    full_of,
    grown_to,
    left_of,
    share_of_patches,
    sizes,
)
from varos_warp.scene.geometry.growth.solids import solid
from varos_warp.scene.geometry.growth.spacing import apart
from varos_warp.scene.geometry.parts import Part, Skin

SIDE_M = 3.0


class Everywhere:
    """A course that sees every place as from a metre away, in pixels of a tenth of a millimetre."""

    angle = 1e-4

    def distance(self, points, normals=None, radius=0.0):
        return np.ones(len(points))

    def __call__(self, points, normals=None):
        return np.full(len(points), 1e-4)


def plane():
    """A level square as a host, two triangles."""
    corner = SIDE_M * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    corners = corner[[[0, 1, 2], [0, 2, 3]]]
    normals = np.broadcast_to([0.0, 0.0, 1.0], (2, 3, 3))
    return Host("plane", np.zeros(3), corners, normals, np.arange(2, dtype=np.uint64), np.ones(2))


def settled(kind, seed, **more):
    """Copies on the plane after those that find no room are left out."""
    wanted = Wanted(Growth(on=["plane"], kind=kind, up=(-1, 1), **more), "growth.0", seed, 0.0)
    some = rooted(wanted, plane(), 0, Everywhere())
    priority = np.argsort(np.lexsort([some.keys, some.size])).astype(np.uint64)
    return some.of(apart(some.points, some.size, wanted.kind.body, priority)), some


def inside(some, margin):
    """How many copies have all of their neighbours on the plane."""
    return np.count_nonzero(((some.points[:, :2] > margin) & (some.points[:, :2] < SIDE_M - margin)).all(axis=1))


def error_of_room(wanted, crowd, monkeypatch):
    """Relative standard error of the share that finds room, from other bodies laid down by chance."""
    shares = []
    for k in range(4):
        left_of.cache_clear()
        monkeypatch.setattr("varos_warp.scene.geometry.growth.room.key_of", lambda *words, k=k: key_of(*words, k))
        share = share_of(crowd.full, crowd.stray, crowd.left)
        shares.append(left_of(wanted.block.kind, wanted.size_m, crowd.full * wanted.per_m2, share_of_patches(share)))
    return np.std(shares, ddof=1) / np.mean(shares)


@pytest.mark.parametrize(
    ("kind", "scars", "more", "seeds", "bodies"),
    [
        ("barnacle", True, {"per_m2": 230, "size_m": (0.012, 0.04)}, 8, room.BODIES),
        ("mussel", True, {}, 8, room.BODIES),
        ("mussel", False, {}, 10, room.BODIES),
        ("coralline", True, {}, 24, room.BODIES),
        ("anemone", True, {"per_m2": 1}, 24, 10_000),
        ("pebble", False, {"per_m2": 400, "size_m": (0.01, 0.07)}, 8, room.BODIES),
    ],
)
def test_the_mean_number_is_per_m2_though_bodies_need_room(kind, scars, more, seeds, bodies, monkeypatch):
    """Counted by a ratio estimator: most of the scatter between seeds is that of clumps, whose mean is known.

    What a kind prefers is left out, as it moves the mean. Of so many seeds that hardly more is known by more: what room
    bodies find is known no better. Nor is more known by more bodies than so many: of anemones there are few.
    """
    monkeypatch.setattr(room, "BODIES", bodies)
    monkeypatch.setattr("varos_warp.scene.geometry.growth.placing._liking", lambda *_: 0.0)
    monkeypatch.setitem(KINDS, kind, replace(KINDS[kind], scars=scars))
    for known in (filling, left_of):
        known.cache_clear()
    try:
        wanted = Wanted(Growth(on=["plane"], kind=kind, up=(-1, 1), **more), "growth.0", 0, 0.0)
        crowd, margin = wanted.crowding("plane"), wanted.kind.body * wanted.size_m[1]
        both = [settled(kind, seed, **more) for seed in range(seeds)]
        chance = error_of_room(wanted, crowd, monkeypatch)
    finally:
        for known in (filling, left_of):
            known.cache_clear()
    left, all_ = np.array([[inside(some, margin) for some in pair] for pair in both], float).T
    share = share_of(crowd.full, crowd.stray, crowd.left)
    mean = crowd.stray + (crowd.full * (left_by_scars() if scars else 1.0) - crowd.stray) * share
    ratio = left.sum() / all_.sum()
    error = np.sqrt(np.sum((left - ratio * all_) ** 2)) / all_.sum()
    assert abs(ratio * mean - 1.0) < 4.0 * np.hypot(mean * error, chance)


def nearest(some, body):
    """How far every copy is from the nearest other, over the least distance that the two may have."""
    gap = np.linalg.norm(some.points[:, None] - some.points, axis=2)
    gap /= 0.5 * body * (some.size[:, None] + some.size)
    np.fill_diagonal(gap, np.inf)
    return gap.min(axis=1)


def test_bodies_of_clumps_touch_and_do_not_overlap():
    """Most have a neighbour within a quarter of the least distance; as rain they have none."""
    more = {"per_m2": 200, "size_m": (0.012, 0.04)}
    body, seeds = KINDS["barnacle"].body, range(3, 7)  # in one plane there are too few clumps
    near = np.concatenate([nearest(settled("barnacle", seed, **more)[0], body) for seed in seeds])
    rain = nearest(settled("barnacle", 3, cluster=0, **more)[0], body)
    assert near.min() >= 1.0 - 1e-12
    assert np.median(near) < 1.25 < 1.5 < np.median(rain)


def test_sizes_of_what_grows_are_log_normal():
    low, high = 0.01, 0.08
    found = sizes(KINDS["turf"], (low, high), uniform(np.arange(20_000, dtype=np.uint64), 0))
    deviation = np.log(high / low) / (LOW + HIGH)
    z = (np.log(found / low) - LOW * deviation) / deviation

    def law(x):
        return (ndtr(x) - ndtr(-LOW)) / (ndtr(HIGH) - ndtr(-LOW))

    assert kstest(z, law).pvalue > 1e-3


def test_old_bodies_are_in_the_middle_and_young_ones_at_the_rim():
    clump = np.full(3, key_of("clump"))
    rim, middle, core = grown_to(KINDS["barnacle"], np.array([0.0, 0.5, 1.0]), clump)
    assert rim < middle < core <= 1.0
    _, some = settled("barnacle", 2, per_m2=400)
    same = grown_to(KINDS["barnacle"], np.zeros(len(some.clump)), some.clump)
    assert same.min() < 0.6 * same.max(), "clumps are of different ages"


def test_clumps_have_their_radius():
    """Of balls about chosen middles: places that are full lie within, those beyond the rim are empty."""
    crowd = crowding(60.0, 0.06, key_of(4), None)
    grid = np.stack(np.meshgrid(*[np.arange(0.0, 3.0, 0.01)] * 2, indexing="ij"), -1).reshape(-1, 2)
    there = crowd(np.column_stack([grid, np.zeros(len(grid))]))
    wide = [np.ptp(grid[there.clump == key], axis=0).max() for key in np.unique(there.clump[there.clump > 0])]
    assert len(wide) > 5
    assert 0.06 < np.median(wide) < 0.3
    assert max(wide) < 2.0 * EMPTY_FROM * 0.06 * np.exp(SPREAD * 2.06 + OUTLINE * OUTLINE_MOST)


def test_outlines_of_clumps_have_lobes_and_fringes():
    """Of variance 1, and alike at places 0.6 radii apart, which waves of 2.6 radii are for 0.64 of it: sin x / x."""
    radius, step = 0.06, 0.6
    points = np.random.default_rng(1).random((4000, 3)) * 20.0 * radius
    products = []
    for number in range(24):
        outline = crowding(60.0, radius, key_of(number), None).outline
        here, there = (
            sum(share * field(at) for field, share in outline) for at in (points, points + [step * radius, 0.0, 0.0])
        )
        products.append([np.mean(here * here), np.mean(here * there)])
    variance, alike = np.mean(products, axis=0)
    error = np.std(products, axis=0)[1] / np.sqrt(len(products))
    np.testing.assert_allclose(variance, 1.0, atol=0.05)
    expected = sum(share**2 * np.sinc(2.0 * step / times) for times, share in OUTLINES)
    assert abs(alike - expected) < 3.0 * error + 0.03  # waves are 0.7 to 1.7 times as long
    assert alike > 0.2


def test_places_are_the_same_whatever_else_is_asked_for():
    crowd = crowding(25.0, 0.06, key_of(1), key_of("host"))
    points = np.random.default_rng(1).random((4000, 3)) * [3.0, 3.0, 0.0]
    whole, some = crowd(points), crowd(points[::7])
    np.testing.assert_array_equal(whole.weight[::7], some.weight)
    np.testing.assert_array_equal(whole.clump[::7], some.clump)


def test_what_cannot_be_above_is_not_asked_for():
    crowd = crowding(25.0, 0.06, key_of(1), key_of("host"))
    points = np.random.default_rng(1).random((4000, 3)) * [3.0, 3.0, 0.0]
    above = crowd.peak * np.random.default_rng(2).random(4000)
    kept = crowd(points).weight > above
    np.testing.assert_array_equal(kept, crowd(points, 0.0, above).weight > above)
    assert (crowd.may(points, above) | ~kept).all()


def copies(count, normal, size=0.02):
    keys = np.arange(1, count + 1, dtype=np.uint64)
    return Rooted(
        np.zeros(count, np.int32),
        np.zeros((count, 3)),
        np.tile(np.asarray(normal, float), (count, 1)),
        np.full(count, size),
        keys,
        np.full(count, 50.0),
        np.full(count, key_of("clump")),
    )


@pytest.mark.parametrize(
    ("silt", "normal", "share"), [(0.6, [0, 0, 1], 0.6), (0.6, [0, 0, -1], 0.0), (0, [0, 0, 1], 0)]
)
def test_silt_lies_on_what_looks_up_as_on_the_host(silt, normal, share):
    found = _silted(Placed(["host"], np.array([float(silt)]), copies(4000, normal))).mean()
    assert abs(found - share) <= 4.0 * np.sqrt(share * (1.0 - share) / 4000)


def test_on_walls_silt_is_on_the_upper_side():
    some = copies(200, [0.0, -1.0, 0.0])
    up = _poses(some, KINDS["barnacle"], np.ones(200, bool))[:, 2, :3] / 0.02 @ FROM
    assert up.min() > 0.2


def test_hydroids_of_a_wall_bend_with_the_current_and_barnacles_do_not():
    some = copies(400, [0.0, -1.0, 0.0])
    clean = np.zeros(400, bool)
    along = CURRENT - [0.0, CURRENT[1], 0.0]
    along /= np.linalg.norm(along)
    bent, any_way = (_poses(some, KINDS[kind], clean)[:, :3, 1] / 0.02 @ along for kind in ("hydroid", "barnacle"))
    assert np.quantile(bent, 0.1) > 0.3, "those that lean far have none of their own way"
    assert abs(any_way.mean()) < 4.0 * np.sqrt(0.5 / 400)


def test_dust_lies_where_it_comes_from():
    for shape in (levels[0] for levels in prototypes("barnacle")[:2]):
        dusty = dusted(solid(shape.vertices, shape.faces, np.zeros(3)), thin=False)
        high, low = (dusty.colours[side * shape.vertices[:, 1] > 0.3].mean() for side in (1, -1))
        assert high > 1.5 * low > 0.0
        assert dusty.colours.max() <= SILT.max()


def test_tints_of_a_clump_are_much_alike():
    kind = KINDS["barnacle"]
    some = copies(500, [0, 0, 1])
    tones = _which(some, kind, np.zeros(500, bool)) % (len(kind.tints) + len(kind.dusty))
    assert tones.max() < len(kind.tints)
    clean = _which(some, kind, np.ones(500, bool)) % (len(kind.tints) + len(kind.dusty))
    assert clean.min() >= len(kind.tints)


def grid_part(colour=0.5, **more):
    points = np.stack(np.meshgrid(np.linspace(0, 1, 51), np.linspace(0, 1, 51), indexing="ij"), -1).reshape(-1, 2)
    i = (np.arange(50)[:, None] * 51 + np.arange(50)).ravel()
    faces = np.vstack([np.stack([i, i + 51, i + 52], -1), np.stack([i, i + 52, i + 1], -1)]).astype(np.int32)
    skin = Skin(np.full((len(faces), 3, 3), colour, np.float32), **more)
    return Part("host", np.column_stack([points, np.zeros(len(points))]), faces, SimpleNamespace(), skin=skin)


def test_hosts_are_coated_at_the_feet_of_copies_only():
    some = joined([copies(1, [0, 0, 1], 0.04)])
    some.points[:] = [0.5, 0.5, 0.0]
    part = grid_part()
    (done,) = coated([part], [(KINDS["turf"], Placed(["host"], np.zeros(1), some))])
    far = np.linalg.norm(part.vertices - some.points, axis=1)[part.faces]
    assert (done.skin.corners[far < 0.001] < 0.3).all()
    assert (done.skin.corners[far > 0.11] == 0.5).all()
    assert (part.skin.corners == 0.5).all(), "the part itself is as it was"


def test_fewer_find_room_where_there_are_more_or_scars():
    size_m = KINDS["mussel"].size_m
    full = full_of("mussel", size_m)
    packed, loose = (left_of("mussel", size_m, density, share_of_patches(0.1)) for density in (full, 0.1 * full))
    assert 0.1 < packed < 0.5 < loose < left_by_scars()
    assert left_of("turf", KINDS["turf"].size_m, 1e5, 0.1) == left_by_scars(), "turf may overlap"
    assert left_of("kelp", KINDS["kelp"].size_m, 1e-3, 0.1) == 1.0, "nor does kelp leave scars"


def test_what_scars_leave_is_the_mean_of_their_field():
    z = np.linspace(-8.0, 8.0, 200_001)
    density = np.exp(-0.5 * z * z)
    for power in (1, 2):
        leaves, shares = scars()
        mean = density @ _left_by_scars(z) ** power / density.sum()
        assert abs(shares @ leaves**power - mean) < 1e-4
    assert abs(shares.sum() - 1.0) < 1e-6


def test_more_than_find_room_are_told_of():
    how = filling("barnacle", (0.02, 0.03), 20_000.0, 11.0)
    assert 100.0 < how.most < 1500.0
    assert filling("barnacle", (0.02, 0.03), 0.5 * how.most, 11.0).most == 0.5 * how.most


@pytest.mark.parametrize(("kind", "per_m2", "cluster"), [("starfish", 60.0, 1.0), ("shell", 1500.0, 1.0)])
def test_what_is_left_is_that_of_the_clumps_that_are_made(kind, per_m2, cluster):
    """Where loose kinds stand so close that clumps must be fuller, fewer find room in them."""
    size_m = KINDS[kind].size_m
    how = filling(kind, size_m, per_m2, cluster)
    share = share_of_patches(share_of(how.times, KINDS[kind].stray, how.left))
    again = left_of(kind, size_m, how.times * per_m2, share)
    assert how.left == pytest.approx(again, rel=0.04)  # twice of what chance there is in it
    assert how.most == pytest.approx(min(how.times * again / LEAST_CROWDED, 1.0) * per_m2, rel=0.04)


def test_no_clump_that_reaches_a_place_is_missed():
    """Of all sizes, and of places that clumps reach twice as far to as to others: those of all pairs."""
    rng = np.random.default_rng(3)
    middle, points = rng.random((200, 3)), rng.random((500, 3))
    radius, reach = np.exp(rng.uniform(-4.0, -1.0, 200)), np.exp(rng.uniform(-0.7, 0.7, 500))
    far = np.linalg.norm(middle[:, None] - points, axis=2) / (radius[:, None] * reach)
    site, at, x = clumps._near(middle, radius, points, reach)
    order = np.lexsort([at, site])
    np.testing.assert_array_equal(np.stack([site, at])[:, order], np.nonzero(far < clumps.HALO_TO))
    np.testing.assert_allclose(x[order], far[far < clumps.HALO_TO], rtol=1e-12)
