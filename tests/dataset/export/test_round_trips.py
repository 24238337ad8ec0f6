"""A course that was exported, or stands in a dataset, comes back as it was; the noise of its IMU, too."""

import json
import shutil

import numpy as np
import pytest
import standins
from readback import ROUNDING
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset.export import export
from varos_warp.dataset.layout import POSE_FORMS
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError
from varos_warp.scene.courses.recorded import read_course
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.file.noise_profiles import load_profile
from varos_warp.scene.frames import transform
from varos_warp.sim.driving import drive


def followed(file, **trajectory):
    """The scene of the dataset with another trajectory: a file."""
    return scene_from_dict(standins.scene_dict(trajectory={"file": str(file), **trajectory}))


def poses_of(scene):
    read_course(scene)
    stops = scene.trajectory.stops
    return stops.time_ns, transform(stops.attitude.as_matrix(), stops.position)


def check_vehicle(scene, data, name):
    """Poses at the times of what ``name`` stands for are the vehicle's, as the dataset has them."""
    time_ns, T = poses_of(scene)
    known_ns = data.time_ns() if name in data.cameras else data.poses(name)[0]
    vehicle_ns, T_w_v = data.poses("vehicle")
    np.testing.assert_array_equal(time_ns, known_ns - known_ns[0])
    np.testing.assert_allclose(T, T_w_v[np.isin(vehicle_ns, known_ns)], rtol=0.0, atol=4 * ROUNDING)


def test_the_tum_export_is_of_its_camera(data, out):
    check_vehicle(followed(out / "tum/groundtruth.txt", of="L0"), data, "L0")


def test_the_euroc_export_is_of_its_imu(data, out):
    file = out / "euroc/mav0/state_groundtruth_estimate0/data.csv"
    check_vehicle(followed(file, of="imu"), data, "imu0")


def test_the_euroc_export_without_an_imu_is_of_the_vehicle_in_our_axes(data, tmp_path):
    copy = shutil.copytree(data.root, tmp_path / "copy")
    meta = json.loads((copy / "dataset.json").read_text())
    del meta["sensors"]["imu0"]
    (copy / "dataset.json").write_text(json.dumps(meta))
    export(copy, "euroc", tmp_path / "euroc")
    file = tmp_path / "euroc/mav0/state_groundtruth_estimate0/data.csv"
    check_vehicle(followed(file, body="rfu"), data, "vehicle")


@pytest.mark.parametrize(("name", "of"), [("vehicle", "vehicle"), ("R0", "R0"), ("imu0", "imu")])
@pytest.mark.parametrize("form", POSE_FORMS)
def test_poses_of_a_dataset_are_known_by_their_columns(data, name, of, form):
    check_vehicle(followed(data.layout.poses(name, form), of=of), data, name)


def test_states_of_a_dataset_are_the_vehicles(data):
    check_vehicle(followed(data.layout.states), data, "vehicle")


@pytest.mark.parametrize(
    ("name", "of", "says"),
    [
        ("R0", None, r"has poses of R0, not of vehicle.*Say trajectory\.of: R0"),
        ("vehicle", "L0", r"has poses of vehicle, not of L0.*Say trajectory\.of: vehicle"),
        ("depth0", None, "has poses of depth0, from which no vehicle's follow"),
    ],
)
def test_a_file_of_a_dataset_says_whose_poses_it_has(data, name, of, says):
    with pytest.raises(InputError, match=says):
        poses_of(followed(data.layout.poses(name, "quaternion"), of=of))


@pytest.mark.parametrize("words", [{"frame": "ned"}, {"body": "flu"}])
def test_a_file_of_a_dataset_is_in_our_axes(data, words):
    with pytest.raises(InputError, match="are in our axes"):
        poses_of(followed(data.layout.poses("vehicle", "quaternion"), **words))


def test_the_course_through_an_export_is_at_its_times_where_the_dataset_has_the_vehicle(data, out):
    file = out / "euroc/mav0/state_groundtruth_estimate0/data.csv"
    driven = drive(followed(file, of="imu"))
    time_ns, T = data.poses("vehicle")
    found = driven.trajectory.at(time_ns[time_ns <= driven.trajectory.time_ns[-1]])
    np.testing.assert_allclose(found.poses(), T[: len(found)], rtol=0.0, atol=4 * ROUNDING)
    # between them a cubic spline is as exact as its order says: h^2 / 12 times the fourth derivative
    inside = slice(40, -40)
    states = data.states()["acceleration"][: len(found)]
    np.testing.assert_allclose(found.acceleration[inside], states[inside], atol=1.1 * 0.005**2 / 12 * 0.3 * 2.0**4)


def test_an_export_of_another_epoch_comes_back_alike(data, tmp_path):
    export(data.root, "tum", tmp_path / "tum", cameras=["L0"], start_ns=1_700_000_000_123_456_789)
    check_vehicle(followed(tmp_path / "tum/groundtruth.txt", of="L0"), data, "L0")


# ---------------------------------------------------------------------------------------------------- noise of the IMU


@pytest.mark.parametrize("name", ["kalibr_imu.yaml", "mav0/imu0/sensor.yaml", "openvins/kalibr_imu_chain.yaml"])
def test_the_noise_of_an_export_is_that_of_the_dataset(noisy, tmp_path, recwarn, name):
    export(noisy.root, "euroc", tmp_path / "euroc")
    known = noisy.meta["sensors"]["imu0"]["noise"]
    found = load_profile(tmp_path / "euroc" / name, 200.0).imu.model_dump()
    for key in ("accelerometer_noise_density", "gyroscope_noise_density", "gyroscope_random_walk"):
        assert found[key] == known[key]
    assert found["accelerometer_random_walk"] == 1e-5  # which stands for none, that estimators refuse
    assert not [warning for warning in recwarn.list if "rate_hz" in str(warning.message)]


def test_the_command_line_takes_what_it_exported_for_a_profile(data, out, tmp_path):
    file = out / "euroc/kalibr_imu.yaml"
    done = CliRunner().invoke(app, ["noise", str(data.root), "--profile", str(file), "-o", str(tmp_path / "noisy")])
    assert done.exit_code == 0, done.output
    made = Dataset(tmp_path / "noisy")
    assert made.meta["noise"]["profile"]["name"] == "kalibr_imu"
    assert made.meta["sensors"]["imu0"]["noise"]["gyroscope_noise_density"] == 1e-4
    bad = tmp_path / "bad.yaml"
    bad.write_text(file.read_text().replace("1.0e-05", "none"))
    done = CliRunner().invoke(app, ["noise", str(data.root), "--profile", str(bad), "-o", str(tmp_path / "other")])
    assert done.exit_code == 2
    assert "bad.yaml:4: accelerometer_random_walk = 'none': should be a finite number" in done.stderr
