"""The altimeter: closed forms of its range, its noise, and its way through a dataset and the exports."""

import json
import shutil

import numpy as np
import pytest
import standins
from scipy.spatial.transform import Rotation
from standins import make_scene, scene_dict, tree

import varos_warp as vw
from varos_warp.dataset import files
from varos_warp.dataset.export import export
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report.curves import curves
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.errors import InputError
from varos_warp.products.sensors.altimeter import ALTIMETER, Altimeter, AltimeterNoise
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Part
from varos_warp.scene.info import scene_info
from varos_warp.sim.clock import times_ns
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.sensors.suite import measured
from varos_warp.sim.sensors.surroundings import Around

ROUNDING = 1e-14
HEIGHT = 3.0
TILTED = Rotation.from_euler("xyz", [(0, 0, 0), (0, 0, 130), (12, 0, 0), (-7, 15, 40), (20, -10, -80)], degrees=True)
FLAT = {"kind": "procedural", "relief_m": 0.0, "size_m": 40.0, "resolution": 5, "position": [0, 0, -3]}
"""The ground of the stand-in that renders."""
BLOCK = {"position": [0.1, 0.2, -0.2], "direction": [0.1, 0.3, -2.0], "rate_hz": 20, "max_range_m": 2.85}
PROFILE = NoiseProfile(name="sound", altimeter={"range_std": 0.05, "scale": 0.02, "bias": -0.1})


def motion(turned: Rotation) -> Trajectory:
    """Rows 0.2 s apart at rest at a height over the plane z = 0, so that an altimeter of 5 Hz reads each of them."""
    rest, place = np.zeros((len(turned), 3)), np.tile([0.0, 0.0, HEIGHT], (len(turned), 1))
    return Trajectory(times_ns(len(turned), 5.0), place, rest, rest, turned.as_quat(scalar_first=True), rest, rest)


def plane(z: float = 0.0, size: float = 100.0) -> Part:
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * size + [0.0, 0.0, z]
    return Part("terrain", corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), Diffuse())


def read(turned: Rotation, parts, **block) -> np.ndarray:
    return measured(ALTIMETER, motion(turned), Altimeter(rate_hz=5.0, **block), Around(parts=parts)).range


# --------------------------------------------------------------------------------------------------------------- range


def test_over_flat_ground_it_reads_the_height_over_the_cosine_of_the_tilt():
    tilt = np.arccos(TILTED.as_matrix()[:, 2, 2])
    assert np.degrees(tilt.max()) > 20.0
    np.testing.assert_allclose(read(TILTED, [plane()]), HEIGHT / np.cos(tilt), rtol=ROUNDING)


def test_a_beam_of_any_direction_begins_at_the_sensor():
    """The sensor stands at R l over the ground, and its beam R d falls by -(R d)_z a metre."""
    lever, along = np.array([0.3, -0.5, 0.4]), np.array([1.0, -2.0, -4.0])
    start, fall = HEIGHT + TILTED.apply(lever)[:, 2], -TILTED.apply(along / np.linalg.norm(along))[:, 2]
    assert (fall > 0).all()
    made = read(TILTED, [plane()], position=tuple(lever), direction=tuple(along))
    np.testing.assert_allclose(made, start / fall, rtol=ROUNDING)


@pytest.mark.parametrize(("most", "sees"), [(2.999, False), (3.001, True)])
def test_beyond_the_farthest_range_it_reads_nothing(most, sees):
    assert np.isfinite(read(TILTED[:1], [plane()], max_range_m=most)).item() == sees


def test_a_beam_that_meets_nothing_reads_nothing():
    assert np.isnan(read(TILTED[:1], [plane()], direction=(0.0, 0.0, 1.0))).all()


def messages(sensor: str, block: dict, **blocks) -> list[str]:
    scene = scene_from_dict(
        {
            "vehicle": {sensor: block},
            **blocks,
            "trajectory": {"poses": [{"position": [0, 0, 0]}, {"position": [1, 0, 0], "time_s": 1.0}]},
        }
    )
    return [text for text in vw.simulate(scene).messages if sensor in text]


