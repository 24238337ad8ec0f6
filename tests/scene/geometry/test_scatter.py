import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.stats import kstest

from varos_warp.errors import InputError
from varos_warp.scene.checks import check_scene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_instances, build_parts, build_single_parts
from varos_warp.scene.geometry.parts import Instances
from varos_warp.scene.geometry.query import heights_at
from varos_warp.scene.geometry.scatter import _scales
from varos_warp.scene.geometry.surface import Surface
from varos_warp.scene.geometry.terrain import write_ply
from varos_warp.scene.info import scene_info

NUT = {"kind": "nut", "size": "M64", "chord_error_m": 2e-3}
ROCK = {"kind": "boulder", "diameter": 0.4, "chord_error_m": 0.01}
HILLS = {"kind": "procedural", "size_m": 20, "resolution": 65, "relief_m": 2.0, "feature_m": 6}
FLAT = {**HILLS, "relief_m": 0.0}


def scene(*blocks, terrain=HILLS, folder=".", **more):
    return scene_from_dict(
        {"trajectory": {"poses": [{"position": [0, 0, 5]}]}, "terrain": terrain, "scatter": list(blocks), **more},
        folder,
    )


def scattered(*blocks, **more) -> list[Instances]:
    s = scene(*blocks, **more)
    return build_instances(s, build_single_parts(s))


def places(instances):
    return instances.T_w_o[:, :3, 3]


def slope(folder, angle_deg=30.0):
    """A plane that rises along x."""
    x = np.array([[-5, -5], [5, -5], [5, 5], [-5, 5]], float)
    vertices = np.column_stack([x, np.tan(np.radians(angle_deg)) * x[:, 0]])
    write_ply(folder / "slope.ply", vertices, np.array([[0, 1, 2], [0, 2, 3]]))
    return {"file": "slope.ply"}


def test_copies_stand_on_the_terrain_and_sink_in_as_far_as_is_asked():
    (still,), (sunk,) = (
        scattered({"object": ROCK, "count": 40, "sink_m": sink, "scale_range": [0.5, 2.0]}) for sink in (0.0, 0.1)
    )
    terrain = build_single_parts(scene())[0]
    ground = np.array([z[-1] for z in heights_at(terrain.vertices, terrain.faces, places(still)[:, :2])])
    np.testing.assert_allclose(places(still)[:, 2], ground, atol=1e-9)
    scale = np.linalg.norm(still.T_w_o[:, :3, 0], axis=1)
    for instances, depth in ((still, 0.0), (sunk, 0.1)):
        lowest = np.array([part.vertices[:, 2].min() for part in instances.parts()])
        np.testing.assert_allclose(lowest, ground - depth * scale, atol=1e-9)


def test_copies_keep_the_clearance_between_the_circles_around_them():
    (instances,) = scattered({"object": NUT, "count": 100, "clearance_m": 0.2, "circle": [1, 2, 4]})
    radius = np.linalg.norm(instances.vertices[:, :2], axis=1).max()
    assert pdist(places(instances)[:, :2]).min() >= 2.0 * radius + 0.2
    closer = scattered({"object": NUT, "count": 100, "clearance_m": -0.05, "circle": [1, 2, 0.8]})[0]
    assert 2.0 * radius - 0.05 <= pdist(places(closer)[:, :2]).min() < 2.0 * radius


def test_copies_of_two_blocks_keep_clear_of_each_other():
    one, two = scattered(
        {"object": NUT, "count": 30, "circle": [0, 0, 2]},
        {"object": ROCK, "count": 10, "circle": [0, 0, 2], "clearance_m": 0.1},
    )
    radii = [np.linalg.norm(i.vertices[:, :2], axis=1).max() for i in (one, two)]
    gap = np.linalg.norm(places(one)[:, None, :2] - places(two)[None, :, :2], axis=2) - sum(radii)
    assert gap.min() >= 0.1


