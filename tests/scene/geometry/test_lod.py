"""Level of detail by need: what is allowed where, and that images move by no more."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.description import LevelOfDetail, Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import camera_pose, intrinsics, look_at_matrix, transform
from varos_warp.scene.geometry import lod
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.lod import Need, allowed_all_over, depth_step, keep_parts, pixel_angle, reduce_parts
from varos_warp.scene.geometry.parts import Instances, Part, Skin
from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.terrain import Surface

STEP = 25.0 / 65535
VIEW = {"resolution": [320, 180], "sensor_mm": [4.416, 2.484], "focal_mm": 3.4}
TERRAIN = generate_terrain(30.0, 121, 1.5, seed=5)
POSES = [transform(look_at_matrix((x, -3.0, 1.6), (x, 2.0, 0.0)), (x, -3.0, 1.6)) for x in (-1.0, 0.0, 1.0)]


def make_scene(**changes):
    """A camera, and no lamps unless asked for."""
    vehicle = {"cameras": [VIEW], "lights": []} | changes.pop("vehicle", {})
    return Scene(vehicle=vehicle, trajectory={"poses": [{"position": [0, 0, 0]}]}, **changes)


def floor(mesh=TERRAIN, name="terrain", **how):
    return Part(name, mesh[0], mesh[1], Diffuse(), **how)


def project(camera, T_w_v, points):
    """Pixels [N, 2] of points, and whether they are in the picture."""
    p = (points - (T := camera_pose(camera, T_w_v))[:3, 3]) @ T[:3, :3]
    q = p @ intrinsics(camera).T
    pixel = q[:, :2] / q[:, 2:]
    return pixel, (p[:, 2] > 0.0) & ((pixel >= 0.0) & (pixel <= camera.resolution)).all(axis=1)


@pytest.fixture(scope="module")
def reduced():
    """The terrain at one pixel, without regard to D."""
    scene = make_scene()
    (part,), (kept,) = reduce_parts(scene, [floor()], POSES, LevelOfDetail(tolerance_px=1.0, depth_steps=None))
    return scene, part, kept


# ------------------------------------------------------------------------------------------------------- the criterion


def test_no_point_in_the_picture_moves_further_than_its_distance_over_the_pixel_angle_says():
    """Small moves in random directions of points all over the picture: never more, and all of it in the corners."""
    camera = Camera(**VIEW)
    rng = np.random.default_rng(2)
    corner = np.where(rng.random((20_000, 1)) < 0.3, 1.0, rng.random((20_000, 2)))
    corner *= rng.choice([-1.0, 1.0], corner.shape)
    p = np.column_stack([corner * [2.208, 1.242], np.full(len(corner), 3.4)]) * rng.uniform(0.5, 9.0, (len(corner), 1))
    e = rng.normal(size=p.shape)
    e *= 1e-6 / np.linalg.norm(e, axis=1, keepdims=True)
    K = intrinsics(camera)
    moved = [(q @ K.T)[:, :2] / q[:, 2:] for q in (p, p + e)]
    share = np.linalg.norm(moved[1] - moved[0], axis=1) * pixel_angle(camera) * np.linalg.norm(p, axis=1) / 1e-6
    assert 0.98 < share.max() <= 1.0 + 1e-4  # the moves are not infinitely small: 1e-6 m at half a metre, and rounding


def test_the_step_of_d_is_0_381_mm_at_25_m():
    assert depth_step(make_scene()) == pytest.approx(0.000381, rel=2e-3)
    assert depth_step(make_scene(render={"depth_range_m": [0, 5]})) == pytest.approx(5 / 65535)


@pytest.mark.parametrize(("pixels", "distance", "allowed"), [
    (0.5, 0.1, "pixel"), (0.01, 5.0, "pixel"), (50.0, 0.8, STEP), (50.0, 1.0, STEP), (50.0, 7.0, 7.0 * STEP)])
def test_the_stricter_of_pixels_and_depth_rules_and_depth_by_one_step_up_to_a_metre(pixels, distance, allowed):
    scene = make_scene()
    need = Need(scene, POSES, LevelOfDetail(tolerance_px=pixels))
    if allowed == "pixel":
        allowed = pixels * pixel_angle(scene.vehicle.cameras[0]) * distance
    assert need.at(np.array(distance)) == pytest.approx(allowed)


def test_depth_does_not_count_where_nobody_asks_for_it():
    angle = pixel_angle(Camera(**VIEW))
    for scene, detail in ((make_scene(), LevelOfDetail(tolerance_px=9.0, depth_steps=None)),
                          (make_scene(render={"outputs": ["A", "C"]}), LevelOfDetail(tolerance_px=9.0))):
        assert Need(scene, POSES, detail).at(np.array(0.5)) == pytest.approx(9.0 * angle * 0.5)


def test_lamps_count_as_cameras_do_and_the_finest_camera_rules():
    far_lamp = make_scene(vehicle={"lights": [{"kind": "point", "position": [0.0, 5.0, -1.0]}]})
    point = POSES[1][:3, :3] @ [0.0, 5.0, -1.2] + POSES[1][:3, 3]
    detail = LevelOfDetail(depth_steps=None)
    assert Need(far_lamp, POSES[1:2], detail).distance(point[None])[0] == pytest.approx(0.2)
    two = make_scene(vehicle={"cameras": [VIEW, VIEW | {"id": "L0", "resolution": [1280, 720]}]})
    assert Need(two, POSES, detail).per_metre == pytest.approx(Need(make_scene(), POSES, detail).per_metre / 4)


def test_what_is_near_is_found_as_if_all_distances_were_looked_at():
    need, rng = Need(make_scene(), POSES, LevelOfDetail()), np.random.default_rng(5)
    for count in (1, 64, 65, 1000):
        points = rng.normal(scale=20.0, size=(count, 3))
        distance = need.distance(points)
        assert need.nearest(points) == distance.min()


def test_all_that_is_in_a_picture_counts_as_seen_and_what_is_behind_does_not():
    scene = make_scene()
    need, camera = Need(scene, POSES, LevelOfDetail()), scene.vehicle.cameras[0]
    points = np.random.default_rng(1).uniform(-8.0, 8.0, (4000, 3))
    seen = need.in_view(points, 1e-9)
    pictured = np.any([project(camera, T, points)[1] for T in POSES], axis=0)
    np.testing.assert_array_equal(seen, pictured)
    assert 0.05 < pictured.mean() < 0.95
    behind = points[:, 1] < -3.5
    assert not need.in_view(points[behind], 0.4)[points[behind, 2] < 1.0].any()


def test_a_ball_that_reaches_into_the_picture_counts_as_seen():
    scene = make_scene()
    need, rng = Need(scene, POSES[1:2], LevelOfDetail()), np.random.default_rng(3)
    centres, direction = rng.uniform(-6.0, 6.0, (300, 3)), rng.normal(size=(300, 60, 3))
    on_ball = centres[:, None] + 0.7 * direction / np.linalg.norm(direction, axis=2, keepdims=True)
    pictured = project(scene.vehicle.cameras[0], POSES[1], on_ball.reshape(-1, 3))[1].reshape(300, 60).any(axis=1)
    assert need.in_view(centres, 0.7)[pictured].all()


# --------------------------------------------------------------------------------------------------------- what it does


def test_pictures_move_by_no_more_than_the_tolerance(reduced):
    """Every vertex of the original that a camera pictures, and the point of the reduced surface nearest to it."""
    scene, part, kept = reduced
    assert kept.kept < 0.5 * kept.triangles
    face = Surface(part.vertices, part.faces).nearest(TERRAIN[0])[1]
    partner = trimesh.triangles.closest_point(part.vertices[part.faces[face]], TERRAIN[0])
    worst = 0.0
    for T in POSES:
        (before, pictured), (after, _) = (project(scene.vehicle.cameras[0], T, points)
                                          for points in (TERRAIN[0], partner))
        worst = max(worst, np.linalg.norm(after - before, axis=1)[pictured].max())
    assert 0.2 < worst <= 1.0


def test_the_report_says_what_is_kept_where_and_its_errors_are_the_measured_ones(reduced):
    scene, part, kept = reduced
    assert (kept.triangles, kept.kept) == (len(TERRAIN[1]), len(part.faces))
    assert kept.reason == "as far as the pixel tolerance lets"
    assert sum(r.triangles for r in kept.regions) == kept.triangles
    assert sum(r.kept for r in kept.regions) == kept.kept
    assert 0.9 < kept.of_allowed <= 0.97
    d = Surface(part.vertices, part.faces).nearest(TERRAIN[0])[0]
    assert 1e3 * d.max() <= kept.error_mm * (1 + 1e-6) < 1.5e3 * d.max()
    for region in kept.regions:
        low, high = region.nearest_m
        assert high == 2 * low
        assert region.allowed_mm == pytest.approx(1e3 * pixel_angle(scene.vehicle.cameras[0]) * low
                                                  * (1.0 if region.in_view else lod.UNSEEN))
        assert region.error_mm <= 2.0 * region.allowed_mm


def test_what_is_never_in_view_is_kept_coarser_but_kept(reduced):
    """Behind the cameras at the same distances: fewer triangles, within four times the tolerance."""
    scene, part, _ = reduced
    camera = scene.vehicle.cameras[0]
    eyes = np.array([camera_pose(camera, T)[:3, 3] for T in POSES])
    points = part.vertices[part.faces].mean(axis=1)
    distance = np.linalg.norm(points[:, None] - eyes, axis=2).min(axis=1)
    ring = (distance > 6.0) & (distance < 10.0)
    behind = ring & (points[:, 1] < -4.0)
    original = TERRAIN[0][TERRAIN[1]].mean(axis=1)
    before = np.linalg.norm(original[:, None] - eyes, axis=2).min(axis=1)
    before = (before > 6.0) & (before < 10.0)
    share = [np.count_nonzero(chosen) / np.count_nonzero(given) for chosen, given in (
        (behind, before & (original[:, 1] < -4.0)), (ring & (points[:, 1] > 2.0), before & (original[:, 1] > 2.0)))]
    assert share[0] < 0.7 * share[1]
    d = Surface(part.vertices, part.faces).nearest(TERRAIN[0])[0]
    nearest = np.linalg.norm(TERRAIN[0][:, None] - eyes, axis=2).min(axis=1)
    assert np.max(d / (pixel_angle(camera) * nearest)) <= lod.UNSEEN


def test_the_tolerance_in_depth_rules_where_it_is_the_stricter_one():
    (part,), (kept,) = reduce_parts(make_scene(), [floor()], POSES, LevelOfDetail(tolerance_px=1.0))
    assert kept.reason == "as far as the depth tolerance lets"
    distance = np.min([np.linalg.norm(TERRAIN[0] - T[:3, 3], axis=1) for T in POSES], axis=0)
    d = Surface(part.vertices, part.faces).nearest(TERRAIN[0])[0]
    assert np.max(d / np.maximum(distance, 1.0)) <= lod.UNSEEN * STEP


def test_what_cannot_or_need_not_be_reduced_stays_the_same_object():
    ball = trimesh.creation.icosphere(subdivisions=2)
    small = floor((np.asarray(ball.vertices), np.asarray(ball.faces, np.int32)), "objects.0")
    textured = floor(skin=Skin(np.zeros((len(TERRAIN[1]), 3, 3), np.float32)))
    many = Instances("scatter.0", *TERRAIN, np.eye(4)[None], textured.material, skin=textured.skin)
    scene = make_scene(objects=[{"file": "ball.ply"}])
    parts, kept = reduce_parts(scene, [textured, small, many], POSES, LevelOfDetail(tolerance_px=3.0))
    assert parts[0] is textured
    assert parts[2] is many
    assert parts[1] is small
    assert "texture map" in kept[0].reason
    assert "fewer than 1000" in kept[1].reason


def test_parametric_objects_are_made_with_the_chord_error_that_they_need():
    """One 3 m away is made coarser, one 0.5 m away finer, and one that says how it is made stays."""
    pipe = {"kind": "pipe", "radius": 0.2, "length": 0.4}
    places = [[0, 3.0, 1.6], [0, -2.0, 1.6], [1, 3.0, 1.6]]
    scene = make_scene(objects=[pipe | {"position": place} for place in places[:2]]
                       + [pipe | {"position": places[2], "chord_error_m": 0.0003}])
    given = build_parts(scene)
    parts, kept = reduce_parts(scene, given, POSES, LevelOfDetail(tolerance_px=0.05))
    assert len(parts[0].faces) < len(given[0].faces)
    assert len(parts[1].faces) > len(given[1].faces)
    assert parts[2] is given[2]
    need = Need(scene, POSES, LevelOfDetail(tolerance_px=0.05))
    for part, row in zip(parts[:2], kept[:2], strict=True):
        middle = part.vertices[part.faces].mean(axis=1) - part.origin
        outside = (np.hypot(middle[:, 0], middle[:, 1]) > 0.19) & (np.abs(middle[:, 2]) < 0.1)  # not the rims
        sag = 0.2 - np.hypot(middle[outside, 0], middle[outside, 1])
        assert sag.max() <= allowed_all_over(need, part.vertices)[0] * 1.05  # the box is that of the new mesh
        assert row.error_mm == pytest.approx(1e3 * allowed_all_over(need, given[int(row.name[-1])].vertices)[0])


def test_the_copy_that_comes_nearest_decides_for_all():
    ball = trimesh.creation.icosphere(subdivisions=4)
    poses = np.array([transform(position=p) for p in ([0, 3, 1.6], [0, -1.0, 1.6])])
    poses[1, :3, :3] *= 0.5
    group = Instances("scatter.0", 0.4 * ball.vertices, np.asarray(ball.faces, np.int32), poses, Diffuse())
    (made,), (kept,) = reduce_parts(make_scene(), [group], POSES, LevelOfDetail(depth_steps=None))
    d = Surface(made.vertices, made.faces).nearest(group.vertices)[0].max()
    angle = 0.5 * pixel_angle(Camera(**VIEW))
    assert len(made.faces) < len(group.faces)
    assert d <= min(angle * (6.0 - 0.4), angle * (2.0 - 0.2) / 0.5)
    assert kept.kept == len(made.faces)
    np.testing.assert_array_equal(made.T_w_o, group.T_w_o)


def test_where_it_is_off_everything_is_kept_and_the_report_says_so():
    (kept,) = keep_parts(make_scene(), [floor()], POSES)
    assert kept.kept == kept.triangles == len(TERRAIN[1])
    assert "off" in kept.reason
    nearest = np.min([np.linalg.norm(TERRAIN[0] - T[:3, 3], axis=1).min() for T in POSES])
    assert kept.nearest_m <= nearest
