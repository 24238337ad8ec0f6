"""The noise pass: noisy readings by default, the truth beside them, same seed same bytes, nothing else changed."""

import json
import re
import shutil

import numpy as np
import pytest
from standins import make_scene, tree

from varos_warp.dataset.noise_pass import add_noise, noise_of
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.products.sensors.imu import imu_noise
from varos_warp.scene.description.exposure import CameraExposure
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.description.optics import Vignetting
from varos_warp.scene.file.noise_profiles import load_profile, merge_profiles, named_profiles
from varos_warp.sim.sensors import image_noise

PROFILE = load_profile("low_light_rov")


@pytest.fixture(scope="module")
def noisy(written, tmp_path_factory):
    return add_noise(written, PROFILE, tmp_path_factory.mktemp("noisy") / "out", seed=4, quiet=True)


def test_readings_are_truth_plus_bias_plus_white_noise_of_profile_and_seed(written, noisy):
    clean, imu, truth, bias = Dataset(written).imu(), noisy.imu(), noisy.imu(truth=True), noisy.imu_bias()
    made = imu_noise(PROFILE.imu, len(imu["time_ns"]), 200.0, seed=4)
    for name, noise in zip(("acceleration", "angular_velocity"), made, strict=True):
        np.testing.assert_array_equal(truth[name], clean[name])
        np.testing.assert_array_equal(imu[name], truth[name] + noise.white + noise.bias)
        np.testing.assert_array_equal(bias[name], noise.bias)
    gauge = noisy.depth_gauge()["depth"]
    np.testing.assert_array_equal(noisy.depth_gauge(truth=True)["depth"], Dataset(written).depth_gauge()["depth"])
    np.testing.assert_allclose(gauge / 0.002, np.rint(gauge / 0.002), atol=1e-6)


def test_headers_say_which_columns_are_readings_and_which_truth(noisy):
    header = noisy.layout.sensor("imu0").read_text().splitlines()[0].split(",")
    assert header[1].startswith("a_RS_S_x")
    assert header[7].startswith("true_a_RS_S_x")
    assert header[10].startswith("true_w_RS_S_x")
    assert "NOISE" in (noisy.root / "README.txt").read_text()


def test_images_have_noise_about_the_clean_ones_which_are_kept(written, noisy):
    clean = Dataset(written)
    for camera in clean.cameras:
        np.testing.assert_array_equal(noisy.pixels("A", 3, camera, truth=True), clean.pixels("A", 3, camera))
        assert (noisy.pixels("A", 3, camera) != clean.pixels("A", 3, camera)).mean() > 0.5
    assert noisy.layout.clean("L0", 3).samefile(clean.layout.image("L0", "A", 3))
    difference = noisy.image("A", 3) * noisy.gain("A", 3) - clean.image("A", 3) * clean.gain("A", 3)
    assert abs(difference).mean() < 0.1  # a few of 580 electrons at white, and cos^4
    assert difference.mean() < 0.0


def test_everything_else_is_that_of_the_dataset_without_noise(written, noisy):
    before, after = tree(written), tree(noisy.root)
    changed = {name for name in before if after.get(name) != before[name]}
    images = {name for name in before if "/A/" in name}
    assert images <= changed
    assert changed - images <= {
        "dataset.json",
        "README.txt",
        "contact_sheet.png",
        "report.html",
        "checksums",
        "vehicle0/imu0/imu0_data.csv",
        "vehicle0/depth0/depth0_data.csv",
    }


def test_dataset_json_says_profile_and_seed(written, noisy):
    assert noise_of(noisy) == (PROFILE, 4)
    assert noise_of(Dataset(written)) is None
    assert noisy.meta["sensors"]["imu0"]["noise"]["gyroscope_noise_density"] == PROFILE.imu.gyroscope_noise_density
    json.dumps(noisy.meta, allow_nan=False)


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not(written, noisy, tmp_path, monkeypatch):
    monkeypatch.setattr("varos_warp.dataset.progress.os.cpu_count", lambda: 1)
    again = add_noise(written, PROFILE, tmp_path / "again", seed=4, quiet=True)
    other = add_noise(written, PROFILE, tmp_path / "other", seed=5, quiet=True)
    assert tree(again.root) == tree(noisy.root)
    for path in (noisy.layout.sensor("imu0"), noisy.layout.sensor("depth0"), noisy.layout.image("R0", "A", 9)):
        assert (other.root / path.relative_to(noisy.root)).read_bytes() != path.read_bytes()


def test_a_frame_has_the_same_noise_in_a_dataset_of_few_frames(noisy, tmp_path):
    produce(make_scene(render={"exposure": {"A": 1.0}}), tmp_path / "few", quiet=True, frames=slice(3, 5))
    produce(make_scene(render={"exposure": {"A": 1.0}}), tmp_path / "all", quiet=True)
    few, whole = (add_noise(tmp_path / name, PROFILE, tmp_path / f"{name}_noisy", 4, True) for name in ("few", "all"))
    np.testing.assert_array_equal(few.pixels("A", 4, "R0"), whole.pixels("A", 4, "R0"))


