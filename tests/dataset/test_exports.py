"""Exports come back through evo and plain parsers as the poses, depths and readings that the dataset has."""

import io
import json
import shutil
import struct
import sys
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from evo.tools import file_interface
from PIL import Image
from rosbags.rosbag2 import Writer
from scipy.spatial.transform import Rotation
from standins import make_scene, scene_dict, tree
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset import files, stream
from varos_warp.dataset.exports import FORMATS, export, job
from varos_warp.dataset.exports import stream as stream_export
from varos_warp.dataset.layout import Dataset
from varos_warp.dataset.produce import produce
from varos_warp.errors import InputError

pytestmark = pytest.mark.filterwarnings("ignore:tum has room for 1")
ROUNDING = 1e-14
"""Of a rotation matrix to a quaternion and back, and of products of a few transforms: tens of 2^-53."""


@pytest.fixture(scope="module")
def data(written):
    return Dataset(written)


@pytest.fixture(scope="module")
def out(written, tmp_path_factory):
    """An export in each format, by name."""
    root = tmp_path_factory.mktemp("exports")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in FORMATS:
            export(written, name, root / name)
    return root


def matrices(position, quaternion, scalar_first):
    T = np.tile(np.eye(4), (len(position), 1, 1))
    T[:, :3, 3] = position
    T[:, :3, :3] = Rotation.from_quat(quaternion, scalar_first=scalar_first).as_matrix()
    return T


def rows(path, separator=" "):
    """Words of the lines that are no remarks."""
    return [line.split(separator) for line in path.read_text().splitlines() if line and not line.startswith("#")]


# -------------------------------------------------------------------------------------------------------------- EuRoC


def test_euroc_ground_truth_is_the_course_of_the_imu(data, out):
    path = out / "euroc/mav0/state_groundtruth_estimate0/data.csv"
    course = file_interface.read_euroc_csv_trajectory(path)
    time_ns, T_w_s = data.poses("imu0")
    np.testing.assert_allclose(course.timestamps, time_ns / 1e9, rtol=0, atol=1e-15)
    np.testing.assert_allclose(course.poses_se3, T_w_s, rtol=0, atol=ROUNDING)
    assert [len(row) for row in rows(path, ",")] == [17] * len(time_ns)


def test_euroc_velocity_is_the_derivative_of_the_position(data, out):
    """Central differences over h = 5 ms are good to h^2/6 times the third derivative, which is below 4 m/s^3."""
    table = np.array(rows(out / "euroc/mav0/state_groundtruth_estimate0/data.csv", ","), float)
    difference = (table[2:, 1:4] - table[:-2, 1:4]) / 0.01
    assert np.abs(difference - table[1:-1, 8:11]).max() < 0.005**2 / 6 * 4
    without_lever = np.abs(difference - data.states()["velocity"][1:-1]).max()
    assert without_lever > 0.05  # so the lever arm counts


def test_euroc_imu_has_the_gyroscope_first_and_a_row_after_the_last_image(data, out):
    path = out / "euroc/mav0/imu0/data.csv"
    assert path.read_text().splitlines()[0] == (
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]")
    table, imu = rows(path, ","), data.imu()
    assert [int(row[0]) for row in table] == imu["time_ns"].tolist()
    np.testing.assert_array_equal(np.array(table, float)[:, 1:4], imu["angular_velocity"])
    np.testing.assert_array_equal(np.array(table, float)[:, 4:], imu["acceleration"])
    images = [int(line) for line in (out / "euroc/times.txt").read_text().splitlines()]
    assert images == data.time_ns().tolist()
    assert int(table[0][0]) <= images[0]
    assert int(table[-1][0]) > images[-1]


def test_orb_slam3_is_not_given_an_image_after_the_last_imu_row(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    path = copy / "vehicle0/imu0/imu0_data.csv"
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:-20]))  # the last row is at 0.905 s now
    cut = [line.split(",")[0] for line in lines[:-20]][-1]
    export(copy, "euroc", tmp_path / "out")
    times = [int(line) for line in (tmp_path / "out/times.txt").read_text().splitlines()]
    assert times[-1] < int(cut)
    assert len(times) == sum(t < int(cut) for t in Dataset(copy).time_ns())


