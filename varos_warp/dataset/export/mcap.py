"""ROS 2: an MCAP bag of images, calibration, readings of sensors and the true course, by the library rosbags.

Compressed images are the dataset's PNG files as they are; depth is PNG of 16 bit millimetres (REP 118), planar z, 0
for none. Raw ones, where asked for, are rgb8, and float32 metres with inf for none. The topics are those that
image_transport knows a camera by. The log time of a message is its stamp.

Axes and names of frames are those of REP 103 and 105, which `FRAMES` says in the bag, too. Sensors keep their own axes,
as REP 145 has it of an IMU, so that calibrations of other exports are true of the bag; /tf_static has how they are
turned.
"""

from collections.abc import Callable, Iterator
from operator import itemgetter

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.dataset import png
from varos_warp.dataset.export.shared.job import Job, baseline, lens_of, quaternion, to_units
from varos_warp.dataset.export.shared.moving import lights_of_others
from varos_warp.dataset.progress import Progress
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import optional
from varos_warp.products.sensors.protocol import SensorProduct
from varos_warp.products.sensors.registry import SENSORS as ALL
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.frames import transform

IMAGES = WATER + DEPTH
PER_METRE = 1000.0
ROS_MODELS = {"brown_conrady": "plumb_bob", "rational": "rational_polynomial", "kannala_brandt": "equidistant"}
"""What ROS calls models of distortion."""
MAP, ODOM, BASE = "map", "odom", "base_link"
FRAMES = (
    "map (the dataset's world, z up) -> odom (the same: the course has no drift) -> base_link (x forward, y left, "
    f"z up) -> {', '.join(sensor.ros_frame for sensor in ALL)} (axes of the readings) and "
    "cam<id>_optical_frame (x right, y down, z forward); map -> cameras that stand in the world, and what moves: "
    "objects in their own axes, vehicles in those of base_link, with their lights, which point along z"
)
"""The tree of frames, under ``frames`` in the custom data of the bag's metadata."""
T_BASE_V = transform(np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
"""A vehicle's axes x right, y forward, z up in those of REP 103."""
T_V_BASE = T_BASE_V.T
Event = tuple[int, str, Callable]
"""Time [ns], topic, and what makes the message, or None: it is called when its turn comes, so one image is held at a
time."""
SENSORS = tuple(sensor.id for sensor in ALL if sensor.ros_types)
TYPES = {
    **{f"/{sensor.id}{topic}": kind for sensor in ALL for topic, kind in sensor.ros_types.items()},
    "ground_truth": "nav_msgs/msg/Odometry",
    "tf": "tf2_msgs/msg/TFMessage",
    "tf_static": "tf2_msgs/msg/TFMessage",
    "camera_info": "sensor_msgs/msg/CameraInfo",
    "compressed": "sensor_msgs/msg/CompressedImage",
    "image": "sensor_msgs/msg/Image",
    "depth": "sensor_msgs/msg/Image",
}
"""Message type by the topic of a sensor, or by the last word of another."""


def write(job: Job) -> None:
    """Write ``bag/bag.mcap`` and its metadata.yaml; an `InputError` says that rosbags is not installed."""
    optional("rosbags.rosbag2", "the package rosbags", "export", key="to", value="mcap")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    events = sorted(_events(job, Messages(store.types)), key=itemgetter(0))
    writer = Writer(job.out / "bag", version=8, storage_plugin=StoragePlugin.MCAP)
    if job.raw:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.set_custom_data("frames", FRAMES)
    with writer as bag, Progress("bag", len(events), "messages", job.quiet) as progress:
        topics = {}
        for time_ns, topic, make in events:
            kind = TYPES.get(topic) or TYPES[topic.rsplit("/", 1)[-1]]
            if topic not in topics:
                profiles = [_latched()] if topic == "/tf_static" else []
                topics[topic] = bag.add_connection(topic, kind, typestore=store, offered_qos_profiles=profiles)
            if (message := make()) is not None:
                bag.write(topics[topic], time_ns, store.serialize_cdr(message, kind))
            progress.advance()


def _latched():
    """Static transforms reach whoever comes late."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    none = QosTime(0, 0)
    return Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        none,
        none,
        QosLiveliness.AUTOMATIC,
        none,
        False,
    )


def _events(job: Job, messages: "Messages") -> Iterator[Event]:
    """Every message of the bag, sensor by sensor; static transforms first."""
    data = job.data
    yield data.start_ns, "/tf_static", lambda: messages.tf(data.start_ns, *_mounts(job))
    for sensor in (sensor for sensor in ALL if sensor.id in data.recorded):
        for topic in sensor.ros_types:
            yield from _readings(data, sensor, topic, messages)
    if "vehicle" in data.recorded:
        yield from _course(data.states(), messages)
    for key in data.moving:
        time_ns, T = data.poses(key)
        T = T @ T_V_BASE if key.startswith("vehicles.") else T  # which have axes of a vehicle
        for t, p, q in zip(time_ns.tolist(), T[:, :3, 3], quaternion(T, scalar_first=True), strict=True):
            yield t, "/tf", lambda t=t, key=key, p=p, q=q: messages.tf(t, (MAP, key, p, q))
    for camera in job.cameras:
        yield from _camera(job, camera, messages)


def _readings(data: Dataset, sensor: SensorProduct, topic: str, messages: "Messages") -> Iterator[Event]:
    """Readings of a sensor with its noise, a message each on one of its topics."""
    read = data.readings(sensor.id)
    for i, t in enumerate(read["time_ns"].tolist()):
        yield (
            t,
            f"/{sensor.id}{topic}",
            lambda t=t, i=i: sensor.ros(messages, topic, t, {key: read[key][i] for key in read}, data.meta),
        )


def _course(states: dict, messages: "Messages") -> Iterator[Event]:
    """The vehicle: pose in the world, velocities in the axes of its base, as Odometry has them; and the transform."""
    R_w_v, R_v_base = Rotation.from_quat(states["quaternion"], scalar_first=True), T_V_BASE[:3, :3]
    R_w_base = R_w_v * Rotation.from_matrix(R_v_base)
    attitude = R_w_base.as_quat(canonical=True, scalar_first=True)
    velocity, turning = R_w_v.inv().apply(states["velocity"]) @ R_v_base, states["angular_velocity"] @ R_v_base
    for t, p, q, v, w in zip(states["time_ns"].tolist(), states["position"], attitude, velocity, turning, strict=True):
        yield t, "/ground_truth", lambda t=t, p=p, q=q, v=v, w=w: messages.odometry(t, p, q, v, w)
        yield t, "/tf", lambda t=t, p=p, q=q: messages.tf(t, (ODOM, BASE, p, q))


def _camera(job: Job, camera: str, messages: "Messages") -> Iterator[Event]:
    """Image, calibration and depth of every frame."""
    topic, name = f"/cam{camera}", optical_frame(camera)
    facts, K = job.data.camera(camera), job.data.intrinsics(camera, "opencv")
    lens = lens_of(job, camera, "MCAP (ROS)", *ROS_MODELS)
    before = job.cameras[: job.cameras.index(camera)]
    baseline_m = next(filter(None, (baseline(job, left, camera) for left in before)), 0.0)

    def image(t: int, frame: int):
        file = job.data.layout.image(camera, job.images, frame).read_bytes()
        return messages.png(t, name, file, "rgb8; png compressed bgr8")

    def depth(t: int, frame: int):
        file = png.encode(to_units(job.data.planar_depth(frame, camera), PER_METRE))
        return messages.png(t, name, file, "16UC1; png compressed ")

    def raw_image(t: int, frame: int):
        return messages.raw(t, name, job.data.pixels(job.images, frame, camera), "rgb8")

    def raw_depth(t: int, frame: int):
        return messages.raw(t, name, job.data.planar_depth(frame, camera).astype("<f4"), "32FC1")

    made = {"image/compressed": image, "image": raw_image, "depth/compressed": depth, "depth": raw_depth}
    made = {
        kind: make
        for kind, make in made.items()
        if (job.raw or "/" in kind) and (job.has_depth or kind.startswith("image"))
    }
    for t, frame in zip(job.data.views(camera)[0].tolist(), job.data.frames, strict=True):
        yield t, f"{topic}/camera_info", lambda t=t: messages.camera_info(t, name, facts, K, lens, baseline_m)
        for kind, make in made.items():
            yield t, f"{topic}/{kind}", lambda t=t, frame=frame, make=make: make(t, frame)


def optical_frame(camera: str) -> str:
    """Name of a camera's frame, by its id."""
    return f"cam{camera}_optical_frame"


def _mounts(job: Job) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Parent, child, position and quaternion of what is fixed."""
    mounts = [(MAP, ODOM, np.eye(4))]
    mounts += [
        (BASE, sensor.ros_frame, T_BASE_V @ np.array(job.data.meta["sensors"][sensor.id]["T_v_s"]))
        for sensor in ALL
        if sensor.id in job.data.meta["sensors"]
    ]
    for camera in job.cameras:
        facts, name = job.data.camera(camera), optical_frame(camera)
        in_world = facts["mount"] == "world"
        mounts.append(
            (MAP, name, np.array(facts["T_w_c"])) if in_world else (BASE, name, T_BASE_V @ np.array(facts["T_v_c"]))
        )
    mounts += [(*keys, T_BASE_V @ np.array(light["T_v_light"])) for keys, light in lights_of_others(job).items()]
    for parent, child, T in mounts:
        yield parent, child, T[:3, 3], quaternion(T[None], scalar_first=True)[0]


class Messages:
    """Makes ROS messages of classes by their names; quaternions are x y z w there, and are given scalar first here."""

    def __init__(self, types):
        self._types = types

    def __getitem__(self, name: str):
        return self._types[name]

    def header(self, time_ns: int, frame_id: str):
        """Stamp and frame."""
        stamp = self["builtin_interfaces/msg/Time"](*divmod(time_ns, 10**9))
        return self["std_msgs/msg/Header"](stamp, frame_id)

    def vector(self, values, kind: str = "Vector3"):
        """A Vector3 or Point."""
        return self[f"geometry_msgs/msg/{kind}"](*map(float, values))

    def rotation(self, q):
        """A Quaternion of (w, x, y, z)."""
        w, x, y, z = map(float, q)
        return self["geometry_msgs/msg/Quaternion"](x, y, z, w)

    def odometry(self, time_ns: int, position, q, velocity, angular_velocity):
        """An Odometry of the vehicle in the world: exact, so its covariances are zero."""
        pose = self["geometry_msgs/msg/Pose"](self.vector(position, "Point"), self.rotation(q))
        twist = self["geometry_msgs/msg/Twist"](self.vector(velocity), self.vector(angular_velocity))
        return self["nav_msgs/msg/Odometry"](
            self.header(time_ns, ODOM),
            BASE,
            self["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36)),
            self["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
        )

    def tf(self, time_ns: int, *poses):
        """A TFMessage of (parent, child, position, quaternion) each: the pose of the child in the parent."""
        return self["tf2_msgs/msg/TFMessage"](
            [
                self["geometry_msgs/msg/TransformStamped"](
                    self.header(time_ns, parent),
                    child,
                    self["geometry_msgs/msg/Transform"](self.vector(position), self.rotation(q)),
                )
                for parent, child, position, q in poses
            ]
        )

    def camera_info(
        self, time_ns: int, frame_id: str, facts: dict, K: np.ndarray, lens: tuple[str, list[float]], baseline_m: float
    ):
        """A CameraInfo; of the right camera of a rectified pair, P holds the baseline."""
        model, k = ROS_MODELS.get(lens[0], "plumb_bob"), np.array(lens[1] or [0.0] * 5)
        P = np.column_stack([K, [-K[0, 0] * baseline_m, 0.0, 0.0]])
        region = self["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        return self["sensor_msgs/msg/CameraInfo"](
            self.header(time_ns, frame_id),
            facts["height"],
            facts["width"],
            model,
            k,
            K.ravel(),
            np.eye(3).ravel(),
            P.ravel(),
            0,
            0,
            region,
        )

    def png(self, time_ns: int, frame_id: str, data: bytes, form: str):
        """A CompressedImage."""
        return self["sensor_msgs/msg/CompressedImage"](
            self.header(time_ns, frame_id), form, np.frombuffer(data, np.uint8)
        )

    def raw(self, time_ns: int, frame_id: str, pixels: np.ndarray, encoding: str):
        """An Image of little-endian pixels [H, W] or [H, W, C]."""
        height, width = pixels.shape[:2]
        return self["sensor_msgs/msg/Image"](
            self.header(time_ns, frame_id),
            height,
            width,
            encoding,
            0,
            pixels.nbytes // height,
            np.frombuffer(pixels.tobytes(), np.uint8),
        )
