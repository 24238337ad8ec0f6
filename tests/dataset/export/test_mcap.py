"""The MCAP export comes back through rosbags, evo, and the reader of the MCAP project."""

import io
import sys

import cv2
import numpy as np
import pytest
import standins
import yaml
from bags import decoded, messages_of, vectors
from evo.tools import file_interface
from PIL import Image
from readback import ROUNDING, largest_ape, matrices
from scipy.spatial.transform import Rotation

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.points import points_at
from varos_warp.dataset.reader.rows import sight
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_from_dict


@pytest.fixture(scope="module")
def bag(out):
    return messages_of(out / "mcap/bag")


def stamp_ns(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_a_bag_has_the_readings_and_its_log_times_are_the_stamps(data, bag):
    imu, gauge = data.imu(), data.depth_gauge()
    np.testing.assert_array_equal([t for t, _ in bag["/imu0"]], imu["time_ns"])
    assert all(t == stamp_ns(m) for topic in ("/imu0", "/ground_truth", "/camR0/camera_info") for t, m in bag[topic])
    np.testing.assert_array_equal(vectors(bag["/imu0"], lambda m: m.linear_acceleration), imu["acceleration"])
    np.testing.assert_array_equal(vectors(bag["/imu0"], lambda m: m.angular_velocity), imu["angular_velocity"])
    assert bag["/imu0"][0][1].orientation_covariance[0] == -1
    np.testing.assert_array_equal([m.data for _, m in bag["/depth0"]], gauge["depth"])


def poses_of(messages, get):
    """T [N, 4, 4] of messages with a position and an orientation."""
    position, rotation = zip(*(get(m) for _, m in messages), strict=True)
    return matrices([[p.x, p.y, p.z] for p in position], [[q.x, q.y, q.z, q.w] for q in rotation], scalar_first=False)


def base_of(T_w_v):
    """REP 103's axes of a vehicle: x forward, y left, z up, where ours are x right, y forward, z up."""
    right, forward, up, place = np.moveaxis(T_w_v, -1, 0)
    return np.stack([forward, -right, up, place], -1)


def test_evo_reads_the_vehicles_course_from_a_bag(data, out):
    from rosbags.rosbag2 import Reader

    with Reader(out / "mcap/bag") as reader:
        course = file_interface.read_bag_trajectory(reader, "/ground_truth")
    time_ns, T_w_v = data.poses("vehicle")
    assert largest_ape(course, time_ns, base_of(T_w_v)) < ROUNDING


def test_odometry_moves_in_the_axes_of_the_base(data, bag):
    """The twist is that of the child frame (nav_msgs), in which the position's derivative is the velocity."""
    states = data.states()
    assert {(m.header.frame_id, m.child_frame_id) for _, m in bag["/ground_truth"]} == {("odom", "base_link")}
    T = poses_of(bag["/ground_truth"], lambda m: (m.pose.pose.position, m.pose.pose.orientation))
    for get, world in (
        (lambda m: m.twist.twist.linear, states["velocity"]),
        (
            lambda m: m.twist.twist.angular,
            Rotation.from_quat(states["quaternion"], scalar_first=True).apply(states["angular_velocity"]),
        ),
    ):
        turned = np.einsum("nij,nj->ni", T[:, :3, :3], vectors(bag["/ground_truth"], get))
        np.testing.assert_allclose(turned, world, rtol=0, atol=ROUNDING)


def test_images_of_a_bag_are_the_datasets_files_and_depth_is_in_millimetres(data, bag):
    for camera in data.cameras:
        for frame, (_, image), (_, depth) in zip(
            data.frames, bag[f"/cam{camera}/image/compressed"], bag[f"/cam{camera}/depth/compressed"], strict=True
        ):
            assert image.data.tobytes() == data.layout.image(camera, "A", frame).read_bytes()
            with Image.open(io.BytesIO(depth.data.tobytes())) as opened:
                units = np.array(opened)
            truth = data.depth(frame, camera)
            assert np.abs(units / 1000 - truth)[np.isfinite(truth)].max() <= 0.0005 + 25 * 2.0**-24
            assert not units[np.isinf(truth)].any()
    info = bag["/camL0/camera_info"][0][1]
    np.testing.assert_array_equal(info.k.reshape(3, 3), data.intrinsics("L0", "opencv"))
    assert (info.width, info.height) == (48, 27)


class Tree:
    """The frames of a bag at a time, by what leads from each to its parent."""

    def __init__(self, bag, time_ns):
        moving = [(t, m) for t, m in bag["/tf"] if t == time_ns]
        self.parents = {
            each.child_frame_id: (each.header.frame_id, T)
            for topic in (moving, bag["/tf_static"])
            for _, message in topic
            for each, T in zip(
                message.transforms,
                poses_of(
                    [(0, each) for each in message.transforms],
                    lambda m: (m.transform.translation, m.transform.rotation),
                ),
                strict=True,
            )
        }

    def from_map(self, frame):
        """T of the frame in map."""
        T = np.eye(4)
        while frame != "map":
            frame, up = self.parents[frame]
            T = up @ T
        return T


def test_the_tree_is_that_of_rep_105_and_the_metadata_tell_it(bag, out):
    tree = Tree(bag, 300_000_000)
    assert {child: parent for child, (parent, _) in tree.parents.items()} == {
        "odom": "map",
        "base_link": "odom",
        "imu_link": "base_link",
        "depth_gauge_link": "base_link",
        "camL0_optical_frame": "base_link",
        "camR0_optical_frame": "base_link",
    }
    about = yaml.safe_load((out / "mcap/bag/metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert "base_link (x forward, y left, z up" in about["custom_data"]["frames"]
    named = {m.header.frame_id for topic in bag for _, m in bag[topic][:1] if hasattr(m, "header")}
    assert named - {"odom"} == {"imu_link", "depth_gauge_link", "camL0_optical_frame", "camR0_optical_frame"}


def test_a_point_of_the_world_goes_down_the_tree_to_the_pixel_whose_depth_it_has(data, bag):
    """Pixels that the dataset's own model of the camera, its pose and D place in the world, by CameraInfo's K."""
    rng = np.random.default_rng(4)
    for camera in ("L0", "R0"):
        frame, time_ns = data.frames[3], int(data.time_ns(camera)[3])
        z = data.planar_depth(frame, camera)
        row, col = np.transpose(rng.permutation(np.argwhere(np.isfinite(z)))[:50])
        points = points_at(data.camera_model(camera), sight(data, frame, camera), row, col, z[row, col])
        info = next(m for t, m in bag[f"/cam{camera}/camera_info"] if t == time_ns)
        T = np.linalg.inv(Tree(bag, time_ns).from_map(info.header.frame_id))
        there = points @ T[:3, :3].T + T[:3, 3]
        u, v, w = (there @ info.k.reshape(3, 3).T).T
        np.testing.assert_allclose(np.stack([u / w, v / w], -1), np.stack([col, row], -1), rtol=0, atol=1e-9)
        np.testing.assert_allclose(there[:, 2], z[row, col], rtol=0, atol=1e-9)


def test_moving_transforms_are_the_course_of_the_vehicle(data, bag):
    course = [(t, m.transforms[0]) for t, m in bag["/tf"]]
    assert {len(message.transforms) for _, message in bag["/tf"]} == {1}
    time_ns, T_w_v = data.poses("vehicle")
    np.testing.assert_array_equal([t for t, _ in course], time_ns)
    T = poses_of(course, lambda m: (m.transform.translation, m.transform.rotation))
    np.testing.assert_allclose(T, base_of(T_w_v), rtol=0, atol=ROUNDING)


@pytest.fixture(scope="module")
def ahead(tmp_path_factory):
    """The bag of a vehicle that stands, then goes forward and turns left; its IMU is turned."""
    root = tmp_path_factory.mktemp("ahead")
    legs = [
        {"position": [0, 0, 1]},
        {"position": [0, 0, 1]},
        {"position": [0, 3, 1]},
        {"position": [-3, 3, 1], "rotation_euler_deg": [20, 10, 90]},
    ]
    scene = scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 9, "relief_m": 0.0},
            "vehicle": {"cameras": [{"id": "M0", "resolution": [16, 9]}], "imu": {"rotation_euler_deg": [0, 90, 0]}},
            "trajectory": {"waypoints": legs, "speed": 0.5},
            "surface_depth_m": 50,
            "render": {"outputs": ["A"], "frame_rate_hz": 1},
        }
    )
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch, ("render.planner.plan", "render.renderer"))  # a course with dynamics
        produce(scene, root / "data", quiet=True)
    export(root / "data", "mcap", root / "out")
    return messages_of(root / "out/bag")


