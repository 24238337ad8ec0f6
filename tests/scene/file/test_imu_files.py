"""Noise of IMUs from files of Kalibr, OpenVINS, EuRoC and imu_utils: their units, their doubts, and what is refused."""

import json
import re

import numpy as np
import pytest

from varos_warp.errors import InputError
from varos_warp.scene.file import load, noise_profiles
from varos_warp.scene.file.load import load_scene, scene_from_dict, scene_to_dict
from varos_warp.scene.file.noise_profiles import load_profile

KALIBR = """#Accelerometers
accelerometer_noise_density: 2.1e-3
accelerometer_random_walk: 4.0e-4
#Gyroscopes
gyroscope_noise_density: 1.9e-4
gyroscope_random_walk: 2.2e-6
rostopic: /imu/data
update_rate: 200.0
"""
DENSITIES = {
    "accelerometer_noise_density": 2.1e-3,
    "accelerometer_random_walk": 4.0e-4,
    "gyroscope_noise_density": 1.9e-4,
    "gyroscope_random_walk": 2.2e-6,
}
EUROC = """sensor_type: imu
comment: VI-Sensor IMU (ADIS16448)
T_BS: {cols: 4, rows: 4, data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
rate_hz: 200
""" + "".join(f"{key}: {value}\n" for key, value in DENSITIES.items())
OPENVINS = (
    "%YAML:1.0\n\nimu0:\n"
    + "".join(f"  {line}\n" for line in KALIBR.splitlines())
    + (
        "  time_offset: 0.0\n  model: kalibr\n  T_i_b: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"
        "  Tw: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
    )
)
IMU_UTILS = """%YAML:1.0
---
type: IMU
name: own
Gyr:
   unit: " rad/s"
   avg-axis:
      gyr_n: 1.9e-03
      gyr_w: 2.2e-05
   x-axis:
      gyr_n: 2.0e-03
      gyr_w: 3.0e-05
Acc:
   unit: " m/s^2"
   avg-axis:
      acc_n: 2.1e-02
      acc_w: 4.0e-04
"""
FORK = IMU_UTILS.replace('" rad/s"', '"gyr_n: rad / sqrt(s), gyr_w: rad / s^2 / sqrt(Hz)"').replace(
    '" m/s^2"', '"acc_n: m / s^2 / sqrt(Hz), acc_w: m / s^3 / sqrt(Hz)"'
)


@pytest.fixture
def scene(tmp_path):
    def load(text, noise="imu.yaml", **imu):
        (tmp_path / "imu.yaml").write_text(text)
        return scene_from_dict(
            {"trajectory": {"poses": [{"position": [0, 0, 0]}]}, "vehicle": {"imu": {"noise": noise, **imu}}}, tmp_path
        )

    return load


def densities(scene):
    return scene.vehicle.imu.noise.model_dump(include={*DENSITIES})


@pytest.mark.parametrize("text", [KALIBR, EUROC, OPENVINS, KALIBR.replace("2.1e-3", "21e-4")])
def test_kalibr_openvins_and_euroc_have_our_densities_under_our_names(scene, text, recwarn):
    """YAML takes 21e-4 for text."""
    assert densities(scene(text)) == DENSITIES
    assert not recwarn.list


def test_of_several_imus_one_is_named(scene):
    both = OPENVINS + OPENVINS.partition("\n\n")[2].replace("imu0", "imu1").replace("2.1e-3", "0.5")
    assert densities(scene(both, "imu.yaml#imu1"))["accelerometer_noise_density"] == 0.5
    assert densities(scene(both, "imu.yaml#imu0")) == DENSITIES
    with pytest.raises(InputError, match=r"tells of 2 IMUs. Name one: FILE#imu0"):
        scene(both)
    with pytest.raises(InputError, match=r"has no 'imu7'. It has: imu0, imu1"):
        scene(both, "imu.yaml#imu7")
    with pytest.raises(InputError, match=r"has no 'imu0'. It tells of one IMU"):
        scene(KALIBR, "imu.yaml#imu0")


def test_another_rate_than_that_of_the_imu_is_told_of(scene):
    with pytest.warns(UserWarning, match=r"update_rate is 200 Hz, but rate_hz of the IMU is 100 Hz"):
        assert densities(scene(KALIBR, rate_hz=100)) == DENSITIES


def test_scales_and_misalignments_are_told_of(scene):
    with pytest.warns(UserWarning, match="scale-misalignment"):
        scene(KALIBR + "model: scale-misalignment\naccelerometers: {M: [[1, 0, 0]]}\n")