def test_t_bs_takes_camera_coordinates_to_the_body_and_its_pose_to_the_cameras(data, out):
    time_ns, T_w_b = data.poses("imu0")
    for number, camera in enumerate(data.cameras):
        sensor = yaml.safe_load((out / f"euroc/mav0/cam{number}/sensor.yaml").read_text())
        assert (sensor["T_BS"]["rows"], sensor["T_BS"]["cols"]) == (4, 4)
        T_b_c = np.reshape(sensor["T_BS"]["data"], (4, 4))
        at_frames = T_w_b[np.isin(time_ns, data.time_ns(camera))]
        np.testing.assert_allclose(at_frames @ T_b_c, data.poses(camera)[1], rtol=0, atol=ROUNDING)
        assert sensor["resolution"] == [48, 27]
        np.testing.assert_allclose(sensor["intrinsics"], [3.4 / 4.416 * 48, 3.4 / 2.484 * 27, 23.5, 13.0], rtol=1e-15)
        assert (sensor["sensor_type"], sensor["camera_model"]) == ("camera", "pinhole")
        assert (sensor["distortion_model"], sensor["distortion_coefficients"]) == ("radial-tangential", [0.0] * 4)
        kalibr = yaml.safe_load((out / "euroc/kalibr_camchain.yaml").read_text())[f"cam{number}"]
        np.testing.assert_allclose(kalibr["T_cam_imu"] @ T_b_c, np.eye(4), rtol=0, atol=ROUNDING)
        assert all(isinstance(x, float) for x in kalibr["intrinsics"])
    imu = yaml.safe_load((out / "euroc/mav0/imu0/sensor.yaml").read_text())
    np.testing.assert_array_equal(np.reshape(imu["T_BS"]["data"], (4, 4)), np.eye(4))
    assert imu["rate_hz"] == 200


def test_euroc_images_are_named_by_their_time_and_byte_for_byte_the_datasets(data, out):
    table = rows(out / "euroc/mav0/cam1/data.csv", ",")
    assert [(int(t), name) for t, name in table] == [(t, f"{t}.png") for t in data.time_ns("R0").tolist()]
    for frame, (_, name) in zip(data.frames, table, strict=True):
        assert (out / "euroc/mav0/cam1/data" / name).read_bytes() == data.layout.png("R0", "A", frame).read_bytes()


def test_noise_that_the_scene_has_is_stated_and_its_bias_is_in_the_ground_truth(tmp_path):
    noise = {"gyroscope_noise_density": 2e-4, "gyroscope_random_walk": 3e-5, "accelerometer_noise_density": 4e-3}
    vehicle = scene_dict()["vehicle"]
    scene = make_scene(vehicle=vehicle | {"imu": vehicle["imu"] | {"noise": noise}}, render={"outputs": ["A"]})
    produce(scene, tmp_path / "data", quiet=True)
    export(tmp_path / "data", "euroc", tmp_path / "out")
    sensor = yaml.safe_load((tmp_path / "out/mav0/imu0/sensor.yaml").read_text())
    assert {key: sensor[key] for key in noise} == noise
    assert sensor["accelerometer_random_walk"] > 0  # Kalibr refuses zero
    assert "accelerometer_random_walk" in sensor["comment"]
    truth = np.array(rows(tmp_path / "out/mav0/state_groundtruth_estimate0/data.csv", ","), float)
    np.testing.assert_array_equal(truth[:, 14:], 0.3)
    np.testing.assert_array_equal(truth[:, 11:14], 0.0)


def test_orb_slam3_settings_have_points_in_reals_and_none_in_integers(data, out):
    lines = (out / "euroc/orb_slam3.yaml").read_text().splitlines()
    assert lines[0] == "%YAML:1.0"
    values = dict(line.split(": ", 1) for line in lines[1:] if ": " in line)
    for key in ("Camera1.fx", "Camera1.cy", "IMU.NoiseGyro", "IMU.AccWalk", "IMU.Frequency", "Viewer.ViewpointX"):
        assert "." in values[key], key
        assert float(values[key]) >= 0
    for key in ("Camera.width", "Camera.fps", "Camera.RGB", "ORBextractor.nFeatures"):
        assert values[key].isdecimal(), key
    T = np.array(json.loads(values["   data"])).reshape(4, 4)
    sensor = yaml.safe_load((out / "euroc/mav0/cam0/sensor.yaml").read_text())
    np.testing.assert_array_equal(T.ravel(), sensor["T_BS"]["data"])


# ------------------------------------------------------------------------------------------------ TUM, KITTI, and depth