def test_at_rest_gravity_is_felt_up_and_forward_is_x_and_left_is_y(ahead):
    """+9.81 along z of the base (REP 145), by the IMU's own axes and /tf_static."""
    first, imu = ahead["/ground_truth"][0][1], ahead["/imu0"][0][1]
    assert (first.twist.twist.linear.x, first.twist.twist.angular.z) == (0.0, 0.0)
    _, T = Tree(ahead, 0).parents[imu.header.frame_id]
    felt = imu.linear_acceleration
    np.testing.assert_allclose(T[:3, :3] @ [felt.x, felt.y, felt.z], [0, 0, 9.81], rtol=0, atol=1e-12)
    assert abs(felt.z) < 1e-12  # so it is the tree that turns it
    speed = vectors(ahead["/ground_truth"], lambda m: m.twist.twist.linear)
    turning = vectors(ahead["/ground_truth"], lambda m: m.twist.twist.angular)
    assert speed[:, 0].max() > 0.4
    assert turning[:, 2].max() > 0.05
    position = vectors(ahead["/ground_truth"], lambda m: m.pose.pose.position)
    straight = (position[:, 1] > 0.5) & (position[:, 1] < 1.5)
    assert straight.sum() > 100
    np.testing.assert_allclose(speed[straight][:, 1:], 0.0, rtol=0, atol=1e-12)