@pytest.mark.parametrize("rate", [200.0, 400.0])
def test_imu_utils_writes_standard_deviations_of_readings_and_least_allan_deviations(scene, rate):
    """The Allan deviation of what comes of it has its values: n / sqrt(rate) at 1 s, and w where it is least."""
    with pytest.warns(UserWarning, match=rf"taken for readings at {rate:g} Hz they are"):
        found = densities(scene(IMU_UTILS, rate_hz=rate))
    tau = np.geomspace(0.01, 1e7, 2_000_001)
    for sensor, n, w in (("gyroscope", 1.9e-3, 2.2e-5), ("accelerometer", 2.1e-2, 4.0e-4)):
        N, K = found[f"{sensor}_noise_density"], found[f"{sensor}_random_walk"]
        assert np.hypot(N, K / np.sqrt(3.0)) == pytest.approx(n / np.sqrt(rate), rel=1e-12)
        assert np.sqrt(N**2 / tau + K**2 * tau / 3.0).min() == pytest.approx(w, rel=1e-9)


def test_a_least_allan_deviation_of_nothing_is_no_random_walk(scene):
    with pytest.warns(UserWarning, match="imu_utils"):
        found = densities(scene(IMU_UTILS.replace("2.2e-05", "0.0")))
    assert found["gyroscope_random_walk"] == 0.0
    assert found["gyroscope_noise_density"] == pytest.approx(1.9e-3 / np.sqrt(200.0), rel=1e-14)


def test_the_fork_of_imu_utils_writes_densities_and_says_so(scene, recwarn):
    assert densities(scene(FORK)) == {
        "accelerometer_noise_density": 2.1e-2,
        "accelerometer_random_walk": 4.0e-4,
        "gyroscope_noise_density": 1.9e-3,
        "gyroscope_random_walk": 2.2e-5,
    }
    assert not recwarn.list


def test_a_scene_is_written_with_the_numbers_not_the_file(scene, tmp_path):
    written = scene_to_dict(scene(KALIBR))
    json.dumps(written)
    (tmp_path / "imu.yaml").unlink()
    assert scene_to_dict(scene_from_dict(written)) == written
    assert DENSITIES.items() <= written["vehicle"]["imu"]["noise"].items()


def test_each_of_several_vehicles_may_have_its_file(tmp_path):
    (tmp_path / "imu.yaml").write_text(KALIBR)
    course = {"poses": [{"position": [0, 0, 0]}]}
    scene = scene_from_dict(
        {
            "vehicles": [
                {"id": "0", "trajectory": course},
                {"id": "1", "trajectory": course, "imu": {"noise": "imu.yaml"}},
            ]
        },
        tmp_path,
    )
    assert densities(scene.observed_by("1")) == DENSITIES
    assert scene.vehicle.imu.noise is None


def test_a_file_may_be_set_and_is_relative_to_the_scene_file(tmp_path, monkeypatch):
    (tmp_path / "imu.yaml").write_text(KALIBR)
    (tmp_path / "scene.yaml").write_text("trajectory: {poses: [{position: [0, 0, 0]}]}\n")
    monkeypatch.chdir(tmp_path.parent)
    for path in (tmp_path / "scene.yaml", f"{tmp_path.name}/scene.yaml"):
        assert densities(load_scene(path, ["vehicle.imu.noise=imu.yaml"])) == DENSITIES


