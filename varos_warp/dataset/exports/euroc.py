"""EuRoC / ASL: mav0 with cameras, IMU and ground truth; settings for ORB-SLAM3 and Kalibr beside it.

The body frame B is the IMU's, as in EuRoC and as readers take it for; without an IMU it is the vehicle's. T_BS maps
sensor to body coordinates.
"""

import warnings

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from varos_warp.dataset import files
from varos_warp.dataset.exports.job import Job, quaternion
from varos_warp.errors import InputError
from varos_warp.scene.frames import inverse

IMAGES = "A"
TIME = "#timestamp [ns]"
NOISE_FREE = {"gyroscope_noise_density": 1e-4, "gyroscope_random_walk": 1e-6,
              "accelerometer_noise_density": 1e-3, "accelerometer_random_walk": 1e-5}
"""Estimators and Kalibr refuse zeros, so readings without noise are said to have this little; Kalibr's units."""


def write(job: Job) -> None:
    """Write the folder; cameras that stand in the world have no T_BS and are left out."""
    if not job.data.layout.states.is_file():
        raise InputError("EuRoC needs the course of the vehicle, which this dataset lacks", file=job.data.root,
                         remedy="`varos-warp simulate` into the same folder adds it.")
    cameras = [camera for camera in job.cameras if job.data.camera(camera)["mount"] != "world"]
    if fixed := sorted(set(job.cameras) - set(cameras)):
        warnings.warn(f"not on the vehicle, so left out: {', '.join(fixed)}", stacklevel=2)
    if not cameras:
        raise InputError("no camera is on the vehicle, so none has a T_BS", file=job.data.root,
                         remedy="Export to colmap, nerfstudio or tum.")
    body = _body(job)
    T_B_c = {camera: inverse(body) @ np.array(job.data.camera(camera)["T_v_c"]) for camera in cameras}
    _yaml(job, "mav0/body.yaml", {"comment": "varos_warp: B is the IMU" if job.has_sensor("imu0") else
                                  "varos_warp: B is the vehicle, x right, y forward, z up"})
    for number, camera in enumerate(cameras):
        _camera(job, f"mav0/cam{number}", camera, T_B_c[camera])
    _depth_gauge(job, body)
    if not job.has_sensor("imu0"):
        states = job.data.states()
        _ground_truth(job, states["time_ns"], job.data.poses("vehicle")[1], states["velocity"])
        return
    _imu(job)
    _ground_truth(job, *_imu_course(job, body), job.data.imu_bias())
    _orb_slam3(job, cameras[0], T_B_c[cameras[0]])
    _kalibr(job, T_B_c)


def _body(job: Job) -> np.ndarray:
    """T_v_B."""
    return np.array(job.data.meta["sensors"]["imu0"]["T_v_s"]) if job.has_sensor("imu0") else np.eye(4)


# -------------------------------------------------------------------------------------------------------------- mav0


def _camera(job: Job, folder: str, camera: str, T_B_c: np.ndarray) -> None:
    time_ns = job.poses(camera)[0].tolist()
    for frame, t in zip(job.data.frames, time_ns, strict=True):
        job.link(camera, job.images, frame, f"{folder}/data/{t}.png")
    files.write_csv(job.out / folder / "data.csv", [TIME, "filename"], time_ns, [f"{t}.png" for t in time_ns])
    facts = job.data.camera(camera)
    _yaml(job, f"{folder}/sensor.yaml", {
        "sensor_type": "camera", "comment": f"varos_warp camera {camera}", "T_BS": _matrix(T_B_c),
        "rate_hz": job.data.meta["frames"]["rate_hz"], "resolution": [facts["width"], facts["height"]],
        "camera_model": "pinhole", "intrinsics": _fu_fv_cu_cv(job, camera),
        "distortion_model": "radial-tangential", "distortion_coefficients": [0.0] * 4})


def _imu(job: Job) -> None:
    """Gyroscope first, then accelerometer."""
    imu = job.data.imu()
    files.write_csv(job.out / "mav0/imu0/data.csv",
                    [TIME, *_xyz("w_RS_S_{} [rad s^-1]"), *_xyz("a_RS_S_{} [m s^-2]")],
                    imu["time_ns"], imu["angular_velocity"], imu["acceleration"])
    noise, comment = _noise(job)
    _yaml(job, "mav0/imu0/sensor.yaml", {"sensor_type": "imu", "comment": comment, "T_BS": _matrix(np.eye(4)),
                                         "rate_hz": job.data.meta["sensors"]["imu0"]["rate_hz"], **noise})


