"""What all exports do: link images, encode depth anew, leave nothing behind, refuse what cannot be."""

import json
import shutil
import warnings

import cv2
import numpy as np
import OpenEXR
import pytest
import standins
from PIL import Image
from readback import rows
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Writer
from standins import make_scene, tree
from typer.testing import CliRunner

from varos_warp import cli
from varos_warp.dataset import files
from varos_warp.dataset.export import FORMATS, LABELS, export
from varos_warp.dataset.export.shared import job
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import along_axis
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.optics.camera import CameraModel

pytestmark = pytest.mark.filterwarnings("ignore:tum holds one camera")


@pytest.mark.parametrize(
    ("form", "folder", "unit", "largest"),
    [
        ("tum", "depth", 1 / 5000, 65535 / 5000),
        ("kitti", "sequences/01/depth_2", 1 / 256, 25.0),
        ("nerfstudio", "depths", 1 / 1000, 25.0),
    ],
)
def test_depth_comes_back_in_metres_within_half_a_unit(data, out, form, folder, unit, largest):
    """Rounding to the unit, and float32 of D (2^-24 of 25 m) once; what is too far is 0."""
    paths = sorted(p for p in (out / form / folder).glob("*.png") if "camR0" not in p.name)
    assert len(paths) == 10
    for frame, path in zip(data.frames, paths, strict=True):
        with Image.open(path) as image:
            units = np.array(image)
        truth, read = data.depth(frame, "L0"), units * unit
        assert units.dtype == np.uint16
        there = truth <= largest
        assert 0 < there.mean() < 1
        assert np.abs(read - truth)[there].max() <= unit / 2 + 25 * 2.0**-24
        assert not units[~there].any()


def test_depth_along_the_ray_becomes_planar(data):
    """A wall at z = 5 m seen by the pixel (row 3, column 40)."""
    K = data.intrinsics()
    row, col = np.indices((27, 48)) + 0.5
    ray = np.stack([(col - K[0, 2]) / K[0, 0], (row - K[1, 2]) / K[1, 1], np.ones((27, 48))], -1)
    along = 5.0 * np.linalg.norm(ray, axis=-1)
    np.testing.assert_allclose(along_axis(along, CameraModel(K)), 5.0, rtol=1e-14)


def test_where_nothing_moves_no_poses_lie_beside(out):
    assert not list(out.glob("*/moving"))


def test_opencv_and_openexr_read_the_native_images_as_the_dataset_does(data):
    for camera in data.cameras:
        frame = data.frames[-1]
        bgr = cv2.imread(str(data.layout.image(camera, "A", frame)), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(bgr[..., ::-1], data.pixels("A", frame, camera))
        units = cv2.imread(str(data.layout.image(camera, "D", frame)), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(units, data.pixels("D", frame, camera))
        with OpenEXR.File(str(data.layout.exr(camera, "A", frame))) as file:
            rgb = file.channels()["RGB"].pixels
        assert rgb.dtype == np.float16
        np.testing.assert_array_equal(rgb.astype(np.float32), data.linear("A", frame, camera))


@pytest.mark.parametrize("time_ns", [0, 5_000_000, 1629158400_005_000_001, -5])
def test_seconds_keep_every_nanosecond(time_ns):
    whole, decimals = job.seconds(time_ns).split(".")
    assert len(decimals) == 9
    assert abs(int(whole)) * 10**9 + int(decimals) == abs(time_ns)


def test_images_are_the_same_files_or_copies_where_they_cannot_be(written, tmp_path, monkeypatch):
    source, linked, copied = Dataset(written).layout.image("L0", "A", 0), tmp_path / "a/1.png", tmp_path / "b/1.png"
    files.link(source, linked)
    assert linked.samefile(source)
    monkeypatch.setattr(files.os, "link", lambda *_: (_ for _ in ()).throw(OSError("no links here")))
    files.link(source, copied)
    assert not copied.samefile(source)
    assert copied.read_bytes() == source.read_bytes()


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "corners"])  # which needs a board
def test_a_failed_export_leaves_nothing_and_the_dataset_as_it_was(written, labelled, tmp_path, monkeypatch, name):
    source, how = (labelled.root, ("B", ["M0"])) if name in LABELS else (written, ())
    before = tree(source)

    def full(*_args, **_options):
        raise OSError(28, "No space left on device")

    for owner, function in ((files, "write_bytes"), (Writer, "write"), (files, "atomic")):
        monkeypatch.setattr(owner, function, full)
    with pytest.raises(InputError, match="No space left"):
        export(source, name, tmp_path / "out", *how)
    assert list(tmp_path.iterdir()) == []
    assert tree(source) == before


