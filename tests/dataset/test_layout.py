"""Folders and names are those of the released dataset, and reading gives back what was simulated and rendered."""

import functools
import json

import numpy as np
import pytest
from standins import FlatFloorRenderer, make_scene, simulate

import varos_warp
from varos_warp.dataset import files
from varos_warp.dataset.layout import from_runs, runs
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError
from varos_warp.scene.frames import camera_pose


@pytest.fixture(scope="module")
def data(written):
    return Dataset(written)


def test_names_and_folders_are_those_of_the_released_dataset(written):
    """Paper, tables 5 and 6; the tree as read in programs that use the released data."""
    cam = written / "vehicle0" / "cam0"
    for output in "ABCD":
        assert (cam / output / f"seq01_veh0_camL0_{output}-00000009.png").is_file()
    for name in (
        "camL0.yaml",
        "camL0_timestamps.csv",
        "camL0_poses/camL0_poses_transformation_matrix.csv",
        "camL0_poses/camL0_poses_euler.csv",
        "../imu0/imu0_data.csv",
        "../depth0/depth0_data.csv",
        "../ground_truth_vehicle0_poses/vehicle0_poses_euler.csv",
        "../cam1/camR0.yaml",
    ):
        assert (cam / name).is_file(), name


def test_ids_of_sequence_and_vehicle_are_in_the_names(tmp_path):
    from varos_warp.dataset.layout import Layout

    scene = make_scene(sequence="a7", vehicle={"id": "Z", "cameras": [{"id": "M3"}]})
    path = Layout.of(scene, tmp_path).image("M3", "D", 12345678).relative_to(tmp_path).as_posix()
    assert path == "vehicleZ/cam0/D/seqa7_vehZ_camM3_D-12345678.png"


def test_the_public_name_opens_a_dataset(written):
    data = varos_warp.Dataset(written)
    assert len(data) == 10
    assert "10 frames, outputs ABCD, cameras L0, R0" in repr(data)


def test_depth_comes_back_within_half_a_step(data):
    scene = make_scene()
    T_w_v = simulate(scene).trajectory.T_w_v(60)
    truth = (
        FlatFloorRenderer(scene)
        .render(T_w_v, "R0", "D", spp=8, max_scatterings=None, max_bounces=None, layers=(), frame=3)
        .D.depth
    )
    read = data.depth(3, "R0")
    within = truth < 25 - 25 / 65535
    assert within.any()
    assert (~within).any()
    assert np.abs(read[within] - truth[within]).max() <= 0.5 * 25 / 65535 + 25 * 2.0**-23
    assert np.isinf(read[truth > 25]).all()


def test_images_are_their_linear_radiance_within_rounding(data):
    """Half of an 8 bit step through the steepest part of the inverse sRGB curve is 0.5 * 2.4 / 1.055 / 255 of white."""
    for output in "AB":
        image, linear, gain = data.image(output, 2), data.linear(output, 2), data.gain(output, 2)
        below_white = linear * gain < 1
        assert np.abs(image - linear)[below_white].max() * gain < 0.5 * 2.4 / 1.055 / 255


def test_normals_of_a_flat_floor_point_up(data):
    normal = data.image("C", 0)
    hit = normal.any(axis=-1)
    assert 0 < hit.mean() < 1
    assert np.abs(normal[hit] - [0, 0, 1]).max() < 0.01


def test_poses_are_exactly_those_of_the_simulation(data):
    scene = make_scene()
    trajectory = simulate(scene).trajectory
    state = data.states()
    for name, values in state.items():
        np.testing.assert_array_equal(values, getattr(trajectory, name))
    for frame in (0, 7):
        expected = camera_pose(scene.vehicle.cameras[1], trajectory.T_w_v(20 * frame))
        np.testing.assert_array_equal(data.T_w_c(frame, "R0"), expected)


def test_sensors_are_exactly_those_of_the_simulation(data):
    simulation = simulate(make_scene())
    imu, gauge = data.imu(), data.depth_gauge()
    np.testing.assert_array_equal(imu["acceleration"], simulation.imu.acceleration)
    np.testing.assert_array_equal(imu["angular_velocity"], simulation.imu.angular_velocity)
    np.testing.assert_array_equal(imu["time_ns"], simulation.imu.time_ns)
    np.testing.assert_array_equal(gauge["depth"], simulation.depth_gauge.depth)
    assert data.imu_bias() is None


