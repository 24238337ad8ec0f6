"""Settings of ORB-SLAM3 and OpenVINS read by OpenCV, as they read them; of Kalibr by PyYAML and its reader's rules."""

import cv2
import numpy as np
import pytest
import yaml
from readback import ROUNDING

from varos_warp.dataset.export import export

FLOAT32 = 2.0**-24
"""Relative rounding of a number as float32, which ORB-SLAM3's matrices are."""


def opened(path):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.isOpened()
    return storage


def reals(node):
    """Numbers of a sequence, or of a sequence of them."""
    items = [node.at(i) for i in range(node.size())]
    return [reals(item) if item.isSeq() else item.real() for item in items]


def T_b_c(data, camera):
    return np.linalg.inv(data.meta["sensors"]["imu0"]["T_v_s"]) @ np.array(data.camera(camera)["T_v_c"])


# ---------------------------------------------------------------------------------------------------------- ORB-SLAM3


def test_opencv_reads_the_settings_of_orb_slam3_as_the_kinds_that_it_asks_for(data, out):
    """``readParameter<int>`` refuses a real and aborts; ``readParameter<float>`` takes both."""
    settings = opened(out / "euroc/orb_slam3.yaml")
    assert (out / "euroc/orb_slam3.yaml").read_bytes().startswith(b"%YAML:1.0\n")
    assert settings.getNode("File.version").string() == "1.0"
    assert settings.getNode("Camera.type").string() == "PinHole"
    facts, K = data.camera("L0"), data.intrinsics("L0", "opencv")
    integers = {
        "Camera.width": facts["width"],
        "Camera.height": facts["height"],
        "Camera.fps": 10,
        "Camera.RGB": 0,
        "ORBextractor.nFeatures": 1000,
        "ORBextractor.nLevels": 8,
        "ORBextractor.iniThFAST": 20,
        "ORBextractor.minThFAST": 7,
    }
    for key, value in integers.items():
        assert settings.getNode(key).isInt(), key
        assert settings.getNode(key).real() == value
    for number in (1, 2):
        names = dict(
            zip(
                ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"),
                [*K[[0, 1, 0, 1], [0, 1, 2, 2]], 0.0, 0.0, 0.0, 0.0],
                strict=True,
            )
        )
        for name, value in names.items():
            node = settings.getNode(f"Camera{number}.{name}")
            assert node.isReal()
            assert node.real() == value
    for key in ("IMU.NoiseGyro", "IMU.NoiseAcc", "IMU.GyroWalk", "IMU.AccWalk"):
        assert settings.getNode(key).real() > 0
    assert settings.getNode("IMU.Frequency").real() == 200


def test_opencv_reads_the_matrices_of_orb_slam3(data, out):
    settings = opened(out / "euroc/orb_slam3.yaml")
    T = settings.getNode("IMU.T_b_c1").mat()
    assert T.dtype == np.float32
    np.testing.assert_allclose(T, T_b_c(data, "L0"), rtol=FLOAT32, atol=ROUNDING)
    right_in_left = settings.getNode("Stereo.T_c1_c2").mat()
    np.testing.assert_allclose(
        right_in_left, np.linalg.inv(T_b_c(data, "L0")) @ T_b_c(data, "R0"), rtol=FLOAT32, atol=ROUNDING
    )
    assert right_in_left[0, 3] == pytest.approx(0.2, rel=FLOAT32)  # the right camera lies to the right of the left


def test_a_single_camera_has_no_stereo_settings(written, tmp_path):
    export(written, "euroc", tmp_path / "out", cameras=["R0"])
    text = (tmp_path / "out/orb_slam3.yaml").read_text()
    assert "Camera2" not in text
    assert "Stereo" not in text
    assert opened(tmp_path / "out/openvins/estimator_config.yaml").getNode("max_cameras").real() == 1


# ------------------------------------------------------------------------------------------------------------- Kalibr


