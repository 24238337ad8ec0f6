"""The nerfstudio export comes back through nerfbaselines' copy of its parser, trimesh and OpenCV."""

import json

import cv2
import numpy as np
import trimesh


def test_nerfstudio_cameras_have_y_up_and_look_along_minus_z(data, out):
    model = json.loads((out / "nerfstudio/transforms.json").read_text())
    assert (model["camera_model"], model["w"], model["h"]) == ("OPENCV", 48, 27)
    np.testing.assert_allclose(
        [model["fl_x"], model["fl_y"], model["cx"], model["cy"]],
        [3.4 / 4.416 * 48, 3.4 / 2.484 * 27, 24, 13.5],
        rtol=1e-15,
    )
    assert len(model["frames"]) == 20
    views = [(camera, frame) for camera in data.cameras for frame in data.frames]
    for (camera, frame), entry in zip(views, model["frames"], strict=True):
        T, T_w_c = np.array(entry["transform_matrix"]), data.T_w_c(frame, camera)
        np.testing.assert_array_equal(T @ [0, 0, -1, 0], T_w_c @ [0, 0, 1, 0])
        np.testing.assert_array_equal(T @ [0, 1, 0, 0], T_w_c @ [0, -1, 0, 0])
        np.testing.assert_array_equal(T[:, [0, 3]], T_w_c[:, [0, 3]])
        for key in ("file_path", "depth_file_path"):
            assert (out / "nerfstudio" / entry[key]).is_file()


def test_nerfbaselines_loads_the_images_and_the_poses(data, out, nerfbaselines):
    """It keeps poses and intrinsics as float32, poses in OpenCV's axes."""
    found = [nerfbaselines.load(out / "nerfstudio", split=split) for split in ("train", "test")]
    seen = {}
    for part in found:
        for path, pose, K, size, pixels in zip(
            part["image_paths"],
            part["cameras"].poses,
            part["cameras"].intrinsics,
            part["cameras"].image_sizes,
            part["images"],
            strict=True,
        ):
            camera, frame = path.split("_cam")[-1][:2], int(path[-12:-4])
            seen[camera, frame] = True
            np.testing.assert_allclose(pose, data.T_w_c(frame, camera)[:3], rtol=0, atol=4 * 2.0**-24)
            np.testing.assert_allclose(K, data.intrinsics(camera)[[0, 1, 0, 1], [0, 1, 2, 2]], rtol=2.0**-24)
            assert size.tolist() == [48, 27]
            np.testing.assert_array_equal(pixels[..., :3], data.pixels("A", frame, camera))
    assert set(seen) == {(camera, frame) for camera in data.cameras for frame in data.frames}


def test_near_and_far_are_the_ends_of_the_depth_images(data, out):
    model = json.loads((out / "nerfstudio/transforms.json").read_text())
    assert model["depth_unit_scale_factor"] == 0.001
    truth = np.array([data.depth(frame, camera) for camera in data.cameras for frame in data.frames])
    there = truth[np.isfinite(truth)]
    assert abs(model["near"] - there.min()) <= 0.0005 + 25 * 2.0**-24
    assert abs(model["far"] - there.max()) <= 0.0005 + 25 * 2.0**-24
    for entry in model["frames"]:
        units = cv2.imread(str(out / "nerfstudio" / entry["depth_file_path"]), cv2.IMREAD_UNCHANGED)
        assert units.dtype == np.uint16
        assert units.max() <= model["far"] * 1000


def test_the_point_cloud_is_that_of_colmap_and_lies_on_the_floor(out):
    model = json.loads((out / "nerfstudio/transforms.json").read_text())
    cloud = trimesh.load(out / "nerfstudio" / model["ply_file_path"])
    lines = [line.split() for line in (out / "colmap/sparse/0/points3D.txt").read_text().splitlines()[1:]]
    np.testing.assert_array_equal(cloud.vertices, np.array(lines)[:, 1:4].astype(np.float32))
    np.testing.assert_array_equal(cloud.colors[:, :3], np.array(lines)[:, 4:7].astype(np.uint8))
    assert np.abs(cloud.vertices[:, 2] + 3.0).max() < 25 / 65535 / 2 + 25 * 2.0**-24