def test_intrinsics_have_both_pixel_conventions(data):
    """Focal length 3.4 / 4.416 * 48 px; the principal point in the middle of 48 x 27 pixels."""
    half, opencv = data.intrinsics(), data.intrinsics(convention="opencv")
    np.testing.assert_allclose(half, [[36.956521739, 0, 24], [0, 36.956521739, 13.5], [0, 0, 1]], rtol=1e-9)
    np.testing.assert_allclose(half - opencv, [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]], atol=1e-12)


def test_frames_are_100_ms_apart_on_the_simulations_ticks(data):
    np.testing.assert_array_equal(data.time_ns(), np.arange(10) * 100_000_000)


@pytest.mark.parametrize("frames", [[], [0], [0, 1, 2, 7], [3, 5, 6, 9]])
def test_ranges_of_frames_come_back(frames):
    assert from_runs(runs(frames)) == frames


def test_a_folder_without_dataset_json_is_bad_input(tmp_path):
    with pytest.raises(InputError, match="it is not a dataset"):
        Dataset(tmp_path)
    files.write_json(tmp_path / "dataset.json", {"schema_version": 99})
    with pytest.raises(InputError, match="schema version 1"):
        Dataset(tmp_path)


def test_an_unknown_camera_and_a_frame_that_is_not_there_are_told_with_those_that_are(data, tmp_path):
    with pytest.raises(InputError, match=r"no such camera.*L0, R0"):
        data.depth(0, "X9")
    with pytest.raises(IndexError, match="no frame 99: the dataset has 0 to 9"):
        data.depth(99)


@pytest.mark.parametrize(
    "keys",
    [
        "versions",
        "versions.varos_warp",
        "device",
        "sources",
        "scene",
        "samples",
        "samples.plan",
        "frames.ranges",
        "frames.rate_hz",
        "depth",
        "depth.kind",
        "depth.range_m",
        "cameras",
        "cameras.0.width",
        "cameras.0.K_opencv",
        "cameras.1.mount",
        "sensors",
        "outputs",
        "gravity",
        "surface_depth_m",
        "lights",
        "sequence",
        "vehicle",
    ],
)
def test_an_entry_that_is_missing_from_dataset_json_is_bad_input_that_names_it(written, tmp_path, keys):
    meta = json.loads((written / "dataset.json").read_text())
    *path, last = [int(key) if key.isdigit() else key for key in keys.split(".")]
    block = functools.reduce(lambda block, key: block[key], path, meta)
    del block[last]
    (tmp_path / "dataset.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match=rf"dataset.json: .*{keys}.*missing or damaged"):
        Dataset(tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("spp", 0, "samples.plan.spp is missing or damaged: .*greater than 0"),
        ("spp", "many", "samples.plan.spp .*valid number"),
        ("max_scatterings", -1, "samples.plan.max_scatterings .*greater than or equal to 0"),
        ("max_bounces", 2.5, "samples.plan.max_bounces .*integer"),
        ("integrator", "magic", "samples.plan.integrator .*'auto', 'field', 'path' or 'reference'"),
        (
            "spp_by_frame",
            {"L0": [[0, 4.0]], "X9": [[0, 4.0]]},
            "samples.plan.spp_by_frame.X9 is of no camera of the dataset.*L0, R0",
        ),
        ("spp_by_frame", {"L0": []}, "samples.plan.spp_by_frame.L0 .*at least 1"),
        ("spp_by_frame", {"L0": [[0, -4.0]]}, r"samples.plan.spp_by_frame.L0.0.1 .*greater than 0"),
        ("spp_by_frame", {"L0": [[5, 4.0], [2, 4.0]]}, "samples.plan.spp_by_frame.L0 .*frames are not in order"),
    ],
)
def test_a_plan_that_cannot_be_is_bad_input_that_says_what_is_wrong(written, tmp_path, key, value, words):
    meta = json.loads((written / "dataset.json").read_text())
    meta["samples"]["plan"][key] = value
    (tmp_path / "dataset.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match=words):
        Dataset(tmp_path)


@pytest.mark.parametrize(("key", "value"), [("scene", None), ("outputs", ["Q"]), ("frames", []), ("device", "cpu")])
def test_an_entry_of_the_wrong_kind_in_dataset_json_is_bad_input(written, tmp_path, key, value):
    meta = json.loads((written / "dataset.json").read_text()) | {key: value}
    (tmp_path / "dataset.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match=key):
        Dataset(tmp_path)
