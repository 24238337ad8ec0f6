"""The KITTI export comes back through pykitti, evo and OpenCV."""

from datetime import timedelta

import cv2
import numpy as np
import pykitti
import pytest
from evo.tools import file_interface
from PIL import Image
from readback import ROUNDING, largest_ape
from standins import make_scene

from varos_warp.dataset.export import export
from varos_warp.dataset.run.produce import produce


def test_pykitti_reads_the_sequence(data, out):
    sequence = pykitti.odometry(str(out / "kitti"), "01")
    T_w_c = data.poses("L0")[1]
    np.testing.assert_allclose(T_w_c[0] @ sequence.poses, T_w_c, rtol=0, atol=ROUNDING)
    assert sequence.timestamps == [timedelta(seconds=i / 10) for i in range(10)]
    for K in (sequence.calib.K_cam0, sequence.calib.K_cam1, sequence.calib.K_cam2, sequence.calib.K_cam3):
        np.testing.assert_array_equal(K, data.intrinsics("L0", "opencv"))
    assert sequence.calib.b_rgb == pytest.approx(0.2, rel=1e-12)
    assert sequence.calib.b_gray == pytest.approx(0.2, rel=1e-12)
    for i, frame in enumerate(data.frames):
        for camera, color, grey in zip(data.cameras, sequence.get_rgb(i), sequence.get_gray(i), strict=True):
            np.testing.assert_array_equal(color, data.pixels("A", frame, camera))
            np.testing.assert_array_equal(grey, Image.fromarray(data.pixels("A", frame, camera)).convert("L"))


def test_kitti_grey_images_are_grey_to_opencv(data, out):
    """Luma 0.299 R + 0.587 G + 0.114 B (ITU-R 601): Pillow and OpenCV round it differently, by one at most."""
    for i, frame in enumerate(data.frames):
        grey = cv2.imread(str(out / f"kitti/sequences/01/image_0/{i:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert grey.shape == (27, 48)
        luma = data.pixels("A", frame, "L0") @ np.array([0.299, 0.587, 0.114])
        assert np.abs(grey - luma).max() <= 1


def test_the_depth_benchmarks_names_lead_to_the_same_depth_and_images(data, out):
    drive = out / "kitti/train/varos_drive_01_sync"
    for i, frame in enumerate(data.frames):
        for place, camera in ((2, "L0"), (3, "R0")):
            units = cv2.imread(str(drive / f"proj_depth/groundtruth/image_0{place}/{i:010d}.png"), cv2.IMREAD_UNCHANGED)
            truth = data.depth(frame, camera)
            there = np.isfinite(truth)
            assert np.abs(units / 256 - truth)[there].max() <= 0.5 / 256 + 25 * 2.0**-24
            assert not units[~there].any()
            color = (drive / f"image_0{place}/data/{i:010d}.png").read_bytes()
            assert color == data.layout.image(camera, "A", frame).read_bytes()


def test_kitti_poses_are_relative_to_the_first_frame_and_times_begin_at_zero(data, out):
    path = file_interface.read_kitti_poses_file(out / "kitti/poses/01.txt")
    T_w_c = data.poses("L0")[1]
    np.testing.assert_array_equal(path.poses_se3[0], np.eye(4))
    assert largest_ape(path, None, np.linalg.inv(T_w_c[0]) @ T_w_c) < ROUNDING
    times = (out / "kitti/sequences/01/times.txt").read_text().split()
    assert times == [f"0.{i}00000000" for i in range(10)]
    images = [p.name for p in sorted((out / "kitti/sequences/01/image_3").iterdir())]
    assert images == [f"{i:06d}.png" for i in range(10)]


def test_kitti_projections_take_a_point_to_the_same_row_of_both_cameras(data, out):
    """P2 is the left camera and P3 the right, 0.2 m to its right; x_right = x_left - f b / z."""
    lines = (out / "kitti/sequences/01/calib.txt").read_text().splitlines()
    calib = {name: np.array(line.split(), float).reshape(3, 4) for name, line in (x.split(":") for x in lines)}
    assert list(calib) == ["P0", "P1", "P2", "P3", "Tr"]
    in_left, T_l_w = np.array([0.3, -0.2, 4.0, 1.0]), np.linalg.inv(data.T_w_c(5, "L0"))
    in_right = np.linalg.inv(data.T_w_c(5, "R0")) @ np.linalg.inv(T_l_w) @ in_left
    left, right = calib["P2"] @ in_left, calib["P3"] @ in_left
    expected = data.intrinsics("R0", "opencv") @ in_right[:3]
    np.testing.assert_allclose(right / right[2], expected / expected[2], rtol=1e-12)
    assert left[0] / left[2] - right[0] / right[2] == pytest.approx(3.4 / 4.416 * 48 * 0.2 / 4.0)
    np.testing.assert_array_equal(calib["Tr"] @ [1, 0, 0, 1], [0, 0, 1])  # ahead of the lidar is ahead of the camera


def test_cameras_that_are_no_rectified_pair_are_not_made_one(tmp_path):
    scene = make_scene(
        vehicle={
            "cameras": [
                {"id": name, "position": [x, 0, 0], "rotation_euler_deg": [-15, 0, yaw], "resolution": [16, 9]}
                for name, x, yaw in (("L0", -0.1, 0), ("R0", 0.1, 1))
            ],
            "imu": {},
            "depth_gauge": {},
        },
        render={"outputs": ["A"]},
    )
    produce(scene, tmp_path / "data", quiet=True)
    with pytest.warns(UserWarning, match="left out: R0"):
        export(tmp_path / "data", "kitti", tmp_path / "out")
    files = {p.name for p in (tmp_path / "out/sequences/01").iterdir()}
    assert files == {"image_0", "image_2", "times.txt", "calib.txt"}