@pytest.mark.parametrize(
    ("sensor", "far", "words"),
    [
        (
            "altimeter",
            {"max_range_m": 2.9},
            "vehicle.altimeter: its beam meets nothing within max_range_m = 2.9 in the "
            "whole run, so all readings are nan",
        ),
        (
            "dvl",
            {"range_m": [0.1, 2.9]},
            "vehicle.dvl: none of its beams meets anything within range_m = [0.1, 2.9] in the "
            "whole run, so all readings are nan",
        ),
    ],
)
def test_a_sensor_that_meets_nothing_in_a_whole_run_is_told_of(sensor, far, words):
    assert messages(sensor, far, terrain=FLAT) == [words]
    assert messages(sensor, {}, terrain=FLAT) == []


def test_info_lists_the_sensors_that_the_scene_asks_for():
    rest = {"terrain": FLAT, "trajectory": {"poses": [{"position": [0, 0, 0]}]}}
    scene = scene_from_dict({"vehicle": {"altimeter": BLOCK, "dvl": {}}, **rest})
    told = scene_info(scene, build_parts(scene))["sensors"]
    assert list(told) == ["dvl", "altimeter"]
    assert told["altimeter"] == BLOCK
    assert "sensors" not in scene_info(scene_from_dict(rest), [])


def test_it_reads_the_first_of_several_surfaces():
    np.testing.assert_allclose(read(TILTED[:1], [plane(), plane(2.25, size=0.5)]), 0.75, rtol=ROUNDING)


def test_it_sees_the_body_of_another_vehicle_and_not_of_its_own():
    board = {"kind": "calibration_board", "rows": 9, "columns": 9, "square_m": 0.8, "rotation_euler_deg": [-90, 0, 0]}
    still = {"duration_s": 0.5, "poses": [{"position": [0, 0, 0]}]}
    below = {"duration_s": 0.5, "poses": [{"position": [0, 0, -1.75]}]}
    own = board | {"position": [0, 0, -0.5]}
    scene = scene_from_dict(
        {
            "terrain": FLAT,
            "vehicles": [
                {"id": "0", "altimeter": {}, "body": own, "trajectory": still},
                {"id": "1", "trajectory": below},
            ],
        }
    )
    np.testing.assert_allclose(vw.simulate(scene).altimeter.range, 3.0, atol=1e-6)
    other = {"id": "1", "trajectory": below, "body": board}
    scene = scene_from_dict(
        {"terrain": FLAT, "vehicles": [{"id": "0", "altimeter": {}, "body": own, "trajectory": still}, other]}
    )
    np.testing.assert_allclose(vw.simulate(scene).altimeter.range, 1.75, atol=1e-6)


@pytest.mark.parametrize("direction", [(0.0, 0.0, -1.0), (0.0, 0.0, 2.0), (1.0, -2.0, 0.5), (0.0, 3.0, 0.0)])
def test_the_x_axis_of_the_sensor_is_its_beam(direction):
    T = ALTIMETER.mounting(Altimeter(direction=direction))
    np.testing.assert_allclose(T[:3, 0], np.array(direction) / np.linalg.norm(direction), atol=ROUNDING)
    np.testing.assert_allclose(np.cross(T[:3, 0], T[:3, 1]), T[:3, 2], atol=ROUNDING)


def test_one_tick_at_a_time_it_reads_what_it_reads_at_once():
    scene = scene_from_dict(
        {
            "terrain": FLAT | {"relief_m": 0.5},
            "vehicle": {"altimeter": {"rate_hz": 130}},
            "trajectory": {"duration_s": 0.5, "waypoints": [{"position": [0, 0, 0]}, {"position": [1, 2, 0.5]}]},
        }
    )
    simulator = vw.Simulator(scene)
    steps = [simulator.state]
    while not simulator.finished:
        steps.append(simulator.step())
    batch = vw.simulate(scene).altimeter
    for name in ("time_ns", "range"):
        assert np.array_equal(np.concatenate([getattr(step.altimeter, name) for step in steps]), getattr(batch, name))
    assert len(np.unique(batch.range)) > 10


