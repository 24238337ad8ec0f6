"""VSLAM-LAB: a sequence of its benchmark, for the SLAM systems that it runs (https://github.com/VSLAM-LAB/VSLAM-LAB).

``VAROS_WARP/<sequence>`` has rgb_0, rgb_1, depth_0, rgb.csv, groundtruth.csv, imu_0.csv and calibration.yaml, and
``dataset_varos_warp.yaml`` describes the data set. The body frame B is the IMU's; without an IMU it is the first
camera's. T_BS maps sensor to body coordinates. The course is that of the first camera, which systems give the poses of.
"""

import re
import warnings

import numpy as np
import yaml

from varos_warp.dataset import files
from varos_warp.dataset.export.estimators import NoAliases, imu_noise
from varos_warp.dataset.export.shared.job import Job, lens_of, quaternion
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.frames import inverse

IMAGES = WATER + DEPTH
SENSORS = ("imu0",)
HOLDS = "one camera, or two on the vehicle of which the second is at the right of the first and looks the same way"
NAME = "varos_warp"
"""Name of the data set; its folder is that in capitals."""
GROUND_TRUTH = ["ts (ns)", *(f"t{axis} (m)" for axis in "xyz"), "qx", "qy", "qz", "qw"]
READINGS = ["ts (ns)", *(f"w{axis} (rad s^-1)" for axis in "xyz"), *(f"a{axis} (m s^-2)" for axis in "xyz")]
DISTORTIONS = {("brown_conrady", 4): "radtan4", ("brown_conrady", 5): "radtan5", ("kannala_brandt", 4): "equid4"}
"""Its names of models of distortion, by ours and how many coefficients there are."""
SATURATION = 1000.0
"""The IMU has none, but systems want a limit [m/s^2, rad/s]: one that nothing reaches."""
LEAST_BIAS = {"gyroscope": 1e-3, "accelerometer": 1e-2}
"""The least standard deviation of the first bias that is stated [rad/s, m/s^2]: systems refuse zeros."""
LEAST_COSINE = 0.9
"""Least cosine of the angle between the views of a pair."""


def cameras(job: Job) -> tuple[str, ...]:
    """The first camera and, if there is one, its partner to the right."""
    first, *others = job.cameras
    return (first, *[camera for camera in others if _is_right_of(job, first, camera)][:1])


def write(job: Job) -> None:
    """Write the sequence and the description of the data set that it is of."""
    sequence = re.sub(r"[^A-Za-z0-9_.-]", "_", job.data.root.resolve().name).lstrip(".") or "sequence"
    folder = f"{NAME.upper()}/{sequence}"
    has_imu = "imu0" in job.data.recorded and not _in_world(job, job.cameras[0])
    rgb = [_camera(job, folder, number, camera, has_imu) for number, camera in enumerate(job.cameras)]
    _warn_of_unlike(rgb, job.cameras)
    _lists(job, folder)
    imu = _imu(job, folder) if has_imu else []
    lines = ["%YAML 1.2", "---", "cameras:", *map(_item, rgb), *(["", "imus:"] if imu else []), *map(_item, imu)]
    job.text(f"{folder}/calibration.yaml", lines)
    job.text(f"dataset_{NAME}.yaml", [_yaml(_description(job, sequence, rgb, imu), flow=False).rstrip("\n")])


# ------------------------------------------------------------------------------------------------------------- cameras


def _in_world(job: Job, camera: str) -> bool:
    return job.data.camera(camera)["mount"] == "world"


def _is_right_of(job: Job, left: str, right: str) -> bool:
    """Return whether two cameras are the pair that stereo systems take them for: both on the vehicle, side by side."""
    if _in_world(job, left) or _in_world(job, right):
        return False
    T = inverse(_mount(job, left)) @ _mount(job, right)
    x, y, z = T[:3, 3]
    return bool(x > max(abs(y), abs(z)) and T[2, 2] > LEAST_COSINE)


def _mount(job: Job, camera: str) -> np.ndarray:
    """T_v_c [4, 4]."""
    return np.array(job.data.camera(camera)["T_v_c"])


def _body(job: Job, has_imu: bool) -> np.ndarray:
    """T_v_B [4, 4] of the body."""
    return np.array(job.data.meta["sensors"]["imu0"]["T_v_s"]) if has_imu else _mount(job, job.cameras[0])


def _camera(job: Job, folder: str, number: int, camera: str, has_imu: bool) -> dict:
    """Link the images of a camera, encode its depth if it is the first, and give its entry in calibration.yaml."""
    facts, time_ns = job.data.camera(camera), job.data.views(camera)[0].tolist()
    lens, k = lens_of(job, camera, "VSLAM-LAB", "brown_conrady", "brown_conrady without k3", "kannala_brandt")
    job.link_images(camera, (f"{folder}/rgb_{number}/{t}.png" for t in time_ns))
    has_depth = job.has_depth and number == 0
    if has_depth:
        job.depths(camera, (f"{folder}/depth_0/{t}.png" for t in time_ns), _per_metre(job))
    focal, centre = np.split(np.array(job.fx_fy_cx_cy(camera)), 2)
    T_B_c = np.eye(4) if _in_world(job, camera) else inverse(_body(job, has_imu)) @ _mount(job, camera)
    return {
        "cam_name": f"rgb_{number}",
        "cam_type": "rgb+depth" if has_depth else "rgb",
        **({"depth_name": "depth_0"} if has_depth else {}),
        "cam_model": "pinhole",
        **({"distortion_type": DISTORTIONS[lens, len(k)]} if k else {}),
        "focal_length": focal.tolist(),
        "principal_point": centre.tolist(),
        **({"depth_factor": _per_metre(job)} if has_depth else {}),
        **({"distortion_coefficients": k} if k else {}),
        "image_dimension": [facts["width"], facts["height"]],
        "fps": float(job.data.meta["frames"]["rate_hz"]),
        "T_BS": T_B_c.ravel().tolist(),
    }