def _imu_course(job: Job, T_v_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [N], T_w_s [N, 4, 4] and velocity of the IMU itself [N, 3] in world axes: v + R_wv (omega x l)."""
    time_ns, T_w_s = job.data.poses("imu0")
    states = job.data.states()
    rows = np.searchsorted(states["time_ns"], time_ns).clip(max=len(states["time_ns"]) - 1)
    if not np.array_equal(states["time_ns"][rows], time_ns):
        raise InputError("the IMU's samples are not on the ticks of the vehicle", file=job.data.layout.states,
                         remedy="Check it with `varos-warp validate`, then `run` again.")
    R_w_v = Rotation.from_quat(states["quaternion"][rows], scalar_first=True)
    return time_ns, T_w_s, states["velocity"][rows] + R_w_v.apply(
        np.cross(states["angular_velocity"][rows], T_v_s[:3, 3]))


def _ground_truth(job: Job, time_ns: np.ndarray, T_w_b: np.ndarray, velocity: np.ndarray, bias=None) -> None:
    """17 columns; the quaternion's scalar comes first; the biases are zero where there is no noise."""
    folder = "mav0/state_groundtruth_estimate0"
    if bias is None:
        bias = dict.fromkeys(("angular_velocity", "acceleration"), np.zeros_like(velocity))
    header = ["#timestamp", *_xyz("p_RS_R_{} [m]"), *(f"q_RS_{a} []" for a in "wxyz"), *_xyz("v_RS_R_{} [m s^-1]"),
              *_xyz("b_w_RS_S_{} [rad s^-1]"), *_xyz("b_a_RS_S_{} [m s^-2]")]
    files.write_csv(job.out / folder / "data.csv", header, time_ns, T_w_b[:, :3, 3],
                    quaternion(T_w_b, scalar_first=True), velocity, bias["angular_velocity"], bias["acceleration"])
    _yaml(job, f"{folder}/sensor.yaml", {"sensor_type": "visual-inertial", "comment": "exact, of the simulation; "
                                         "gravity is along -z", "T_BS": _matrix(np.eye(4))})


def _depth_gauge(job: Job, T_v_b: np.ndarray) -> None:
    """EuRoC knows none; it has its own folder, which readers pass over."""
    if not job.has_sensor("depth0"):
        return
    gauge, facts = job.data.depth_gauge(), job.data.meta["sensors"]["depth0"]
    files.write_csv(job.out / "mav0/depth_gauge0/data.csv", [TIME, "depth [m]"], gauge["time_ns"], gauge["depth"])
    _yaml(job, "mav0/depth_gauge0/sensor.yaml", {
        "sensor_type": "depth_gauge", "comment": "metres below the surface, positive down",
        "T_BS": _matrix(inverse(T_v_b) @ np.array(facts["T_v_s"])), "rate_hz": facts["rate_hz"]})


# ---------------------------------------------------------------------------------------------------------- settings


def _orb_slam3(job: Job, camera: str, T_b_c1: np.ndarray) -> None:
    """Settings (mono-inertial) and times.txt, as text: OpenCV reads dotted keys but cannot write them.

    ORB-SLAM3 looks one IMU row beyond each image without asking if there is one, so times.txt names only the images
    between the first row and the last.
    """
    facts, noise = job.data.camera(camera), _noise(job)[0]
    fu, fv, cu, cv = _fu_fv_cu_cv(job, camera)
    imu_ns, time_ns = job.data.imu()["time_ns"], job.data.time_ns(camera)
    job.text("times.txt", map(str, time_ns[(time_ns >= imu_ns[0]) & (time_ns < imu_ns[-1])].tolist()))
    values = {"Camera1.fx": fu, "Camera1.fy": fv, "Camera1.cx": cu, "Camera1.cy": cv, "Camera1.k1": 0.0,
              "Camera1.k2": 0.0, "Camera1.p1": 0.0, "Camera1.p2": 0.0, "Camera.width": facts["width"],
              "Camera.height": facts["height"], "Camera.fps": round(job.data.meta["frames"]["rate_hz"]),
              "Camera.RGB": 0}
    inertial = {"IMU.NoiseGyro": noise["gyroscope_noise_density"], "IMU.NoiseAcc": noise["accelerometer_noise_density"],
                "IMU.GyroWalk": noise["gyroscope_random_walk"], "IMU.AccWalk": noise["accelerometer_random_walk"],
                "IMU.Frequency": float(job.data.meta["sensors"]["imu0"]["rate_hz"])}
    features = {"ORBextractor.nFeatures": 1000, "ORBextractor.scaleFactor": 1.2, "ORBextractor.nLevels": 8,
                "ORBextractor.iniThFAST": 20, "ORBextractor.minThFAST": 7, "Viewer.KeyFrameSize": 0.05,
                "Viewer.KeyFrameLineWidth": 1.0, "Viewer.GraphLineWidth": 0.9, "Viewer.PointSize": 2.0,
                "Viewer.CameraSize": 0.08, "Viewer.CameraLineWidth": 3.0, "Viewer.ViewpointX": 0.0,
                "Viewer.ViewpointY": -0.7, "Viewer.ViewpointZ": -3.5, "Viewer.ViewpointF": 500.0}
    matrix = ", ".join(map(_real, T_b_c1.ravel().tolist()))
    job.text("orb_slam3.yaml", [
        "%YAML:1.0", 'File.version: "1.0"', 'Camera.type: "PinHole"', *_settings(values),
        "IMU.T_b_c1: !!opencv-matrix", "   rows: 4", "   cols: 4", "   dt: f", f"   data: [{matrix}]",
        *_settings(inertial), *_settings(features)])


def _settings(values: dict) -> list[str]:
    """``key: value`` with a point in every real number: OpenCV tells 1 from 1.0."""
    return [f"{key}: {_real(value) if isinstance(value, float) else value}" for key, value in values.items()]


def _real(x: float) -> str:
    """Digits of a float64 with a point, as YAML 1.1 and OpenCV want them."""
    return yaml.safe_dump(float(x)).split("\n")[0]


def _kalibr(job: Job, T_B_c: dict[str, np.ndarray]) -> None:
    """Camera chain and IMU; T_cam_imu is the inverse of T_BS."""
    chain: dict[str, dict] = {}
    numbers = range(len(T_B_c))
    for number, (camera, T) in enumerate(T_B_c.items()):
        facts = job.data.camera(camera)
        chain[f"cam{number}"] = {
            "cam_overlaps": [n for n in numbers if n != number], "camera_model": "pinhole",
            "distortion_coeffs": [0.0] * 4, "distortion_model": "radtan", "intrinsics": _fu_fv_cu_cv(job, camera),
            "resolution": [facts["width"], facts["height"]], "rostopic": f"/cam{number}/image_raw",
            "T_cam_imu": inverse(T).tolist(), "timeshift_cam_imu": 0.0}
        if number:
            before = list(T_B_c.values())[number - 1]
            chain[f"cam{number}"]["T_cn_cnm1"] = (inverse(T) @ before).tolist()
    _yaml(job, "kalibr_camchain.yaml", chain)
    _yaml(job, "kalibr_imu.yaml", {**_noise(job)[0], "rostopic": "/imu0",
                                   "update_rate": float(job.data.meta["sensors"]["imu0"]["rate_hz"])})


# -------------------------------------------------------------------------------------------------------------- parts


def _noise(job: Job) -> tuple[dict[str, float], str]:
    """The IMU's noise in Kalibr's units without zeros, and a remark."""
    noise = job.data.meta["sensors"]["imu0"].get("noise") or {}
    values = {key: float(noise.get(key) or little) for key, little in NOISE_FREE.items()}
    free = [key for key in NOISE_FREE if not noise.get(key)]
    comment = f"; without noise, small numbers stand in for zero: {', '.join(free)}" if free else ""
    return values, f"varos_warp IMU{comment}"


def _fu_fv_cu_cv(job: Job, camera: str) -> list[float]:
    """Pinhole of a camera where the centre of the top left pixel is (0, 0)."""
    return job.data.intrinsics(camera, "opencv")[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()


def _matrix(T: np.ndarray) -> dict:
    return {"cols": 4, "rows": 4, "data": T.ravel().tolist()}


def _xyz(pattern: str) -> list[str]:
    return [pattern.format(axis) for axis in "xyz"]


class _Dumper(yaml.SafeDumper):
    """A key a line, as EuRoC's and Kalibr's own files, with lists of numbers in brackets."""


_Dumper.add_representer(list, lambda dumper, items: dumper.represent_sequence(
    "tag:yaml.org,2002:seq", items, flow_style=not any(isinstance(item, list) for item in items)))


def _yaml(job: Job, name: str, content: dict) -> None:
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=100_000)
    files.write_bytes(job.out / name, text.encode())
