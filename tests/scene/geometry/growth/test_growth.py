"""Where copies of growth stand: on their hosts, as many as asked for, in clusters, whatever else there is."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.stats import chi2

from varos_warp.errors import InputError
from varos_warp.scene.description.growth import Growth
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.growth import placing
from varos_warp.scene.geometry.growth.chance import key_of, poisson_counts, uniform
from varos_warp.scene.geometry.growth.clumps import FULL_TO, crowding
from varos_warp.scene.geometry.growth.edges import edges_of
from varos_warp.scene.geometry.growth.hosts import REACH_M
from varos_warp.scene.geometry.growth.kinds import KINDS, prototypes
from varos_warp.scene.geometry.growth.spacing import apart
from varos_warp.scene.geometry.parts import Grown, Instances
from varos_warp.scene.geometry.relief.density import ASIDE_M, footprint
from varos_warp.scene.geometry.topology import area_normals

HILLS = {"kind": "procedural", "size_m": 12, "resolution": 13, "relief_m": 3.0, "feature_m": 5}
ROCK = {"kind": "boulder", "diameter": 1.2, "position": [0, 2, 0.4], "chord_error_m": 0.01}
EVEN = {"kind": "hydroid", "cluster": 0, "size_m": [0.2, 0.2], "up": [-1, 1]}


def scene(*growth, **more):
    """Growth on hills and a boulder around cameras of large pixels that look along all six axes."""
    turns = [[0, 0, 0], [0, 0, 90], [0, 0, 180], [0, 0, -90], [90, 0, 0], [-90, 0, 0]]
    cameras = [
        {"id": f"M{i}", "resolution": [320, 320], "sensor_mm": [9.6, 9.6], "focal_mm": 4.8, "rotation_euler_deg": turn}
        for i, turn in enumerate(turns)
    ]
    return scene_from_dict(
        {
            "trajectory": {"poses": [{"position": [0, 0, 3]}]},
            "terrain": HILLS,
            "objects": [ROCK],
            "vehicle": {"cameras": cameras},
            "growth": list(growth),
            **more,
        }
    )


def grown(*growth, **more) -> list[Grown]:
    return [part for part in build_parts(scene(*growth, **more)) if isinstance(part, Grown)]


def roots(groups):
    return np.concatenate([np.zeros((0, 3)), *(group.T_w_o[:, :3, 3] for group in groups)])


def sizes(groups):
    return np.concatenate([group.scale for group in groups])


def in_order(points):
    return points[np.lexsort(points.T)]


def host_mesh(number):
    part = build_parts(scene())[number]
    return trimesh.Trimesh(part.vertices, part.faces, process=False)


def cells(points):
    """Counts on the squares of 1 m of the terrain, of which each is two triangles."""
    return np.histogram2d(*points[:, :2].T, bins=[np.arange(-6, 7)] * 2)[0]


def test_counts_are_poisson_by_the_area_of_the_surface():
    counts = cells(roots(grown({"on": ["terrain"], "per_m2": 30, "seed": 3, **EVEN})))
    terrain = host_mesh(0)
    middle = terrain.triangles_center
    area = np.histogram2d(*middle[:, :2].T, bins=[np.arange(-6, 7)] * 2, weights=terrain.area_faces)[0]
    assert np.ptp(area) > 0.1
    statistic = ((counts - 30 * area) ** 2 / (30 * area)).sum()
    assert chi2.ppf(1e-4, area.size) < statistic < chi2.ppf(1.0 - 1e-4, area.size)


def test_clusters_raise_the_variance():
    level = {"terrain": {**HILLS, "relief_m": 0.0}}
    even, crowded = (
        cells(roots(grown({"on": ["terrain"], "per_m2": 30, **EVEN, "cluster": cluster}, **level)))
        for cluster in (0, 9)
    )
    error = np.sqrt(2.0 / even.size)  # of the variance over the mean, where that is 1
    assert abs(even.var() / even.mean() - 1.0) < 4.0 * error
    assert crowded.var() / crowded.mean() > 1.0 + 20.0 * error


@pytest.mark.parametrize("host", [None, "host"])
@pytest.mark.parametrize("times", [4.0, 25.0])
def test_the_mean_over_all_hosts_is_one(times, host):
    places = np.random.default_rng(0).random((300, 3)) * [4.0, 4.0, 0.0]
    means = [crowding(times, 0.06, key_of(k), host and key_of(host, k))(places).weight.mean() for k in range(120)]
    # 24 waves are not quite a normal variable: a hundredth, and some more of what is rare
    assert abs(np.mean(means) - 1.0) < 4.0 * np.std(means) / np.sqrt(len(means)) + 0.01


@pytest.mark.usefixtures("few_bodies")
@pytest.mark.parametrize(("host", "number"), [("terrain", 0), ("objects.0", 1)])
def test_every_root_lies_on_its_host(host, number):
    points = roots(grown({"on": [host], "kind": "barnacle", "per_m2": 60, "size_m": [0.05, 0.1]}))
    mesh = host_mesh(number)
    assert len(points) > 20
    _, distance, _ = trimesh.proximity.closest_point_naive(mesh, points)
    assert distance.max() < 1e-6 * np.linalg.norm(mesh.extents)


def test_copies_of_a_scatter_carry_growth_where_they_stand():
    s = {
        "scatter": [
            {
                "object": {k: ROCK[k] for k in ("kind", "diameter", "chord_error_m")},
                "count": 6,
                "scale_range": [0.5, 1.0],
            }
        ],
        "objects": [],
    }
    groups = grown({"on": ["scatter.0"], "kind": "barnacle", "per_m2": 60, "cluster": 0, "size_m": [0.05, 0.1]}, **s)
    (rocks,) = [part for part in build_parts(scene(**s)) if part.name == "scatter.0"]
    copies = {part.name: trimesh.Trimesh(part.vertices, part.faces, process=False) for part in rocks.parts()}
    carrying = set()
    for group in groups:
        for k, name in enumerate(group.hosts):
            if (mine := group.host == k).any():
                carrying.add(name)
                distance = trimesh.proximity.closest_point_naive(copies[name], group.T_w_o[mine, :3, 3])[1]
                assert distance.max() < 1e-6
    assert carrying == set(copies)


def test_the_ranges_of_slope_and_depth_are_kept():
    block = {"on": ["objects.0"], "per_m2": 200, **EVEN, "up": [-0.2, 0.6], "depth_m": [9.4, 9.8]}
    points = roots(grown(block, surface_depth_m=10.0))
    mesh = host_mesh(1)
    _, _, face = trimesh.proximity.closest_point_naive(mesh, points)
    assert len(points) > 20
    up = mesh.face_normals[face][:, 2]
    assert (up > -0.2 - 1e-9).all()
    assert (up < 0.6 + 1e-9).all()
    assert (points[:, 2] > 0.2 - 1e-9).all()
    assert (points[:, 2] < 0.6 + 1e-9).all()


@pytest.mark.usefixtures("few_bodies")
def test_sizes_are_those_asked_for():
    small, large = 0.05, 0.15
    size = sizes(grown({"on": ["terrain"], "kind": "shell", "per_m2": 20, "size_m": [small, large]}))
    assert small * (1 - 1e-9) < size.min() < 0.06
    assert 0.12 < size.max() < large * (1 + 1e-9)


def test_sizes_follow_a_power_law():
    for kind in ("shell", "pebble"):
        wanted = placing.Wanted(Growth(on=["terrain"], kind=kind), "growth.0", 1, 0.0)
        sizes = wanted.sizes(np.linspace(0.0, 1.0, 1001))
        np.testing.assert_allclose(wanted.share_above(sizes), np.linspace(1.0, 0.0, 1001), atol=1e-12)
        density = -np.diff(wanted.share_above(sizes := np.geomspace(*wanted.size_m, 200))) / np.diff(sizes)
        slope = np.polyfit(np.log(0.5 * (sizes[1:] + sizes[:-1])), np.log(density), 1)[0]
        assert abs(slope + KINDS[kind].small) < 0.01


@pytest.mark.usefixtures("few_bodies")
def test_the_places_do_not_depend_on_what_else_there_is():
    alone = {"on": ["objects.0"], "kind": "barnacle", "size_m": [0.05, 0.1]}
    other = {"on": ["terrain", "objects.0"], "kind": "shell", "size_m": [0.1, 0.1]}
    first, again = grown(alone), grown(alone)
    assert all(np.array_equal(a.T_w_o, b.T_w_o) for a, b in zip(first, again, strict=True))
    beside = [group for group in grown(other, alone) if group.name == "growth.1"]
    np.testing.assert_array_equal(in_order(roots(beside)), in_order(roots(first)))
    elsewhere = grown(alone, trajectory={"poses": [{"position": [1, -1, 3]}]})
    np.testing.assert_array_equal(in_order(roots(elsewhere)), in_order(roots(first)))
    assert not np.array_equal(in_order(roots(grown({**alone, "seed": 2})))[:5], in_order(roots(first))[:5])


@pytest.mark.usefixtures("few_bodies")
def test_batches_do_not_show(monkeypatch):
    block = {"on": ["terrain"], "kind": "shell", "size_m": [0.1, 0.1], "per_m2": 20}
    whole = grown(block)
    monkeypatch.setattr(placing, "BATCH", 100)
    for a, b in zip(whole, grown(block), strict=True):
        np.testing.assert_array_equal(a.T_w_o, b.T_w_o)


@pytest.mark.usefixtures("few_bodies")
def test_bodies_do_not_overlap():
    groups = grown({"on": ["terrain"], "kind": "starfish", "per_m2": 3, "size_m": [0.2, 0.4]})
    points, size = roots(groups), sizes(groups)
    gap = np.linalg.norm(points[:, None] - points, axis=2) - 0.5 * (size[:, None] + size)
    np.fill_diagonal(gap, np.inf)
    assert len(points) > 100
    assert gap.min() >= -1e-12


def test_thinning_is_that_of_one_after_the_other():
    rng = np.random.default_rng(1)
    points, size, priority = rng.random((400, 3)) * [1, 1, 0], rng.uniform(0.02, 0.1, 400), rng.permutation(400)
    kept = []
    for i in np.argsort(-priority):
        if all(np.linalg.norm(points[i] - points[j]) >= 0.4 * (size[i] + size[j]) for j in kept):
            kept.append(i)
    assert set(np.flatnonzero(apart(points, size, 0.8, priority.astype(np.uint64)))) == set(kept)


@pytest.mark.usefixtures("few_bodies")
def test_more_than_find_room_are_told_so():
    with pytest.warns(UserWarning, match=r"growth\.0\.per_m2: no 300 starfish of 0\.2 to 0\.4 m find room.*lower it"):
        assert grown({"on": ["terrain"], "kind": "starfish", "per_m2": 300, "size_m": [0.2, 0.4]})


def test_a_block_that_asks_for_none_is_told_so():
    with pytest.warns(UserWarning, match=r"growth\.0: no barnacle is placed: its per_m2 is 0"):
        assert grown({"on": ["terrain"], "kind": "barnacle", "per_m2": 0}) == []


@pytest.mark.usefixtures("few_bodies")
def test_what_is_smaller_than_one_and_a_half_pixels_is_left_out_and_told():
    """A pixel is 1/160 wide at a metre: 2 cm from the nearest of the hills, which is over 2 m away."""
    with pytest.warns(UserWarning, match=r"growth\.0: no barnacle is placed: all of about \d+ would be smaller"):
        assert grown({"on": ["terrain"], "kind": "barnacle", "size_m": [0.002, 0.004]}) == []
    facts = grown({"on": ["terrain"], "kind": "barnacle", "per_m2": 50, "size_m": [0.01, 0.05]})[0].facts
    assert facts["too_small"] > 0 < facts["copies"]


@pytest.mark.usefixtures("few_bodies")
def test_no_copy_is_smaller_than_one_and_a_half_pixels_of_the_nearest_view():
    block = {"on": ["terrain"], "kind": "shell", "per_m2": 60, "size_m": [0.001, 0.1]}
    groups = grown(block)
    near = footprint(scene(), build_parts(scene()))
    pixels = sizes(groups) / near(roots(groups))
    assert 1.5 <= pixels.min() < 1.6


@pytest.mark.usefixtures("few_bodies")
def test_there_is_none_far_from_the_course():
    far = {"terrain": {**HILLS, "size_m": 120, "resolution": 61, "relief_m": 0.0}}
    points = roots(grown({"on": ["terrain"], "kind": "kelp", "per_m2": 0.5}, **far))
    away = np.linalg.norm(points - [0, 0, 3], axis=1)
    assert 20.0 < away.max() < REACH_M + ASIDE_M


def test_large_triangles_are_as_full_as_small_ones():
    plain = {"terrain": {"kind": "procedural", "size_m": 30, "resolution": 2, "relief_m": 0.0}, "objects": []}
    points = roots(grown({"on": ["terrain"], "per_m2": 4, **EVEN}, **plain))
    counts = np.histogram2d(*points[:, :2].T, bins=[np.linspace(-15, 15, 11)] * 2)[0]
    statistic = ((counts - 36) ** 2 / 36).sum()
    assert chi2.ppf(1e-4, 100) < statistic < chi2.ppf(1.0 - 1e-4, 100)


def test_too_many_are_refused():
    with pytest.raises(InputError, match=r"growth\.0\.per_m2 = 50000.*Lower it"):
        grown({"on": ["terrain"], "kind": "kelp", "per_m2": 50_000})


def test_numbers_of_poisson_are_those_of_their_distribution():
    keys = np.arange(200_000, dtype=np.uint64)
    for mean in (0.03, 1.5, 40.0):
        counts = poisson_counts(uniform(keys, 0), np.full(len(keys), mean))
        assert abs(counts.mean() - mean) < 4.0 * np.sqrt(mean / len(keys))
        assert abs(counts.var() / mean - 1.0) < 4.0 * np.sqrt((2.0 + 1.0 / mean) / len(keys))


@pytest.mark.parametrize("kind", KINDS)
def test_prototypes_are_of_unit_size_and_dull_as_the_sea_is(kind):
    shapes = prototypes(kind)
    assert 4 <= len(shapes) <= 12
    for shape in (level for levels in shapes for level in levels):
        height, wide = shape.vertices[:, 2].max(), np.ptp(shape.vertices, axis=0).max()
        assert abs((height if KINDS[kind].tall else wide) - 1.0) < 1e-9
        assert (shape.colours >= 0.0).all()
        assert shape.colours.mean() < 0.35
        assert shape.vertices[:, 2].min() < 0.0, "nothing shows under its foot"


@pytest.mark.parametrize("kind", ["barnacle", "coralline", "starfish", "pebble", "mussel", "anemone"])
def test_faces_of_bodies_look_outwards(kind):
    for shape in prototypes(kind)[0]:
        normals, middle = area_normals(shape.vertices, shape.faces), shape.vertices[shape.faces].mean(axis=1)
        foot = np.array([0.0, 0.0, min(0.0, shape.vertices[:, 2].min())])
        assert (normals * (middle - foot)).sum() > 0.0


@pytest.mark.usefixtures("few_bodies")
def test_copies_all_at_once_are_those_one_by_one():
    groups = [*grown({"on": ["objects.0"], "kind": "barnacle", "size_m": [0.05, 0.1]})]
    groups += [
        part
        for part in build_parts(
            scene(scatter=[{"object": {"kind": "nut", "size": "M64"}, "count": 40, "max_tilt_deg": 30}])
        )
        if isinstance(part, Instances)
    ]
    for group in groups:
        parts, joined = group.parts(), group.joined()
        np.testing.assert_array_equal(joined.vertices, np.concatenate([part.vertices for part in parts]))
        corners = [part.vertices[part.faces] for part in parts]
        np.testing.assert_array_equal(joined.vertices[joined.faces], np.concatenate(corners))
        boxes = [[box.vertices.min(axis=0), box.vertices.max(axis=0)] for box in group.boxes()]
        np.testing.assert_array_equal(group.extents(), boxes)
        assert [part.name for part in parts] == group.names


def test_a_block_of_boulders_may_have_several_shapes():
    block = {"object": {"kind": "boulder", "diameter": 0.4, "chord_error_m": 0.01, "seed": 5}, "count": 11}
    groups = [part for part in build_parts(scene(scatter=[{**block, "shapes": 4}])) if isinstance(part, Instances)]
    assert [len(group) for group in groups] == [3, 3, 3, 2]
    assert [name for group in groups for name in group.names] == [f"scatter.0.{i}" for i in range(11)]
    assert len({group.vertices.tobytes() for group in groups}) == 4
    (one,) = [part for part in build_parts(scene(scatter=[block])) if isinstance(part, Instances)]
    np.testing.assert_array_equal(one.vertices, groups[0].vertices)


@pytest.mark.parametrize("cuts", [0, 5])
def test_edges_stand_out_and_planes_do_not(cuts):
    """Of a cube of a metre: samples of its two large triangles a side scatter, small ones do not."""
    box = trimesh.creation.box([1.0, 1.0, 1.0])
    for _ in range(cuts):
        box = box.subdivide()
    edges = edges_of(np.asarray(box.triangles), np.arange(len(box.faces), dtype=np.uint64))
    level, edge, corner = edges(np.array([[0.03, 0.07, 0.5], [0.5, 0.1, 0.5], [0.5, 0.5, 0.5]]))
    assert abs(level) < 1e-9
    assert edge > 0.4
    assert corner > 0.4


def test_thin_plates_are_edges_at_their_rims_only():
    plate = trimesh.creation.box([0.5, 0.5, 0.002])
    edges = edges_of(np.asarray(plate.triangles), np.arange(len(plate.faces), dtype=np.uint64))
    np.testing.assert_array_equal(edges(np.array([[0.05, 0.05, 0.001], [0.249, 0.05, 0.001]])), [0.0, 1.0])


def test_bars_are_edges_all_around():
    bar = trimesh.creation.cylinder(0.012, 0.5)
    edges = edges_of(np.asarray(bar.triangles), np.arange(len(bar.faces), dtype=np.uint64))
    np.testing.assert_array_equal(edges(np.array([[0.012, 0.0, 0.05], [0.0, -0.012, 0.0]])), 1.0)


def test_walls_of_a_pipe_are_no_edges():
    pipe = trimesh.creation.annulus(0.18, 0.2, 2.0)
    edges = edges_of(np.asarray(pipe.triangles), np.arange(len(pipe.faces), dtype=np.uint64))
    angle = np.linspace(0.0, 6.0, 50)
    out = edges(np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.linspace(-0.8, 0.8, 50)]))
    assert out.mean() < 0.2


def test_a_host_of_which_nothing_is_near_has_no_edges():
    nothing = edges_of(np.zeros((0, 3, 3)), np.zeros(0, np.uint64))
    assert len(nothing(np.zeros((0, 3)))) == 0


@pytest.mark.usefixtures("few_bodies")
def test_fewer_barnacles_are_fewer_clumps_and_no_looser_ones():
    wanted = [placing.Wanted(Growth(on=["terrain"], kind="barnacle", per_m2=n), "growth.0", 1, 0.0) for n in (400, 800)]
    few, many = (each.per_m2 * each.crowding("terrain").peak for each in wanted)
    assert abs(few / many - 1.0) < 1e-6


@pytest.mark.usefixtures("few_bodies")
def test_more_mussels_are_larger_beds_and_no_fuller_ones():
    wanted = [placing.Wanted(Growth(on=["terrain"], kind="mussel", per_m2=n), "growth.0", 1, 0.0) for n in (200, 1600)]
    few, many = (each.per_m2 * each.crowding("terrain").peak for each in wanted)
    assert abs(few / many - 1.0) < 1e-6


def test_copies_are_smaller_at_the_rim_of_their_clump():
    crowd = crowding(25.0, 0.06, key_of(1), None)
    there = crowd(np.random.default_rng(0).random((20_000, 3)) * [5.0, 5.0, 0.0])
    assert (there.depth[there.weight == there.weight.min()] == 0.0).all(), "what stands alone"
    full = there.weight > 0.99 * crowd.peak
    within = 1.0 - FULL_TO**2  # a clump that overlaps no other is full where it is so deep
    assert np.median(there.depth[full]) > within > 2.0 * np.median(there.depth[~full & (there.depth > 0.0)])
    assert (there.clump > 0)[there.depth > 0.0].all()


def test_kinds_half_a_turn_apart_have_their_territories_where_the_other_has_not():
    places = np.random.default_rng(0).random((20_000, 3)) * [10.0, 10.0, 0.0]
    one, other = (
        crowding(25.0, 0.06, key_of(k), key_of("host"), territory)(places).weight > 5.0
        for k, territory in ((1, 0.0), (2, 0.5))
    )
    assert np.count_nonzero(one & other) < 0.2 * one.mean() * other.mean() * len(places)


def test_a_host_beyond_reach_carries_none_of_a_kind_that_prefers_edges():
    far = {**ROCK, "position": [2 * REACH_M, 0, 0.4]}
    (group,) = grown(
        {"kind": "hydroid", "on": ["objects.0", "objects.1"], "per_m2": 200, "seed": 1}, objects=[ROCK, far]
    )[:1]
    assert set(np.array(group.hosts)[group.host]) == {"objects.0"}


def density_ratio(kind, there, **host):
    """How many more copies of a kind stand on a square metre of a lone host where ``there`` says than elsewhere."""
    block = {"kind": kind, "on": ["objects.0"], "per_m2": 400, "size_m": [0.03, 0.03], "cluster": 9}
    groups = [group for seed in range(6) for group in grown(block | {"seed": seed}, **host)]
    part = build_parts(scene(**host))[1]
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    even, of = trimesh.sample.sample_surface(mesh, 20_000, seed=1)
    points = roots(groups)
    assert len(points) > 500
    _, at = cKDTree(mesh.triangles_center).query(points)
    share, by_area = there(points, mesh.face_normals[at]).mean(), there(even, mesh.face_normals[of]).mean()
    return share / (1.0 - share) / (by_area / (1.0 - by_area))


@pytest.mark.usefixtures("few_bodies")
def test_kinds_that_prefer_edges_are_denser_there():
    """Within 3 cm of the edges of a block: 2.7 times as dense as elsewhere, and 0.85 times without liking."""
    low, high = np.array([-0.6, 1.4, 0.4]), np.array([0.6, 2.6, 1.0])
    box = {"kind": "concrete_block", "size_m": [1.2, 1.2, 0.6], "chamfer_m": 0, "eyes": 0, "position": [0, 2, 0.4]}

    def at_edges(points, _):
        return np.sort(np.minimum(points - low, high - points), axis=1)[:, 1] < 0.03

    assert KINDS["hydroid"].edges > 1.0
    assert density_ratio("hydroid", at_edges, objects=[box]) > 1.8


@pytest.mark.usefixtures("few_bodies")
def test_kinds_that_prefer_undersides_are_denser_there_and_those_that_prefer_tops_above():
    ratios = {
        kind: density_ratio(kind, lambda _, normals: normals[:, 2] < 0.0, objects=[{**ROCK, "position": [0, 2, 2]}])
        for kind in ("tube_worm", "turf")
    }
    assert KINDS["tube_worm"].under > 0.0 > KINDS["turf"].under
    assert ratios["tube_worm"] > 1.5
    assert ratios["turf"] < 1.0 / 1.5
