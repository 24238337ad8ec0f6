"""Stream files: what is written is read, damage is passed over, a cut file is refused."""

import json
import struct

import numpy as np
import pytest

from varos_warp.dataset import stream
from varos_warp.dataset.export import export
from varos_warp.dataset.noise import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.errors import InputError
from varos_warp.scene.noise_profile import NoiseProfile


@pytest.fixture(scope="module")
def data(written):
    return Dataset(written)


@pytest.fixture(scope="module")
def out(written, tmp_path_factory):
    out = tmp_path_factory.mktemp("stream") / "out"
    export(written, "stream", out)
    return out


def test_a_stream_has_everything_in_the_order_of_time(data, out):
    messages = list(stream.read_stream(out / "stream.sbst"))
    times = [m.time_ns for m in messages]
    assert times == sorted(times)
    of = {id: [m for m in messages if m.id == id] for id in stream.FIELDS}
    assert json.loads(of[stream.DESCRIPTION][0].text)["cameras"] == data.meta["cameras"]
    assert messages[0].id == stream.DESCRIPTION
    imu, states = data.imu(), data.states()
    np.testing.assert_array_equal([m.time_ns for m in of[stream.IMU]], imu["time_ns"])
    np.testing.assert_array_equal([m.values for m in of[stream.IMU]],
                                  np.hstack([imu["acceleration"], imu["angular_velocity"]]))
    np.testing.assert_array_equal([m.values[0] for m in of[stream.DEPTH_GAUGE]], data.depth_gauge()["depth"])
    np.testing.assert_array_equal([m.values for m in of[stream.VEHICLE_POSE]],
                                  np.hstack([states["position"], states["quaternion"]]))
    assert len(of[stream.IMAGE]) == 2 * 4 * 10
    for message in of[stream.IMAGE]:
        frame, camera, letter = message.values
        assert message.time_ns == data.time_ns()[frame]
        original = data.layout.png(data.cameras[camera], chr(letter), frame)
        assert (out / message.text).read_bytes() == original.read_bytes()


def test_a_message_is_its_mark_its_id_its_length_and_its_payload():
    """Table 7 of the paper, little-endian; the time survives beyond the 53 bits of a float64."""
    time_ns = 1629158400_000_000_001
    message = stream.Message(stream.DEPTH_GAUGE, time_ns, (80.25,))
    assert message.encode() == b"SBST" + struct.pack("<IIqd", 3, 16, time_ns, 80.25)
    ((id, payload),) = stream.split_messages(message.encode())
    assert stream.Message.decode(id, payload) == message


def gauge_messages(count):
    return [stream.Message(stream.DEPTH_GAUGE, i, (float(i),)) for i in range(count)]


def test_a_walk_with_struct_alone_finds_the_messages(out):
    """As a reader would that knows only table 7 of the paper."""
    content, at, count = (out / "stream.sbst").read_bytes(), 0, 0
    while at < len(content):
        mark, _, length = struct.unpack_from("<4sII", content, at)
        assert mark == b"SBST"
        at, count = at + 12 + length, count + 1
    assert at == len(content)
    assert count == len(list(stream.read_stream(out / "stream.sbst")))


def test_messages_of_an_unknown_id_are_passed_over_whatever_they_hold(tmp_path):
    known = gauge_messages(3)
    strange = [struct.pack("<4sII", b"SBST", 77, 3) + b"abc", struct.pack("<4sII", b"SBST", 2**32 - 1, 0)]
    (tmp_path / "s").write_bytes(b"".join([known[0].encode(), *strange, known[1].encode(), known[2].encode()]))
    assert list(stream.read_stream(tmp_path / "s")) == known


def test_a_stream_that_is_cut_between_two_messages_is_bad_input(out, tmp_path):
    content = (out / "stream.sbst").read_bytes()
    end = stream.Message(stream.END, 0).encode()
    assert content.endswith(stream.START + end[4:12] + content[-8:])
    for stop in (len(content) - len(end), content.rfind(stream.START, 0, len(content) - len(end))):
        (tmp_path / "s").write_bytes(content[:stop])
        with pytest.raises(InputError, match="ends before its last message"):
            list(stream.read_stream(tmp_path / "s"))


def test_reading_goes_on_after_damage_and_says_so(tmp_path):
    data = bytearray(b"".join(m.encode() for m in gauge_messages(5)))
    data[2 * 28:2 * 28 + 4] = b"SBXX"
    (tmp_path / "s").write_bytes(data)
    with pytest.warns(UserWarning, match="damaged bytes passed over"):
        read = list(stream.read_stream(tmp_path / "s"))
    assert {0, 3, 4} <= {m.time_ns for m in read} <= {0, 1, 3, 4}
    assert all(m in gauge_messages(5) for m in read)


@pytest.mark.filterwarnings("ignore:a damaged message")
@pytest.mark.parametrize("seed", range(20))
def test_damage_anywhere_costs_the_messages_that_it_hits_and_their_neighbours(tmp_path, seed):
    """40 random bytes over 200 messages; payloads have no checksum, so damage within one may be read."""
    rng = np.random.default_rng(seed)
    whole = gauge_messages(200)
    data = bytearray(b"".join(m.encode() for m in whole))
    for at in rng.integers(0, len(data) - 28, 40):  # the last message ends the file
        data[at] = rng.integers(256)
    (tmp_path / "s").write_bytes(data)
    with pytest.warns(UserWarning, match="damaged bytes"):
        read = list(stream.read_stream(tmp_path / "s"))
    kept = [message for message in read if message in whole]
    assert kept == [message for message in whole if message in read]  # in their order
    assert len(kept) >= 200 - 2 * 40  # a damaged head takes the message before it along
    damaged = [message for message in read if message not in whole]
    assert len(damaged) <= 40


@pytest.mark.parametrize("lost", [1, 16, 20, 27])
def test_a_stream_that_ends_within_a_message_is_bad_input(tmp_path, lost):
    data = b"".join(m.encode() for m in gauge_messages(3))
    (tmp_path / "s").write_bytes(data[:-lost])
    with pytest.raises(InputError, match="ends within"):
        list(stream.read_stream(tmp_path / "s"))


def test_readings_with_noise_are_streamed_with_it_and_the_description_says_so(written, tmp_path):
    profile = NoiseProfile(name="rough", imu={"accelerometer_noise_density": 0.1}, depth_gauge={"bias": 0.5})
    noisy = add_noise(written, profile, tmp_path / "data", seed=5, quiet=True)
    export(noisy.root, "stream", tmp_path / "out")
    first, *messages = stream.read_stream(tmp_path / "out/stream.sbst")
    about = json.loads(first.text)["noise"]
    assert (about["profile"]["name"], about["seed"]) == ("rough", 5)
    read = [m.values[:3] for m in messages if m.id == stream.IMU]
    np.testing.assert_array_equal(read, noisy.imu()["acceleration"])
    read = [m.values[0] for m in messages if m.id == stream.DEPTH_GAUGE]
    np.testing.assert_array_equal(read, noisy.depth_gauge()["depth"])
