"""Rotations: angles and back, and attitudes of what stands or moves in a scene."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.scene.description.vehicle import Waypoint
from varos_warp.scene.frames import attitudes, euler_angles


def test_euler_angles_are_about_the_fixed_axes_x_then_y_then_z():
    rotation = Rotation.random(20, random_state=3)
    for (x, y, z), R in zip(euler_angles(rotation), rotation.as_matrix(), strict=True):
        parts = [Rotation.from_rotvec(v).as_matrix() for v in ((x, 0, 0), (0, y, 0), (0, 0, z))]
        np.testing.assert_allclose(parts[2] @ parts[1] @ parts[0], R, atol=1e-14)


def test_half_a_turn_is_plus_pi():
    assert euler_angles(Rotation.from_euler("xyz", [[0, 0, -180]], degrees=True))[0, 2] == np.pi


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0])
def test_gimbal_lock_is_silent_and_still_the_same_attitude(recwarn, pitch_deg):
    rotation = Rotation.from_euler("xyz", [[20, pitch_deg, 30]], degrees=True)
    back = Rotation.from_euler("xyz", euler_angles(rotation))
    assert (back.inv() * rotation).magnitude()[0] < 1e-7  # acos near 1 loses half the digits
    assert not recwarn.list


def test_a_stop_that_names_no_attitude_keeps_that_of_the_one_before_it():
    stops = [
        Waypoint(position=(0, 0, 0)),
        Waypoint(position=(1, 0, 0), rotation_euler_deg=(0, 0, 40)),
        Waypoint(position=(2, 0, 0)),
        Waypoint(position=(3, 0, 0), look_at=(3, 0, -1)),
        Waypoint(position=(4, 0, 0)),
    ]
    turned = attitudes(stops)
    assert turned[0].magnitude() == 0.0
    assert np.degrees(turned[2].magnitude()) == pytest.approx(40.0)
    np.testing.assert_allclose(turned[4].apply([0, 1, 0]), [0, 0, -1], atol=1e-15)