def test_twist_and_readings_turn_and_speed_up_as_the_base_does(ahead):
    """Against central differences of its poses over steps h: off by h^2/6 and h^2/12 times second derivatives.

    These are bounded by second differences of what is compared, with a half more for what is of higher order.
    """
    messages, h = ahead["/ground_truth"], 0.005
    T = poses_of(messages, lambda m: (m.pose.pose.position, m.pose.pose.orientation))
    R, place = T[:, :3, :3], T[:, :3, 3]
    turn = Rotation.from_matrix(R[:-2].transpose(0, 2, 1) @ R[2:]).as_rotvec() / (2.0 * h)
    turning = vectors(messages, lambda m: m.twist.twist.angular)
    assert (np.abs(turning).max(axis=0) > 0.02).all()  # about all axes
    np.testing.assert_allclose(turning[1:-1], turn, rtol=0, atol=1.5 / 6 * np.abs(np.diff(turning, 2, axis=0)).max())
    _, mount = Tree(ahead, 0).parents[ahead["/imu0"][0][1].header.frame_id]
    felt, gyro = (
        vectors(ahead["/imu0"], get)[: len(T)] @ mount[:3, :3].T
        for get in (lambda m: m.linear_acceleration, lambda m: m.angular_velocity)
    )
    np.testing.assert_allclose(gyro, turning, rtol=0, atol=1e-12)
    second = (place[2:] - 2.0 * place[1:-1] + place[:-2]) / h**2 + [0.0, 0.0, 9.81]
    own = np.einsum("nji,nj->ni", R[1:-1], second)
    assert np.abs(own[:, :2]).max() > 0.02
    world = np.einsum("nij,nj->ni", R, felt)
    bound = 1.5 / 12 * np.linalg.norm(np.diff(world, 2, axis=0), axis=1).max() + 1e-9  # rounding of places over h^2
    np.testing.assert_allclose(felt[1:-1], own, rtol=0, atol=bound)


