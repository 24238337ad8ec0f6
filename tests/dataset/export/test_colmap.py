"""The COLMAP export comes back through pycolmap and nerfbaselines."""

import numpy as np
import pycolmap
import pytest
from readback import ROUNDING, rows
from standins import make_scene

from varos_warp.dataset.export import export
from varos_warp.dataset.export.seed import COUNT
from varos_warp.dataset.run.produce import produce


@pytest.fixture(scope="module")
def model(out):
    return pycolmap.Reconstruction(out / "colmap/sparse/0")


def views(data):
    return [(camera, frame) for camera in data.cameras for frame in data.frames]


def test_pycolmap_has_the_cameras_and_poses_of_the_dataset(data, out, model):
    assert [model.cameras[i].model.name for i in sorted(model.cameras)] == ["PINHOLE", "PINHOLE"]
    for number, camera in enumerate(data.cameras, start=1):
        np.testing.assert_array_equal(model.cameras[number].calibration_matrix(), data.intrinsics(camera))
    assert len(model.images) == 20
    for (camera, frame), image_id in zip(views(data), sorted(model.images), strict=True):
        image = model.images[image_id]
        assert image.camera_id == 1 + data.cameras.index(camera)
        T_c_w = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
        np.testing.assert_allclose(T_c_w @ data.T_w_c(frame, camera), np.eye(4), rtol=0, atol=ROUNDING)
        pixels = pycolmap.Bitmap.read(str(out / "colmap/images" / image.name), True).to_array()
        np.testing.assert_array_equal(pixels, data.pixels("A", frame, camera))


def test_points_lie_where_their_pixel_sees_the_floor_and_have_its_colour(data, model):
    """The floor is at z = -3; D is known to half of 25/65535 m along the camera's z, so to that over cos of a ray."""
    assert len(model.points3D) > 10_000
    for (camera, frame), image_id in zip(views(data), sorted(model.images), strict=True):
        image, colors, T_w_c = model.images[image_id], data.pixels("A", frame, camera), data.T_w_c(frame, camera)
        seen = [point for point in image.points2D if point.has_point3D()]
        assert len(seen) > 0
        uv = np.array([point.xy for point in seen])
        points = [model.points3D[point.point3D_id] for point in seen]
        xyz = np.array([point.xyz for point in points])
        z = (np.linalg.inv(T_w_c) @ np.column_stack([xyz, np.ones(len(xyz))]).T)[2]
        drop = (T_w_c[2, 3] - xyz[:, 2]) / z  # metres down for a metre along the camera's z
        assert np.all(np.abs(xyz[:, 2] + 3.0) <= drop * 25 / 65535 / 2 + 25 * 2.0**-24)
        col, row = (uv - 0.5).astype(int).T
        np.testing.assert_array_equal([point.color for point in points], colors[row, col])


def test_points_project_to_the_middle_of_their_pixels(model):
    """Rounding of float64 over a few operations, in pixels of an image that is 48 wide."""
    model.update_point_3d_errors()
    assert max(point.error for point in model.points3D.values()) < 48 * 1e-13


def test_there_are_no_more_points_than_asked_for_and_the_same_every_time(written, data, out, tmp_path, monkeypatch):
    export(written, "colmap", tmp_path / "again")
    first, second = (path / "sparse/0/points3D.txt" for path in (out / "colmap", tmp_path / "again"))
    assert first.read_bytes() == second.read_bytes()
    assert len(rows(first)) <= COUNT
    monkeypatch.setattr("varos_warp.dataset.export.seed.COUNT", 60)
    export(written, "colmap", tmp_path / "few")
    assert len(rows(tmp_path / "few/sparse/0/points3D.txt")) == 60  # three of each of 20 images


def test_nerfbaselines_loads_the_model_for_gaussian_splatting(data, out, nerfbaselines):
    found = nerfbaselines.load(out / "colmap", "points3D_xyz")
    points = np.array(rows(out / "colmap/sparse/0/points3D.txt"))
    order = np.lexsort(found["points3D_xyz"].T)
    native = points[:, 1:4].astype(np.float32)
    np.testing.assert_array_equal(found["points3D_xyz"][order], native[np.lexsort(native.T)])
    for path, pose, pixels in zip(found["image_paths"], found["cameras"].poses, found["images"], strict=True):
        camera, frame = path.split("/cam")[-1][:2], int(path[-12:-4])
        np.testing.assert_allclose(pose, data.T_w_c(frame, camera)[:3], rtol=0, atol=4 * 2.0**-24)  # it has float32
        np.testing.assert_array_equal(pixels[..., :3], data.pixels("A", frame, camera))


def test_without_depth_images_have_a_line_of_no_points(tmp_path):
    produce(make_scene(render={"outputs": ["A"]}), tmp_path / "data", quiet=True)
    export(tmp_path / "data", "colmap", tmp_path / "out")
    folder = tmp_path / "out/sparse/0"
    lines = [x for x in (folder / "images.txt").read_text().split("\n") if not x.startswith("#")]
    assert lines[1::2] == [""] * 20
    model = pycolmap.Reconstruction(folder)
    assert (len(model.images), len(model.points3D)) == (20, 0)