def test_kalibrs_reader_would_take_the_camera_chain(data, out):
    """The checks of its ``CameraParameters`` and ``CameraChainParameters``."""
    chain = yaml.safe_load((out / "euroc/kalibr_camchain.yaml").read_text())
    assert list(chain) == ["cam0", "cam1"]
    for camera, entry in zip(data.cameras, chain.values(), strict=True):
        assert isinstance(entry["rostopic"], str)
        assert (entry["camera_model"], entry["distortion_model"]) == ("pinhole", "radtan")
        assert len(entry["intrinsics"]) == len(entry["distortion_coeffs"]) == 4
        assert all(isinstance(x, float) and x >= 0 for x in entry["intrinsics"])
        assert [type(x) for x in entry["resolution"]] == [int, int]
        assert isinstance(entry["timeshift_cam_imu"], float)
        assert all(0 <= number < len(chain) for number in entry["cam_overlaps"])
        np.testing.assert_allclose(entry["T_cam_imu"] @ T_b_c(data, camera), np.eye(4), rtol=0, atol=ROUNDING)
    between = np.array(chain["cam1"]["T_cn_cnm1"]) @ chain["cam0"]["T_cam_imu"]
    np.testing.assert_allclose(between, chain["cam1"]["T_cam_imu"], rtol=0, atol=ROUNDING)


def test_kalibrs_reader_would_take_the_imu(data, out, noisy, tmp_path):
    """It refuses numbers that are not positive."""
    imu = yaml.safe_load((out / "euroc/kalibr_imu.yaml").read_text())
    keys = {
        "accelerometer_noise_density",
        "accelerometer_random_walk",
        "gyroscope_noise_density",
        "gyroscope_random_walk",
        "update_rate",
    }
    assert set(imu) == {*keys, "rostopic"}
    assert all(imu[key] > 0 for key in keys)
    export(noisy.root, "euroc", tmp_path / "out")
    stated = yaml.safe_load((tmp_path / "out/kalibr_imu.yaml").read_text())
    asked = noisy.meta["noise"]["profile"]["imu"]
    assert {key: stated[key] for key in keys if asked.get(key)} == {key: asked[key] for key in keys if asked.get(key)}


# ----------------------------------------------------------------------------------------------------------- OpenVINS


def test_opencv_reads_the_chains_of_openvins(data, out):
    """As its ``parse``: entry [row][column] of a sequence of sequences; T_cam_imu is inverted for T_imu_cam."""
    folder = out / "euroc/openvins"
    settings = opened(folder / "estimator_config.yaml")
    cameras = opened(folder / settings.getNode("relative_config_imucam").string())
    for number, camera in enumerate(data.cameras):
        node = cameras.getNode(f"cam{number}")
        np.testing.assert_allclose(
            np.linalg.inv(reals(node.getNode("T_cam_imu"))), T_b_c(data, camera), rtol=0, atol=ROUNDING
        )
        K = data.intrinsics(camera, "opencv")
        assert reals(node.getNode("intrinsics")) == K[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
        assert reals(node.getNode("distortion_coeffs")) == [0.0] * 4
        assert node.getNode("distortion_model").string() == "radtan"
        assert reals(node.getNode("resolution")) == [data.camera(camera)["width"], data.camera(camera)["height"]]
    chain = opened(folder / settings.getNode("relative_config_imu").string())
    imu = chain.getNode("imu0")
    for name, expected in {
        "Tw": np.eye(3),
        "Ta": np.eye(3),
        "Tg": np.zeros((3, 3)),
        "R_IMUtoGYRO": np.eye(3),
        "R_IMUtoACC": np.eye(3),
        "T_i_b": np.eye(4),
    }.items():
        np.testing.assert_array_equal(reals(imu.getNode(name)), expected)
    assert imu.getNode("model").string() == "kalibr"
    assert imu.getNode("rostopic").string() == "/imu0"


def test_openvins_is_told_the_scenes_gravity_and_not_to_estimate_the_exact_calibration(data, out):
    settings = opened(out / "euroc/openvins/estimator_config.yaml")
    assert settings.getNode("gravity_mag").real() == -data.meta["gravity"][2]
    assert settings.getNode("max_cameras").real() == 2
    assert settings.getNode("track_frequency").real() > data.meta["frames"]["rate_hz"]
    for key in ("calib_cam_extrinsics", "calib_cam_intrinsics", "calib_cam_timeoffset", "calib_imu_intrinsics"):
        assert settings.getNode(key).isInt()  # OpenCV's false
        assert settings.getNode(key).real() == 0