def test_noise_is_not_added_twice(written, noisy, tmp_path):
    with pytest.raises(InputError, match=r"low_light_rov.*already.*made of"):
        add_noise(noisy.root, load_profile("bar30"), tmp_path / "twice", quiet=True)
    assert not (tmp_path / "twice").exists()


def test_imu_noise_of_the_scene_leaves_room_for_other_sensors_only(tmp_path):
    scene = make_scene()
    imu = scene.vehicle.imu.model_dump() | {"noise": {"gyroscope_noise_density": 1e-3}}
    produce(make_scene(vehicle=scene.vehicle.model_dump() | {"imu": imu}), tmp_path / "d", images=False, quiet=True)
    data = Dataset(tmp_path / "d")
    assert (data.imu()["acceleration"] - data.imu(truth=True)["acceleration"]).mean() == pytest.approx(0.3)
    with pytest.raises(InputError, match="IMU has noise already"):
        add_noise(tmp_path / "d", load_profile("mpu6050"), tmp_path / "out", quiet=True)
    made = add_noise(tmp_path / "d", load_profile("bar30"), tmp_path / "out", quiet=True)
    np.testing.assert_array_equal(made.imu(truth=True)["acceleration"], data.imu(truth=True)["acceleration"])


def test_the_ideal_profile_changes_no_reading(written, tmp_path):
    made = add_noise(written, load_profile("ideal"), tmp_path / "out", quiet=True)
    assert made.layout.sensor("imu0").samefile(Dataset(written).layout.sensor("imu0"))
    assert not made.has_noise("A")


def test_a_part_for_which_there_is_no_sensor_is_left_out_with_a_warning(tmp_path):
    produce(make_scene(), tmp_path / "d", images=False, quiet=True)
    with pytest.warns(UserWarning, match="no readings of: camera"):
        made = add_noise(tmp_path / "d", PROFILE, tmp_path / "out", quiet=True)
    assert made.meta["noise"]["profile"]["camera"] is None


def test_a_camera_with_vignetting_gets_none_of_the_profile(tmp_path):
    """dataset.json and its camera model say what it has; A is what the profile without vignetting makes."""
    fall = {"kind": "polynomial", "coefficients": [-0.4]}
    scene = make_scene()
    cameras = [scene.vehicle.cameras[0].model_copy(update={"vignetting": Vignetting(**fall)})]
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"cameras": cameras})})
    produce(scene, tmp_path / "d", frames=slice(2), quiet=True)
    data = Dataset(tmp_path / "d")
    assert data.camera()["vignetting"] == fall
    np.testing.assert_allclose(data.camera_model().rays([[0.0, 0.0]]).weight, 0.6)
    with pytest.warns(UserWarning, match="A of L0 has the vignetting of the scene"):
        made = add_noise(data.root, PROFILE, tmp_path / "out", quiet=True)
    without = PROFILE.model_copy(update={"camera": PROFILE.camera.model_copy(update={"vignetting": None})})
    bare = add_noise(data.root, without, tmp_path / "bare", quiet=True)
    np.testing.assert_array_equal(made.image("A", 0, "L0"), bare.image("A", 0, "L0"))


def exposed_for(out, seconds, gain="adaptive"):
    """A dataset of two frames of one camera with such a shutter."""
    scene = make_scene(render={"exposure": {"A": gain}})
    camera = scene.vehicle.cameras[0].model_copy(update={"exposure": CameraExposure(time_s=seconds or 0.0)})
    scene = scene.model_copy(update={"vehicle": scene.vehicle.model_copy(update={"cameras": [camera]})})
    produce(scene, out, frames=slice(2), quiet=True)
    return out


def test_dark_current_gathers_while_the_shutter_is_open(tmp_path):
    """Its electrons are added to those of the light, whatever the vignetting; exactly where none are shot."""
    root = exposed_for(tmp_path / "d", 0.02)
    model = {"electrons_per_radiance": 1e5, "shot_noise": False, "bits": 16, "vignetting": {"kind": "cos4"}}
    dark, light = (NoiseProfile(camera=model | more) for more in ({"dark_current_electrons_per_s": 5000.0}, {}))
    made, without = (
        add_noise(root, profile, tmp_path / name, quiet=True) for name, profile in (("dark", dark), ("light", light))
    )
    linear, gain = Dataset(root).linear("A", 1), Dataset(root).gain("A", 1)
    bare = image_noise.expose(light.camera, linear, gain, np.random.default_rng(0))
    more = image_noise.expose(dark.camera, linear, gain, np.random.default_rng(0), exposure_s=0.02)
    unclipped = more < 2**16 - 1
    np.testing.assert_allclose((more - bare)[unclipped], 100.0 * gain / 1e5 * (2**16 - 1), atol=1.0)  # 100 electrons
    assert made.pixels("A", 1).mean() > without.pixels("A", 1).mean()
    assert validate(made.root, quiet=True).problems == []


