"""The COLMAP export comes back through pycolmap and nerfbaselines."""

import shutil

import cv2
import numpy as np
import pycolmap
import pytest
from readback import ROUNDING, rows
from standins import make_scene

from varos_warp.dataset.export import colmap, export
from varos_warp.dataset.export.shared.seed import COUNT
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import load_scene


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
    monkeypatch.setattr("varos_warp.dataset.export.shared.seed.COUNT", 60)
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


# ------------------------------------------------------------------------------------------------------- the database


def test_the_database_has_the_cameras_rigs_frames_and_images_of_the_model(out, model, tmp_path):
    """COLMAP changes what it opens: it adds the tables that are not there."""
    shutil.copyfile(out / "colmap/database.db", tmp_path / "database.db")
    with pycolmap.Database.open(tmp_path / "database.db") as database:
        cameras = {camera.camera_id: camera for camera in database.read_all_cameras()}
        assert set(cameras) == set(model.cameras)
        for number, camera in model.cameras.items():
            known = cameras[number]
            assert (known.model, known.width, known.height) == (camera.model, camera.width, camera.height)
            np.testing.assert_array_equal(known.params, camera.params)
            assert known.has_prior_focal_length
        assert {image.image_id: (image.name, image.camera_id) for image in database.read_all_images()} == {
            number: (image.name, image.camera_id) for number, image in model.images.items()
        }
        assert {rig.rig_id: rig.ref_sensor_id for rig in database.read_all_rigs()} == {
            number: rig.ref_sensor_id for number, rig in model.rigs.items()
        }
        assert {frame.frame_id: (frame.rig_id, frame.data_ids) for frame in database.read_all_frames()} == {
            number: (frame.rig_id, frame.data_ids) for number, frame in model.frames.items()
        }


def test_every_camera_model_has_colmaps_number():
    assert colmap.NUMBERS.keys() == colmap.PARAMETERS.keys()
    assert colmap.NUMBERS == {name: int(pycolmap.CameraModelId.__members__[name]) for name in colmap.PARAMETERS}


def test_a_camera_behind_a_port_has_no_database_for_colmap_would_take_it_for_one_in_air(tmp_path):
    camera = {"id": "M0", "resolution": [16, 9], "port": {"kind": "flat", "distance_m": 0.01}}
    scene = make_scene(vehicle={"cameras": [camera], "imu": {}, "depth_gauge": {}}, render={"outputs": ["A"]})
    produce(scene, tmp_path / "data", quiet=True)
    export(tmp_path / "data", "colmap", tmp_path / "out")
    assert not (tmp_path / "out/database.db").exists()


TEXTURED = """
name: triangulation
seed: 1
water: none
terrain: {kind: procedural, size_m: 6, resolution: 33, relief_m: 0.0, material: floor}
materials: {floor: {kind: slope_blend, flat: &noise {texture: noise.png, tiles: 1}, steep: *noise}}
vehicle:
  cameras:
  - &left {id: L0, position: [-0.3, 0, 0], rotation_euler_deg: [-80, 0, 0], resolution: [240, 160],
           sensor_mm: [4.8, 3.2], focal_mm: 4.0}
  - {<<: *left, id: R0, position: [0.3, 0, 0]}
  lights: []
trajectory:
  poses:
  - {time_s: 0, position: [0, -0.4, 2.5]}
  - {time_s: 1, position: [0, 0.4, 2.5], rotation_euler_deg: [0, 0, 10]}
render: {outputs: [B, D], spp_b: 4, denoise_b: none, frame_rate_hz: 2}
"""
"""A floor at z = 0 with a texture for SIFT, before a stereo pair with a focal length of 200 px, 2.5 m above it."""


def texture(size=512):
    """Noise of five octaves."""
    rng = np.random.default_rng(1)
    octaves = [
        cv2.resize(rng.standard_normal((n, n)), (size, size), interpolation=cv2.INTER_CUBIC)
        for n in (8, 16, 32, 64, 128)
    ]
    return cv2.normalize(sum(octaves), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


@pytest.fixture(scope="module")
def triangulated(tmp_path_factory):
    """COLMAP's model of points that it found in images, from the exact poses; rendered, not by the stand-ins."""
    folder = tmp_path_factory.mktemp("triangulated")
    cv2.imwrite(str(folder / "noise.png"), texture())
    (folder / "scene.yaml").write_text(TEXTURED)
    produce(load_scene(folder / "scene.yaml"), folder / "data", device="cpu", quiet=True)
    out = folder / "out"
    export(folder / "data", "colmap", out, images="B")
    pycolmap.extract_features(out / "database.db", out / "images", device=pycolmap.Device.cpu)
    pycolmap.match_exhaustive(out / "database.db", device=pycolmap.Device.cpu)
    model = pycolmap.Reconstruction(out / "sparse/0")
    found = pycolmap.triangulate_points(model, out / "database.db", out / "images", tmp_path_factory.mktemp("model"))
    found.update_point_3d_errors()
    return found


def test_colmaps_triangulator_finds_points_from_the_exact_poses(triangulated):
    """A quarter of a pixel is what SIFT is good for in such images."""
    assert len(triangulated.images) == 6
    assert len(triangulated.points3D) > 200
    assert np.median([point.error for point in triangulated.points3D.values()]) < 0.25


def test_triangulated_points_lie_on_the_floor(triangulated):
    """Half of them nearer than a quarter of a pixel: 2.5 m away that is 2.5 / 200 * 0.25 m."""
    assert np.median([abs(point.xyz[2]) for point in triangulated.points3D.values()]) < 2.5 / 200 * 0.25