def test_copies_keep_clear_of_objects_and_do_not_lie_in_them():
    objects = [
        {"kind": "pipe", "radius": 0.2, "length": 6, "position": [0, 0, 0.2], "rotation_euler_deg": [0, 90, 0]},
        {"kind": "boulder", "diameter": 5.0, "position": [0, 4, 0], "chord_error_m": 0.05},
    ]
    stone = ROCK | {"chord_error_m": 0.1, "diameter": 0.2}
    block = {"object": stone, "count": 80, "area": [-4, -2, 4, 5], "clearance_m": 0.3}
    s = scene(block, terrain=FLAT, objects=objects)
    parts = build_single_parts(s)
    (instances,) = build_instances(s, parts)
    for part in parts[1:]:
        corners = np.concatenate([copy.vertices for copy in instances.parts()])
        assert Surface(part.vertices, part.faces).nearest(corners)[0].min() >= 0.3
    rock = parts[2].vertices
    beside = np.linalg.norm(places(instances)[:, :2] - [0, 4], axis=1)
    assert beside.min() > np.linalg.norm(rock[:, :2] - [0, 4], axis=1).min()
    (free,) = scattered(block, terrain=FLAT)
    assert (np.abs(places(free)[:, 1]) < 0.3).any()  # without the objects there are some


@pytest.mark.parametrize(
    "region", [{"area": [-3, -1, 2, 5]}, {"circle": [2, -3, 1.5]}, {"polygon": [[0, 0], [6, 1], [1, 2], [0, 7]]}]
)
def test_copies_fill_their_area_evenly_and_nothing_else(region):
    (instances,) = scattered({"object": {"kind": "nut", "size": "M3"}, "count": 400, **region}, terrain=FLAT)
    xy = places(instances)[:, :2]
    if "area" in region:
        u = (xy - [-3, -1]) / [5, 6]
    elif "circle" in region:
        u = ((np.linalg.norm(xy - [2, -3], axis=1) / 1.5) ** 2)[:, None]
    else:
        arrow = (xy[:, 0] + 6 * xy[:, 1] <= 13) | (5 * xy[:, 0] + xy[:, 1] <= 7)  # below either side of the dent
        assert (xy >= 0).all()
        assert arrow.all()
        u = np.zeros((0, 1))
    assert (u >= 0).all()
    assert (u <= 1).all()
    # means of uniform numbers: 4 standard errors of 1 / sqrt(12 n)
    assert np.all(np.abs(u.mean(axis=0) - 0.5) < 4.0 / np.sqrt(12 * 400)) if len(u) else True


def test_copies_follow_from_the_seeds_alone_and_more_of_them_keep_the_first_ones():
    block = {"object": ROCK, "count": 50, "scale_range": [0.5, 1.5]}
    few, many = scattered(block)[0].T_w_o, scattered({**block, "count": 80})[0].T_w_o
    np.testing.assert_array_equal(few, many[:50])
    assert np.abs(few - scattered({**block, "seed": 2})[0].T_w_o).max() > 0.1
    assert np.abs(few - scattered(block, seed=2)[0].T_w_o).max() > 0.1


def test_copies_lean_with_the_slope_as_far_as_they_may(tmp_path):
    normal = np.array([-np.sin(np.pi / 6), 0.0, np.cos(np.pi / 6)])
    for most, angle in ((0.0, 0.0), (10.0, 10.0), (90.0, 30.0)):
        (instances,) = scattered(
            {"object": NUT, "count": 5, "max_tilt_deg": most}, terrain=slope(tmp_path), folder=tmp_path
        )
        up = instances.T_w_o[:, :3, 2]
        np.testing.assert_allclose(np.degrees(np.arccos(up[:, 2])), angle, atol=1e-6)
        if most == 90.0:
            np.testing.assert_allclose(up, np.tile(normal, (5, 1)), atol=1e-9)


def test_copies_leave_steep_ground_alone():
    terrain = build_single_parts(scene())[0]
    (instances,) = scattered({"object": {"kind": "nut", "size": "M3"}, "count": 200, "max_slope_deg": 5})
    xy, d = places(instances)[:, :2], 0.002
    z = [
        np.array([h[-1] for h in heights_at(terrain.vertices, terrain.faces, xy + step)])
        for step in ([d, 0], [-d, 0], [0, d], [0, -d])
    ]
    steepness = np.degrees(np.arctan(np.hypot(z[0] - z[1], z[2] - z[3]) / (2 * d)))
    assert np.quantile(steepness, 0.98) <= 5.0 + 1e-6  # but for an edge between the points of measure
    everywhere = scattered({"object": {"kind": "nut", "size": "M3"}, "count": 200})[0]
    assert len(everywhere) == 200


