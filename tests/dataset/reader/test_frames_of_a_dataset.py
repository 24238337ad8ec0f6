"""A dataset is a sequence of frames, whose images are read when they are asked for and are those of the files."""

import itertools
import pickle
import shutil
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest
from standins import make_scene, simulate

from varos_warp.dataset import files
from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError


@pytest.fixture(scope="module")
def data(written):
    return Dataset(written)


@pytest.fixture
def copy(written, tmp_path):
    return shutil.copytree(written, tmp_path / "copy")


def test_frames_come_by_place_from_either_end_and_by_slices(data):
    assert [frame.number for frame in data] == list(range(10))
    assert [data[i].number for i in (0, 3, -1, np.int64(4))] == [0, 3, 9, 4]
    assert [(f.number, f.camera) for f in data[7:100:2, "R0"]] == [(7, "R0"), (9, "R0")]
    assert data[5, "R0"].camera == "R0"
    assert data[5].camera == "L0"


@pytest.mark.parametrize(
    ("name", "says"), [("imu", "Did you mean 'imu0'?"), ("hull", "There are: L0, R0, vehicle, imu0")]
)
def test_poses_of_an_unknown_name_are_refused_with_those_there_are(data, name, says):
    with pytest.raises(InputError) as refused:
        data.poses(name)
    assert says in refused.value.message


@pytest.mark.parametrize("index", [10, -11])
def test_a_place_beyond_the_ends_is_an_index_error(data, index):
    with pytest.raises(IndexError, match="10 frames"):
        data[index]


def test_a_number_that_the_dataset_has_not_is_an_index_error(data):
    with pytest.raises(IndexError, match=r"no frame 12: the dataset has 0 to 9; data\[0\] is the first"):
        data.frame(12)
    with pytest.raises(IndexError, match="no frame 12"):
        data.T_w_c(12)


@pytest.mark.parametrize(
    ("index", "example"),
    [
        ("R0", "R0"),
        ("A", "L0"),
        (0.5, "L0"),
        (None, "L0"),
        ([1, 2], "L0"),
        (np.arange(2), "L0"),
        ((0, "L0", 1), "L0"),
        (slice("a", 3), "L0"),
    ],
)
def test_an_index_that_is_no_number_is_a_type_error_that_says_what_to_give(data, index, example):
    with pytest.raises(TypeError, match=rf"no place of a frame.*data\[0\].*with a camera, data\[0, '{example}'\]"):
        data[index]


def test_places_and_numbers_differ_where_frames_were_left_out(tmp_path):
    produce(make_scene(), tmp_path / "out", frames=slice(4, 7), quiet=True)
    data = Dataset(tmp_path / "out")
    assert [(f.index, f.number, f.time_ns) for f in data] == [(i, 4 + i, (4 + i) * 100_000_000) for i in range(3)]
    assert data.frame(6).index == 2
    np.testing.assert_array_equal(data[1].T_w_c, data.T_w_c(5))
    for ask in (data.T_w_c, data.depth, data.flow, partial(data.image, "A"), partial(data.linear, "B")):
        with pytest.raises(IndexError, match=r"no frame 0: the dataset has 4 to 6; data\[0\] is the first"):
            ask(0)


def test_images_are_the_pixels_of_the_files_in_their_units(data):
    frame = data[3, "R0"]
    assert (frame.A.dtype, frame.A.shape) == (np.uint8, (27, 48, 3))
    np.testing.assert_array_equal(frame.A, files.read_png(data.layout.image("R0", "A", 3)))
    np.testing.assert_array_equal(frame.B, files.read_png(data.layout.image("R0", "B", 3)))
    np.testing.assert_array_equal(frame.D, data.depth(3, "R0"))
    length = np.linalg.norm(frame.C, axis=-1)
    assert frame.C.dtype == np.float32
    np.testing.assert_allclose(length[length > 0], 1.0, atol=1e-6)


def test_the_image_is_the_radiance_times_the_gain_through_the_srgb_curve(data):
    from varos_warp.products.images.radiance import encode_color

    frame = data[2]
    np.testing.assert_array_equal(frame.A, encode_color(frame.A_radiance, frame.gain()))
    np.testing.assert_array_equal(frame.B, encode_color(frame.B_radiance, frame.gain("B")))
    assert not np.array_equal(frame.A_radiance, frame.B_radiance)


def test_poses_and_time_are_those_of_the_simulation(data):
    trajectory = simulate(make_scene()).trajectory
    for frame in data[::3, "R0"]:
        tick = 20 * frame.number
        assert frame.time_ns == trajectory.time_ns[tick]
        np.testing.assert_allclose(frame.T_w_v, trajectory.T_w_v(tick), atol=1e-15)
        np.testing.assert_allclose(frame.T_w_c, frame.T_w_v @ data.camera("R0")["T_v_c"], atol=1e-15)


