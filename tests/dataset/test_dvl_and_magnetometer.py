"""DVL and magnetometer in a dataset: written, read back, with noise, validated, reported; absent without a trace."""

import json
import shutil

import numpy as np
import pytest
from standins import make_scene, scene_dict, simulate, tree

from varos_warp.dataset import files
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report.curves import curves, envelope
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.dataset.view import view
from varos_warp.errors import InputError
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.file.load import scene_to_dict
from varos_warp.scene.geometry.build import build_parts

FLOOR = {"kind": "procedural", "relief_m": 0.0, "size_m": 40.0, "resolution": 5, "position": [0, 0, -3]}
"""That of the stand-in that renders."""
DVL = {"position": [0.1, 0.2, -0.2], "rotation_euler_deg": [5, 1, 30], "rate_hz": 20, "range_m": [0.5, 3.4]}
MAGNETOMETER = {"position": [0, 0, 0.2], "rotation_euler_deg": [0, 10, 20], "rate_hz": 50}
PROFILE = NoiseProfile(
    name="both",
    dvl={"velocity_std": 0.01, "scale": 0.02, "range_std": 0.05},
    magnetometer={"noise_density": 1e-9, "random_walk": 1e-9, "bias": (1e-6, 0.0, 0.0), "turn_on_bias": 1e-7},
)


def scene_with_both():
    vehicle = scene_dict()["vehicle"] | {"dvl": DVL, "magnetometer": MAGNETOMETER}
    return make_scene({"outputs": ["A", "D"]}, vehicle=vehicle, terrain=FLOOR)


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Read it, do not change it."""
    import standins

    out = tmp_path_factory.mktemp("both")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene_with_both(), out, quiet=True)
    return out


@pytest.fixture(scope="module")
def noisy(both, tmp_path_factory):
    return add_noise(both, PROFILE, tmp_path_factory.mktemp("noisy") / "out", seed=7, quiet=True)


def test_readings_come_back_with_lock_lost_and_found(both):
    scene, data = scene_with_both(), Dataset(both)
    made, read = simulate(scene, build_parts(scene)), data.dvl()
    for name, values in read.items():
        np.testing.assert_array_equal(values, getattr(made.dvl, name))
    locked = np.isfinite(read["range"]).sum(axis=1)
    assert {2, 3, 4} <= set(locked)  # or the tests below would test less
    np.testing.assert_array_equal(np.isfinite(read["velocity"]).all(axis=1), locked >= 3)
    np.testing.assert_array_equal(data.magnetometer()["field"], made.magnetometer.field)
    assert data.magnetometer(100_000_000, 140_000_000)["time_ns"].tolist() == [100_000_000, 120_000_000]
    assert {"mag0", "dvl0"} <= set(data.recorded)


def test_dataset_json_and_readme_say_what_the_readings_follow_from(both):
    data = Dataset(both)
    about = data.meta["sensors"]
    np.testing.assert_allclose(np.linalg.norm(about["dvl0"]["beams"], axis=1), 1.0)
    assert about["dvl0"]["range_m"] == [0.5, 3.4]
    assert about["mag0"]["field_T"] == [0.0, 1.36e-5, -5.03e-5]
    assert {"magnetometer", "dvl"} <= data.meta["conventions"].keys()
    text = (both / "README.txt").read_text()
    assert "\n\nMAGNETOMETER (" in text
    assert "\n\nDVL (" in text


def test_a_scene_without_them_leaves_no_trace(written):
    assert not {"dvl", "magnetometer"} & scene_to_dict(make_scene())["vehicle"].keys()
    assert not {"dvl", "magnetometer"} & NoiseProfile().model_dump().keys()
    text = json.dumps(Dataset(written).meta) + (written / "README.txt").read_text()
    assert not any(word in text.lower() for word in ("dvl", "magnetometer", "{more}"))
    assert not any("dvl0" in name or "mag0" in name for name in tree(written))


def test_both_are_sound_and_so_are_they_with_noise(both, noisy):
    for root, names in (
        (
            both,
            (
                "mag0: against poses",
                "dvl0: readings against ranges and states",
                "dvl0: beams with another range than to the scene's meshes",
            ),
        ),
        (noisy.root, ("mag0: readings against profile and seed", "dvl0: readings against profile and seed")),
    ):
        result = validate(root, quiet=True)
        assert result.problems == []
        assert {*names} <= {measure["name"] for measure in result.measures}


def test_noise_keeps_the_truth_beside_the_readings(both, noisy):
    clean = Dataset(both)
    for name in ("dvl", "magnetometer"):
        for quantity, values in getattr(clean, name)().items():
            np.testing.assert_array_equal(getattr(noisy, name)(truth=True)[quantity], values)
    read, truth = noisy.dvl(), noisy.dvl(truth=True)
    np.testing.assert_array_equal(np.isnan(read["range"]), np.isnan(truth["range"]))
    seen = np.isfinite(truth["range"])
    assert (read["range"][seen] != truth["range"][seen]).all()
    assert noisy.meta["sensors"]["dvl0"]["noise"]["scale"] == 0.02
    bias = noisy.bias("mag0")["field"]
    np.testing.assert_array_equal(bias[:, 0], files.read_csv(noisy.layout.sensor("mag0"))["b_B_S_x [T]"])
    assert noisy.bias("dvl0") is None
    assert clean.bias("mag0") is None


def test_the_report_draws_what_is_known_of_curves_with_gaps(both):
    data = Dataset(both)
    plots = {plot["title"]: plot for plot in curves(data, data.time_ns() * 1e-9)}
    velocity, drawn = data.dvl()["velocity"].T, np.array(plots["Velocity over the bottom (DVL)"]["y"], float)
    np.testing.assert_allclose(drawn, velocity, rtol=5e-6, atol=1e-12)
    np.testing.assert_allclose(plots["Magnetic field"]["y"], 1e6 * data.magnetometer()["field"].T, rtol=5e-6)
    x, y = np.arange(10_000.0), np.ones((10_000, 1))
    y[::7] = np.nan
    assert (envelope(x, y)[1] == 1.0).all()  # a gap shorter than an interval does not blot it out


def test_the_viewer_has_every_reading(both, tmp_path):
    pytest.importorskip("rerun.dataframe")
    from rerun.dataframe import load_recording
    from test_view import cell, rows

    recording = load_recording(view(both, tmp_path / "test.rrd", quiet=True))
    for name, quantity, readings in (
        ("dvl0", "velocity", Dataset(both).dvl()),
        ("mag0", "field", Dataset(both).magnetometer()),
    ):
        for i, axis in enumerate("xyz"):
            found = [cell(row, "scalars") for row in rows(recording, f"/{name}/{quantity}/{axis}")]
            np.testing.assert_array_equal(found, readings[quantity][:, i])


# ------------------------------------------------------------------------------------------------------------- damages


def change(root, name, row, column, by):
    """Change a cell of a sensor's table; NaN becomes a number, and ``by`` NaN makes it one."""
    path = Dataset(root).layout.sensor(name)
    table = files.read_csv(path)
    values = table[list(table)[column]]
    values[row] = by if np.isnan(values[row]) else values[row] + by
    path.unlink()  # it may be shared with the dataset without noise
    files.write_csv(path, list(table), *table.values())