def test_tum_course_is_that_of_the_camera_and_its_lists_name_the_images(data, out):
    course = file_interface.read_tum_trajectory_file(out / "tum/groundtruth.txt")
    np.testing.assert_allclose(course.poses_se3, data.poses("L0")[1], rtol=0, atol=ROUNDING)
    for name in ("rgb", "depth"):
        table = rows(out / f"tum/{name}.txt")
        assert [round(float(t) * 1e9) for t, _ in table] == data.time_ns().tolist()
        assert all((out / "tum" / path).is_file() for _, path in table)
    text = (out / "tum/groundtruth.txt").read_text()
    assert not any(line != line.strip() for line in text.splitlines())
    first = rows(out / "tum/rgb.txt")[0][1]
    assert (out / "tum" / first).read_bytes() == data.layout.png("L0", "A", 0).read_bytes()


@pytest.mark.parametrize(("form", "folder", "unit", "largest"), [
    ("tum", "depth", 1 / 5000, 65535 / 5000), ("kitti", "sequences/01/depth_2", 1 / 256, 25.0),
    ("nerfstudio", "depths", 1 / 1000, 25.0)])
def test_depth_comes_back_in_metres_within_half_a_unit(data, out, form, folder, unit, largest):
    """Rounding to the unit, and float32 of D (2^-24 of 25 m) once; what is too far is 0."""
    paths = sorted(p for p in (out / form / folder).glob("*.png") if "camR0" not in p.name)
    assert len(paths) == 10
    for frame, path in zip(data.frames, paths, strict=True):
        with Image.open(path) as image:
            units = np.array(image)
        truth, read = data.depth(frame, "L0"), units * unit
        assert units.dtype == np.uint16
        there = truth <= largest
        assert 0 < there.mean() < 1
        assert np.abs(read - truth)[there].max() <= unit / 2 + 25 * 2.0**-24
        assert not units[~there].any()


def test_kitti_poses_are_relative_to_the_first_frame_and_times_begin_at_zero(data, out):
    path = file_interface.read_kitti_poses_file(out / "kitti/poses/01.txt")
    T_w_c = data.poses("L0")[1]
    np.testing.assert_array_equal(path.poses_se3[0], np.eye(4))
    np.testing.assert_allclose(T_w_c[0] @ path.poses_se3, T_w_c, rtol=0, atol=ROUNDING)
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
    scene = make_scene(vehicle={"cameras": [
        {"id": name, "position": [x, 0, 0], "rotation_euler_deg": [-15, 0, yaw], "resolution": [16, 9]}
        for name, x, yaw in (("L0", -0.1, 0), ("R0", 0.1, 1))], "imu": {}, "depth_gauge": {}},
        render={"outputs": ["A"]})
    produce(scene, tmp_path / "data", quiet=True)
    with pytest.warns(UserWarning, match="R0 left out"):
        export(tmp_path / "data", "kitti", tmp_path / "out")
    assert {p.name for p in (tmp_path / "out/sequences/01").iterdir()} == {"image_2", "times.txt", "calib.txt"}


def test_depth_along_the_ray_becomes_planar(data):
    """A wall at z = 5 m seen by the pixel (row 3, column 40)."""
    K = data.intrinsics()
    row, col = np.indices((27, 48)) + 0.5
    ray = np.stack([(col - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1], np.ones((27, 48))], -1)
    along = 5.0 * np.linalg.norm(ray, axis=-1)
    fake = SimpleNamespace(depth=lambda frame, camera: along, intrinsics=lambda camera: K,
                           meta={"depth": {"kind": "range"}})
    np.testing.assert_allclose(job.planar_depth(fake, 0, "L0"), 5.0, rtol=1e-14)


# --------------------------------------------------------------------------------------------------- COLMAP, nerfstudio


def test_colmap_poses_are_world_to_camera_with_the_scalar_first(data, out):
    """Pinholes where the centre of the top left pixel is (0.5, 0.5); two lines an image."""
    cameras = {row[0]: row for row in rows(out / "colmap/sparse/0/cameras.txt")}
    assert cameras["1"][1:4] == ["PINHOLE", "48", "27"]
    np.testing.assert_allclose(np.array(cameras["1"][6:], float), [24, 13.5])
    lines = [x for x in (out / "colmap/sparse/0/images.txt").read_text().split("\n") if not x.startswith("#")]
    assert lines[1::2] == [""] * 20  # each image has its line of points, without any
    assert len(lines) == 41
    images = [line.split() for line in lines[:-1:2]]
    assert [row[0] for row in images] == [str(i + 1) for i in range(20)]
    for index, (camera, frame) in enumerate((c, f) for c in data.cameras for f in data.frames):
        row = images[index]
        assert row[8] == str(1 + data.cameras.index(camera))
        assert (out / "colmap/images" / row[9]).read_bytes() == data.layout.png(camera, "A", frame).read_bytes()
        T_c_w = matrices([np.array(row[5:8], float)], [np.array(row[1:5], float)], scalar_first=True)[0]
        np.testing.assert_allclose(T_c_w @ data.T_w_c(frame, camera), np.eye(4), rtol=0, atol=ROUNDING)


