"""The VSLAM-LAB export comes back by pandas, PyYAML, OpenCV and evo, as that program reads it."""

import warnings

import cv2
import numpy as np
import pandas as pd
import pytest
import yaml
from evo.tools import file_interface
from readback import ROUNDING, largest_ape, matrices
from standins import make_scene

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError


def described(root):
    """dataset_varos_warp.yaml and the folder of its only sequence."""
    about = yaml.safe_load((root / "dataset_varos_warp.yaml").read_text())
    (name,) = about["sequence_names"]
    return about, root / about["dataset_name"].upper() / name


def calibration(folder):
    """The cameras and IMUs of calibration.yaml, by PyYAML."""
    found = yaml.safe_load((folder / "calibration.yaml").read_text())
    return found["cameras"], found.get("imus")


@pytest.fixture(scope="module")
def pair(out):
    return described(out / "vslamlab")


def test_the_sequence_has_what_its_modes_ask_for(pair):
    about, folder = pair
    assert about["modes"] == ["mono", "stereo", "rgbd", "mono-vi", "stereo-vi", "rgbd-vi"]
    assert about["cam_models"] == ["pinhole"]
    assert all((folder / name).is_dir() for name in ("rgb_0", "rgb_1", "depth_0"))
    assert all((folder / name).is_file() for name in ("rgb.csv", "calibration.yaml", "imu_0.csv", "groundtruth.csv"))


def test_the_list_names_each_image_and_its_time(data, pair):
    about, folder = pair
    table = pd.read_csv(folder / "rgb.csv")
    assert list(table) == [
        "ts_rgb_0 (ns)",
        "path_rgb_0",
        "ts_depth_0 (ns)",
        "path_depth_0",
        "ts_rgb_1 (ns)",
        "path_rgb_1",
    ]
    for number, camera in enumerate(("L0", "R0")):
        assert table[f"ts_rgb_{number} (ns)"].tolist() == data.time_ns(camera).tolist()
        for frame, path in zip(data.frames, table[f"path_rgb_{number}"], strict=True):
            assert (folder / path).read_bytes() == data.layout.image(camera, "A", frame).read_bytes()
    spacing_ns = np.diff(table["ts_rgb_0 (ns)"])
    np.testing.assert_allclose(1e9 / spacing_ns, about["rgb_hz"], rtol=1e-8)


def test_depth_over_its_factor_is_metres(data, pair):
    """Rounding to the unit, and float32 of D (2^-24 of 25 m) once; what is too far is 0."""
    _, folder = pair
    factor = calibration(folder)[0][0]["depth_factor"]
    for frame, path in zip(data.frames, pd.read_csv(folder / "rgb.csv")["path_depth_0"], strict=True):
        units, truth = cv2.imread(str(folder / path), cv2.IMREAD_UNCHANGED), data.planar_depth(frame, "L0")
        there = np.isfinite(truth)
        assert 0 < there.mean() < 1
        assert np.abs(units / factor - truth)[there].max() <= 0.5 / factor + 25 * 2.0**-24
        assert not units[~there].any()


def test_the_course_is_that_of_the_first_camera(data, pair, tmp_path):
    """Evo takes the table as VSLAM-LAB hands it over: blanks between, no header, stamps in ns."""
    _, folder = pair
    table = pd.read_csv(folder / "groundtruth.csv")
    assert list(table) == ["ts (ns)", "tx (m)", "ty (m)", "tz (m)", "qx", "qy", "qz", "qw"]
    time_ns, T_w_c = data.views("L0")
    assert table["ts (ns)"].tolist() == time_ns.tolist()
    found = matrices(table.iloc[:, 1:4].to_numpy(), table.iloc[:, 4:].to_numpy(), scalar_first=False)
    np.testing.assert_allclose(found, T_w_c, rtol=0, atol=ROUNDING)
    table.to_csv(tmp_path / "groundtruth.txt", header=False, index=False, sep=" ", lineterminator="\n")
    course = file_interface.read_tum_trajectory_file(tmp_path / "groundtruth.txt")
    assert largest_ape(course, 1_000_000_000 * time_ns, T_w_c) < 1e-9  # evo's own matrices round; m and rad


