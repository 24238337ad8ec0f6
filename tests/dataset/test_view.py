"""A recording for Rerun holds the dataset's times to the nanosecond, its images bit by bit and its poses."""

import io
import os
import shutil
import socket
import sys

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation
from standins import make_scene
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.view import local_origin, view
from varos_warp.errors import InputError

if not os.environ.get("CI"):
    pytest.importorskip("rerun.dataframe")


@pytest.fixture(scope="module")
def recording(written, tmp_path_factory):
    from rerun.dataframe import load_recording

    return load_recording(view(written, tmp_path_factory.mktemp("view") / "test.rrd", quiet=True))


@pytest.fixture(scope="module")
def data(written):
    return Dataset(written)


def rows(recording, entity: str, timeline: str = "time") -> list[dict]:
    """Everything that Rerun's own reader finds of an entity, in the order of its time line; nothing that is static."""
    table = recording.view(index=timeline, contents=entity).select().read_all()
    found = [{name: value for name, value in row.items() if value is not None} for row in table.to_pylist()]
    return [row for row in found if row.get(timeline) is not None]


def cell(row: dict, name: str):
    """The first value of a component."""
    return next(value for key, value in row.items() if key.endswith(name))[0]


def times(found: list[dict]) -> list[int]:
    return [
        int(row["time"].value) if hasattr(row["time"], "value") else round(row["time"] / np.timedelta64(1, "ns"))
        for row in found
    ]


SINGLE = 2.0**-22
"""Of a pose of at most 2 m: entries of q are good to 2^-25 each, |dR| <= 4 |dq|; positions to 2^-24."""


def pose(row: dict) -> np.ndarray:
    """[3, 4], single precision; Rerun's quaternions are x, y, z, w."""
    return np.column_stack([Rotation.from_quat(cell(row, "quaternion")).as_matrix(), cell(row, "translation")])


def test_cameras_are_at_their_poses_at_the_times_of_the_frames(recording, data):
    for camera in data.cameras:
        found = rows(recording, f"/world/cam{camera}")
        assert times(found) == data.time_ns(camera).tolist()
        for row, frame in zip(found, data[:, camera], strict=True):
            np.testing.assert_allclose(pose(row), frame.T_w_c[:3], rtol=0, atol=SINGLE)
            assert row["frame"] == frame.number


def test_the_vehicle_moves_at_every_tick(recording, data):
    time_ns, T_w_v = data.poses("vehicle")
    found = rows(recording, "/world/vehicle")
    assert times(found) == time_ns.tolist()
    np.testing.assert_allclose([pose(row) for row in found], T_w_v[:, :3], rtol=0, atol=SINGLE)


def test_the_projection_is_that_of_the_camera(recording, data):
    table = recording.view(index="time", contents="/world/camR0", include_semantically_empty_columns=True)
    static = table.select_static().read_all().to_pylist()[0]
    K = np.reshape(cell(static, "image_from_camera"), (3, 3)).T
    np.testing.assert_allclose(K, data.intrinsics("R0"), rtol=2.0**-23)
    assert cell(static, "resolution") == [48, 27]


@pytest.mark.parametrize("output", "ABC")
def test_images_are_the_files_themselves(recording, data, output):
    found = rows(recording, f"/world/camR0/{output}", "frame")
    assert [row["frame"] for row in found] == data.frames
    for row in found:
        pixels = np.array(Image.open(io.BytesIO(bytes(cell(row, "blob")))))
        np.testing.assert_array_equal(pixels, data.pixels(output, row["frame"], "R0"))


def test_depth_is_in_metres_and_nothing_is_zero(recording, data):
    found = rows(recording, "/world/camL0/D", "frame")
    assert len(found) == 10
    for row in found:
        depth = np.frombuffer(bytes(cell(row, "buffer")), np.uint16).reshape(27, 48) / cell(row, "meter")
        truth = data.depth(row["frame"])
        np.testing.assert_allclose(depth, np.where(np.isinf(truth), 0, truth), rtol=1e-6)
        assert np.isinf(truth).any()