def test_nerfstudio_cameras_have_y_up_and_look_along_minus_z(data, out):
    model = json.loads((out / "nerfstudio/transforms.json").read_text())
    assert (model["camera_model"], model["w"], model["h"]) == ("OPENCV", 48, 27)
    np.testing.assert_allclose([model["fl_x"], model["fl_y"], model["cx"], model["cy"]],
                               [3.4 / 4.416 * 48, 3.4 / 2.484 * 27, 24, 13.5], rtol=1e-15)
    assert len(model["frames"]) == 20
    for (camera, frame), entry in zip(((c, f) for c in data.cameras for f in data.frames), model["frames"], strict=True):
        T, T_w_c = np.array(entry["transform_matrix"]), data.T_w_c(frame, camera)
        np.testing.assert_array_equal(T @ [0, 0, -1, 0], T_w_c @ [0, 0, 1, 0])
        np.testing.assert_array_equal(T @ [0, 1, 0, 0], T_w_c @ [0, -1, 0, 0])
        np.testing.assert_array_equal(T[:, [0, 3]], T_w_c[:, [0, 3]])
        for key in ("file_path", "depth_file_path"):
            assert (out / "nerfstudio" / entry[key]).is_file()


# --------------------------------------------------------------------------------------------------------------- MCAP


@pytest.fixture(scope="module")
def bag(out):
    """Log times and messages of the bag by topic."""
    from rosbags.highlevel import AnyReader

    topics = {}
    with AnyReader([out / "mcap/bag"]) as reader:
        for connection, time_ns, raw in reader.messages():
            topics.setdefault(connection.topic, []).append((time_ns, reader.deserialize(raw, connection.msgtype)))
    return topics


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def vectors(messages, get):
    return np.array([[(v := get(m)).x, v.y, v.z] for _, m in messages])


def test_a_bag_has_the_readings_and_its_log_times_are_the_stamps(data, bag):
    imu, gauge = data.imu(), data.depth_gauge()
    np.testing.assert_array_equal([t for t, _ in bag["/imu0"]], imu["time_ns"])
    assert all(t == stamp_ns(m) for topic in ("/imu0", "/ground_truth", "/camR0/camera_info") for t, m in bag[topic])
    np.testing.assert_array_equal(vectors(bag["/imu0"], lambda m: m.linear_acceleration), imu["acceleration"])
    np.testing.assert_array_equal(vectors(bag["/imu0"], lambda m: m.angular_velocity), imu["angular_velocity"])
    assert bag["/imu0"][0][1].orientation_covariance[0] == -1
    np.testing.assert_array_equal([m.data for _, m in bag["/depth0"]], gauge["depth"])


def test_evo_reads_the_vehicles_course_from_a_bag(data, out):
    from rosbags.rosbag2 import Reader

    with Reader(out / "mcap/bag") as reader:
        course = file_interface.read_bag_trajectory(reader, "/ground_truth")
    np.testing.assert_allclose(course.poses_se3, data.poses("vehicle")[1], rtol=0, atol=ROUNDING)


def test_odometry_moves_in_the_vehicles_own_axes(data, bag):
    states = data.states()
    own = vectors(bag["/ground_truth"], lambda m: m.twist.twist.linear)
    turned = Rotation.from_quat(states["quaternion"], scalar_first=True).apply(own)
    np.testing.assert_allclose(turned, states["velocity"], rtol=0, atol=ROUNDING)


