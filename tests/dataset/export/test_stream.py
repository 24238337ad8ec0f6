"""The stream file, read with nothing but the reader that docs/exports.md shows."""

import csv
import json
import re
import shutil
import struct
from collections import defaultdict
from itertools import pairwise
from pathlib import Path

import pytest
import standins
from standins import make_scene, scene_dict

from varos_warp.dataset.export import export
from varos_warp.dataset.export.stream import FIELDS, SENSOR_IDS
from varos_warp.dataset.layout import READINGS
from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.description.noise_profile import NoiseProfile

PAGE = (Path(__file__).parents[3] / "docs/exports.md").read_text(encoding="utf-8")
READER = next(
    code for code in re.findall(r"^```python\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL) if "def read_stream" in code
)
space: dict = {}
exec(READER, space)
read_stream = space["read_stream"]
LATE = 1_629_158_400_000_000_001
"""A start of the sequence beyond the 53 bits of a float64 [ns]."""
PROFILE = NoiseProfile(
    name="all",
    imu={"accelerometer_noise_density": 4e-3, "gyroscope_random_walk": 3e-5},
    depth_gauge={"noise_density": 0.01, "bias": 0.1},
    magnetometer={"noise_density": 1e-9, "random_walk": 1e-9},
    dvl={"velocity_std": 0.01, "range_std": 0.05},
    altimeter={"range_std": 0.02},
    camera={"electrons_per_dn": 2.0},
)


@pytest.fixture(scope="module")
def everything(tmp_path_factory):
    """Four frames of all sensors and images, of a pair, of which one is behind a port, a fixed camera, what moves."""
    left, right = scene_dict()["vehicle"]["cameras"]
    vehicle = scene_dict()["vehicle"] | {
        "cameras": [
            left,
            right | {"port": {"kind": "flat", "distance_m": 0.01}},
            left | {"id": "W0", "mount": "world", "position": [0, -2, 0]},
        ],
        "dvl": {"position": [0.1, 0.2, -0.2], "rate_hz": 20, "range_m": [0.5, 3.4]},
        "magnetometer": {"rate_hz": 50},
        "altimeter": {"max_range_m": 3.0},
    }
    path = [{"time_s": 0, "position": [0, 2, -2]}, {"time_s": 1, "position": [1, 2, -2]}]
    scene = make_scene(
        {"outputs": [*"ABCDSPF"]},
        vehicle=vehicle,
        objects=[{"kind": "boulder", "diameter": 0.5, "path": path}],
        terrain={"kind": "procedural", "relief_m": 0.0, "size_m": 40.0, "resolution": 5, "position": [0, 0, -3]},
    )
    out = tmp_path_factory.mktemp("everything")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene, out / "data", frames=slice(0, 4), quiet=True)
        add_noise(out / "data", PROFILE, out / "noisy", seed=5, quiet=True)
    for name in ("data", "noisy"):
        export(out / name, "stream", out / f"{name} stream", start_ns=LATE)
    return out


@pytest.fixture(scope="module", params=["data", "noisy"])
def streamed(request, everything):
    """The dataset, the folder of its stream, and the messages in it by their ids."""
    folder, messages = everything / f"{request.param} stream", defaultdict(list)
    for id, *rest in read_stream(folder / "stream.sbst"):
        messages[id].append(rest)
    return Dataset(everything / request.param), folder, messages


def rows_of(path, first=1, count=None):
    """Time, moved to the start, and numbers of each row of a CSV file, as written: without numpy, exactly."""
    with path.open(newline="") as file:
        _, *rows = csv.reader(file)
    return [(int(row[0]) + LATE, *map(float, row[first : None if count is None else first + count])) for row in rows]


def plain(messages):
    """Time and numbers of messages; NaN as text, for it does not equal itself."""
    return [tuple(str(x) if x != x else x for x in (time_ns, *numbers)) for time_ns, numbers, _ in messages]


