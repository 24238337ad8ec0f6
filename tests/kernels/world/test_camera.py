"""Cameras: directions as the intrinsics say, and rays of an image point that meet in the plane of focus."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, rng_array, run, uniform_p
from scipy.spatial.transform import Rotation

from varos_warp.kernels.world import camera as kernel
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.frames import camera_pose, intrinsics, transform


@wp.kernel(enable_backward=False)
def rays(
    camera: kernel.Camera,
    image: wp.array(dtype=wp.vec2),
    lens: wp.array(dtype=wp.vec2),
    o: wp.array(dtype=wp.vec3),
    d: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    ray = kernel.camera_ray(camera, image[i][0], image[i][1], lens[i])
    o[i] = ray.o
    d[i] = ray.d


T_W_V = transform(Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix(), [3.0, -2.0, 1.0])
VIEW = {"position": [0.1, 0.2, -0.3], "rotation_euler_deg": [-15, 5, 30], "resolution": [320, 180]}


def shoot(image, lens, pinhole=False, **view):
    """Rays of a camera on the vehicle at T_W_V: origins, directions, T_w_c and the camera block."""
    view = Camera(**VIEW | view)
    scene = Scene(vehicle={"cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]})
    record = DeviceScene(scene, [], "cpu").camera(view, T_W_V, pinhole=pinhole)
    o, d = run(rays, [record, np.asarray(image, float), np.asarray(lens, float)], [wp.vec3, wp.vec3])
    return o.astype(float), d.astype(float), camera_pose(view, T_W_V), view


def image_points(n=500):
    return rng_array(1, (n, 2)).astype(float) * [320, 180]


def test_pinhole_rays_follow_the_intrinsics_and_leave_from_the_camera():
    points = image_points()
    o, d, T_w_c, view = shoot(points, rng_array(2, (500, 2)))
    expected = np.column_stack([points, np.ones(500)]) @ np.linalg.inv(intrinsics(view)).T @ T_w_c[:3, :3].T
    np.testing.assert_allclose(d, expected / np.linalg.norm(expected, axis=1, keepdims=True), atol=1e-6)
    np.testing.assert_allclose(o, np.tile(T_w_c[:3, 3], (500, 1)), atol=1e-6)


def test_the_centre_of_the_image_looks_forward_right_is_right_and_down_is_down():
    _, d, T_w_c, _ = shoot([[160, 90], [320, 90], [160, 180]], np.zeros((3, 2)))
    local = d @ T_w_c[:3, :3]
    np.testing.assert_allclose(local[0], [0, 0, 1], atol=1e-6)
    assert local[1][0] > 0
    assert local[2][1] > 0
    # half the sensor over the focal length
    np.testing.assert_allclose(local[1:, :2].max(axis=1) / local[1:, 2], [4.416 / 2 / 3.4, 2.484 / 2 / 3.4], rtol=1e-5)


@pytest.mark.parametrize("focus", [0.5, 3.0, 100.0])
def test_all_rays_of_an_image_point_meet_in_the_plane_of_focus(focus):
    """At z = focus, where the pinhole's ray is too: depth of field does not distort."""
    point = np.tile([[250.0, 30.0]], (1000, 1))
    o, d, T_w_c, view = shoot(point, rng_array(3, (1000, 2)), f_stop=1.7, focus_m=focus)
    origin, direction = (o - T_w_c[:3, 3]) @ T_w_c[:3, :3], d @ T_w_c[:3, :3]
    meet = origin + ((focus - origin[:, 2]) / direction[:, 2])[:, None] * direction
    np.testing.assert_allclose(
        meet, np.tile(focus * np.linalg.inv(intrinsics(view)) @ [250, 30, 1], (1000, 1)), atol=1e-6 * focus + 2e-6
    )
    assert np.ptp(direction[:, 0]) > 1e-4 / focus


def test_the_lens_is_a_disk_of_focal_length_over_twice_the_f_stop():
    n = 1 << 16
    o, _, T_w_c, _ = shoot(np.tile([[10.0, 20.0]], (n, 1)), rng_array(4, (n, 2)), f_stop=1.7, focal_mm=340.0)
    on_lens = (o - T_w_c[:3, 3]) @ T_w_c[:3, :3]
    radius = 0.34 / 1.7 / 2
    np.testing.assert_allclose(on_lens[:, 2], 0, atol=2e-6)
    share = (on_lens[:, :2] ** 2).sum(axis=1) / radius**2
    assert share.max() < 1 + 1e-5
    azimuth = np.arctan2(on_lens[:, 1], on_lens[:, 0]) / (2 * np.pi) % 1.0
    assert_plausible([uniform_p(np.clip(share, 0, 1)), uniform_p(azimuth)])


def test_f_stop_0_and_pinhole_have_no_depth_of_field():
    points, lens = image_points(), rng_array(5, (500, 2))
    bare = shoot(points, lens)
    for closed in (shoot(points, lens, f_stop=0.0, focus_m=0.2), shoot(points, lens, pinhole=True, f_stop=1.7)):
        assert np.array_equal(bare[0], closed[0])
        assert np.array_equal(bare[1], closed[1])
    assert not np.array_equal(bare[0], shoot(points, lens, f_stop=1.7)[0])