def test_images_of_a_bag_are_the_datasets_files_and_depth_is_in_millimetres(data, bag):
    for camera in data.cameras:
        for frame, (_, image), (_, depth) in zip(data.frames, bag[f"/cam{camera}/image/compressed"],
                                                 bag[f"/cam{camera}/depth/compressed"], strict=True):
            assert image.data.tobytes() == data.layout.png(camera, "A", frame).read_bytes()
            with Image.open(io.BytesIO(depth.data.tobytes())) as opened:
                units = np.array(opened)
            truth = data.depth(frame, camera)
            assert np.abs(units / 1000 - truth)[np.isfinite(truth)].max() <= 0.0005 + 25 * 2.0**-24
            assert not units[np.isinf(truth)].any()
    info = bag["/camL0/camera_info"][0][1]
    np.testing.assert_array_equal(info.k.reshape(3, 3), data.intrinsics("L0", "opencv"))
    assert (info.width, info.height) == (48, 27)


def test_static_transforms_of_a_bag_lead_from_the_vehicle_to_each_camera(data, bag):
    ((_, message),) = bag["/tf_static"]
    found = {t.child_frame_id: t for t in message.transforms}
    assert set(found) == {"imu0", "depth0", "camL0", "camR0"}
    r, p = found["camR0"].transform.rotation, found["camR0"].transform.translation
    T = matrices([[p.x, p.y, p.z]], [[r.x, r.y, r.z, r.w]], scalar_first=False)[0]
    np.testing.assert_allclose(data.poses("vehicle")[1][60] @ T, data.T_w_c(3, "R0"), rtol=0, atol=ROUNDING)