def same(messages, rows):
    assert len(rows) > 0
    assert plain(messages) == [tuple(str(x) if x != x else x for x in row) for row in rows]


@pytest.mark.parametrize("sensor", READINGS)
def test_readings_are_those_of_the_dataset_to_the_last_bit_and_so_are_truth_and_bias(streamed, sensor):
    data, _, messages = streamed
    number, path = SENSOR_IDS[sensor], data.layout.sensor(sensor)
    count = sum(map(len, READINGS[sensor].values()))
    same(messages[number], rows_of(path, 1, count))
    if not data.has_noise(sensor):
        assert not messages[number + 1]
        assert not messages[number + 2]
        return
    same(messages[number + 1], rows_of(path, 1 + count, count))
    if sensor == "imu0":
        same(messages[number + 2], rows_of(data.layout.bias("imu0")))
    elif sensor in ("dvl0", "altimeter0"):
        assert not messages[number + 2]
    else:
        same(messages[number + 2], rows_of(path, 1 + 2 * count, count))


def test_the_true_states_of_the_vehicle_are_those_of_the_dataset(streamed):
    data, _, messages = streamed
    same(messages[50], rows_of(data.layout.states))


def test_true_poses_of_vehicle_sensors_cameras_and_what_moves_are_those_of_the_dataset(streamed):
    data, _, messages = streamed
    sources = json.loads(messages[1][0][2])["sources"]
    assert set(sources) == {"vehicle", *READINGS, "L0", "R0", "W0", "objects.0"}
    for number, name in enumerate(sources):
        found = [(time_ns, numbers[1:], text) for time_ns, numbers, text in messages[51] if numbers[0] == number]
        same(found, rows_of(data.layout.poses(name, "transformation_matrix")))


def test_images_of_all_types_and_cameras_are_pointed_to_at_their_times(streamed):
    data, folder, messages = streamed
    expected = []
    for number, camera in enumerate(data.cameras):
        times = rows_of(data.layout.camera_file(camera, "_timestamps.csv"), 1, 0)
        expected += [
            (time_ns, frame, number, letter)
            for (time_ns,), frame in zip(times, data.frames, strict=True)
            for letter in data.outputs
        ]
    assert len(expected) == 3 * 4 * 7
    assert sorted((t, frame, camera, letter.decode()) for t, (frame, camera, letter), _ in messages[60]) == sorted(
        expected
    )
    for _, (frame, camera, letter), path in messages[60]:
        original = data.layout.image(data.cameras[camera], letter.decode(), frame)
        assert (folder / path).read_bytes() == original.read_bytes()


def test_what_the_numbers_of_s_mean_lies_beside_the_stream(streamed):
    data, folder, _ = streamed
    assert (folder / "segments.json").read_bytes() == data.layout.segments.read_bytes()