def test_what_cannot_be_exported_is_bad_input(written, tmp_path):
    for change, words in (
        ({"to": "rosbag"}, "no format.*euroc, tum"),
        ({"images": "C"}, "no colour images.*A, B"),
        ({"cameras": ["X1"]}, "no such camera"),
        ({"start_ns": -1}, "nanoseconds since 1970"),
        ({"start_ns": 2**31 * 10**9}, "before the year 2038"),
        ({"out": written}, "is there already"),
        ({"out": written / "to" / "tum"}, "lies within the dataset"),
    ):
        with pytest.raises(InputError, match=words):
            export(**({"dataset_root": written, "to": "tum", "out": tmp_path / "out"} | change))
    assert list(tmp_path.iterdir()) == []


def test_a_missing_image_is_found_before_anything_is_written(written, tmp_path):
    copy = shutil.copytree(written, tmp_path / "copy")
    Dataset(copy).layout.image("L0", "D", 4).unlink()
    with pytest.raises(InputError, match=r"D-00000004.png.*missing"):
        export(copy, "nerfstudio", tmp_path / "out")
    export(copy, "euroc", tmp_path / "out")  # which takes no depth


@pytest.mark.parametrize("name", ["euroc", "tum", "mcap"])
def test_readings_that_are_gone_are_bad_input_not_an_export_without_them(written, tmp_path, name):
    copy = shutil.copytree(written, tmp_path / "copy")
    Dataset(copy).layout.sensor("imu0").unlink()
    with pytest.raises(InputError, match=r"imu0_data.csv.*no such file"):
        export(copy, name, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_cameras_that_stand_in_the_world_have_poses_but_no_place_on_a_body(tmp_path):
    scene = make_scene(
        vehicle={
            "cameras": [{"id": "M0", "mount": "world", "position": [0, -2, 0], "resolution": [16, 9]}],
            "imu": {},
            "depth_gauge": {},
        },
        render={"outputs": ["A"]},
    )
    produce(scene, tmp_path / "data", quiet=True)
    with pytest.warns(UserWarning, match="M0"), pytest.raises(InputError, match="no camera is on the vehicle"):
        export(tmp_path / "data", "euroc", tmp_path / "out")
    export(tmp_path / "data", "tum", tmp_path / "out")
    assert not (tmp_path / "out/depth.txt").exists()
    assert len({tuple(row[1:]) for row in rows(tmp_path / "out/groundtruth.txt")}) == 1


def test_frames_without_sensors_go_to_colmap_but_not_to_euroc(tmp_path):
    produce(make_scene(render={"outputs": ["A"]}), tmp_path / "data", quiet=True, sensors=False)
    with pytest.raises(InputError, match=r"course of the vehicle.*simulate"):
        export(tmp_path / "data", "euroc", tmp_path / "out")
    assert len(export(tmp_path / "data", "colmap", tmp_path / "out").data) == 10


def test_a_clock_that_is_set_moves_every_stamp_by_as_much_and_keeps_its_nanoseconds(written, data, out, tmp_path):
    """Beyond the 53 bits of a float64."""
    start = 1_629_158_400_000_000_001
    for name in ("euroc", "tum", "mcap", "kitti"):
        export(written, name, tmp_path / name, start_ns=start)
    times = [start + t for t in data.time_ns("L0").tolist()]
    assert sorted(p.name for p in (tmp_path / "euroc/mav0/cam0/data").iterdir()) == [f"{t}.png" for t in times]
    assert [int(line) for line in (tmp_path / "euroc/times.txt").read_text().split()] == times
    for table in ("cam0", "imu0", "depth_gauge0", "state_groundtruth_estimate0"):
        moved, native = (rows(root / f"mav0/{table}/data.csv", ",") for root in (tmp_path / "euroc", out / "euroc"))
        assert [int(row[0]) - start for row in moved] == [int(row[0]) for row in native]
    for table in ("rgb.txt", "depth.txt", "groundtruth.txt", "accelerometer.txt"):
        moved, native = ([row[0].split(".") for row in rows(root / table)] for root in (tmp_path / "tum", out / "tum"))
        moved, native = ([int(s) * 10**9 + int(ns) for s, ns in table] for table in (moved, native))
        assert [t - start for t in moved] == native
    with AnyReader([tmp_path / "mcap/bag"]) as moved, AnyReader([out / "mcap/bag"]) as native:
        assert [t - start for _, t, _ in moved.messages()] == [t for _, t, _ in native.messages()]
    relative = "kitti/sequences/01/times.txt"
    assert (tmp_path / relative).read_bytes() == (out / relative).read_bytes()


def test_the_command_line_exports_and_refuses(written, tmp_path):
    arguments = [
        "export",
        str(written),
        "--to",
        "colmap",
        "-o",
        str(tmp_path / "out"),
        "--images",
        "B",
        "--camera",
        "R0",
    ]
    done = CliRunner().invoke(cli.app, arguments)
    assert (done.exit_code, done.output) == (0, f"{tmp_path / 'out'}: 10 frames of R0 as colmap\n")
    assert len(list((tmp_path / "out/images/camR0").glob("*_B-*.png"))) == 10
    again = CliRunner().invoke(cli.app, arguments)
    assert again.exit_code == 2
    assert "is there already" in again.output


@pytest.mark.parametrize(
    ("form", "cameras"), [("kitti", ["L0"]), ("euroc", ["L0"]), ("tum", ["L0"]), ("colmap", ["L0", "O0"])]
)
@pytest.mark.filterwarnings("ignore:kitti holds|euroc holds|tum holds")
def test_the_command_line_names_the_cameras_that_an_export_has_and_no_others(tmp_path, form, cameras):
    scene = make_scene(
        vehicle={
            "cameras": [
                {"id": "L0", "resolution": [16, 9]},
                {"id": "O0", "mount": "world", "position": [0, -2, 0], "resolution": [16, 9]},
            ],
            "imu": {},
            "depth_gauge": {},
        },
        render={"outputs": ["A"]},
    )
    produce(scene, tmp_path / "data", quiet=True)
    call = ["export", str(tmp_path / "data"), "--to", form, "-o"]
    done = CliRunner().invoke(cli.app, [*call, str(tmp_path / "out")])
    assert done.stdout == f"{tmp_path / 'out'}: 10 frames of {', '.join(cameras)} as {form}\n"
    told = json.loads(CliRunner().invoke(cli.app, [*call, str(tmp_path / "more"), "--json"]).stdout)
    assert told["cameras"] == cameras


@pytest.fixture(scope="module")
def one_frame(tmp_path_factory):
    """A dataset of one frame."""
    root = tmp_path_factory.mktemp("one") / "data"
    scene = make_scene(vehicle={"cameras": [{"id": "M0", "resolution": [16, 9]}]}, render={"outputs": ["A", "D"]})
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene, root, frames=slice(0, 1), quiet=True)
    return root