def floor_seen_through(frame, K, first_center):
    """Heights above the floor of the stand-in's world of all points that a frame sees, by D, K and the pose."""
    from standins import FLOOR_Z

    row, col = np.nonzero(np.isfinite(frame.D))
    ray = np.column_stack([col + first_center, row + first_center, np.ones(len(row))]) @ np.linalg.inv(K).T
    return (frame.T_w_c[:3, :3] @ (ray * frame.D[row, col, None]).T)[2] + frame.T_w_c[2, 3] - FLOOR_Z


def test_points_lie_on_the_floor_in_either_convention_of_pixels(data):
    """A half step of D, and the ray's slope of at most 1, are 0.2 mm; half a pixel wrong is centimetres."""
    frame, within = data[3, "R0"], 0.5 * 25 / 65535 + 25 * 2.0**-23
    assert np.abs(floor_seen_through(frame, frame.K_opencv, 0.0)).max() < within
    assert np.abs(floor_seen_through(frame, frame.K_center_half, 0.5)).max() < within
    assert np.abs(floor_seen_through(frame, frame.K_center_half, 0.0)).max() > 20 * within
    np.testing.assert_array_equal(frame.K, frame.K_center_half)
    for K, convention in ((frame.K_opencv, "opencv"), (frame.K_center_half, "center_half")):
        np.testing.assert_array_equal(K, data.intrinsics("R0", convention))


def test_an_unknown_convention_of_pixels_is_bad_input(data):
    with pytest.raises(InputError, match=r"convention = 'colmap': no such convention.*center_half, opencv"):
        data.intrinsics("L0", "colmap")


def test_the_vehicle_follows_from_its_camera_where_it_was_not_written(written, copy):
    for name in ("ground_truth_vehicle0_poses", "imu0", "depth0"):
        shutil.rmtree(copy / "vehicle0" / name)
    for found, expected in zip(Dataset(copy), Dataset(written), strict=True):
        np.testing.assert_allclose(found.T_w_v, expected.T_w_v, atol=1e-15)


def test_an_image_is_read_when_it_is_asked_for_and_once(copy):
    frame = Dataset(copy)[0]
    first = frame.A
    shutil.rmtree(copy / "vehicle0/cam0/A")
    assert frame.A is first
    with pytest.raises(InputError, match=r"A-00000001.png: there is no such file"):
        _ = Dataset(copy)[1].A


def test_what_is_changed_in_a_pose_does_not_come_back(data):
    pose = data[1].T_w_c
    pose[:] = 0
    assert data[1].T_w_c[3, 3] == 1
    reading = data.imu()["acceleration"]
    reading[:] = 0
    assert data.imu()["acceleration"].any()


def test_readings_between_the_times_of_frames_are_each_there_once(data):
    """Intervals are half open, so those between frames share the readings out."""
    times = data.time_ns()
    whole = data.imu(times[0], times[-1])
    parts = [data.imu(*ends) for ends in itertools.pairwise(times)]
    assert {len(part["time_ns"]) for part in parts} == {20}
    for key, values in whole.items():
        np.testing.assert_array_equal(np.concatenate([part[key] for part in parts]), values)
    assert data.depth_gauge(10_000_000, 20_000_000)["time_ns"].tolist() == [10_000_000, 15_000_000]
    assert data.states(stop_ns=1)["position"].shape == (1, 3)
    assert data.imu(start_ns=10**18)["acceleration"].shape == (0, 3)


def test_a_dataset_and_its_frames_survive_pickling(data, tmp_path, monkeypatch):
    frame = data[4, "R0"]
    size = len(pickle.dumps(frame))
    _ = frame.A, frame.D
    text = pickle.dumps([data, frame])
    assert len(pickle.dumps(frame)) == size
    monkeypatch.chdir(tmp_path)
    again, same = pickle.loads(text)
    assert len(again) == len(data)
    np.testing.assert_array_equal(same.A, frame.A)
    assert same.data is again


def test_a_dataset_opened_by_a_relative_path_is_found_by_a_process_elsewhere(written, tmp_path, monkeypatch):
    monkeypatch.chdir(written.parent)
    text = pickle.dumps(Dataset(written.name))
    monkeypatch.chdir(tmp_path)
    assert pickle.loads(text)[0].A.shape == (27, 48, 3)