def test_the_gyroscope_integrates_to_the_turn_between_two_poses_of_tf(ahead):
    """By the middle of neighbouring readings; the frame is that of the readings, led to ``map`` by both kinds of /tf.

    A trapezoid's step errs by h^3/12 times the second derivative of the rate, and by as much as the turn that two
    rates which are not parallel make, h^3/12 of the rate times its derivative: both are summed over all steps.
    """
    times = [t for t, m in ahead["/tf"] if m.transforms[0].child_frame_id == "base_link"]
    first, last, h = times[0], times[-1], 0.005
    frame = ahead["/imu0"][0][1].header.frame_id
    start, end = (Tree(ahead, t).from_map(frame)[:3, :3] for t in (first, last))
    rate = vectors([(t, m) for t, m in ahead["/imu0"] if first <= t <= last], lambda m: m.angular_velocity)
    assert len(rate) == round((last - first) * 1e-9 / h) + 1
    turned = Rotation.from_matrix(start)
    for step in Rotation.from_rotvec(h / 2.0 * (rate[:-1] + rate[1:])):
        turned = turned * step
    truth = Rotation.from_matrix(end)
    change = np.linalg.norm(np.diff(rate, axis=0), axis=1)
    bound = (
        h / 12 * np.linalg.norm(np.diff(rate, 2, axis=0), axis=1).sum()
        + h * h / 12 * (np.linalg.norm(rate[1:], axis=1) * change).sum()
    )
    assert (Rotation.from_matrix(start).inv() * truth).magnitude() > 1.0
    assert (turned.inv() * truth).magnitude() < 1.5 * bound


def test_the_right_camera_of_a_pair_is_known_by_its_baseline(data, bag):
    """x_right = x_left - f b / z, of a point straight ahead of the left camera."""
    left, right = (bag[f"/cam{camera}/camera_info"][0][1].p.reshape(3, 4) for camera in ("L0", "R0"))
    assert left[0, 3] == 0
    assert right[0, 3] == pytest.approx(-data.intrinsics("R0")[0, 0] * 0.2, rel=1e-12)
    np.testing.assert_array_equal(left[:, :3], right[:, :3])


# -------------------------------------------------------------------------------------------- the MCAP project's reader


@pytest.fixture(scope="module")
def raw(written, tmp_path_factory):
    out = tmp_path_factory.mktemp("raw") / "out"
    export(written, "mcap", out, raw=True)
    return decoded(out / "bag/bag.mcap")


def test_the_reader_of_mcap_finds_what_rosbags_finds(bag, out):
    found = decoded(out / "mcap/bag/bag.mcap")
    assert {topic: [t for t, _ in messages] for topic, messages in found.items()} == {
        topic: [t for t, _ in messages] for topic, messages in bag.items()
    }
    np.testing.assert_array_equal(
        vectors(found["/imu0"], lambda m: m.linear_acceleration), vectors(bag["/imu0"], lambda m: m.linear_acceleration)
    )
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
        for frame, (_, image), (_, depth) in zip(
            data.frames, raw[f"/cam{camera}/image"], raw[f"/cam{camera}/depth"], strict=True
        ):
            assert (image.encoding, depth.encoding) == ("rgb8", "32FC1")
            assert (image.step, depth.step) == (48 * 3, 48 * 4)
            np.testing.assert_array_equal(
                np.frombuffer(image.data, np.uint8).reshape(27, 48, 3), data.pixels("A", frame, camera)
            )
            np.testing.assert_array_equal(
                np.frombuffer(depth.data, np.float32).reshape(27, 48), data.depth(frame, camera)
            )
    assert {topic for topic in raw if topic.startswith("/camL0/")} == {
        "/camL0/camera_info",
        "/camL0/image",
        "/camL0/image/compressed",
        "/camL0/depth",
        "/camL0/depth/compressed",
    }


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
