"""EuRoC / ASL: mav0 with cameras, IMU and ground truth; settings of estimators beside it.

The body frame B is the IMU's, as in EuRoC and as readers take it for; without an IMU it is the vehicle's. T_BS maps
sensor to body coordinates.
"""

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export import estimators
from varos_warp.dataset.export.estimators import imu_noise, kalibr_camera, write_yaml
from varos_warp.dataset.export.shared.job import Job, quaternion
from varos_warp.errors import InputError
from varos_warp.products.sensors.protocol import xyz
from varos_warp.scene.description.image_types import WATER
from varos_warp.scene.frames import inverse

IMAGES = WATER
HOLDS = "cameras on the vehicle"
TIME = "#timestamp [ns]"


def cameras(job: Job) -> tuple[str, ...]:
    """Return the cameras on the vehicle: one that stands in the world has no T_BS."""
    return tuple(camera for camera in job.cameras if job.data.camera(camera)["mount"] != "world")


def write(job: Job) -> None:
    """Write the folder."""
    if "vehicle" not in job.data.recorded:
        raise InputError(
            "EuRoC needs the course of the vehicle, which this dataset lacks",
            file=job.data.root,
            remedy="`varos-warp simulate` into the same folder adds it.",
        )
    if not job.cameras:
        raise InputError(
            "no camera is on the vehicle, so none has a T_BS",
            file=job.data.root,
            remedy="Export to colmap, nerfstudio or tum.",
        )
    has_imu = "imu0" in job.data.recorded
    body = np.array(job.data.meta["sensors"]["imu0"]["T_v_s"]) if has_imu else np.eye(4)  # T_v_B
    T_B_c = {camera: inverse(body) @ np.array(job.data.camera(camera)["T_v_c"]) for camera in job.cameras}
    words = "the IMU" if has_imu else "the vehicle, x right, y forward, z up"
    write_yaml(job, "mav0/body.yaml", {"comment": f"varos_warp: B is {words}"})
    for number, camera in enumerate(job.cameras):
        _camera(job, f"mav0/cam{number}", camera, T_B_c[camera])
    _depth_gauge(job, body)
    if not has_imu:
        states = job.data.states()
        _ground_truth(job, states["time_ns"], job.data.poses("vehicle")[1], states["velocity"])
        return
    _imu(job)
    time_ns, T_w_s = job.data.poses("imu0")
    _ground_truth(job, time_ns, T_w_s, job.data.motion_at(time_ns).velocity_of(body[:3, 3]), job.data.imu_bias())
    estimators.write(job, T_B_c)


# -------------------------------------------------------------------------------------------------------------- mav0


def _camera(job: Job, folder: str, camera: str, T_B_c: np.ndarray) -> None:
    time_ns = job.data.views(camera)[0].tolist()
    job.link_images(camera, (f"{folder}/data/{t}.png" for t in time_ns))
    files.write_csv(job.out / folder / "data.csv", [TIME, "filename"], time_ns, [f"{t}.png" for t in time_ns])
    facts, (model, intrinsics, distortion, k) = job.data.camera(camera), kalibr_camera(job, camera)
    _sensor(
        job,
        folder,
        "camera",
        f"varos_warp camera {camera}, {job.noise(job.images)}",
        T_B_c,
        rate_hz=job.data.meta["frames"]["rate_hz"],
        resolution=[facts["width"], facts["height"]],
        camera_model=model,
        intrinsics=intrinsics,  # the double sphere has Kalibr's name, for EuRoC has none
        distortion_model={"radtan": "radial-tangential"}.get(distortion, distortion),
        distortion_coefficients=k,
    )


def _sensor(job: Job, folder: str, kind: str, comment: str, T_B_s: np.ndarray, **more) -> None:
    """Write sensor.yaml of a folder: what it is, where it is on the body, and more."""
    matrix = {"cols": 4, "rows": 4, "data": T_B_s.ravel().tolist()}
    write_yaml(job, f"{folder}/sensor.yaml", {"sensor_type": kind, "comment": comment, "T_BS": matrix, **more})


def _imu(job: Job) -> None:
    """Gyroscope first, then accelerometer."""
    imu = job.data.imu()
    files.write_csv(
        job.out / "mav0/imu0/data.csv",
        [TIME, *xyz("w_RS_S", "rad s^-1"), *xyz("a_RS_S", "m s^-2")],
        imu["time_ns"],
        imu["angular_velocity"],
        imu["acceleration"],
    )
    noise, comment = imu_noise(job)
    rate_hz = job.data.meta["sensors"]["imu0"]["rate_hz"]
    _sensor(job, "mav0/imu0", "imu", comment, np.eye(4), rate_hz=rate_hz, **noise)


def _ground_truth(job: Job, time_ns: np.ndarray, T_w_b: np.ndarray, velocity: np.ndarray, bias=None) -> None:
    """17 columns; the quaternion's scalar comes first; the biases are zero where there is no noise."""
    folder = "mav0/state_groundtruth_estimate0"
    if bias is None:
        bias = dict.fromkeys(("angular_velocity", "acceleration"), np.zeros_like(velocity))
    header = [
        "#timestamp",
        *xyz("p_RS_R", "m"),
        *(f"q_RS_{a} []" for a in "wxyz"),
        *xyz("v_RS_R", "m s^-1"),
        *xyz("b_w_RS_S", "rad s^-1"),
        *xyz("b_a_RS_S", "m s^-2"),
    ]
    files.write_csv(
        job.out / folder / "data.csv",
        header,
        time_ns,
        T_w_b[:, :3, 3],
        quaternion(T_w_b, scalar_first=True),
        velocity,
        bias["angular_velocity"],
        bias["acceleration"],
    )
    _sensor(job, folder, "visual-inertial", "exact, of the simulation; gravity is along -z", np.eye(4))


def _depth_gauge(job: Job, T_v_b: np.ndarray) -> None:
    """EuRoC knows none; it has its own folder, which readers pass over."""
    if "depth0" not in job.data.recorded:
        return
    gauge, facts = job.data.depth_gauge(), job.data.meta["sensors"]["depth0"]
    files.write_csv(job.out / "mav0/depth_gauge0/data.csv", [TIME, "depth [m]"], gauge["time_ns"], gauge["depth"])
    comment = f"metres below the surface, positive down, {job.noise('depth0')}"
    T_B_s = inverse(T_v_b) @ np.array(facts["T_v_s"])
    _sensor(job, "mav0/depth_gauge0", "depth_gauge", comment, T_B_s, rate_hz=facts["rate_hz"])