def test_threads_may_share_a_dataset(written):
    data = Dataset(written)

    def read(i):
        frame = data[i % 10, "LR"[i % 2] + "0"]
        return frame.A.sum() + frame.gain() + frame.T_w_c.sum() + frame.T_w_v.sum()

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(read, range(60)))
    fresh = Dataset(written)
    expected = [
        (f := fresh[i % 10, "LR"[i % 2] + "0"]).A.sum() + f.gain() + f.T_w_c.sum() + f.T_w_v.sum() for i in range(60)
    ]
    assert found == expected


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("imu0_data.csv", lambda d: d.imu()),
        ("depth0_data.csv", lambda d: d.depth_gauge()),
        ("vehicle0_states.csv", lambda d: d.states()),
        ("camL0_timestamps.csv", lambda d: d[0].time_ns),
        ("camL0_poses_transformation_matrix.csv", lambda d: d[0].T_w_c),
        ("vehicle0_poses_transformation_matrix.csv", lambda d: d[0].T_w_v),
    ],
)
@pytest.mark.parametrize("damage", ["no rows", "few columns", "no number", "gone"])
def test_a_damaged_table_is_bad_input_that_names_it(copy, name, read, damage):
    path = next(copy.rglob(name))
    lines = path.read_text().splitlines()
    if damage == "no rows":
        lines = lines[:1]
    elif damage == "few columns":
        lines = [line.split(",")[0] for line in lines] if "timestamps" not in name else [lines[0]]
    elif damage == "no number":
        lines[2] = "x" + lines[2]
    path.write_text("\n".join(lines) + "\n") if damage != "gone" else path.unlink()
    if name.startswith("depth0") and damage == "few columns":
        assert len(lines[0].split(",")) == 1
    with pytest.raises(InputError, match=name):
        read(Dataset(copy))


@pytest.mark.parametrize(
    "name",
    [
        "imu0_data.csv",
        "depth0_data.csv",
        "vehicle0_states.csv",
        "camL0_timestamps.csv",
        "camL0_poses_transformation_matrix.csv",
        "camL0_exposure_A.csv",
        "dataset.json",
        "seq01_veh0_camL0_C-00000000.png",
        "seq01_veh0_camL0_A-00000000.exr",
    ],
)
@pytest.mark.parametrize(
    ("end", "problem"), [(0, "it is empty|it is not a whole"), (-2, "its last line is cut|it is not a whole|Expecting")]
)
def test_an_empty_or_cut_file_is_bad_input_that_says_so(copy, name, end, problem):
    """Also where the last number only lacks digits."""
    path = next(copy.rglob(name))
    path.write_bytes(path.read_bytes()[:end])
    with pytest.raises(InputError, match=rf"{name}: cannot be read: ({problem})"):
        read_everything(Dataset(copy))


def read_everything(data):
    frame = data[0]
    return (
        data.imu(),
        data.depth_gauge(),
        data.states(),
        frame.T_w_c,
        frame.T_w_v,
        frame.A,
        frame.B,
        frame.C,
        frame.D,
        frame.A_radiance,
        frame.gain(),
    )


@pytest.mark.parametrize("content", ["[]", "{}", '{"segments": 1}'])
def test_a_table_of_segments_of_another_form_is_bad_input(copy, content):
    (copy / "segments.json").write_text(content)
    with pytest.raises(InputError, match=r"segments.json: has no list of segments"):
        Dataset(copy).segments()


def test_an_exr_without_a_channel_is_bad_input(copy):
    channels = {name: np.zeros((27, 48), np.float16) for name in "RG"}
    files.write_exr(next(copy.rglob("seq01_veh0_camL0_A-00000000.exr")), channels)
    with pytest.raises(InputError, match=r"A-00000000.exr: has no channel B"):
        _ = Dataset(copy)[0].A_radiance


def test_a_table_with_an_endless_entry_is_bad_input(copy):
    next(copy.rglob("imu0_data.csv")).write_text("0" * 200_000 + "\n")
    with pytest.raises(InputError, match=r"imu0_data.csv: cannot be read: field larger than"):
        Dataset(copy).imu()


def test_an_export_does_not_pass_over_readings_that_are_gone(copy, tmp_path):
    """The folder says that there was an IMU: a dataset without its file is damaged, not one without an IMU."""
    (copy / "vehicle0/imu0/imu0_data.csv").unlink()
    assert "imu0" in Dataset(copy).recorded
    with pytest.raises(InputError, match=r"imu0_data.csv: there is no such file"):
        export(copy, "tum", tmp_path / "out", cameras=["L0"], quiet=True)


def test_poses_that_are_not_those_of_the_frames_are_bad_input(copy):
    path = copy / "vehicle0/cam0/camL0_poses/camL0_poses_transformation_matrix.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:-1]) + "\n")
    with pytest.raises(InputError, match=r"camL0_poses_\w+.csv: the poses are not those of the frames"):
        _ = Dataset(copy)[0].T_w_c


def test_an_unknown_camera_or_image_is_bad_input(data):
    with pytest.raises(InputError, match=r"no such camera.*L0, R0"):
        data[0, "X9"]
    with pytest.raises(InputError, match=r"no such image.*A, B, C, D, S"):
        data.image("Q", 0)
