"""Settings of estimators that read the EuRoC export: ORB-SLAM3, Kalibr and OpenVINS.

What each asks for was read in its source: ORB-SLAM3 ``Settings.cc`` (mono-inertial, and stereo-inertial where there
are two cameras), Kalibr ``ConfigReader.py`` and, of rolling shutters, what ``RsCalibrator.py`` saves, OpenVINS
``opencv_yaml_parse.h`` and its EuRoC configuration. OpenCV reads the first and the last; it wants ``%YAML:1.0`` in the
first line, which PyYAML, Kalibr's reader, refuses. ORB-SLAM3 and OpenVINS know global shutters only.
"""

import warnings
from importlib import resources
from typing import NamedTuple

import numpy as np
import yaml

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job, lens_of
from varos_warp.scene.frames import inverse
from varos_warp.scene.optics.shutter import offsets_of_rows_s

NOISE_FREE = {
    "gyroscope_noise_density": 1e-4,
    "gyroscope_random_walk": 1e-6,
    "accelerometer_noise_density": 1e-3,
    "accelerometer_random_walk": 1e-5,
}
"""Estimators and Kalibr refuse zeros, so readings without noise are said to have this little; Kalibr's units."""


def write(job: Job, T_b_c: dict[str, np.ndarray]) -> None:
    """Write the settings of all, with poses [4, 4] of the cameras on the IMU by id, in the order of their folders."""
    spheres = [camera for camera in T_b_c if kalibr_camera(job, camera).model == "ds"]
    if orb_slam3 := not set(spheres) & set(list(T_b_c)[:2]):
        _orb_slam3(job, T_b_c)
    chain = _camera_chain(job, T_b_c)
    imu = {**imu_noise(job)[0], "rostopic": "/imu0", "update_rate": float(job.data.meta["sensors"]["imu0"]["rate_hz"])}
    write_yaml(job, "kalibr_camchain.yaml", chain)
    write_yaml(job, "kalibr_imu.yaml", imu)
    if not spheres:
        _openvins(job, chain, imu)
        return
    unsaid = " and ".join(["ORB-SLAM3"] * (not orb_slam3) + ["OpenVINS"])
    warnings.warn(
        f"{unsaid} cannot state a double sphere ({', '.join(spheres)}): no settings for {unsaid} are written",
        stacklevel=2,
    )


def _settings(program: str) -> dict:
    """What a program asks for, whatever the dataset."""
    path = resources.files("varos_warp") / "data" / "estimators" / f"{program}.yaml"
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def imu_noise(job: Job) -> tuple[dict[str, float], str]:
    """The IMU's noise in Kalibr's units without zeros, and a remark."""
    noise = job.data.meta["sensors"]["imu0"].get("noise") or {}
    values = {key: float(noise.get(key) or little) for key, little in NOISE_FREE.items()}
    free = [key for key in NOISE_FREE if not noise.get(key)]
    comment = f"; small numbers stand in for zero: {', '.join(free)}" if free else ""
    return values, f"varos_warp IMU, {job.noise('imu0')}{comment}"


class KalibrCamera(NamedTuple):
    """A camera as Kalibr has it."""

    model: str
    """pinhole, or ds of the double sphere."""
    intrinsics: list[float]
    """fx, fy, cx, cy [pixels], behind xi and alpha of a double sphere."""
    distortion: str
    """radtan or equidistant; none of a double sphere."""
    k: list[float]
    """Its four coefficients, or none."""


def kalibr_camera(job: Job, camera: str) -> KalibrCamera:
    """What Kalibr calls a camera, and its numbers."""
    known = "brown_conrady without k3", "kannala_brandt", "double_sphere"
    lens, k = lens_of(job, camera, "EuRoC (Kalibr's radtan, equidistant and ds)", *known)
    if lens == "double_sphere":
        return KalibrCamera("ds", [*k, *job.fx_fy_cx_cy(camera)], "none", [])
    return KalibrCamera(
        "pinhole", job.fx_fy_cx_cy(camera), "equidistant" if lens == "kannala_brandt" else "radtan", k or [0.0] * 4
    )


# ---------------------------------------------------------------------------------------------------------- ORB-SLAM3


def _orb_slam3(job: Job, T_b_c: dict[str, np.ndarray]) -> None:
    """Settings and times.txt, as text: OpenCV reads dotted keys but cannot write them.

    ORB-SLAM3 looks one IMU row beyond each image without asking if there is one, so times.txt names only the images
    between the first row and the last.
    """
    (first, T_b_c1), *others = T_b_c.items()
    facts, noise, meta = job.data.camera(first), imu_noise(job)[0], job.data.meta
    imu_ns, time_ns = job.data.imu()["time_ns"], job.data.time_ns(first)
    job.text("times.txt", map(str, time_ns[(time_ns >= imu_ns[0]) & (time_ns < imu_ns[-1])].tolist()))
    values = {
        **_orb_slam3_camera(job, first, 1),
        "Camera.width": facts["width"],
        "Camera.height": facts["height"],
        "Camera.fps": max(1, round(meta["frames"]["rate_hz"])),
        "Camera.RGB": 0,
        "IMU.NoiseGyro": noise["gyroscope_noise_density"],
        "IMU.NoiseAcc": noise["accelerometer_noise_density"],
        "IMU.GyroWalk": noise["gyroscope_random_walk"],
        "IMU.AccWalk": noise["accelerometer_random_walk"],
        "IMU.Frequency": float(meta["sensors"]["imu0"]["rate_hz"]),
    } | _settings("orb_slam3")
    kind = "KannalaBrandt8" if kalibr_camera(job, first).distortion == "equidistant" else "PinHole"
    lines = ["%YAML:1.0", 'File.version: "1.0"', f'Camera.type: "{kind}"', *_opencv_matrix("IMU.T_b_c1", T_b_c1)]
    if others:
        second, T_b_c2 = others[0]
        values |= {**_orb_slam3_camera(job, second, 2), "Stereo.ThDepth": 60.0}
        lines += _opencv_matrix("Stereo.T_c1_c2", inverse(T_b_c1) @ T_b_c2)
    job.text(
        "orb_slam3.yaml",
        lines + [f"{key}: {_real(value) if isinstance(value, float) else value}" for key, value in values.items()],
    )


