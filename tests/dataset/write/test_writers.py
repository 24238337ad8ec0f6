"""What the text files say: headers that readers know, conventions in words, and poses in three forms."""

import csv
import hashlib
import json
import re
import textwrap

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from standins import FLOOR_Z, make_scene, simulate

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.write import tables
from varos_warp.dataset.write import texts as writers
from varos_warp.render.decisions import Plan
from varos_warp.scene.description.lights import SpotLight
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import pose_matrix


def header(path):
    with path.open() as file:
        return next(csv.reader(file))


def test_headers_are_those_that_users_of_the_released_data_read(written):
    vehicle = written / "vehicle0"
    assert header(vehicle / "cam0/camL0_poses/camL0_poses_transformation_matrix.csv") == (
        "# timestamp [ns],r11,r12,r13,s_x_vw,r21,r22,r23,s_y_vw,r31,r32,r33,s_z_vw".split(",")
    )
    assert header(vehicle / "imu0/imu0_data.csv")[:2] == ["# timestamp [ns]", "a_RS_S_x [m s^-2]"]
    assert header(vehicle / "imu0/imu0_data.csv")[4] == "w_RS_S_x [rad s^-1]"
    assert header(vehicle / "cam0/camL0_timestamps.csv") == ["# timestamp [ns]", "A", "B", "C", "D"]
    assert header(vehicle / "ground_truth_vehicle0_poses/vehicle0_poses_euler.csv") == [
        "# timestamp [ns]",
        "s_x_vw",
        "s_y_vw",
        "s_z_vw",
        "theta_x_vw",
        "theta_y_vw",
        "theta_z_vw",
    ]


def test_calibration_has_the_released_files_keys_in_millimetres(written):
    text = yaml.safe_load((written / "vehicle0/cam0/camL0.yaml").read_text())
    assert (text["focal_length"], text["sensor_width"], text["sensor_height"]) == (3.4, 4.416, 2.484)
    assert (text["width"], text["height"]) == (48, 27)
    assert text["resolution"] == {"width": 48, "height": 27}


def test_euler_angles_are_about_the_fixed_world_axes_x_then_y_then_z(tmp_path):
    layout = Layout(tmp_path, "01", "0", ("M0",))
    angles = np.random.default_rng(0).uniform(-1.4, 1.4, (20, 3))
    T = np.tile(np.eye(4), (20, 1, 1))
    for i, (x, y, z) in enumerate(angles):
        Rx, Ry, Rz = (Rotation.from_rotvec(v).as_matrix() for v in ([x, 0, 0], [0, y, 0], [0, 0, z]))
        T[i, :3, :3] = Rz @ Ry @ Rx
    tables.write_poses(layout, "M0", np.arange(20), T)
    table = files.read_csv(layout.poses("M0", "euler"))
    np.testing.assert_allclose(np.column_stack([table[f"theta_{a}_vw"] for a in "xyz"]), angles, atol=1e-14)


def test_quaternions_have_a_positive_scalar_and_come_first(tmp_path):
    layout = Layout(tmp_path, "01", "0", ("M0",))
    rotations = Rotation.random(30, random_state=0)
    T = np.tile(np.eye(4), (30, 1, 1))
    T[:, :3, :3] = rotations.as_matrix()
    tables.write_poses(layout, "M0", np.arange(30), T)
    table = files.read_csv(layout.poses("M0", "quaternion"))
    q = np.column_stack([table[f"q_{a}"] for a in "wxyz"])
    assert (q[:, 0] >= 0).all()
    np.testing.assert_allclose(Rotation.from_quat(q, scalar_first=True).as_matrix(), T[:, :3, :3], atol=1e-14)


def test_the_imus_poses_have_its_lever_arm_and_its_axes(written):
    scene = make_scene()
    _, T = Dataset(written).poses("imu0")
    vehicle = simulate(scene).trajectory.T_w_v(50)
    np.testing.assert_allclose(T[50, :3, 3], (vehicle @ [0.1, 0.2, 0.05, 1.0])[:3], atol=1e-14)
    R_v_s = Rotation.from_euler("xyz", [5, 10, 15], degrees=True).as_matrix()
    np.testing.assert_allclose(T[50, :3, :3], vehicle[:3, :3] @ R_v_s, atol=1e-14)


def test_light_poses_point_along_the_cone_in_the_world(written):
    scene = make_scene()
    table = files.read_csv(written / "vehicle0/lights0/lights0_poses.csv")
    assert len(table["frame"]) == 10
    T_w_v = simulate(scene).trajectory.T_w_v(20 * 4)
    direction = T_w_v[:3, :3] @ np.array([0, 1, -0.2]) / np.linalg.norm([0, 1, -0.2])
    np.testing.assert_allclose([table[f"direction_w_{a}"][4] for a in "xyz"], direction, atol=1e-14)
    np.testing.assert_allclose([table[f"p_wl_{a} [m]"][4] for a in "xyz"], (T_w_v @ [0.15, -0.1, 0, 1])[:3], atol=1e-14)