def test_calibration_is_that_of_the_cameras_about_the_imu(data, pair):
    cameras, (imu,) = calibration(pair[1])
    T_v_s = np.array(data.meta["sensors"]["imu0"]["T_v_s"])
    for number, (entry, camera) in enumerate(zip(cameras, ("L0", "R0"), strict=True)):
        assert (entry["cam_name"], entry["cam_model"]) == (f"rgb_{number}", "pinhole")
        K = np.array(
            [
                [entry["focal_length"][0], 0, entry["principal_point"][0]],
                [0, entry["focal_length"][1], entry["principal_point"][1]],
                [0, 0, 1],
            ]
        )
        np.testing.assert_array_equal(K, data.intrinsics(camera, "opencv"))
        assert entry["image_dimension"] == [48, 27]
        T_v_c = T_v_s @ np.reshape(entry["T_BS"], (4, 4))
        np.testing.assert_allclose(T_v_c, data.camera(camera)["T_v_c"], rtol=0, atol=ROUNDING)
    np.testing.assert_array_equal(np.reshape(imu["T_BS"], (4, 4)), np.eye(4))
    assert imu["g"] == pytest.approx(9.81)
    assert min(imu[key] for key in imu if key.startswith("sigma")) > 0


def test_opencv_reads_the_calibration(pair):
    """Systems in C++ read it by FileStorage."""
    file = cv2.FileStorage(str(pair[1] / "calibration.yaml"), cv2.FILE_STORAGE_READ)
    for number, entry in enumerate(calibration(pair[1])[0]):
        node = file.getNode("cameras").at(number)
        assert node.getNode("cam_type").string() == entry["cam_type"]
        T_BS = node.getNode("T_BS")
        assert [T_BS.at(i).real() for i in range(16)] == entry["T_BS"]
    assert file.getNode("imus").at(0).getNode("fps").real() == 200.0


def test_the_imu_has_its_readings_gyroscope_first_and_its_noise(data, pair, noisy, tmp_path):
    def table(root):
        return pd.read_csv(described(root)[1] / "imu_0.csv")

    export(noisy.root, "vslamlab", tmp_path / "out")
    for source, root in ((data, pair[1].parents[1]), (noisy, tmp_path / "out")):
        found, imu = table(root), source.imu()
        assert found["ts (ns)"].tolist() == imu["time_ns"].tolist()
        for letter, unit, key in (("w", "rad s^-1", "angular_velocity"), ("a", "m s^-2", "acceleration")):
            np.testing.assert_array_equal(found[[f"{letter}{axis} ({unit})" for axis in "xyz"]], imu[key])
    (imu,) = calibration(described(tmp_path / "out")[1])[1]
    assert (imu["sigma_a_c"], imu["sigma_g_c"], imu["sigma_gw_c"]) == (4e-3, 2e-4, 3e-5)
    assert imu["sigma_ba"] == 0.3  # the largest part of the constant bias


def made(tmp_path, cameras, sensors=True):
    scene = make_scene(
        vehicle={"cameras": [{"resolution": [16, 9], **camera} for camera in cameras], "imu": {}},
        render={"outputs": ["A"]},
    )
    produce(scene, tmp_path / "data", quiet=True, sensors=sensors)
    return Dataset(tmp_path / "data")


LENSES = {
    "M0": ({"model": "brown_conrady", "k": [-0.1, 0.01, 1e-3, -1e-3]}, "radtan4", 4),
    "M1": ({"model": "brown_conrady", "k": [-0.1, 0.0, 0.0, 0.0, 0.002]}, "radtan5", 5),
    "M2": ({"model": "kannala_brandt", "k": [0.01, 0.0, 0.0, 1e-4]}, "equid4", 4),
}


