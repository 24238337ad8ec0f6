"""How fine a surface must be follows from where cameras come nearest, and one factor keeps the count within bounds."""

import numpy as np
import pytest

from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.relief.budget import factor_for, rough
from varos_warp.scene.geometry.relief.density import (
    AHEAD_M,
    ASIDE_M,
    FASTER,
    NEAREST_M,
    STEP_M,
    UNSEEN,
    footprint,
    longest_edge,
)
from varos_warp.scene.geometry.relief.subdivision import refine

CAMERA = {"id": "M0", "resolution": [1000, 500], "sensor_mm": [4.0, 2.0], "focal_mm": 4.0}
"""1000 pixels of focal length: a pixel is 1 mm wide at 1 m."""


DOWN = {"rotation_euler_deg": [-90, 0, 0]}


def scene(camera=DOWN, **more):
    course = {"poses": [{"position": [0, 0, 2]}, {"position": [10, 0, 2], "time_s": 5}]}
    return Scene.model_validate({"vehicle": {"cameras": [{**CAMERA, **camera}]}, "trajectory": course, **more})


def below(found, expected):
    """Within the room for what the vehicle may be off its course, on the safe side."""
    assert (found <= expected).all()
    assert found == pytest.approx(expected, abs=ASIDE_M + STEP_M)


def test_a_pixel_is_as_wide_as_in_the_nearest_view():
    """Of a camera that looks down, 53 by 28 degrees: below the course, and beside it within its view."""
    seen = footprint(scene(), [])
    points = np.array([[5.0, 0, 0], [5, 1, -2], [5, 1.2, 0]])
    below(seen.distance(points), [2.0, np.hypot(1, 4), np.hypot(1.2, 2)])
    assert seen(points) == pytest.approx(1e-3 * seen.distance(points), rel=1e-9)


def test_what_no_camera_looks_at_is_coarse():
    seen = footprint(scene(), [])
    points = np.array([[5.0, 0, 4], [5, 40, 2]])
    below(seen.distance(points), UNSEEN * np.array([2.0, 40.0]))


def test_a_slanted_surface_is_as_coarse_as_its_pixels_are_large():
    """By the root of the area: at 60 degrees twice the area; at grazing views relief faces the camera anyway."""
    seen, point = footprint(scene(), []), np.array([[5.0, 0, 0]])
    level, steep, grazing, behind = (
        seen.distance(point, np.array([n])) + seen.aside
        for n in ([0.0, 0, 1], [0, np.sqrt(0.75), 0.5], [0, 1.0, 0], [0, 0, -1.0])
    )
    assert steep[0] / level[0] == pytest.approx(np.sqrt(2.0), rel=1e-3)
    assert grazing[0] / level[0] == pytest.approx(np.sqrt(2.5), rel=1e-3)
    assert behind[0] / level[0] == pytest.approx(UNSEEN, rel=1e-3)


def test_a_camera_is_where_it_is_mounted_and_looks_where_it_is_turned():
    """On a rod 0.5 m below, looking forward, which is +y: the floor below is not seen, what is ahead is."""
    seen = footprint(scene({"position": [0, 0, -0.5]}), [])
    points = np.array([[5.0, 3, 1.5], [5, 0, 0]])
    below(seen.distance(points), [3.0, UNSEEN * 1.5])


def test_a_camera_in_the_world_stands_where_it_stands():
    seen = footprint(scene({"mount": "world", "position": [0, 0, 4], **DOWN}), [])
    below(seen.distance(np.array([[0.0, 0, 1], [10, 0, 4]])), [3.0, UNSEEN * 10.0])


def test_a_touched_place_is_no_finer_than_at_the_nearest_distance():
    assert footprint(scene(), []).distance(np.array([[5.0, 0, 1.9]]))[0] == NEAREST_M