def test_a_bag_without_rosbags_is_bad_input_with_the_remedy(written, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(InputError, match=r'pip install "varos_warp\[export\]"'):
        export(written, "mcap", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


# ------------------------------------------------------------------------------------------------------------- stream


def test_a_stream_has_everything_in_the_order_of_time(data, out):
    messages = list(stream.read_stream(out / "stream/stream.sbst"))
    times = [m.time_ns for m in messages]
    assert times == sorted(times)
    of = {id: [m for m in messages if m.id == id] for id in stream.FIELDS}
    assert json.loads(of[stream.DESCRIPTION][0].text)["cameras"] == data.meta["cameras"]
    assert messages[0].id == stream.DESCRIPTION
    imu, states = data.imu(), data.states()
    np.testing.assert_array_equal([m.time_ns for m in of[stream.IMU]], imu["time_ns"])
    np.testing.assert_array_equal([m.values for m in of[stream.IMU]],
                                  np.hstack([imu["acceleration"], imu["angular_velocity"]]))
    np.testing.assert_array_equal([m.values[0] for m in of[stream.DEPTH_GAUGE]], data.depth_gauge()["depth"])
    np.testing.assert_array_equal([m.values for m in of[stream.VEHICLE_POSE]],
                                  np.hstack([states["position"], states["quaternion"]]))
    assert len(of[stream.IMAGE]) == 2 * 4 * 10
    for message in of[stream.IMAGE]:
        frame, camera, letter = message.values
        assert message.time_ns == data.time_ns()[frame]
        original = data.layout.png(data.cameras[camera], chr(letter), frame)
        assert (out / "stream" / message.text).read_bytes() == original.read_bytes()


def test_a_message_is_its_mark_its_id_its_length_and_its_payload():
    """Table 7 of the paper, little-endian; the time survives beyond the 53 bits of a float64."""
    time_ns = 1629158400_000_000_001
    message = stream.Message(stream.DEPTH_GAUGE, time_ns, (80.25,))
    assert message.encode() == b"SBST" + struct.pack("<IIqd", 3, 16, time_ns, 80.25)
    ((id, payload),) = stream.split_messages(message.encode())
    assert stream.Message.decode(id, payload) == message


def gauge_messages(count):
    return [stream.Message(stream.DEPTH_GAUGE, i, (float(i),)) for i in range(count)]


def test_reading_goes_on_after_damage_and_says_so(tmp_path):
    data = bytearray(b"".join(m.encode() for m in gauge_messages(5)))
    data[2 * 28:2 * 28 + 4] = b"SBXX"
    (tmp_path / "s").write_bytes(data)
    with pytest.warns(UserWarning, match="damaged bytes passed over"):
        read = list(stream.read_stream(tmp_path / "s"))
    assert {0, 3, 4} <= {m.time_ns for m in read} <= {0, 1, 3, 4}
    assert all(m in gauge_messages(5) for m in read)


@pytest.mark.parametrize("lost", [1, 16, 20, 27])
def test_a_stream_that_ends_within_a_message_is_bad_input(tmp_path, lost):
    data = b"".join(m.encode() for m in gauge_messages(3))
    (tmp_path / "s").write_bytes(data[:-lost])
    with pytest.raises(InputError, match="ends within"):
        list(stream.read_stream(tmp_path / "s"))


# ------------------------------------------------------------------------------------------------------ all formats


@pytest.mark.parametrize("time_ns", [0, 5_000_000, 1629158400_005_000_001, -5])
def test_seconds_keep_every_nanosecond(time_ns):
    whole, decimals = job.seconds(time_ns).split(".")
    assert len(decimals) == 9
    assert abs(int(whole)) * 10**9 + int(decimals) == abs(time_ns)


def test_images_are_the_same_files_or_copies_where_they_cannot_be(written, tmp_path, monkeypatch):
    source, linked, copied = Dataset(written).layout.png("L0", "A", 0), tmp_path / "a/1.png", tmp_path / "b/1.png"
    files.link(source, linked)
    assert linked.samefile(source)
    monkeypatch.setattr(files.os, "link", lambda *_: (_ for _ in ()).throw(OSError("no links here")))
    files.link(source, copied)
    assert not copied.samefile(source)
    assert copied.read_bytes() == source.read_bytes()


@pytest.mark.parametrize("name", FORMATS)
def test_a_failed_export_leaves_nothing_and_the_dataset_as_it_was(written, tmp_path, monkeypatch, name):
    before = tree(written)

    def full(*_args, **_options):
        raise OSError(28, "No space left on device")

    for owner, function in ((files, "write_bytes"), (stream_export, "write_stream"), (Writer, "write")):
        monkeypatch.setattr(owner, function, full)
    with pytest.raises(InputError, match="No space left"):
        export(written, name, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
    assert tree(written) == before


def test_what_cannot_be_exported_is_bad_input(written, tmp_path):
    for change, words in (({"to": "rosbag"}, "no format.*euroc, tum"), ({"images": "C"}, "no colour images.*A, B"),
                          ({"cameras": ["X1"]}, "no such camera"), ({"out": written}, "is there already")):
        with pytest.raises(InputError, match=words):
            export(**({"dataset_root": written, "to": "tum", "out": tmp_path / "out"} | change))
    assert list(tmp_path.iterdir()) == []


def test_a_missing_image_is_found_before_anything_is_written(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    Dataset(copy).layout.png("L0", "D", 4).unlink()
    with pytest.raises(InputError, match=r"D-00000004.png.*missing"):
        export(copy, "nerfstudio", tmp_path / "out")
    export(copy, "colmap", tmp_path / "out")  # which takes no depth


def test_cameras_that_stand_in_the_world_have_poses_but_no_place_on_a_body(tmp_path):
    scene = make_scene(vehicle={"cameras": [
        {"id": "M0", "mount": "world", "position": [0, -2, 0], "resolution": [16, 9]}], "imu": {}, "depth_gauge": {}},
        render={"outputs": ["A"]})
    produce(scene, tmp_path / "data", quiet=True)
    with pytest.warns(UserWarning, match="M0"), pytest.raises(InputError, match="no camera is on the vehicle"):
        export(tmp_path / "data", "euroc", tmp_path / "out")
    export(tmp_path / "data", "tum", tmp_path / "out")
    assert not (tmp_path / "out/depth.txt").exists()
    assert len({tuple(row[1:]) for row in rows(tmp_path / "out/groundtruth.txt")}) == 1


def test_frames_without_sensors_go_to_colmap_but_not_to_euroc(tmp_path):
    produce(make_scene(render={"outputs": ["A"]}), tmp_path / "data", quiet=True, sensors=False)
    with pytest.raises(InputError, match=r"course of the vehicle.*simulate"):
        export(tmp_path / "data", "euroc", tmp_path / "out")
    assert len(export(tmp_path / "data", "stream", tmp_path / "stream").data) == 10
    assert len(export(tmp_path / "data", "colmap", tmp_path / "out").data) == 10


def test_the_command_line_exports_and_refuses(written, tmp_path):
    arguments = ["export", str(written), "--to", "colmap", "-o", str(tmp_path / "out"), "--images", "B",
                 "--camera", "R0"]
    done = CliRunner().invoke(cli.app, arguments)
    assert (done.exit_code, done.output) == (0, f"{tmp_path / 'out'}: 10 frames of R0 as colmap\n")
    assert len(list((tmp_path / "out/images/camR0").glob("*_B-*.png"))) == 10
    again = CliRunner().invoke(cli.app, arguments)
    assert again.exit_code == 2
    assert "is there already" in again.output