def test_yaw_is_random_or_none_and_scales_stay_in_their_range():
    (instances,) = scattered({"object": NUT, "count": 200, "scale_range": [0.5, 2.0]})
    scale = np.linalg.norm(instances.T_w_o[:, :3, 0], axis=1)
    assert scale.min() >= 0.5
    assert scale.max() <= 2.0
    assert scale.mean() == pytest.approx(1.25, abs=4 * 1.5 / np.sqrt(12 * 200))
    heading = instances.T_w_o[:, 0, 0] / scale
    assert np.abs(heading.mean()) < 4 / np.sqrt(2 * 200)
    (straight,) = scattered({"object": NUT, "count": 5, "random_yaw": False})
    np.testing.assert_allclose(straight.T_w_o[:, :3, :3], np.tile(np.eye(3), (5, 1, 1)), atol=1e-12)


def test_a_block_is_one_mesh_whose_copies_have_names_and_seeds_of_their_own():
    s = scene({"object": {**NUT, "material": "old"}, "count": 3}, materials={"old": {"kind": "rust"}})
    terrain, instances = build_parts(s)
    assert (terrain.name, instances.name, len(instances)) == ("terrain", "scatter.0", 3)
    copies = instances.parts()
    assert [part.name for part in copies] == ["scatter.0.0", "scatter.0.1", "scatter.0.2"]
    assert len({part.origin for part in copies}) == 3
    assert copies[0].material.kind == "rust"
    np.testing.assert_allclose(
        copies[1].vertices, instances.vertices @ instances.T_w_o[1, :3, :3].T + instances.T_w_o[1, :3, 3]
    )


def test_a_mesh_file_can_be_scattered(tmp_path):
    write_ply(tmp_path / "a.ply", np.eye(4, 3), np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))
    (instances,) = scattered({"object": {"file": "a.ply", "scale": 0.1}, "count": 7}, folder=tmp_path)
    assert len(instances) == 7
    assert instances.vertices.max() == pytest.approx(0.1)


# ------------------------------------------------------------------------------------------------------ bad input


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        ({"count": 500, "circle": [0, 0, 1.0]}, "too near to a copy"),
        ({"count": 5, "area": [100, 100, 110, 110]}, "beside the terrain"),
        ({"count": 5, "max_slope_deg": 0.001}, "too steep"),
    ],
)
def test_an_area_without_room_is_refused_with_the_reason(block, reason):
    with pytest.raises(InputError) as caught:
        scattered({"object": NUT, **block})
    assert caught.value.key == "scatter.0.count"
    assert reason in caught.value.message
    assert caught.value.remedy


def test_an_area_under_objects_is_refused():
    with pytest.raises(InputError, match="too near to an object"):
        scattered({"object": NUT, "count": 3, "circle": [0, 0, 0.3]}, objects=[{"kind": "boulder", "diameter": 4}])


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ({"area": [0, 0, 1, 1], "circle": [0, 0, 1]}, "at most one"),
        ({"area": [1, 0, 0, 1]}, "xmin < xmax"),
        ({"scale_range": [2, 1]}, "scale_range"),
        ({"object": {**NUT, "position": [0, 0, 1]}}, "no position"),
        ({"polygon": [[0, 0], [1, 1], [2, 2]]}, "no area"),
        ({"object": {**NUT, "material": "gold"}}, "no material"),
    ],
)
def test_blocks_that_make_no_sense_are_refused(block, words):
    with pytest.raises(InputError, match=words):
        scattered({"object": NUT, "count": 3, **block})


def test_scatter_without_terrain_is_refused():
    with pytest.raises(InputError, match="no terrain"):
        scene({"object": NUT, "count": 3}, terrain=None)


def test_an_unknown_size_names_its_key():
    with pytest.raises(InputError) as caught:
        scattered({"object": {"kind": "bolt", "size": "M7"}, "count": 3})
    assert caught.value.key == "scatter.0.object.size"


# --------------------------------------------------------------------------------------------------------- warnings


