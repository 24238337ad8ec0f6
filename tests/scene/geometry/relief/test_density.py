"""How fine a surface must be follows from where cameras come nearest, and one factor keeps the count within bounds."""

import numpy as np
import pytest

from varos_warp.scene.description import Scene
from varos_warp.scene.geometry.procedural import generate_terrain
from varos_warp.scene.geometry.relief.budget import factor_for, rough
from varos_warp.scene.geometry.relief.density import NEAREST_M, STEP_M, footprint, longest_edge
from varos_warp.scene.geometry.relief.subdivision import refine

CAMERA = {"id": "M0", "resolution": [1000, 500], "sensor_mm": [4.0, 2.0], "focal_mm": 4.0}
"""1000 pixels of focal length: a pixel is 1 mm wide at 1 m."""


def scene(**more):
    course = {"poses": [{"position": [0, 0, 2]}, {"position": [10, 0, 2], "time_s": 5}]}
    return Scene.model_validate({"vehicle": {"cameras": [CAMERA]}, "trajectory": course, **more})


def test_a_pixel_is_as_wide_as_at_the_nearest_place_of_the_course():
    """Where the course passes; beyond its end, from there. Steps of the course and nothing else are taken off."""
    seen = footprint(scene(), [])
    points = np.array([[5.0, 0, 0], [5, 3, -2], [13, 0, -2]])
    assert seen.distance(points) == pytest.approx([2.0, 5.0, 5.0], abs=STEP_M)
    assert (seen.distance(points) <= [2.0, 5.0, 5.0]).all()
    assert seen(points) == pytest.approx(1e-3 * seen.distance(points), rel=1e-9)


def test_cameras_off_the_middle_of_the_vehicle_may_be_nearer():
    off = {**CAMERA, "position": [0, 0, -0.5]}
    seen = footprint(scene(vehicle={"cameras": [off]}), [])
    assert seen.distance(np.array([[5.0, 0, 0]]))[0] == pytest.approx(1.5, abs=STEP_M)


def test_a_camera_in_the_world_stands_where_it_stands():
    fixed = {**CAMERA, "mount": "world", "position": [0, 0, 4]}
    seen = footprint(scene(vehicle={"cameras": [fixed]}), [])
    assert seen.distance(np.array([[0.0, 0, 1], [10, 0, 4]])) == pytest.approx([3.0, 10.0], abs=STEP_M)


def test_a_touched_place_is_no_finer_than_at_the_nearest_distance():
    assert footprint(scene(), []).distance(np.array([[5.0, 0, 2]]))[0] == NEAREST_M


def test_all_vehicles_see_the_same_world():
    two = {"vehicles": [{"id": "0", "cameras": [CAMERA], "trajectory": {"poses": [{"position": [0, 0, 2]}]}},
                        {"id": "1", "cameras": [CAMERA], "trajectory": {"poses": [{"position": [50, 0, 2]}]}}]}
    points = np.array([[0.0, 0, 0], [50, 0, 0]])
    for observer in ("0", "1"):
        seen = footprint(Scene.model_validate({**two, "observer": observer}), [])
        assert seen.distance(points) == pytest.approx([2.0, 2.0], abs=STEP_M)


def wanted(points, factor):
    return longest_edge(4e-4 * np.maximum(np.hypot(points[:, 0], 1.0), NEAREST_M) * 10, factor)


@pytest.mark.parametrize("most", [20_000, 100_000])
def test_the_factor_keeps_the_count_within_a_tenth_of_the_bound(most):
    mesh = generate_terrain(6.0, 13, 0.5)
    factor = factor_for([rough(*mesh, wanted)], most)
    count = len(refine(*mesh, lambda points: wanted(points, factor))[1])
    assert factor > 1.0
    assert 0.7 * most < count < 1.1 * most


def test_a_bound_that_is_kept_anyway_asks_for_no_factor():
    assert factor_for([rough(*generate_terrain(6.0, 13, 0.5), wanted)], 100_000_000) == 1.0


def test_a_bound_that_cannot_be_kept_gives_the_largest_factor():
    mesh = generate_terrain(6.0, 65, 0.5)
    assert factor_for([rough(*mesh, wanted)], 1000) == pytest.approx(256.0)
