"""Settings of estimators that read the EuRoC export: ORB-SLAM3, Kalibr and OpenVINS.

What each asks for was read in its source: ORB-SLAM3 ``Settings.cc`` (mono-inertial, and stereo-inertial where there
are two cameras), Kalibr ``ConfigReader.py``, OpenVINS ``opencv_yaml_parse.h`` and its EuRoC configuration. OpenCV reads
the first and the last; it wants ``%YAML:1.0`` in the first line, which PyYAML, Kalibr's reader, refuses.
"""

import numpy as np
import yaml

from varos_warp.dataset import files
from varos_warp.dataset.export.job import Job
from varos_warp.scene.frames import inverse

NOISE_FREE = {"gyroscope_noise_density": 1e-4, "gyroscope_random_walk": 1e-6,
              "accelerometer_noise_density": 1e-3, "accelerometer_random_walk": 1e-5}
"""Estimators and Kalibr refuse zeros, so readings without noise are said to have this little; Kalibr's units."""
FEATURES = {"ORBextractor.nFeatures": 1000, "ORBextractor.scaleFactor": 1.2, "ORBextractor.nLevels": 8,
            "ORBextractor.iniThFAST": 20, "ORBextractor.minThFAST": 7, "Viewer.KeyFrameSize": 0.05,
            "Viewer.KeyFrameLineWidth": 1.0, "Viewer.GraphLineWidth": 0.9, "Viewer.PointSize": 2.0,
            "Viewer.CameraSize": 0.08, "Viewer.CameraLineWidth": 3.0, "Viewer.ViewpointX": 0.0,
            "Viewer.ViewpointY": -0.7, "Viewer.ViewpointZ": -3.5, "Viewer.ViewpointF": 500.0}
"""Of ORB-SLAM3: those of its EuRoC settings."""
OPENVINS = {
    "verbosity": "INFO", "use_fej": True, "integration": "rk4", "calib_cam_extrinsics": False,
    "calib_cam_intrinsics": False, "calib_cam_timeoffset": False, "calib_imu_intrinsics": False,
    "calib_imu_g_sensitivity": False, "max_clones": 11, "max_slam": 50, "max_slam_in_update": 25,
    "max_msckf_in_update": 40, "dt_slam_delay": 1, "feat_rep_msckf": "GLOBAL_3D",
    "feat_rep_slam": "ANCHORED_MSCKF_INVERSE_DEPTH", "feat_rep_aruco": "ANCHORED_MSCKF_INVERSE_DEPTH",
    "try_zupt": False, "zupt_chi2_multipler": 0, "zupt_max_velocity": 0.1, "zupt_noise_multiplier": 10,
    "zupt_max_disparity": 0.5, "zupt_only_at_beginning": False, "init_window_time": 2.0, "init_imu_thresh": 1.5,
    "init_max_disparity": 10.0, "init_max_features": 50, "init_dyn_use": True, "init_dyn_mle_opt_calib": False,
    "init_dyn_mle_max_iter": 50, "init_dyn_mle_max_time": 0.05, "init_dyn_mle_max_threads": 6, "init_dyn_num_pose": 6,
    "init_dyn_min_deg": 10.0, "init_dyn_inflation_ori": 10, "init_dyn_inflation_vel": 100, "init_dyn_inflation_bg": 10,
    "init_dyn_inflation_ba": 100, "init_dyn_min_rec_cond": 1e-12, "init_dyn_bias_g": [0.0, 0.0, 0.0],
    "init_dyn_bias_a": [0.0, 0.0, 0.0], "record_timing_information": False,
    "record_timing_filepath": "/tmp/traj_timing.txt", "save_total_state": False,
    "filepath_est": "/tmp/ov_estimate.txt", "filepath_std": "/tmp/ov_estimate_std.txt",
    "filepath_gt": "/tmp/ov_groundtruth.txt", "use_klt": True, "num_pts": 200, "fast_threshold": 20, "grid_x": 5,
    "grid_y": 5, "min_px_dist": 10, "knn_ratio": 0.7, "downsample_cameras": False, "num_opencv_threads": 4,
    "histogram_method": "HISTOGRAM", "use_aruco": False, "num_aruco": 1024, "downsize_aruco": True,
    "up_msckf_sigma_px": 1, "up_msckf_chi2_multipler": 1, "up_slam_sigma_px": 1, "up_slam_chi2_multipler": 1,
    "up_aruco_sigma_px": 1, "up_aruco_chi2_multipler": 1, "use_mask": False,
    "relative_config_imu": "kalibr_imu_chain.yaml", "relative_config_imucam": "kalibr_imucam_chain.yaml"}
"""Its EuRoC configuration, all of which it asks for; but the calibration is exact, so it is not to be estimated, and
the vehicle may move from the start, so initialisation may not wait for it to stand still."""


def write(job: Job, T_b_c: dict[str, np.ndarray]) -> None:
    """Write the settings of all of them.

    Args:
        job: With readings of the IMU, whose axes are the body's.
        T_b_c: Pose of each camera on the body, by its id, in the order of their folders.
    """
    _orb_slam3(job, T_b_c)
    chain = _camera_chain(job, T_b_c)
    imu = {**imu_noise(job)[0], "rostopic": "/imu0", "update_rate": float(job.data.meta["sensors"]["imu0"]["rate_hz"])}
    write_yaml(job, "kalibr_camchain.yaml", chain)
    write_yaml(job, "kalibr_imu.yaml", imu)
    _openvins(job, chain, imu)