def test_copies_in_the_way_are_noticed_once_for_their_block():
    s = scene(
        {"object": ROCK, "count": 200, "circle": [0, 0, 5]},
        terrain=FLAT,
        surface_depth_m=50.0,
        trajectory={"waypoints": [{"position": [-6, 0, 0.15 + 0.21]}, {"position": [6, 0, 0.15 + 0.21]}]},
        vehicle={"lights": [{}]},
    )
    parts = build_parts(s)
    x = np.linspace(-6, 6, 400)
    line = np.column_stack([x, 0 * x, 0 * x + 0.36])
    warnings = check_scene(s, parts, (np.arange(400) * 10**7, line, line, np.ones(400, int)))
    assert len(warnings) == 1
    assert "scatter.0" in warnings[0]
    clear = line + [0, 0, 2.0]
    high = s.model_copy(
        update={
            "trajectory": s.trajectory.model_copy(
                update={
                    "waypoints": [
                        w.model_copy(update={"position": (w.position[0], 0.0, 3.0)}) for w in s.trajectory.waypoints
                    ]
                }
            )
        }
    )
    assert check_scene(high, parts, (np.arange(400) * 10**7, clear, clear, np.ones(400, int))) == []


def test_info_counts_the_copies_of_a_block_together():
    s = scene({"object": NUT, "count": 20}, {"object": ROCK, "count": 10})
    parts = build_parts(s)
    rows = scene_info(s, parts)["meshes"]
    assert [row["name"] for row in rows] == ["terrain", "scatter.0 (20 copies)", "scatter.1 (10 copies)"]
    assert rows[1]["triangles"] == 20 * len(parts[1].faces)
    low, high = rows[1]["bounds_m"]
    assert -10.2 < low[0] < high[0] < 10.2


STONES = {"materials": {"stone": {"kind": "layered", "relief": "rock"}}}


def shares(**block):
    """How much of the height of each copy lies under the ground, which is flat at 0."""
    rock = {**ROCK, "material": "stone"}
    groups = scattered({"object": rock, "count": 60, "scale_range": [0.5, 2.0], **block}, terrain=FLAT, **STONES)
    lowest, height = (
        np.concatenate([[measure(part.vertices[:, 2]) for part in group.parts()] for group in groups])
        for measure in (np.min, np.ptp)
    )
    level = build_single_parts(scene(terrain=FLAT))[0].vertices[:, 2].max()
    return (level - lowest) / height


def test_stones_are_let_into_the_ground_by_a_tenth_to_a_half():
    for more in ({}, {"shapes": 4}, {"buried": [0.1, 0.5]}):
        share = shares(**more)
        assert share.min() > 0.1 - 1e-9
        assert share.max() < 0.5 + 1e-9
        assert np.ptp(share) > 0.3


def test_how_deep_is_as_the_block_says():
    assert shares(buried=[0.3, 0.3]) == pytest.approx(0.3)
    assert shares(buried=[0.0, 0.0]) == pytest.approx(0.0, abs=1e-9)


def test_more_copies_leave_the_first_as_deep_as_they_were():
    few, many = (scattered({"object": ROCK, "count": n, "buried": [0.1, 0.5]})[0] for n in (20, 40))
    np.testing.assert_array_equal(few.T_w_o, many.T_w_o[:20])


def test_a_range_that_begins_above_its_end_is_refused():
    with pytest.raises(InputError, match=r"buried: \[0\.5, 0\.1\] begins above its end"):
        scene({"object": ROCK, "count": 1, "buried": [0.5, 0.1]})


@pytest.mark.parametrize("exponent", [0.0, 2.0])
def test_scales_follow_the_power_law(exponent):
    """Kolmogorov-Smirnov against N(>s) ~ s^-exponent within the range; of exponent 0, as it goes to it."""
    u = np.random.default_rng(1).random(20_000)
    block = scene({"object": ROCK, "count": 1, "scale_range": [0.2, 2.0], "size_exponent": exponent}).scatter[0]
    scales = _scales(block, u)

    def share_below(s):
        if exponent == 0.0:
            return np.log(s / 0.2) / np.log(10.0)
        return (0.2**-exponent - s**-exponent) / (0.2**-exponent - 2.0**-exponent)

    assert scales.min() >= 0.2
    assert scales.max() <= 2.0
    assert kstest(scales, share_below).pvalue > 0.01
