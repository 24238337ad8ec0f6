"""Attitudes of waypoints, poses and stops as quaternions: w, x, y, z, Hamilton, body to world."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.description.placed import Stop
from varos_warp.scene.description.vehicle import Pose, Waypoint
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.frames import attitude, attitudes, pose_matrix
from varos_warp.sim.trajectory import simulate

QUARTER_LEFT = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
"""A quarter turn about z, anticlockwise from above."""


def scene(**trajectory):
    return scene_from_dict({"trajectory": trajectory})


@pytest.mark.parametrize("block", [Waypoint, Pose, Stop])
def test_the_scalar_comes_first_and_the_turn_is_right_handed(block):
    stop = block(position=(1, 2, 3), quaternion=QUARTER_LEFT)
    expected = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    np.testing.assert_allclose(attitude(stop), expected, atol=1e-15)
    np.testing.assert_allclose(attitudes([stop])[0].as_matrix(), expected, atol=1e-15)
    np.testing.assert_allclose(pose_matrix(stop)[:3, 3], [1, 2, 3])


def test_a_pose_without_an_attitude_keeps_that_of_a_quaternion_before_it():
    stops = [Pose(time_s=0, position=(0, 0, 0), quaternion=QUARTER_LEFT), Pose(time_s=1, position=(1, 0, 0))]
    first, second = attitudes(stops)
    np.testing.assert_array_equal(first.as_quat(), second.as_quat())


def test_three_decimals_are_enough_and_the_length_is_made_one():
    given = np.array([0.966, 0.0, 0.0, 0.259])
    frames = simulate(scene(poses=[{"time_s": 0, "position": (0, 0, 0), "quaternion": given.tolist()}])).frames
    np.testing.assert_allclose(frames.quaternion[0], given / np.linalg.norm(given), rtol=1e-15)


@pytest.mark.parametrize(
    ("block", "says"),
    [
        ({"quaternion": [1, 0, 0, 0.1]}, "the length of the quaternion w, x, y, z is 1.00499, not 1"),
        ({"quaternion": [0, 0, 0, 0]}, "not 1"),
        ({"quaternion": [1, 0, 0]}, "quaternion.3"),
        ({"quaternion": [1, 0, 0, 0], "look_at": [0, 1, 0]}, "give one of look_at, rotation_euler_deg, quaternion"),
        ({"quaternion": [1, 0, 0, 0], "rotation_euler_deg": [0, 0, 0]}, "give one of"),
        ({"quat": [1, 0, 0, 0]}, "Here it is quaternion"),
    ],
)
@pytest.mark.parametrize("form", ["poses", "waypoints"])
def test_what_is_no_attitude_is_refused_by_its_key(form, block, says):
    with pytest.raises(InputError, match=says) as error:
        scene(**{form: [{"position": [0, 0, 0], **block}]})
    assert error.value.key.startswith(f"trajectory.{form}.0")


def test_an_object_begins_its_path_with_the_attitude_of_its_quaternion():
    path = [
        {"time_s": 0, "position": [0, 3, 0], "quaternion": list(QUARTER_LEFT)},
        {"time_s": 1, "position": [0, 4, 0]},
    ]
    block = scene_from_dict(
        {
            "objects": [{"kind": "boulder", "diameter": 1.0, "path": path}],
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        }
    ).objects[0]
    turned = Rotation.concatenate(attitudes(block.stops)).as_euler("xyz", degrees=True)
    np.testing.assert_allclose(turned, [[0, 0, 90]] * 2, atol=1e-12)


def test_a_scene_without_quaternions_is_written_without_them():
    without = scene_to_dict(scene(waypoints=[{"position": [0, 0, 0]}]))["trajectory"]
    assert "quaternion" not in without["waypoints"][0]
    having = scene_to_dict(scene(waypoints=[{"position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}]))
    assert scene_to_dict(scene_from_dict(having)) == having