def test_a_course_that_turns_sees_all_around():
    """A turn by half about the vertical between two poses at one place."""
    turned = {"position": [0, 0, 0], "rotation_euler_deg": [0, 0, 179], "time_s": 9}
    seen = footprint(scene({}, trajectory={"poses": [{"position": [0, 0, 0]}, turned]}), [])
    below(seen.distance(np.array([[0.0, 3, 0], [-3, 0, 0], [0, -3, 0]])), [3.0, 3.0, 3.0])


def test_all_vehicles_see_the_same_world():
    camera = {**CAMERA, **DOWN}
    two = {
        "vehicles": [
            {"id": name, "cameras": [camera], "trajectory": {"poses": [{"position": [x, 0, 2]}]}}
            for name, x in (("0", 0), ("1", 50))
        ]
    }
    for observer in ("0", "1"):
        seen = footprint(Scene.model_validate({**two, "observer": observer}), [])
        below(seen.distance(np.array([[0.0, 0, 0], [50, 0, 0]])), [2.0, 2.0])


def pixel(points, normals):
    return 4e-3 * np.hypot(points[:, 0], 1.0)


@pytest.mark.parametrize("most", [20_000, 100_000])
def test_the_factor_keeps_the_count_within_a_tenth_of_the_bound(most):
    mesh = generate_terrain(6.0, 13, 0.5)
    factor = factor_for([rough(*mesh, pixel)], most)
    count = len(refine(*mesh, lambda points, normals: longest_edge(pixel(points, normals), factor))[1])
    assert factor > 1.0
    assert 0.7 * most < count < 1.1 * most


def test_a_bound_that_is_kept_anyway_asks_for_no_factor():
    assert factor_for([rough(*generate_terrain(6.0, 13, 0.5), pixel)], 100_000_000) == 1.0


@pytest.mark.parametrize("most", [50_000, 30_000, 20_000])
def test_small_bounds_do_not_fall_off(most):
    """Of a plane of two triangles with pixels of 1 mm; counts are powers of two."""
    mesh = generate_terrain(2.0, 2, 0.0)
    factor = factor_for([rough(*mesh, lambda points, normals: np.full(len(points), 1e-3))], most)
    count = len(refine(*mesh, lambda points, normals: np.full(len(points), longest_edge(1e-3, factor)))[1])
    assert 0.5 * most < count < 1.5 * most


def test_a_bound_below_what_a_mesh_has_is_half_as_many_again():
    mesh = generate_terrain(6.0, 65, 0.5)
    factor = factor_for([rough(*mesh, pixel)], 1000)
    count = len(refine(*mesh, lambda points, normals: longest_edge(pixel(points, normals), factor))[1])
    assert len(mesh[1]) <= count < 2 * len(mesh[1])


def test_a_ball_is_seen_where_some_of_it_is():
    """Its middle is outside of the cone, at 45 degrees; half of it is in view."""
    seen, middle = footprint(scene(), []), np.array([[12.0, 0, 0]])
    assert seen.distance(middle)[0] > 10.0
    below(seen.distance(middle, radius=1.5), np.array([np.hypot(2, 2) - 1.5]))


def test_what_lies_beyond_the_sequence_is_not_seen():
    """At 0.5 m/s for 4 s a vehicle comes 2 m far on its way of 10 m; without an end of the sequence all the way."""
    course = {"waypoints": [{"position": [0, 0, 2]}, {"position": [10, 0, 2]}], "speed": 0.5}
    far = np.array([[9.0, 0.0, 0.0]])
    short = footprint(scene(trajectory={**course, "duration_s": 4.0}), [])
    below(footprint(scene(trajectory=course), []).distance(far), [2.0])
    assert short.eyes[:, 0].max() == pytest.approx(FASTER * 2.0 + AHEAD_M)
    assert short.distance(far)[0] > 10.0


def test_poses_have_times_and_count_all():
    poses = [{"position": [0, 0, 2]}, {"position": [10, 0, 2], "time_s": 5}]
    seen = footprint(scene(trajectory={"poses": poses, "duration_s": 1.0}), [])
    assert seen.eyes[:, 0].max() == 10.0