def test_a_light_pointing_straight_down_has_a_proper_pose():
    light = SpotLight(kind="spot", position=(0, 0, 0), direction=(0, 0, -2.0))
    T = writers.light_pose(light)
    np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(T[:3, :3]), 1.0, atol=1e-14)


def test_the_pose_of_a_light_keeps_the_digits_of_a_short_direction_and_of_a_far_position():
    light = SpotLight(kind="spot", position=(5e5, 7e6, 0), direction=(0.0, 3e-6, -4e-6))
    T = writers.light_pose(light)
    np.testing.assert_allclose(T[:3, 2], [0.0, 0.6, -0.8], atol=1e-15)
    np.testing.assert_array_equal(T[:3, 3], light.position)


def test_euler_angles_at_gimbal_lock_are_silent_and_half_turns_are_positive(tmp_path, recwarn):
    layout = Layout(tmp_path, "01", "0", ("M0",))
    T = np.tile(np.eye(4), (2, 1, 1))
    T[:, :3, :3] = Rotation.from_euler("xyz", [[20, 90, 30], [0, 0, -180]], degrees=True).as_matrix()
    T[1, :2, :2] = [[-1.0, 0.0], [-0.0, -1.0]]
    tables.write_poses(layout, "M0", np.arange(2), T)
    table = files.read_csv(layout.poses("M0", "euler"))
    assert table["theta_z_vw"][1] == np.pi
    assert not recwarn.list


def test_dataset_json_gives_back_the_scene_it_was_made_from(written):
    meta = json.loads((written / "dataset.json").read_text())
    assert scene_from_dict(meta["scene"]) == make_scene()


def test_dataset_json_says_what_the_water_scatters_as(tmp_path):
    (tmp_path / "vsf.csv").write_text("angle_deg,p\n0.1,5\n180,1\n")
    of = [{"weight": 1, "kind": "petzold"}, {"weight": 1, "kind": "tabulated", "file": "vsf.csv"}]
    for phase in ({"g": 0.8}, {"kind": "mixture", "of": of}):
        data = make_scene().model_dump(mode="json")
        data["water"] = {"coefficients": {"sigma_s": [0.1] * 3, "sigma_a": [0.1] * 3, "phase": phase}}
        scene = scene_from_dict(data, tmp_path)
        water = writers.describe_water(scene)
        assert json.loads(json.dumps(water)) == water
        if "g" in phase:
            assert (water["phase"], water["g"], "phase_function" in water) == ("henyey_greenstein", 0.8, False)
    assert water["phase"] == "mixture"
    assert [part["kind"] for part in water["phase_function"]["of"]] == ["petzold", "tabulated"]
    assert len(writers.sources(scene)["vsf.csv"]) == 64


def test_calibration_files_are_among_the_sources_by_their_names(tmp_path):
    text = "{camera_model: pinhole, intrinsics: [50, 50, 23.5, 13], distortion_model: none, resolution: [48, 27]}"
    (tmp_path / "chain.yaml").write_text(f"cam0: {text}\ncam1: {text}\n")
    cameras = [{"id": f"M{i}", "calibration": f"chain.yaml#cam{i}"} for i in range(2)]
    trajectory = {"poses": [{"position": [0, 0, 0]}]}
    scene = scene_from_dict({"vehicle": {"cameras": cameras}, "trajectory": trajectory}, tmp_path)
    assert writers.sources(scene) == {"chain.yaml": hashlib.sha256((tmp_path / "chain.yaml").read_bytes()).hexdigest()}


def test_dataset_json_states_water_depth_lights_and_versions(written):
    meta = json.loads((written / "dataset.json").read_text())
    assert meta["water"]["sigma_t"] == pytest.approx([0.11, 0.06, 0.04])
    assert meta["water"]["albedo"] == pytest.approx([1 / 11, 1 / 3, 1.0])
    assert meta["depth"]["scale_m"] == pytest.approx(25 / 65535)
    assert meta["depth"]["kind"] == "z"
    assert meta["lights"][0]["cone_deg"] == 65
    assert meta["gravity"] == [0, 0, -9.81]
    assert meta["frames"] == {"of": 10, "ranges": [[0, 10]], "rate_hz": 10}
    assert {"varos_warp", "python", "numpy", "warp-lang", "pyoidn"} <= set(meta["versions"])
    assert meta["device"] == {"name": "cpu", "model": "numpy"}
    assert meta["samples"]["plan"]["spp"] == 8


def test_mount_decides_which_pose_of_a_camera_is_stated(tmp_path):
    scene = make_scene(vehicle={"cameras": [{"id": "M0"}, {"id": "S0", "mount": "world", "position": [1, 2, 3]}]})
    layout = Layout.of(scene, tmp_path)
    on_vehicle, standing = (writers.describe_camera(layout, camera) for camera in scene.vehicle.cameras)
    assert "T_v_c" in on_vehicle
    assert np.array(standing["T_w_c"])[:3, 3].tolist() == [1, 2, 3]
    assert "T_v_c" not in standing


def test_readme_has_no_gaps_and_states_gravity_and_step(written):
    text = (written / "README.txt").read_text()
    assert not re.search(r"\{[A-Z_]+\}", text)
    assert "+9.81 on the up axis" in text
    assert "0.381476 mm" in text or "0.381475 mm" in text