@pytest.mark.parametrize(
    ("form", "needs_motion"),
    [
        ("tum", True),
        ("kitti", True),
        ("euroc", True),
        ("mcap", True),
        ("vslamlab", True),
        ("colmap", False),
        ("nerfstudio", False),
    ],
)
def test_one_frame_is_one_frame_and_has_no_motion(one_frame, tmp_path, form, needs_motion):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        done = CliRunner().invoke(cli.app, ["export", str(one_frame), "--to", form, "-o", str(tmp_path / "out")])
    assert (done.exit_code, done.stdout) == (0, f"{tmp_path / 'out'}: 1 frame of M0 as {form}\n")
    told = done.stderr + "".join(str(each.message) for each in caught)
    assert (f"{form} is for odometry and SLAM, and this dataset has one frame" in told) == needs_motion


@pytest.mark.parametrize(
    ("form", "needs_depth"),
    [("tum", True), ("colmap", True), ("nerfstudio", True), ("vslamlab", True), ("euroc", False), ("stream", False)],
)
@pytest.mark.parametrize("outputs", ["AD", "A"])
def test_an_export_without_depth_says_so(tmp_path, monkeypatch, form, needs_depth, outputs):
    standins.install(monkeypatch)
    scene = make_scene(vehicle={"cameras": [{"id": "M0", "resolution": [16, 9]}]}, render={"outputs": [*outputs]})
    produce(scene, tmp_path / "data", frames=slice(0, 2), quiet=True)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        export(tmp_path / "data", form, tmp_path / "out")
    told = [str(each.message) for each in caught]
    assert any("the dataset has no D" in words for words in told) == (needs_depth and outputs == "A")


def test_the_command_line_sets_the_clock_and_tells_of_noise(noisy, tmp_path):
    done = CliRunner().invoke(
        cli.app,
        [
            "export",
            str(noisy.root),
            "--to",
            "mcap",
            "-o",
            str(tmp_path / "out"),
            "--raw",
            "--start-ns",
            "7000000000",
            "--quiet",
        ],
    )
    assert (done.exit_code, done.output) == (
        0,
        f"{tmp_path / 'out'}: 10 frames of L0, R0 as mcap; imu0, depth0, A with the noise of profile test, seed 5\n",
    )
    with AnyReader([tmp_path / "out/bag"]) as bag:
        assert bag.start_time == 7 * 10**9
        assert "/camR0/image" in bag.topics
    done = CliRunner().invoke(
        cli.app,
        [
            "export",
            str(noisy.root),
            "--to",
            "colmap",
            "-o",
            str(tmp_path / "more"),
            "--images",
            "B",
            "--json",
            "--quiet",
        ],
    )
    noise = "with the noise of profile test, seed 5"
    assert json.loads(done.output)["noise"] == {"imu0": noise, "depth0": noise, "B": "without noise"}