def test_every_reading_of_the_sensors_is_there(recording, data):
    imu, gauge = data.imu(), data.depth_gauge()
    for quantity in ("acceleration", "angular_velocity"):
        for i, axis in enumerate("xyz"):
            found = rows(recording, f"/imu0/{quantity}/{axis}")
            assert times(found) == imu["time_ns"].tolist()
            assert [cell(row, "scalars") for row in found] == imu[quantity][:, i].tolist()
    assert [cell(row, "scalars") for row in rows(recording, "/depth0/depth")] == gauge["depth"].tolist()
    gains = [cell(row, "scalars") for row in rows(recording, "/exposure/camL0/A")]
    assert gains == list(data.gains("A").values())


def test_objects_and_range_are_recorded_and_frames_may_be_chosen(tmp_path):
    """D of kind range is made planar, as Rerun takes it."""
    from rerun.dataframe import load_recording

    produce(make_scene(render={"depth_kind": "range"}), tmp_path / "data", quiet=True)
    data = Dataset(tmp_path / "data")
    found = rows(load_recording(view(data.root, tmp_path / "out.rrd", slice(3, 5))), "/world/camR0/D", "frame")
    assert [row["frame"] for row in found] == [3, 4]
    depth, truth = np.frombuffer(bytes(cell(found[0], "buffer")), np.float32), data.planar_depth(3, "R0").ravel()
    near = np.isfinite(truth)
    np.testing.assert_allclose(depth[near], truth[near], rtol=1e-6)
    assert not depth[~near].any()


def test_a_world_far_from_the_origin_is_moved_nearer(data, monkeypatch):
    assert not local_origin(data).any()
    time_ns, T = data.views()
    T = T.copy()
    T[:, :3, 3] += [569_000.25, 7_034_000.5, -40.0]
    monkeypatch.setattr(data, "views", lambda camera=None: (time_ns, T))
    origin = local_origin(data)
    np.testing.assert_array_equal(origin, np.round(origin))
    assert np.abs(T[:, :3, 3] - origin).max() < 2


def test_a_frame_that_is_damaged_is_named_and_leaves_no_file(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    path = Dataset(copy).layout.image("L0", "A", 4)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match=path.name):
        view(copy, tmp_path / "out.rrd", quiet=True)
    assert [p.name for p in tmp_path.iterdir()] == ["copy"]
    with pytest.raises(InputError, match=r"no such frames.*10 frames, 0 to 9"):
        view(written, tmp_path / "out.rrd", slice(20, 30))


def test_without_rerun_there_is_one_clear_message(written, monkeypatch):
    monkeypatch.setitem(sys.modules, "rerun", None)
    result = CliRunner().invoke(app, ["view", str(written)])
    assert result.exit_code == 2
    assert "varos_warp[view]" in result.stderr


def test_a_viewer_that_cannot_be_opened_is_one_clear_message(written, monkeypatch):
    """No display; no program; and one that is open already, here or through a tunnel, is used without a display."""
    from rerun import RecordingStream

    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        monkeypatch.setattr("varos_warp.dataset.view.VIEWER_PORT", server.getsockname()[1])
        result = CliRunner().invoke(app, ["view", str(written)])
        assert result.exit_code == 2
        assert "there is no display for the viewer Rerun. Write a recording with --save FILE.rrd." in result.stderr
        server.listen()

        def spawn(self, **_):
            raise RuntimeError("Failed to find the executable in PATH.\n\n    more")

        monkeypatch.setattr(RecordingStream, "spawn", spawn)
        result = CliRunner().invoke(app, ["view", str(written)])
    assert result.exit_code == 2
    assert "cannot be opened: Failed to find the executable in PATH. Activate the environment" in result.stderr


def test_the_command_line_writes_a_recording(written, tmp_path):
    result = CliRunner().invoke(app, ["view", str(written), "--save", str(tmp_path / "a.rrd"), "--frames", "0:2", "-q"])
    assert result.exit_code == 0, result.output
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"
