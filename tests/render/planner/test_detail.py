"""The level of detail in the plan: what it says of images C and D is what two renderings of them differ by."""

import json

import numpy as np
import pytest

from varos_warp.render.planner.detail import choose_detail, comparable, compare_images, depth_error
from varos_warp.render.planner.plan import plan_render
from varos_warp.render.renderer import DepthImage, FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.frames import camera_pose, look_at_matrix, transform
from varos_warp.scene.geometry.lod import Need, PlacedNeed
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.geometry.procedural import generate_terrain, grid_mesh

VIEW = {"resolution": [160, 90], "sensor_mm": [4.416, 2.484], "focal_mm": 3.4}
TERRAIN = generate_terrain(24.0, 121, 0.8, seed=4)
POSES = [transform(look_at_matrix((x, -3.0, 1.2), (x, 0.0, 0.0)), (x, -3.0, 1.2)) for x in (-0.5, 0.5)]


def make_scene(detail=None, **render):
    return Scene(vehicle={"cameras": [VIEW], "lights": []}, trajectory={"poses": [{"position": [0, 0, 0]}]},
                 render={"spp": 4, "max_scatterings": 0, "level_of_detail": detail, "outputs": ["C", "D"]} | render)


def part(mesh=TERRAIN):
    return Part("terrain", *mesh, Diffuse())


@pytest.fixture(scope="module")
def chosen():
    """A scene at half a pixel, and its detail."""
    scene = make_scene({"tolerance_px": 0.5})
    return scene, choose_detail(scene, [part()], POSES)


def test_where_it_is_off_the_parts_are_those_given_and_nothing_is_compared():
    given = [part()]
    detail = choose_detail(make_scene(), given, POSES)
    assert detail.parts[0] is given[0]
    assert detail.meshes["level_of_detail"] is None
    assert detail.meshes["kept"] == detail.meshes["triangles"] == len(TERRAIN[1])
    assert detail.meshes["memory_mb"]["given"] == detail.meshes["memory_mb"]["kept"]
    assert "depth_error" not in detail.meshes


def test_a_plan_says_what_it_would_do_where_it_is_off(chosen):
    given = [part()]
    detail = choose_detail(make_scene(), given, POSES, propose=True)
    assert detail.parts[0] is given[0]
    assert detail.meshes == chosen[1].meshes | {"level_of_detail": None}


def test_it_is_off_by_default():
    assert Scene(trajectory={"poses": [{"position": [0, 0, 0]}]}).render.level_of_detail is None
    assert make_scene({}).render.level_of_detail.model_dump() == {"tolerance_px": 0.5, "depth_steps": 1.0}


def test_the_plan_carries_it_as_plain_types_and_alike_each_time(chosen):
    scene, detail = chosen
    plan = plan_render(scene, None, POSES, meshes=detail.meshes).to_dict()
    assert json.loads(json.dumps(plan, allow_nan=False))["meshes"]["kept"] == len(detail.parts[0].faces)
    assert choose_detail(scene, [part()], POSES).meshes == detail.meshes
    assert "meshes" not in plan_render(scene, None, POSES).to_dict()
    assert f"{len(detail.parts[0].faces)} of {len(TERRAIN[1])} triangles are kept; D moves by" in plan["reasons"][0]


def test_time_is_measured_only_where_the_cost_is_asked_for(chosen):
    scene, detail = chosen
    assert "seconds_per_million_rays" not in detail.meshes
    costed = choose_detail(scene, [part()], POSES, measure_cost=True).meshes
    assert min(costed.pop("seconds_per_million_rays").values()) > 0.0
    assert costed == detail.meshes


def test_the_stated_depth_error_is_the_difference_of_two_depth_images(chosen):
    """Rendered again; the statement has four digits."""
    scene, detail = chosen
    stated = detail.meshes["depth_error"]
    given, made = (FrameRenderer(scene, "cpu", parts) for parts in ([part()], detail.parts))
    shifts = []
    for T in POSES:
        images = [renderer.render(T, outputs="D").D for renderer in (given, made)]
        compared, _ = comparable(scene, *images)
        shifts.append(np.abs(images[0].depth[compared].astype(float) - images[1].depth[compared]))
    shift = 1e3 * np.concatenate(shifts)
    assert stated["pixels"] == len(shift)
    assert stated["step_mm"] == pytest.approx(25e3 / 65535, rel=1e-3)
    for name, value in (("max", shift.max()), ("p95", np.quantile(shift, 0.95)), ("rms", np.sqrt(np.mean(shift**2)))):
        assert stated[f"{name}_mm"] == pytest.approx(value, rel=1e-3)
        assert stated[f"{name}_steps"] == pytest.approx(value / (25e3 / 65535), rel=1e-3)
    assert sum(row["pixels"] for row in stated["by_distance"]) == stated["pixels"]


