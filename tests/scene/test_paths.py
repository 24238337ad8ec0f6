"""Paths of objects: what is refused, and where they lead."""

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.file.load import load_scene, scene_from_dict, scene_to_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Moving
from varos_warp.sim.clock import times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.poses import REST_S, Knots, poses_along, through_poses

STOPS = [
    {"time_s": 1, "position": [0, 2, 0]},
    {"time_s": 2, "position": [1, 2, 0], "rotation_euler_deg": [0, 0, 50]},
    {"time_s": 4, "position": [1, 3, 1], "look_at": [0, 3, 0]},
]
NUT = "{kind: nut, size: M24, path: [{time_s: 0, position: [0, 2, 0]}, {time_s: 1, position: [1, 2, 0]}]}"


def scene_with(**block):
    return scene_from_dict(
        {"objects": [{"kind": "nut", "size": "M24"} | block], "trajectory": {"poses": [{"position": [0, 0, 0]}]}}
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "objects: [{kind: nut, size: M24, path: "
            "[{time_s: 1, position: [0, 2, 0]}, {time_s: 1, position: [1, 2, 0]}]}]",
            ("objects.0", "path.1.time_s: 1 s is not after the stop before it, at 1 s"),
        ),
        (
            "objects: [{kind: nut, size: M24, path: [{time_s: 0, position: [0, 2, 0]}]}]",
            ("objects.0", "path", "at least 2"),
        ),
        (
            "objects: [{kind: nut, size: M24, position: [9, 0, 0], path: [{time_s: 0, position: [0, 2, 0]}, "
            "{time_s: 1, position: [1, 2, 0]}]}]",
            ("objects.0", "path begins at [0.0, 2.0, 0.0]", "leave out position"),
        ),
        (
            "objects: [{kind: nut, size: M24, path: "
            "[{time_s: 0, position: [0, 2, 0]}, {time_s: 1e9, position: [1, 2, 0]}]}]",
            ("objects.0", "path.1.time_s", "86400"),
        ),
        ("terrain: {kind: procedural, path: [{time_s: 0, position: [0, 2, 0]}]}", ("terrain", "path")),
        (
            f"terrain: {{kind: procedural}}\nscatter: [{{object: {NUT}, count: 3}}]",
            ("scatter.0", "object.path: copies of a scatter stand still"),
        ),
    ],
)
def test_what_cannot_move_so_is_told(tmp_path, text, told):
    path = tmp_path / "scene.yaml"
    path.write_text(text + "\ntrajectory: {poses: [{position: [0, 0, 0]}]}\n")
    with pytest.raises(InputError) as error:
        load_scene(path)
    for words in ("scene.yaml", *told):
        assert words in str(error.value)


def test_an_object_begins_where_its_path_does_with_its_own_attitude():
    scene = scene_with(path=STOPS, rotation_euler_deg=[0, 0, 20])
    (part,) = build_parts(scene)
    (still,) = build_parts(scene_with(position=[0, 2, 0], rotation_euler_deg=[0, 0, 20]))
    assert isinstance(part, Moving)
    assert np.array_equal(part.vertices, still.vertices)
    assert scene_from_dict(scene_to_dict(scene)) == scene
    assert "path" not in scene_to_dict(scene_with())["objects"][0]  # nor in datasets of before


def test_the_motion_is_that_of_a_vehicle_through_the_same_poses():
    """At ticks to the last digit, and between them to the sixth order of a tick."""
    stops = scene_with(path=STOPS).objects[0].stops
    ticks = 1500
    motion = Trajectory(times_ns(ticks, 200), **through_poses(Knots.of(stops), ticks))
    T = poses_along(stops, motion.time_ns)
    np.testing.assert_allclose(T, motion.poses(), atol=1e-15)
    between = motion.time_ns[:-1] + 1_234_567
    np.testing.assert_allclose(poses_along(stops, between), motion.at(between).poses(), atol=1e-9)


def test_it_rests_before_and_after():
    stops = scene_with(path=STOPS).objects[0].stops
    before, after = (1e9 * np.array([1 - REST_S, 4 + REST_S])).astype(np.int64)
    early, late = poses_along(stops, before - np.arange(3) * 10**9), poses_along(stops, after + np.arange(3) * 10**9)
    for T in (early, late):
        np.testing.assert_allclose(T, np.broadcast_to(T[0], T.shape), atol=1e-12)
    assert not np.allclose(early[0], late[0])