def test_without_what_the_numbers_of_s_mean_there_is_no_stream(everything, tmp_path):
    copy = shutil.copytree(everything / "data", tmp_path / "copy")
    (copy / "segments.json").unlink()
    with pytest.raises(InputError, match=r"segments.json: there is no such file. `run` again"):
        export(copy, "stream", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_the_first_message_describes_the_dataset_and_every_id(streamed):
    data, _, messages = streamed
    ((_, _, text),) = messages[1]
    about = json.loads(text)
    assert about["dataset"] == json.loads((data.root / "dataset.json").read_text())
    assert about["start_ns"] == LATE
    assert {int(id) for id in about["messages"]} >= set(messages)


def test_messages_are_in_the_order_of_time_then_of_ids(everything):
    """The first and the last apart, which hold the others."""
    order = [(time_ns, id) for id, time_ns, _, _ in read_stream(everything / "data stream/stream.sbst")]
    assert [id for _, id in (order[0], order[-1])] == [1, 99]
    assert all(one <= other for one, other in pairwise(order[1:-1]))
    assert order[0][0] <= order[1][0]
    assert order[-2][0] <= order[-1][0]


def test_a_message_is_that_of_the_papers_table_7(everything):
    """'SBST', uint32 id, uint32 length, payload; of the first depth, little-endian."""
    data = Dataset(everything / "data")
    payload = struct.pack("<qd", LATE, data.depth_gauge()["depth"][0])
    message = b"SBST" + struct.pack("<II", 20, 16) + payload
    assert (everything / "data stream/stream.sbst").read_bytes().count(message) == 1


def test_a_new_sensor_has_an_id_and_a_description():
    assert SENSOR_IDS.keys() == READINGS.keys()
    assert set(SENSOR_IDS.values()) <= set(FIELDS)


def test_the_documented_reader_is_short_and_takes_the_standard_library_alone():
    assert len(READER.splitlines()) <= 30
    assert re.findall(r"^(?:import|from) .*", READER, re.MULTILINE) == ["import struct, warnings"]


# ------------------------------------------------------------------------------------------------------------- damage


@pytest.fixture(scope="module")
def content(everything):
    return (everything / "data stream/stream.sbst").read_bytes()


@pytest.mark.parametrize("lost", [*range(1, 20), 21, 1000])
def test_a_file_that_ends_within_a_message_is_an_error(content, tmp_path, lost):
    """The last message has 20 bytes."""
    (tmp_path / "s").write_bytes(content[:-lost])
    with pytest.raises(ValueError, match="ends within the message at byte "):
        list(read_stream(tmp_path / "s"))


@pytest.mark.parametrize("cut", ["all", "last"])
def test_a_file_that_ends_between_messages_is_an_error(content, tmp_path, cut):
    (tmp_path / "s").write_bytes(b"" if cut == "all" else content[:-20])
    with pytest.raises(ValueError, match="ends before its last message"):
        list(read_stream(tmp_path / "s"))


@pytest.mark.parametrize("at", [0, 4, 8])
def test_after_damage_reading_goes_on_at_the_next_message_and_a_warning_says_so(content, tmp_path, at):
    """Start, id or length of the message in the middle; the one before it goes, too, if nothing whole follows it."""
    whole = list(read_stream_of(content, tmp_path))
    start = content.find(b"SBST" + struct.pack("<I", 20), len(content) // 2)
    damaged = bytearray(content)
    damaged[start + at] ^= 0xFF
    if at == 4:  # an id that nobody knows: only its message goes, without a word
        read = list(read_stream_of(damaged, tmp_path))
        assert len(read) == len(whole) - 1
    else:
        with pytest.warns(UserWarning, match="damaged bytes passed over"):
            read = list(read_stream_of(damaged, tmp_path))
        assert len(whole) - 2 <= len(read) <= len(whole) - 1
    assert read == [message for message in whole if message in read]


def read_stream_of(content, folder):
    (folder / "s").write_bytes(content)
    return ((id, time_ns, str(numbers), text) for id, time_ns, numbers, text in read_stream(folder / "s"))


# --------------------------------------------------------------------------------------------------- partial datasets


def test_a_dataset_without_images_has_a_stream_of_its_sensors(tmp_path):
    produce(make_scene(), tmp_path / "data", quiet=True, images=False)
    export(tmp_path / "data", "stream", tmp_path / "out")
    assert {id for id, *_ in read_stream(tmp_path / "out/stream.sbst")} == {1, 10, 20, 50, 51, 99}


def test_a_dataset_without_sensors_has_a_stream_of_images_and_cameras(tmp_path):
    produce(make_scene({"outputs": ["D"]}), tmp_path / "data", quiet=True, sensors=False)
    export(tmp_path / "data", "stream", tmp_path / "out", cameras=["R0"])
    messages = list(read_stream(tmp_path / "out/stream.sbst"))
    assert {id for id, *_ in messages} == {1, 51, 60, 99}
    assert {tuple(numbers[1:]) for id, _, numbers, _ in messages if id == 60} == {(1, b"D")}
    assert json.loads(messages[0][3])["sources"] == ["R0"]
