"""Loop closures on courses over a flat floor, where the overlap of two frames follows from their distance."""

import numpy as np
import pytest
import standins

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.frames.loops import LEFT, SAME, closures, loop_closures, overlaps
from varos_warp.dataset.run.produce import produce

STEP = 1.0
"""Metres between frames: overlaps of 0.79, 0.58, 0.38 and 0.17, none near to a threshold."""
OUT_AND_BACK = [*range(12), *range(11, -1, -1)]
COURSES = {"out_and_back": OUT_AND_BACK, "straight": [*range(12)], "still": [0] * 12, "swaying": [0, 1, 2, 1, 0, 1, 2]}
WIDTH = 4.8 / 3.0 * -standins.FLOOR_Z
"""Of what the camera sees of the floor [m]."""


def dataset(out, places):
    """A camera that looks straight down, at multiples of `STEP` along x, two frames a second."""
    vehicle = standins.scene_dict()["vehicle"]
    vehicle["cameras"] = [
        {
            "id": "M0",
            "position": [0, 0, 0],
            "rotation_euler_deg": [-90, 0, 0],
            "resolution": [48, 32],
            "sensor_mm": [4.8, 3.2],
            "focal_mm": 3.0,
        }
    ]
    course = [
        {"time_s": 0.5 * i, "position": [STEP * k, 0, 0], "rotation_euler_deg": [0, 0, 0]} for i, k in enumerate(places)
    ]
    scene = standins.make_scene(
        vehicle=vehicle,
        trajectory={"poses": course},
        render={"outputs": ["D"], "frame_rate_hz": 2, "spp": 1, "integrator": "path"},
    )
    produce(scene, out, quiet=True, renderer=standins.FlatFloorRenderer(scene))
    return Dataset(out)


@pytest.fixture(scope="module")
def data_of(tmp_path_factory):
    """Datasets by name of the course; before any test puts another course in their place."""
    return {name: dataset(tmp_path_factory.mktemp("loops") / name, places) for name, places in COURSES.items()}


def truth(places):
    """Overlap of the camera's rectangles on the floor [n, n]."""
    x = STEP * np.array(places)
    return (1.0 - np.abs(x[:, None] - x) / WIDTH).clip(0.0)


def expected(share):
    """(later, earlier) by the definition, in plain words."""
    found = []
    for late in range(len(share)):
        early = [k for k in range(late) if share[late, k] >= SAME and (share[late, k + 1 : late] < LEFT).any()]
        if early:
            found.append((late, max(early, key=lambda k: share[late, k])))
    return found


def test_a_course_out_and_back_closes_a_loop_at_each_place_that_it_had_left(data_of):
    data = data_of["out_and_back"]
    chosen, share = overlaps(data, "M0")
    assert len(chosen) == len(OUT_AND_BACK)
    error = np.sqrt(0.25 / 96)  # of a share of the 96 points or so that stand in a grid for the floor that is seen
    np.testing.assert_allclose(share, truth(OUT_AND_BACK), atol=4 * error)
    found = loop_closures(data, "M0")
    assert found
    assert [late for late, _ in found] == [late for late, _ in expected(truth(OUT_AND_BACK))]
    assert all(abs(OUT_AND_BACK[late] - OUT_AND_BACK[early]) <= 1 for late, early in found), "its own place"


@pytest.mark.parametrize("name", ["straight", "still", "swaying"])
def test_no_loop_is_closed_where_no_place_was_left(data_of, name):
    assert len(data_of[name]) == len(COURSES[name])
    assert loop_closures(data_of[name], "M0") == []


def test_the_earlier_frame_of_a_closure_is_the_one_that_sees_most_of_it():
    share = truth([0, 1, 11, 1, 0])
    assert closures(share) == [(3, 1), (4, 0)]
