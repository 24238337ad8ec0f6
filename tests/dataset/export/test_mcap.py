"""The MCAP export comes back through rosbags, evo, and the reader of the MCAP project."""

import io
import sys

import cv2
import numpy as np
import pytest
from evo.tools import file_interface
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image
from readback import ROUNDING, largest_ape, matrices
from scipy.spatial.transform import Rotation

from varos_warp.dataset.export import export
from varos_warp.errors import InputError


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
    assert largest_ape(course, *data.poses("vehicle")) < ROUNDING


def test_odometry_moves_in_the_vehicles_own_axes(data, bag):
    states = data.states()
    own = vectors(bag["/ground_truth"], lambda m: m.twist.twist.linear)
    turned = Rotation.from_quat(states["quaternion"], scalar_first=True).apply(own)
    np.testing.assert_allclose(turned, states["velocity"], rtol=0, atol=ROUNDING)


def test_images_of_a_bag_are_the_datasets_files_and_depth_is_in_millimetres(data, bag):
    for camera in data.cameras:
        for frame, (_, image), (_, depth) in zip(data.frames, bag[f"/cam{camera}/image/compressed"],
                                                 bag[f"/cam{camera}/depth/compressed"], strict=True):
            assert image.data.tobytes() == data.layout.image(camera, "A", frame).read_bytes()
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


def test_moving_transforms_are_the_course_of_the_vehicle(data, bag):
    course = [(t, m.transforms[0]) for t, m in bag["/tf"]]
    assert {(m.header.frame_id, m.child_frame_id, len(message.transforms)) for (_, m), (_, message) in
            zip(course, bag["/tf"], strict=True)} == {("world", "vehicle", 1)}
    time_ns, T_w_v = data.poses("vehicle")
    np.testing.assert_array_equal([t for t, _ in course], time_ns)
    position = vectors(course, lambda m: m.transform.translation)
    rotation = [[(q := m.transform.rotation).x, q.y, q.z, q.w] for _, m in course]
    np.testing.assert_allclose(matrices(position, rotation, scalar_first=False), T_w_v, rtol=0, atol=ROUNDING)


def test_the_right_camera_of_a_pair_is_known_by_its_baseline(data, bag):
    """x_right = x_left - f b / z, of a point straight ahead of the left camera."""
    left, right = (bag[f"/cam{camera}/camera_info"][0][1].p.reshape(3, 4) for camera in ("L0", "R0"))
    assert left[0, 3] == 0
    assert right[0, 3] == pytest.approx(-data.intrinsics("R0")[0, 0] * 0.2, rel=1e-12)
    np.testing.assert_array_equal(left[:, :3], right[:, :3])


# -------------------------------------------------------------------------------------------- the MCAP project's reader


def decoded(path):
    """Log times and messages by topic, as the packages mcap and mcap-ros2-support read them."""
    topics = {}
    with path.open("rb") as file:
        for _, channel, message, content in make_reader(file, decoder_factories=[DecoderFactory()]
                                                        ).iter_decoded_messages():
            topics.setdefault(channel.topic, []).append((message.log_time, content))
    return topics


@pytest.fixture(scope="module")
def raw(written, tmp_path_factory):
    out = tmp_path_factory.mktemp("raw") / "out"
    export(written, "mcap", out, raw=True)
    return decoded(out / "bag/bag.mcap")


def test_the_reader_of_mcap_finds_what_rosbags_finds(bag, out):
    found = decoded(out / "mcap/bag/bag.mcap")
    assert {topic: [t for t, _ in messages] for topic, messages in found.items()} == {
        topic: [t for t, _ in messages] for topic, messages in bag.items()}
    np.testing.assert_array_equal(vectors(found["/imu0"], lambda m: m.linear_acceleration),
                                  vectors(bag["/imu0"], lambda m: m.linear_acceleration))
    for topic in ("/camL0/image/compressed", "/camR0/depth/compressed"):
        assert [m.data for _, m in found[topic]] == [m.data.tobytes() for _, m in bag[topic]]


def test_opencv_decodes_compressed_images_as_image_transport_does(data, out):
    found = decoded(out / "mcap/bag/bag.mcap")
    for frame, (_, message) in zip(data.frames, found["/camR0/image/compressed"], strict=True):
        bgr = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(bgr[..., ::-1], data.pixels("A", frame, "R0"))
        assert message.format == "rgb8; png compressed bgr8"
    _, depth = found["/camR0/depth/compressed"][0]
    assert cv2.imdecode(np.frombuffer(depth.data, np.uint8), cv2.IMREAD_UNCHANGED).dtype == np.uint16


def test_raw_images_are_the_pixels_and_the_metres_of_the_dataset(data, raw):
    for camera in data.cameras:
        for frame, (_, image), (_, depth) in zip(data.frames, raw[f"/cam{camera}/image"], raw[f"/cam{camera}/depth"],
                                                 strict=True):
            assert (image.encoding, depth.encoding) == ("rgb8", "32FC1")
            assert (image.step, depth.step) == (48 * 3, 48 * 4)
            np.testing.assert_array_equal(np.frombuffer(image.data, np.uint8).reshape(27, 48, 3),
                                          data.pixels("A", frame, camera))
            np.testing.assert_array_equal(np.frombuffer(depth.data, np.float32).reshape(27, 48),
                                          data.depth(frame, camera))
    assert {topic for topic in raw if topic.startswith("/camL0/")} == {
        "/camL0/camera_info", "/camL0/image", "/camL0/image/compressed", "/camL0/depth", "/camL0/depth/compressed"}


def test_raw_images_are_of_mcap_alone(written, tmp_path):
    with pytest.raises(InputError, match="for mcap only"):
        export(written, "tum", tmp_path / "out", raw=True)


# -------------------------------------------------------------------------------------------------------------- noise


def test_an_imu_without_noise_says_that_its_covariance_is_unknown_and_one_with_noise_states_it(bag, noisy, tmp_path):
    _, exact = bag["/imu0"][7]
    assert not exact.linear_acceleration_covariance.any()
    export(noisy.root, "mcap", tmp_path / "out")
    found = decoded(tmp_path / "out/bag/bag.mcap")
    acceleration = vectors(found["/imu0"], lambda m: m.linear_acceleration)
    np.testing.assert_array_equal(acceleration, noisy.imu()["acceleration"])
    _, message = found["/imu0"][7]
    np.testing.assert_allclose(message.linear_acceleration_covariance, 4e-3**2 * 200 * np.eye(3).ravel(), rtol=1e-15)
    np.testing.assert_allclose(message.angular_velocity_covariance, 2e-4**2 * 200 * np.eye(3).ravel(), rtol=1e-15)


def test_a_bag_without_rosbags_is_bad_input_with_the_remedy(written, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    with pytest.raises(InputError, match=r'pip install "varos_warp\[export\]"'):
        export(written, "mcap", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