def _warn_of_unlike(rgb: list[dict], cameras: tuple[str, ...]) -> None:
    """Stereo systems rectify a pair of one size, by lenses of one kind; images or lenses that differ are told of."""
    kinds = {
        "image_dimension": "resolution",
        "distortion_type": "kind of distortion",
        "focal_length": "focal length",
        "distortion_coefficients": "distortion",
    }
    unlike = [words for key, words in kinds.items() if len({str(camera.get(key)) for camera in rgb}) > 1]
    if unlike:
        warnings.warn(
            f"cameras {' and '.join(cameras)} of the stereo pair are unlike ({', '.join(unlike)}), and many "
            "systems take both for the kind of the first; --camera exports one alone",
            stacklevel=4,
        )


def _per_metre(job: Job) -> float:
    """Units of depth in a metre: any will do, so 16 bits reach as far as D, whose unit this is if it begins at 0."""
    return 65535.0 / job.data.meta["depth"]["range_m"][1]


def _lists(job: Job, folder: str) -> None:
    """rgb.csv of images side by side, and groundtruth.csv of the first camera."""
    header, columns = [], []
    for number, camera in enumerate(job.cameras):
        time_ns = job.data.views(camera)[0]
        for kind in ("rgb", "depth") if job.has_depth and number == 0 else ("rgb",):
            name = f"{kind}_{number}"
            header += [f"ts_{name} (ns)", f"path_{name}"]
            columns += [time_ns, [f"{name}/{t}.png" for t in time_ns.tolist()]]
    files.write_csv(job.out / folder / "rgb.csv", header, *columns)
    time_ns, T_w_c = job.data.views(job.cameras[0])
    files.write_csv(
        job.out / folder / "groundtruth.csv",
        GROUND_TRUTH,
        time_ns,
        T_w_c[:, :3, 3],
        quaternion(T_w_c, scalar_first=False),
    )


# ----------------------------------------------------------------------------------------------------------------- IMU


def _imu(job: Job, folder: str) -> list[dict]:
    """Write the readings, the gyroscope's first, and give the entry in calibration.yaml, in a list."""
    imu, about = job.data.imu(), job.data.meta["sensors"]["imu0"]
    files.write_csv(
        job.out / folder / "imu_0.csv", READINGS, imu["time_ns"], imu["angular_velocity"], imu["acceleration"]
    )
    noise = imu_noise(job)[0]
    zeros = [0.0, 0.0, 0.0]
    return [
        {
            "imu_name": "imu_0",
            "a_max": SATURATION,
            "g_max": SATURATION,
            "sigma_g_c": noise["gyroscope_noise_density"],
            "sigma_gw_c": noise["gyroscope_random_walk"],
            "sigma_a_c": noise["accelerometer_noise_density"],
            "sigma_aw_c": noise["accelerometer_random_walk"],
            "sigma_bg": _first_bias(about, "gyroscope"),
            "sigma_ba": _first_bias(about, "accelerometer"),
            "a0": zeros,
            "g0": zeros,
            "g": float(np.linalg.norm(job.data.meta["gravity"])),
            "s_a": [1.0, 1.0, 1.0],
            "fps": float(about["rate_hz"]),
            "T_BS": np.eye(4).ravel().tolist(),
        }
    ]


def _first_bias(about: dict, sensor: str) -> float:
    """Standard deviation of the bias at the start, about zero: the constant part's largest axis and that drawn once."""
    noise = about.get("noise") or {}
    constant = np.abs(noise.get(f"{sensor}_bias") or [0.0]).max()
    return float(max(np.hypot(constant, noise.get(f"{sensor}_turn_on_bias") or 0.0), LEAST_BIAS[sensor]))


# ------------------------------------------------------------------------------------------------------------ the file


def _description(job: Job, sequence: str, rgb: list[dict], imu: list[dict]) -> dict:
    """What VSLAM-LAB wants to know of a data set."""
    kinds = ["mono", *(["stereo"] if len(rgb) > 1 else []), *(["rgbd"] if job.has_depth else [])]
    return {
        "dataset_name": NAME,
        "rgb_hz": rgb[0]["fps"],
        **({"imu_hz": imu[0]["fps"]} if imu else {}),
        "modes": kinds + [f"{kind}-vi" for kind in kinds if imu],
        "cam_models": list(dict.fromkeys(camera.get("distortion_type", "pinhole") for camera in rgb)),
        **({"depth_factor": rgb[0]["depth_factor"]} if job.has_depth else {}),
        "sequence_names": [sequence],
    }


def _item(entry: dict) -> str:
    """A mapping of a list on one line, as OpenCV and PyYAML read it."""
    return f"  - {_yaml(entry, flow=True).strip()}"


def _yaml(content: dict, flow: bool) -> str:
    return yaml.dump(content, Dumper=NoAliases, sort_keys=False, default_flow_style=flow or None, width=1_000_000)