@pytest.mark.parametrize("render", [{}, {"depth_kind": "range", "depth_range_m": [0.5, 30.0]}])
def test_the_code_in_the_readme_runs_and_gives_what_dataset_gives(tmp_path, monkeypatch, render):
    """Points lie on the floor to half a step of D, of which a ray of slope below 1 makes less."""
    produce(make_scene(render), tmp_path, frames=slice(2, 4), quiet=True)
    code = (tmp_path / "README.txt").read_text().split("IN PYTHON")[1].split("\n", 1)[1]
    found: dict = {}
    monkeypatch.chdir(tmp_path)
    exec(textwrap.dedent(code), found)
    frame = Dataset(tmp_path)[0]
    np.testing.assert_array_equal(found["image"]["A"], frame.A)
    np.testing.assert_allclose(found["normal"], frame.C, atol=3 * 2.0**-24)
    seen = found["has_depth"]
    np.testing.assert_array_equal(seen, np.isfinite(frame.D))
    np.testing.assert_allclose(found["depth"][seen], frame.D[seen], rtol=2.0**-24)
    start, end = render.get("depth_range_m", (0.0, 25.0))
    inside = found["depth"][seen] > start  # what is nearer is put there
    assert np.abs(found["points"][inside, 2] - FLOOR_Z).max() < 0.5 * (end - start) / 65535 + 1e-9
    assert found["colours"].shape == found["points"].shape


@pytest.mark.parametrize("formula", [r"^  d = (.*?)(?: in metres| m),", r"^  n = ([^,]*?) in world axes"])
def test_formulas_of_the_readme_hold_in_numpy_as_they_are_written(written, formula):
    """On the integers that a reader of PNG returns."""
    text = re.search(formula, (written / "README.txt").read_text(), re.MULTILINE)[1]
    value = np.array([0, 3, 65534], np.uint16) if " d " in formula else np.array([0, 3, 254], np.uint8)
    expected = value.astype(float) * 25 / 65535 if " d " in formula else value.astype(float) / 127.5 - 1
    np.testing.assert_allclose(eval(text, {"value": value}), expected, atol=1e-12)


def test_calibration_readme_and_dataset_json_say_which_pixel_is_where(written):
    """The two conventions, in the words of each file."""
    for name in ("README.txt", "dataset.json", "vehicle0/cam0/camL0.yaml", "vehicle0/cam1/camR0.yaml"):
        text = (written / name).read_text()
        assert "centre of the top left pixel is (0, 0)" in text, name
        for convention in ("K_opencv", "K_center_half"):
            assert convention in text, name


def test_a_name_that_looks_like_a_word_of_the_readme_stays(tmp_path):
    scene = make_scene(name="{GRAVITY} {STEP_M}")
    writers.write_readme(Layout.of(scene, tmp_path), scene)
    assert (tmp_path / "README.txt").read_text().startswith("{GRAVITY} {STEP_M}\n")


def test_the_bias_of_a_noisy_imu_is_written(tmp_path):
    scene = make_scene()
    imu = scene.vehicle.imu.model_dump() | {"noise": {"accelerometer_noise_density": 0.01}}
    scene = make_scene(vehicle={"imu": imu})
    layout = Layout.of(scene, tmp_path)
    tables.write_sensors(layout, scene, simulate(scene))
    table = files.read_csv(layout.bias("imu0"))
    assert (table["b_a_RS_S_x [m s^-2]"] == 0.3).all()


def test_a_sensor_that_samples_between_ticks_has_the_poses_of_its_times(tmp_path):
    scene = make_scene()
    simulation = simulate(scene)
    simulation.imu.time_ns[:-1] += 2_000_000
    tables.write_sensors(layout := Layout.of(scene, tmp_path), scene, simulation)
    table = files.read_numbers(layout.poses("imu0", "transformation_matrix"), 13)
    assert np.array_equal(table[0], simulation.imu.time_ns)
    expected = simulation.trajectory.at(table[0]).poses() @ pose_matrix(scene.vehicle.imu)
    np.testing.assert_array_equal(np.column_stack(table[1:]).reshape(-1, 3, 4), expected[:, :3])


def test_a_plan_says_how_outputs_are_made_and_keeps_what_it_says_already():
    """By what denoised them, which need not be what there is now; the scene is not looked at where all is said."""
    scene = make_scene({"denoise": "oidn", "denoise_b": "oidn"})
    plan = Plan(4, None, 3, "path")
    told = writers.with_models(plan, scene, ["A", "B"], {"A": "nlm", "B": "oidn"})
    assert told.models == {
        "A": "path tracer, at most 3 reflections on surfaces, 4 samples per pixel, denoise nlm",
        "B": "no water, uniform ambient light, 8 samples per pixel, denoise oidn",
    }
    more = writers.with_models(told, scene, ["A", "B", "D"], {"A": "none", "B": "none"})
    assert more.models == told.models | {"D": "first hits of pixel centres"}
    assert writers.with_models(more, None, ["A", "B", "D"], {}) is more