def test_depth_moves_by_no_more_than_what_is_allowed_at_right_angles_to_the_surface(chosen):
    """The change along the ray times the cosine to the surface is the distance between two planes.

    The surface is not one, so what is compared are pixels whose normals agree to 2 degrees, and 5 % more is allowed.
    """
    scene, detail = chosen
    given, made = (FrameRenderer(scene, "cpu", parts) for parts in ([part()], detail.parts))
    allowed, count = PlacedNeed(Need(scene, POSES, scene.render.level_of_detail), TERRAIN[0]), 0
    for T in POSES:
        one, two = (renderer.render(T, outputs="CD") for renderer in (given, made))
        parallel = np.sum(one.C.normal * two.C.normal, axis=-1) > np.cos(np.radians(2.0))
        same = comparable(scene, one.D, two.D)[0] & parallel
        T_w_c, (row, col) = camera_pose(scene.vehicle.cameras[0], T), np.nonzero(same)
        ray = np.stack([(col + 0.5 - 80) / 123.19, (row + 0.5 - 45) / 123.19, np.ones(len(row))], axis=1)
        ray = (ray / np.linalg.norm(ray, axis=1, keepdims=True)) @ T_w_c[:3, :3].T
        points = T_w_c[:3, 3] + ray * one.D.range[same][:, None]
        cosine = np.abs(np.sum(ray * one.C.normal[same], axis=1))
        off = np.abs(one.D.range[same].astype(float) - two.D.range[same]) * cosine
        assert np.max(off / allowed(points)) < 1.05
        count += len(points)
    assert count > 0.5 * 2 * 160 * 90


def test_near_the_camera_depth_is_right_to_its_step(chosen):
    """Up to 2 m, where nothing may move by more than two steps at right angles, seen at a slant."""
    rows = {tuple(row["nearest_m"]): row for row in chosen[1].meshes["depth_error"]["by_distance"]}
    near = rows[1.0, 2.0]
    assert near["pixels"] > 1000
    assert near["p95_steps"] < 1.0
    assert near["rms_steps"] < 0.6


def test_a_coarser_tolerance_keeps_fewer_triangles_and_costs_more_depth():
    kept, errors = [], []
    for pixels in (0.25, 1.0, 4.0):
        meshes = choose_detail(make_scene({"tolerance_px": pixels, "depth_steps": None}), [part()], POSES).meshes
        kept.append(meshes["kept"])
        errors.append(meshes["depth_error"]["rms_mm"])
    assert kept == sorted(kept, reverse=True)
    assert errors == sorted(errors)
    assert kept[0] > 2 * kept[2]


def test_depth_statistics_are_those_of_known_numbers():
    given = np.array([1.5, 1.5, 3.0, 3.0])
    stated = depth_error(given, given + [0.001, -0.001, 0.003, 0.0], 0.001)
    assert stated["max_mm"] == pytest.approx(3.0)
    assert stated["rms_steps"] == pytest.approx(np.sqrt((1 + 1 + 9) / 4))
    assert [row["rms_mm"] for row in stated["by_distance"]] == pytest.approx([1.0, 3.0 / np.sqrt(2.0)])
    assert depth_error(given[:0], given[:0], 0.001)["pixels"] == 0


def test_outlines_and_what_lies_beyond_the_range_of_d_are_not_compared():
    """A floor that is seen at a grazing angle is no outline; the edge of a box before it is."""
    floor = (90.0 / np.arange(1.0, 31.0))[:, None] * np.ones((30, 20))  # 1 / z is linear over rows
    box = np.where((np.arange(30)[:, None] > 10) & (np.arange(20) > 9), 2.0, floor)
    compared, outline = comparable(make_scene(), *(DepthImage(z, z) for z in (floor, box)))
    assert not compared[floor >= 25.0].any()
    assert outline[14:, 9:11].all()
    assert not outline[14:, :8].any()
    assert compared[14:, :8][floor[14:, :8] < 25.0].all()
    assert compared[14:, 12:][floor[14:, 12:] < 25.0].all()


def test_a_tilted_plane_that_is_lifted_changes_d_by_the_lift_over_the_cosine():
    """A plane 2 m below, looked at straight down and lifted by 1 mm: planar depth changes by 1 mm everywhere."""
    axis = np.linspace(-6.0, 6.0, 5)
    plane, lifted = (grid_mesh(axis, axis, np.full((5, 5), z)) for z in (0.0, 0.001))
    down = transform(look_at_matrix((0, 0, 2.0), (0, 0, 0)), (0, 0, 2.0))
    errors, _ = compare_images(make_scene(), [part(plane)], [part(lifted)], [down], "cpu")
    assert errors["depth_error"]["max_mm"] == pytest.approx(1.0, abs=1e-3)
    assert errors["depth_error"]["rms_mm"] == pytest.approx(1.0, abs=1e-3)
    assert errors["normal_error_deg"]["p95"] == pytest.approx(0.0, abs=1e-3)