# --------------------------------------------------------------------------------------------------------------- noise


def test_noise_is_white_about_a_scaled_and_shifted_range_and_nothing_stays_nothing():
    count, model = 20_000, AltimeterNoise(range_std=0.04, scale=0.03, bias=0.2)
    truth = {"time_ns": np.arange(count), "range": np.where(np.arange(count) % 10, 5.0, np.nan)}
    made, bias = ALTIMETER.noisy(truth, {}, model, seed=4)
    assert bias is None
    assert np.array_equal(np.isnan(made["range"]), np.isnan(truth["range"]))
    seen = made["range"][np.isfinite(made["range"])]
    assert abs(seen.mean() - (1.03 * 5.0 + 0.2)) < 4 * 0.04 / np.sqrt(len(seen))
    assert abs(seen.std() - 0.04) < 4 * 0.04 / np.sqrt(2 * len(seen))
    assert np.array_equal(ALTIMETER.noisy(truth, {}, model, seed=4)[0]["range"], made["range"], equal_nan=True)
    assert not np.array_equal(ALTIMETER.noisy(truth, {}, model, seed=5)[0]["range"], made["range"], equal_nan=True)


# ------------------------------------------------------------------------------------------------------------- refusal


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"direction": [0, 0, 0]}, "must be 1e-6 to 1e6 long"),
        ({"max_range_m": 0}, "max_range_m"),
        ({"rotation_euler_deg": [0, 0, 0]}, "rotation_euler_deg"),
        ({"rate_hz": -1}, "rate_hz"),
    ],
)
def test_what_is_no_altimeter_is_refused_by_its_key(changes, words):
    with pytest.raises(InputError, match=words) as error:
        scene_from_dict({"vehicle": {"altimeter": changes}, "trajectory": {"poses": [{}]}})
    assert error.value.key.startswith("vehicle.altimeter")


# ------------------------------------------------------------------------------------------------------------- dataset