@pytest.mark.parametrize(
    ("text", "line", "key", "says"),
    [
        (KALIBR.replace("4.0e-4", "much"), 3, "accelerometer_random_walk", "should be a finite number"),
        (KALIBR.replace("4.0e-4", "-1"), 3, "accelerometer_random_walk", "should be a finite number, 0 at least"),
        (KALIBR.replace("4.0e-4", ".nan"), 3, "accelerometer_random_walk", "should be a finite number"),
        (KALIBR.replace("4.0e-4", "[1, 2, 3]"), 3, "accelerometer_random_walk", "should be a finite number"),
        (KALIBR.replace("4.0e-4", "true"), 3, "accelerometer_random_walk", "should be a finite number"),
        (KALIBR.replace("4.0e-4", "1e7"), 3, "accelerometer_random_walk", "at most 1e+06"),
        (KALIBR.replace("rostopic", "ros_topic"), 7, "ros_topic", "unknown key. Did you mean 'rostopic'?"),
        (KALIBR.replace("gyroscope_random_walk: 2.2e-6\n", ""), None, None, "has no gyroscope_random_walk"),
        (KALIBR + KALIBR, 10, "accelerometer_noise_density", "is given twice"),
        (OPENVINS.replace("1.9e-4", "x"), 8, "imu0.gyroscope_noise_density", "should be a finite number"),
        ("imu0: 3\n", 1, "imu0", "should be a block of keys"),
        (IMU_UTILS.replace(" rad/s", "deg/h"), 6, "Gyr.unit", "is a unit that imu_utils does not write"),
        (IMU_UTILS.replace("avg-axis", "mean", 1), 5, "Gyr", "has no avg-axis with gyr_n"),
        (IMU_UTILS.replace("Acc:", "Bcc:"), 13, "Bcc", "unknown key"),
        (IMU_UTILS.replace("x-axis", "q-axis"), 10, "Gyr.q-axis", "unknown key"),
        (IMU_UTILS.replace("2.2e-05", "2.2e-03"), 7, "Gyr.avg-axis", "its least Allan deviation, 0.0022, is more than"),
        ("- 1\n", None, None, "is a mapping of keys to values"),
        ("", None, None, "is empty"),
        ("a: [", 2, None, "is not valid YAML"),
        ("speed: 3\n", 1, "speed", "unknown key"),
    ],
)
def test_what_is_no_such_file_is_refused_with_its_line_and_key(scene, tmp_path, text, line, key, says):
    with pytest.raises(InputError, match=re.escape(says)) as error:
        scene(text)
    assert (error.value.file, error.value.line, error.value.key) == (tmp_path / "imu.yaml", line, key)


def test_a_file_that_is_not_there_is_refused_where_the_scene_names_it(tmp_path):
    (tmp_path / "scene.yaml").write_text(
        "trajectory: {poses: [{position: [0, 0, 0]}]}\nvehicle:\n  imu:\n    noise: lost.yaml\n"
    )
    with pytest.raises(InputError, match=r"there is no such file of an IMU's noise \(.*lost\.yaml\)") as error:
        load_scene(tmp_path / "scene.yaml")
    assert (error.value.file, error.value.line, error.value.key) == (tmp_path / "scene.yaml", 4, "vehicle.imu.noise")


def test_the_model_alone_knows_no_folder_and_says_so():
    from varos_warp.products.sensors.imu import Imu

    with pytest.raises(ValueError, match="which load_scene and scene_from_dict read"):
        Imu(noise="imu.yaml")


# ---------------------------------------------------------------------------------------------------------- profiles


def test_a_profile_may_be_such_a_file(tmp_path):
    path = tmp_path / "my_imu.yaml"
    path.write_text(KALIBR)
    profile = load_profile(path, 200.0)
    assert (profile.name, profile.imu.model_dump(include={*DENSITIES})) == ("my_imu", DENSITIES)
    assert profile.depth_gauge is None
    path.write_text(OPENVINS)
    assert load_profile(f"{path}#imu0").imu == profile.imu


def test_a_profile_of_imu_utils_needs_the_rate_of_the_readings(tmp_path):
    path = tmp_path / "imu.yaml"
    path.write_text(IMU_UTILS)
    with pytest.raises(InputError, match="no density follows unless the rate is known"):
        load_profile(path)
    with pytest.warns(UserWarning, match="taken for readings at 100 Hz"):
        assert load_profile(path, 100.0).imu.gyroscope_noise_density == pytest.approx(1.9e-4, rel=1e-3)


@pytest.mark.parametrize("density", [1e-4, 0.005])
def test_a_profile_whose_gyroscope_looks_like_degrees_is_told_of_by_its_file(tmp_path, recwarn, density):
    path = tmp_path / "mine.yaml"
    path.write_text(f"imu: {{gyroscope_noise_density: {density}}}\n")
    load_profile(path)
    told = [str(warning.message) for warning in recwarn if str(warning.message).startswith(f"{path}: gyroscope_noise")]
    assert len(told) == (density > 2e-3)


def test_a_profile_is_parsed_once(tmp_path, monkeypatch):
    seen, path = [], tmp_path / "mine.yaml"
    path.write_text("imu: {gyroscope_noise_density: 1.0e-4}\n")
    parse = noise_profiles.parse_file
    monkeypatch.setattr(noise_profiles, "parse_file", lambda *args: seen.append(args[0]) or parse(*args))
    monkeypatch.setattr(load, "parse_file", lambda *args: seen.append(args[0]) or parse(*args))
    load_profile(path)
    assert seen == [path]