def test_lenses_have_its_names_and_orders(tmp_path):
    data = made(tmp_path, [{"id": key, "distortion": lens} for key, (lens, _, _) in LENSES.items()])
    for key, (lens, name, count) in LENSES.items():
        export(data.root, "vslamlab", tmp_path / key, cameras=[key])
        about, folder = described(tmp_path / key)
        ((entry,), imus) = calibration(folder)
        assert (entry["distortion_type"], len(entry["distortion_coefficients"])) == (name, count)
        assert entry["distortion_coefficients"] == lens["k"]
        assert (about["cam_models"], about["modes"], len(imus)) == ([name], ["mono", "mono-vi"], 1)


def test_what_it_cannot_state_is_refused_by_name(tmp_path):
    port = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.01}
    data = made(
        tmp_path,
        [
            {"id": "M0", "port": port},
            {"id": "M1"},
            {"id": "M2", "distortion": {"model": "rational", "k": [0.1, 0, 0, 0, 0, 0.1, 0, 0]}},
        ],
    )
    with pytest.raises(InputError, match=r"cameras.0.port: VSLAM-LAB cannot state a port.*--camera M1"):
        export(data.root, "vslamlab", tmp_path / "out", cameras=["M0"])
    with pytest.raises(InputError, match=r"cameras.2.distortion = .*VSLAM-LAB cannot state this"):
        export(data.root, "vslamlab", tmp_path / "out", cameras=["M2"])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("second", "is_pair"),
    [
        ({"position": [0.3, 0, 0]}, True),
        ({"position": [-0.3, 0, 0]}, False),
        ({"position": [0, 0.3, 0]}, False),
        ({"position": [0.3, 0, 0], "rotation_euler_deg": [-90, 0, 0]}, False),
        ({"position": [0.3, 0, 0], "mount": "world"}, False),
    ],
)
def test_only_a_camera_at_the_right_makes_a_pair(tmp_path, second, is_pair):
    data = made(tmp_path, [{"id": "M0"}, {"id": "M1", **second}])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        export(data.root, "vslamlab", tmp_path / "out")
    about, folder = described(tmp_path / "out")
    assert ("stereo" in about["modes"], (folder / "rgb_1").is_dir()) == (is_pair, is_pair)
    assert any("left out: M1" in str(warning.message) for warning in caught) != is_pair


@pytest.mark.parametrize(
    ("second", "says"),
    [
        ({}, None),
        ({"resolution": [24, 18]}, "resolution"),
        ({"focal_mm": 9.0}, "focal length"),
        ({"distortion": {"model": "kannala_brandt", "k": [0.01, 0, 0, 0]}}, "kind of distortion"),
        ({"distortion": {"model": "brown_conrady", "k": [-0.1, 0, 0, 0]}}, "distortion"),
    ],
)
def test_a_pair_of_unlike_cameras_is_told_of(tmp_path, second, says):
    data = made(tmp_path, [{"id": "M0"}, {"id": "M1", "position": [0.3, 0, 0], **second}])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        export(data.root, "vslamlab", tmp_path / "out")
    told = [words for words in map(str, (each.message for each in caught)) if "M0 and M1 of the stereo pair" in words]
    assert len(told) == (says is not None)
    assert all(says in words for words in told)
    assert "stereo" in described(tmp_path / "out")[0]["modes"]


@pytest.mark.parametrize(("mount", "sensors"), [("vehicle", False), ("world", True)])
def test_without_an_imu_the_body_is_the_camera(tmp_path, mount, sensors):
    """Of a dataset without readings, and of a camera that stands in the world."""
    data = made(tmp_path, [{"id": "M0", "position": [0, -2, 0], "mount": mount}], sensors)
    export(data.root, "vslamlab", tmp_path / "out")
    about, folder = described(tmp_path / "out")
    ((entry,), imus) = calibration(folder)
    assert (about["modes"], imus) == (["mono"], None)
    np.testing.assert_allclose(np.reshape(entry["T_BS"], (4, 4)), np.eye(4), rtol=0, atol=ROUNDING)
    assert not (folder / "imu_0.csv").exists()