def imu_noise(job: Job) -> tuple[dict[str, float], str]:
    """The IMU's noise in Kalibr's units without zeros, and a remark."""
    noise = job.data.meta["sensors"]["imu0"].get("noise") or {}
    values = {key: float(noise.get(key) or little) for key, little in NOISE_FREE.items()}
    free = [key for key in NOISE_FREE if not noise.get(key)]
    comment = f"; small numbers stand in for zero: {', '.join(free)}" if free else ""
    return values, f"varos_warp IMU, {job.noise('imu0')}{comment}"


def fu_fv_cu_cv(job: Job, camera: str) -> list[float]:
    """Pinhole of a camera where the centre of the top left pixel is (0, 0)."""
    return job.data.intrinsics(camera, "opencv")[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()


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
    values = {**_orb_slam3_camera(job, first, 1), "Camera.width": facts["width"], "Camera.height": facts["height"],
              "Camera.fps": max(1, round(meta["frames"]["rate_hz"])), "Camera.RGB": 0,
              "IMU.NoiseGyro": noise["gyroscope_noise_density"], "IMU.NoiseAcc": noise["accelerometer_noise_density"],
              "IMU.GyroWalk": noise["gyroscope_random_walk"], "IMU.AccWalk": noise["accelerometer_random_walk"],
              "IMU.Frequency": float(meta["sensors"]["imu0"]["rate_hz"])} | FEATURES
    lines = ["%YAML:1.0", 'File.version: "1.0"', 'Camera.type: "PinHole"', *_opencv_matrix("IMU.T_b_c1", T_b_c1)]
    if others:
        second, T_b_c2 = others[0]
        values |= {**_orb_slam3_camera(job, second, 2), "Stereo.ThDepth": 60.0}
        lines += _opencv_matrix("Stereo.T_c1_c2", inverse(T_b_c1) @ T_b_c2)
    job.text("orb_slam3.yaml", lines + [
        f"{key}: {_real(value) if isinstance(value, float) else value}" for key, value in values.items()])


def _orb_slam3_camera(job: Job, camera: str, number: int) -> dict[str, float]:
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")
    return {f"Camera{number}.{name}": value
            for name, value in zip(names, [*fu_fv_cu_cv(job, camera), 0.0, 0.0, 0.0, 0.0], strict=True)}


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
        facts = job.data.camera(camera)
        chain[f"cam{number}"] = {
            "cam_overlaps": [n for n in numbers if n != number], "camera_model": "pinhole",
            "distortion_coeffs": [0.0] * 4, "distortion_model": "radtan", "intrinsics": fu_fv_cu_cv(job, camera),
            "resolution": [facts["width"], facts["height"]], "rostopic": f"/cam{camera}/image",
            "T_cam_imu": inverse(T).tolist(), "timeshift_cam_imu": 0.0}
        if before is not None:
            chain[f"cam{number}"]["T_cn_cnm1"] = (inverse(T) @ before).tolist()
        before = T
    return chain


def _openvins(job: Job, chain: dict[str, dict], imu: dict) -> None:
    """estimator_config.yaml and the two chains that it names."""
    meta, count = job.data.meta, len(chain)
    settings = OPENVINS | {
        "use_stereo": count > 1, "max_cameras": count, "gravity_mag": float(np.linalg.norm(meta["gravity"])),
        "track_frequency": 2.0 * meta["frames"]["rate_hz"] + 1.0}  # of images, or it drops some
    write_yaml(job, "openvins/estimator_config.yaml", settings, opencv=True)
    write_yaml(job, "openvins/kalibr_imucam_chain.yaml", chain, opencv=True)
    identity = np.eye(3).tolist()
    write_yaml(job, "openvins/kalibr_imu_chain.yaml", {"imu0": {
        "T_i_b": np.eye(4).tolist(), **imu, "time_offset": 0.0, "model": "kalibr", "Tw": identity,
        "R_IMUtoGYRO": identity, "Ta": identity, "R_IMUtoACC": identity, "Tg": np.zeros((3, 3)).tolist()}}, opencv=True)


# --------------------------------------------------------------------------------------------------------------- YAML


class _Dumper(yaml.SafeDumper):
    """A key a line, as EuRoC's and Kalibr's own files, with lists of numbers in brackets."""

    def ignore_aliases(self, data):
        """A matrix that stands twice is written twice: OpenCV's reader knows no aliases."""
        return True

    def increase_indent(self, flow=False, indentless=False):
        """Rows of a matrix are indented: OpenCV's reader does not know them otherwise."""
        return super().increase_indent(flow, False)


_Dumper.add_representer(list, lambda dumper, items: dumper.represent_sequence(
    "tag:yaml.org,2002:seq", items, flow_style=not any(isinstance(item, list) for item in items)))


def write_yaml(job: Job, name: str, content: dict, opencv: bool = False) -> None:
    """Write a YAML file, with OpenCV's first line or without."""
    text = yaml.dump(content, Dumper=_Dumper, sort_keys=False, default_flow_style=False, width=100_000)
    files.write_bytes(job.out / name, (("%YAML:1.0\n\n" if opencv else "") + text).encode())