def _orb_slam3_camera(job: Job, camera: str, number: int) -> dict[str, float]:
    _, intrinsics, distortion, k = kalibr_camera(job, camera)
    last = ("k3", "k4") if distortion == "equidistant" else ("p1", "p2")
    values = zip(("fx", "fy", "cx", "cy", "k1", "k2", *last), [*intrinsics, *k], strict=True)
    return {f"Camera{number}.{name}": value for name, value in values}


def _opencv_matrix(key: str, T: np.ndarray) -> list[str]:
    """Float32, as ORB-SLAM3 takes it for."""
    data = ", ".join(map(_real, T.ravel().tolist()))
    return [f"{key}: !!opencv-matrix", "   rows: 4", "   cols: 4", "   dt: f", f"   data: [{data}]"]


def _real(x: float) -> str:
    """Digits of a float64 with a point, as YAML 1.1 and OpenCV want them."""
    return yaml.safe_dump(float(x)).split("\n")[0]


# --------------------------------------------------------------------------------------------------- Kalibr, OpenVINS


def _camera_chain(job: Job, T_b_c: dict[str, np.ndarray]) -> dict[str, dict]:
    """Kalibr's camera chain; T_cam_imu is the inverse of T_BS. The topics are those of the MCAP export."""
    chain: dict[str, dict] = {}
    numbers, before = range(len(T_b_c)), None
    for number, (camera, T) in enumerate(T_b_c.items()):
        facts, (model, intrinsics, distortion, k) = job.data.camera(camera), kalibr_camera(job, camera)
        chain[f"cam{number}"] = {
            "cam_overlaps": [n for n in numbers if n != number],
            "camera_model": model,
            "distortion_coeffs": k,
            "distortion_model": distortion,
            "intrinsics": intrinsics,
            "resolution": [facts["width"], facts["height"]],
            "rostopic": f"/cam{camera}/image",
            "T_cam_imu": inverse(T).tolist(),
            **_row_times(facts),
        }
        if before is not None:
            chain[f"cam{number}"]["T_cn_cnm1"] = (inverse(T) @ before).tolist()
        before = T
    return chain


def _row_times(facts: dict) -> dict[str, float]:
    """Kalibr's shutter: an image point v rows down is of the stamp + v line_delay, and t_imu = t_cam + timeshift.

    Stamps here are of the middle row, so the shift is that of the first row's middle, v = 0.
    """
    readout_s = (facts.get("exposure") or {"readout_s": 0.0})["readout_s"]
    if not readout_s:
        return {"timeshift_cam_imu": 0.0}
    return {
        "timeshift_cam_imu": float(offsets_of_rows_s(facts["height"], readout_s)[0]),
        "line_delay": readout_s / facts["height"],
    }


def _openvins(job: Job, chain: dict[str, dict], imu: dict) -> None:
    """estimator_config.yaml and the two chains that it names."""
    meta, count = job.data.meta, len(chain)
    settings = _settings("openvins") | {
        "use_stereo": count > 1,
        "max_cameras": count,
        "gravity_mag": float(np.linalg.norm(meta["gravity"])),
        "track_frequency": 2.0 * meta["frames"]["rate_hz"] + 1.0,
    }  # of images, or it drops some
    write_yaml(job, "openvins/estimator_config.yaml", settings, opencv=True)
    # it takes all rows to be of one time, which is best the stamp
    rowless = {
        name: {key: value for key, value in camera.items() if key != "line_delay"} | {"timeshift_cam_imu": 0.0}
        for name, camera in chain.items()
    }
    write_yaml(job, "openvins/kalibr_imucam_chain.yaml", rowless, opencv=True)
    identity = np.eye(3).tolist()
    write_yaml(
        job,
        "openvins/kalibr_imu_chain.yaml",
        {
            "imu0": {
                "T_i_b": np.eye(4).tolist(),
                **imu,
                "time_offset": 0.0,
                "model": "kalibr",
                "Tw": identity,
                "R_IMUtoGYRO": identity,
                "Ta": identity,
                "R_IMUtoACC": identity,
                "Tg": np.zeros((3, 3)).tolist(),
            }
        },
        opencv=True,
    )


# --------------------------------------------------------------------------------------------------------------- YAML


class NoAliases(yaml.SafeDumper):
    """A matrix that stands twice is written twice: OpenCV's reader knows no aliases."""

    def ignore_aliases(self, data):
        """None are made."""
        return True


class _Dumper(NoAliases):
    """A key a line, as EuRoC's and Kalibr's own files, with lists of numbers in brackets."""

    def increase_indent(self, flow=False, indentless=False):
        """Rows of a matrix are indented: OpenCV's reader does not know them otherwise."""
        return super().increase_indent(flow, False)


_Dumper.add_representer(
    list,
    lambda dumper, items: dumper.represent_sequence(
        "tag:yaml.org,2002:seq", items, flow_style=not any(isinstance(item, list) for item in items)
    ),
)


def write_yaml(job: Job, name: str, content: dict, opencv: bool = False) -> None:
    """Write a YAML file, with OpenCV's first line or without."""
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=100_000)
    files.write_bytes(job.out / name, (("%YAML:1.0\n\n" if opencv else "") + text).encode())