def test_dark_current_asks_for_a_time_of_exposure(tmp_path):
    root = exposed_for(tmp_path / "d", None)
    model = {"electrons_per_dn": 2.0, "dark_current_electrons_per_s": 50.0}
    with pytest.raises(
        InputError, match=r"dark_current_electrons_per_s = 50.*L0 has no time of exposure.*exposure.time_s"
    ):
        add_noise(root, NoiseProfile(camera=model), tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()


def test_a_gain_is_no_time_of_exposure_where_the_shutter_has_one(tmp_path):
    """The message tells what to write instead: as many electrons at the middle gain."""
    root, profile = exposed_for(tmp_path / "d", 0.02), NoiseProfile(camera={"electrons_per_dn": 2.0, "bits": 12})
    with pytest.raises(InputError, match=r"electrons_per_dn = 2\.0.*L0 is exposed for 0\.02 s") as caught:
        add_noise(root, profile, tmp_path / "out", quiet=True)
    instead = float(re.search(r"electrons_per_radiance: (\S+)", str(caught.value))[1])
    assert instead == pytest.approx(2.0 * 4095 * np.median(list(Dataset(root).gains("A").values())), rel=1e-3)
    add_noise(root, NoiseProfile(camera={"electrons_per_radiance": instead}), tmp_path / "out", quiet=True)
    constant = exposed_for(tmp_path / "constant", 0.02, gain=2.0)
    add_noise(constant, profile, tmp_path / "more", quiet=True)


def test_no_noise_is_added_to_a_dataset_that_is_not_complete(tmp_path):
    """A shard's images are there, those of the other are not."""
    produce(make_scene(), tmp_path / "d", quiet=True, shard=(0, 2))
    with pytest.raises(InputError, match=r"A-00000000\.png: this image and 49 more are missing.*`run` again"):
        add_noise(tmp_path / "d", load_profile("mpu6050"), tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()


def test_a_failure_leaves_nothing(written, tmp_path):
    broken = shutil.copytree(written, tmp_path / "broken")
    Dataset(broken).layout.exr("L0", "A", 4).write_bytes(b"no image")
    with pytest.raises(InputError, match=r"A-00000004\.exr"):
        add_noise(broken, PROFILE, tmp_path / "out", quiet=True)
    assert [p.name for p in tmp_path.iterdir()] == ["broken"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("camera: {electrons_per_dn: 2, bits: 99}", r"camera\.bits = 99"),
        ("camera: {bits: 12}", "give one of electrons_per_dn and electrons_per_radiance"),
        ("imu: {gyroscope_noise_dens: 1}", "gyroscope_noise_dens: unknown key. Did you mean 'gyroscope_noise_density'"),
        ("camera: {electrons_per_radiance: 1.0e+20}", r"camera\.electrons_per_radiance = 1e\+20"),
        ("camera: {electrons_per_dn: 1.0e+20}", r"camera\.electrons_per_dn = 1e\+20"),
        ("depth_gauge: {resolution: -1}", r"depth_gauge\.resolution = -1"),
        ("", "the noise profile is empty"),
    ],
)
def test_a_wrong_profile_is_bad_input_that_names_file_and_key(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_profile(path)
    assert str(path) in str(caught.value)


def test_profiles_are_known_by_name_and_combine():
    assert {"ideal", "adis16448", "mpu6050"} <= set(named_profiles())
    merged = merge_profiles([load_profile("adis16448"), load_profile("bar30")])
    assert merged.imu.gyroscope_noise_density == 1.6968e-4
    assert merged.depth_gauge.resolution == 0.002
    with pytest.raises(InputError, match="two profiles tell of the imu"):
        merge_profiles([merged, load_profile("mpu6050")])
    with pytest.raises(InputError, match="one of: adis16448"):
        load_profile("mpu9999")
    assert NoiseProfile.model_validate(merged.model_dump(mode="json")) == merged


def test_a_damaged_image_is_named_where_the_dataset_has_it(written, tmp_path):
    shutil.copytree(written, tmp_path / "in")
    data = Dataset(tmp_path / "in")
    image = data.layout.image("L0", "B", 0)
    content = bytearray(image.read_bytes())
    content[len(content) // 2] ^= 255
    image.write_bytes(content)
    with pytest.raises(InputError) as caught:
        add_noise(data.root, PROFILE, tmp_path / "out", quiet=True)
    assert str(caught.value).startswith(str(image))