def produced(out, **sensors):
    scene = make_scene({"outputs": ["A", "D"]}, vehicle=scene_dict()["vehicle"] | sensors, terrain=FLAT)
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene, out, quiet=True)
    return out


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Read it, do not change it."""
    return produced(tmp_path_factory.mktemp("altimeter"), altimeter=BLOCK)


@pytest.fixture(scope="module")
def noisy(made, tmp_path_factory):
    return add_noise(made, PROFILE, tmp_path_factory.mktemp("noisy") / "out", seed=7, quiet=True)


def truth_of(data: Dataset) -> np.ndarray:
    """Height of the sensor over the floor, by the fall of its x axis; beyond its reach nothing."""
    _, T = data.poses("altimeter0")
    distance = (T[:, 2, 3] + 3.0) / -T[:, 2, 0]
    return np.where(distance <= BLOCK["max_range_m"], distance, np.nan)


def test_a_dataset_has_its_readings_poses_and_words(made):
    data = Dataset(made)
    read = data.readings("altimeter0")
    expected = truth_of(data)
    assert 0 < np.isnan(expected).sum() < len(expected)
    np.testing.assert_allclose(read["range"], expected, atol=1e-9)
    assert np.diff(read["time_ns"]).tolist() == [50_000_000] * (len(expected) - 1)
    assert data.meta["sensors"]["altimeter0"]["max_range_m"] == 2.85
    assert "altimeter" in data.meta["conventions"]
    assert "\n\nALTIMETER (altimeter0/altimeter0_data.csv)" in (made / "README.txt").read_text()
    plot = next(plot for plot in curves(data, data.time_ns() * 1e-9) if plot["title"] == "Altimeter")
    np.testing.assert_allclose(np.array(plot["y"], float)[0], expected, rtol=5e-6)


def test_a_scene_without_one_leaves_no_trace(tmp_path):
    assert "altimeter" not in scene_to_dict(make_scene())["vehicle"]
    assert "altimeter" not in NoiseProfile().model_dump()
    written = produced(tmp_path / "out")
    assert "altimeter" not in (json.dumps(Dataset(written).meta) + (written / "README.txt").read_text()).lower()
    assert not any("altimeter" in name for name in tree(written))


def test_noise_keeps_the_truth_beside_the_readings(made, noisy):
    truth = Dataset(made).readings("altimeter0")["range"]
    np.testing.assert_array_equal(noisy.readings("altimeter0", truth=True)["range"], truth)
    assert (np.abs(noisy.readings("altimeter0")["range"] - truth)[np.isfinite(truth)] > 0).all()
    assert noisy.bias("altimeter0") is None


def test_it_is_sound_with_and_without_noise(made, noisy):
    for root, name in (
        (made, "altimeter0: range against the scene's meshes"),
        (noisy.root, "altimeter0: readings against profile and seed"),
    ):
        result = validate(root, quiet=True)
        assert result.problems == []
        assert name in {measure["name"] for measure in result.measures}


@pytest.mark.parametrize(
    ("of_noisy", "column", "by", "problem"),
    [
        (False, 1, 0.001, ": range = "),
        (False, 1, 5.0, "is no distance up to 2.85 m"),
        (True, 1, 0.001, "altimeter0: readings against profile and seed"),
        (True, 1, 1.0, "altimeter0: range off the truth, at most"),
        (True, 2, 0.001, "is not the distance to the scene's meshes"),
    ],
)
def test_a_changed_range_is_found(made, noisy, tmp_path, of_noisy, column, by, problem):
    copy = shutil.copytree(noisy.root if of_noisy else made, tmp_path / "copy")
    (copy / "checksums").unlink()
    path = Dataset(copy).layout.sensor("altimeter0")
    table = files.read_csv(path)
    values = table[list(table)[column]]
    row = int(np.flatnonzero(np.isfinite(values))[3])
    values[row] += by
    path.unlink()  # it may be shared with the dataset without noise
    files.write_csv(path, list(table), *table.values())
    found = "\n".join(validate(copy, quiet=True).problems)
    assert problem in found
    assert "altimeter0" in found


def test_a_lost_reading_is_found(made, tmp_path):
    copy = shutil.copytree(made, tmp_path / "copy")
    (copy / "checksums").unlink()
    path = Dataset(copy).layout.sensor("altimeter0")
    table = files.read_csv(path)
    row = int(np.flatnonzero(np.isfinite(table["range [m]"]))[0])
    table["range [m]"][row] = np.nan
    path.unlink()
    files.write_csv(path, list(table), *table.values())
    (problem,) = validate(copy, quiet=True).problems
    assert problem == (
        f"vehicle0/altimeter0/altimeter0_data.csv:{row + 2}: range = nan: is not the distance to the scene's meshes"
    )


def test_a_dataset_that_does_not_say_how_far_it_reads_is_refused(made, tmp_path):
    copy = shutil.copytree(made, tmp_path / "copy")
    meta = json.loads((copy / "dataset.json").read_text())
    del meta["sensors"]["altimeter0"]["max_range_m"]
    (copy / "dataset.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match=r"the entry sensors.altimeter0.max_range_m"):
        Dataset(copy)


# ------------------------------------------------------------------------------------------------------------- exports


def test_in_a_bag_it_is_a_range_along_x_and_infinite_where_it_meets_nothing(made, tmp_path):
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    export(made, "mcap", tmp_path / "out")
    store, data = get_typestore(Stores.ROS2_HUMBLE), Dataset(made)
    with Reader(tmp_path / "out" / "bag") as bag:
        connections = [c for c in bag.connections if c.topic == "/altimeter0"]
        assert [c.msgtype for c in connections] == ["sensor_msgs/msg/Range"]
        found = [(t, store.deserialize_cdr(raw, c.msgtype)) for c, t, raw in bag.messages(connections)]
    read = data.readings("altimeter0")
    assert [t for t, _ in found] == read["time_ns"].tolist()
    np.testing.assert_array_equal(
        [m.range for _, m in found], np.nan_to_num(read["range"], nan=np.inf).astype(np.float32)
    )
    first = found[0][1]
    assert (first.header.frame_id, first.radiation_type, first.min_range) == ("altimeter_link", first.ULTRASOUND, 0.0)
    assert first.max_range == np.float32(2.85)