def rows_with(root, locked):
    return np.flatnonzero(np.isfinite(Dataset(root).dvl(truth=True)["range"]).sum(axis=1) == locked)


@pytest.mark.parametrize(
    ("name", "column", "locked", "by", "problem"),
    [
        ("mag0", 2, 4, 1e-8, "is not the field in the axes of the poses"),
        ("dvl0", 1, 4, 0.001, "is not what its ranges and vehicle0_states.csv make it"),
        ("dvl0", 4, 4, 0.001, "is not what its ranges and vehicle0_states.csv make it"),
        ("dvl0", 5, 4, 0.001, "is not what its ranges and vehicle0_states.csv make it"),
        ("dvl0", 9, 4, 0.001, "is not what its ranges and vehicle0_states.csv make it"),
        ("dvl0", 3, 4, np.nan, "is not what its ranges and vehicle0_states.csv make it"),
        ("dvl0", 3, 2, 0.5, "is not what its ranges and vehicle0_states.csv make it"),
    ],
)
def test_a_changed_cell_is_named_with_its_file(both, tmp_path, name, column, locked, by, problem):
    copy = shutil.copytree(both, tmp_path / "copy")
    (copy / "checksums").unlink()
    row = rows_with(copy, locked)[1]
    change(copy, name, row, column, by)
    problems = validate(copy, quiet=True).problems
    assert len(problems) == 1
    assert problems[0].startswith(f"vehicle0/{name}/{name}_data.csv:{row + 2}: ")
    assert problem in problems[0]


def test_ranges_and_altitudes_that_are_all_wrong_alike_are_found(both, tmp_path):
    copy = shutil.copytree(both, tmp_path / "copy")
    (copy / "checksums").unlink()
    path = Dataset(copy).layout.sensor("dvl0")
    table = {
        name: values * (0.99 if "range" in name or "altitude" in name else 1)
        for name, values in files.read_csv(path).items()
    }
    path.unlink()
    files.write_csv(path, list(table), *table.values())
    (problem,) = validate(copy, quiet=True).problems
    assert problem.startswith("dvl0: beams with another range than to the scene's meshes")


@pytest.mark.parametrize(
    ("name", "column", "by", "problem"),
    [
        ("mag0", 1, 1e-6, "mag0: reading off truth and bias"),
        ("mag0", 4, 1e-8, "is not the field in the axes of the poses"),
        ("mag0", 7, 1e-6, "mag0: readings against profile and seed"),
        ("dvl0", 1, 0.001, "is not what its beams make it"),
        ("dvl0", 5, 0.001, "dvl0: readings against profile and seed"),
        ("dvl0", 9, 0.2, "dvl0: beam velocity off the truth"),
        ("dvl0", 17, 0.001, "is not what its ranges and vehicle0_states.csv make it"),
    ],
)
def test_damage_to_noise_and_to_truth_is_found(noisy, tmp_path, name, column, by, problem):
    copy = shutil.copytree(noisy.root, tmp_path / "copy")
    (copy / "checksums").unlink()
    change(copy, name, rows_with(copy, 4)[1], column, by)
    assert problem in "\n".join(validate(copy, quiet=True).problems)


@pytest.mark.parametrize(("name", "key"), [("mag0", "field_T"), ("dvl0", "beams"), ("dvl0", "range_m")])
def test_a_dataset_that_does_not_say_what_readings_follow_from_is_refused(both, tmp_path, name, key):
    copy = shutil.copytree(both, tmp_path / "copy")
    meta = json.loads((copy / "dataset.json").read_text())
    del meta["sensors"][name][key]
    (copy / "dataset.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match=r"the entry sensors"):
        Dataset(copy)
