"""F in datasets: of every frame, written and read back to the last digit, held against D and the poses."""

import shutil

import cv2
import numpy as np
import pytest
import standins
from standins import make_scene, scene_dict, tree

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.report import write_report
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.products.images.flow import encode_flow, flow_colors

PORT = {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.008}


def scene_of(outputs, **render):
    """A camera in the water, one behind a port, and one that stands in the world."""
    left, right = scene_dict()["vehicle"]["cameras"]
    fixed = left | {"id": "W0", "position": [0, -1, 0], "mount": "world"}
    vehicle = scene_dict()["vehicle"] | {"cameras": [left, right | {"port": PORT}, fixed]}
    return make_scene(vehicle=vehicle, render={"outputs": list(outputs)} | render)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset; read it, do not change it."""
    out = tmp_path_factory.mktemp("flow")
    with pytest.MonkeyPatch.context() as patch:
        standins.install(patch)
        produce(scene_of("DF"), out, quiet=True)
    return out


@pytest.fixture
def copy(whole, unchecked):
    return unchecked(whole)


def test_every_frame_has_it_the_last_one_too(whole):
    data = Dataset(whole)
    assert (len(data), data.outputs) == (10, ["D", "F"])
    assert validate(whole, quiet=True).problems == []
    for camera in data.cameras:
        table = files.read_csv(data.layout.camera_file(camera, "_timestamps.csv"))
        assert list(table["F"]) == [data.layout.image(camera, "F", frame).name for frame in range(10)]
    for frame in (data[4], data[9]):
        assert np.nanmax(np.abs(frame.F)) > 0.3
        assert np.isfinite(frame.F[np.isfinite(frame.D)]).all()  # D ends at 25 m, F does not
        assert np.isnan(frame.F[0]).all()  # above the horizon
        assert not frame.F_occluded.any()
        assert np.isfinite(frame.F_motion[np.isfinite(frame.D)]).all()
        assert np.nanmax(np.abs(data[frame.index, "W0"].F)) < 1e-9


def test_the_last_frames_next_pose_is_in_the_vehicles_motion(whole):
    data, truth = Dataset(whole), standins.simulate(scene_of("DF")).trajectory
    T_v_c = np.array(data.camera("L0")["T_v_c"])
    np.testing.assert_allclose(data.next_T_w_c(9, "L0"), truth.at([1_000_000_000]).T_w_v(0) @ T_v_c, atol=1e-12)
    np.testing.assert_allclose(data.next_T_w_c(3, "L0"), data.T_w_c(4, "L0"), atol=1e-12)
    assert np.array_equal(data.next_T_w_c(9, "W0"), data.T_w_c(9, "W0"))


def test_opencv_reads_it_as_kitti_has_it(whole):
    """To 1/128 px; blue, green and red in its order."""
    data = Dataset(whole)
    path = data.layout.image("L0", "F", 5)
    known, v, u = np.moveaxis(cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float), -1, 0)
    F = data[5].F
    assert np.array_equal(known == 1, np.isfinite(F[..., 0]))
    assert 0.3 < (known == 1).mean() < 1.0
    decoded = np.stack([(u - 32768) / 64, (v - 32768) / 64], -1)
    assert np.abs(decoded - F)[known == 1].max() <= 1 / 128
    np.testing.assert_array_equal(data.image("F", 5)[known == 1], decoded[known == 1])
    assert np.isnan(data.image("F", 5)[known == 0]).all()


def test_readers_of_raft_and_its_successors_have_it(whole):
    """They let OpenCV choose the depth and ask for colours, turn the planes about, and take 1 for valid."""
    data = Dataset(whole)
    for frame in (0, 9):
        planes = cv2.imread(str(data.layout.image("L0", "F", frame)), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
        u, v, valid = (planes[..., k].astype(np.float32) for k in (2, 1, 0))
        F = data[frame].F
        assert np.unique(valid).tolist() == [0.0, 1.0]
        assert np.array_equal(valid == 1.0, np.isfinite(F[..., 0]))
        flow = (np.stack([u, v], -1) - 2.0**15) / 64.0
        assert flow[valid == 1.0].std(axis=0).min() > 0.05
        assert np.abs(flow - F)[valid == 1.0].max() <= 1 / 128


def test_flow_beyond_16_bits_is_unknown_in_the_png():
    flow = np.array([[[-512.0, 511.984], [512.0, 0.0], [0.0, -512.1], [np.nan, np.nan]]], np.float32)
    pixels = encode_flow(flow)
    assert pixels.tolist() == [[[0, 65535, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0]]]


def test_parts_make_the_files_of_the_whole(whole, tmp_path, monkeypatch):
    """Frames of a selection have the flow to the sequence's next, whichever are in the dataset; F may come later."""
    standins.install(monkeypatch)
    produce(scene_of("DF"), tmp_path, quiet=True, frames=slice(2, 8, 3))
    assert validate(tmp_path, quiet=True).problems == []
    produce(scene_of("D"), tmp_path, quiet=True)
    produce(scene_of("DF"), tmp_path, quiet=True)
    mine, all_at_once = tree(tmp_path), tree(whole)
    assert mine.keys() == all_at_once.keys()
    assert [
        name for name in mine if mine[name] != all_at_once[name] and name not in ("dataset.json", "checksums")
    ] == []


def test_without_the_vehicle_the_last_frame_is_not_held_against_its_next(tmp_path, monkeypatch):
    standins.install(monkeypatch)
    produce(scene_of("DF"), tmp_path, quiet=True, frames=slice(3), sensors=False)
    data = Dataset(tmp_path)
    assert data.next_T_w_c(2) is None
    assert validate(tmp_path, quiet=True).problems == []


def change(data, number, **planes):
    path = data.layout.exr("L0", "F", number)
    channels = files.read_exr(path)
    for name, add in planes.items():
        channels[name.replace("_", ".")][20, 25] += add
    files.write_exr(path, channels)
    files.write_png(data.layout.image("L0", "F", number), encode_flow(data.flow(number, "L0").flow))


@pytest.mark.parametrize("frame", [4, 9])
@pytest.mark.parametrize(
    ("planes", "problem"),
    [
        ({"flow_v": 0.1}, "the flow of 1 of "),
        ({"flow_u": np.nan}, "the flow of 1 of "),
        ({"motion_z": 1e-3}, "the motion of 1 of "),
    ],
)
def test_one_wrong_pixel_is_found(copy, frame, planes, problem):
    change(Dataset(copy), frame, **planes)
    found = "\n".join(validate(copy, quiet=True).problems)
    assert f"F-{frame:08d}.exr: {problem}" in found
    assert "the first in row 20, column 25" in found


def test_swapped_images_are_found(copy):
    layout = Dataset(copy).layout
    layout.image("R0", "F", 1).write_bytes(layout.image("R0", "F", 6).read_bytes())
    shutil.copy(layout.exr("L0", "F", 2), layout.exr("L0", "F", 7))
    text = "\n".join(validate(copy, quiet=True).problems)
    assert "camR0_F-00000001.png: is not its EXR (F_exr) in steps of 1/64 pixel" in text
    assert "camL0_F-00000007.exr: the flow of " in text


def test_a_cut_file_and_a_missing_channel_are_found(copy):
    layout = Dataset(copy).layout
    layout.image("L0", "F", 0).write_bytes(layout.image("L0", "F", 0).read_bytes()[:-30])
    channels = files.read_exr(layout.exr("L0", "F", 1))
    del channels["motion.y"]
    files.write_exr(layout.exr("L0", "F", 1), channels)
    text = "\n".join(validate(copy, quiet=True).problems)
    assert "F-00000000.png" in text
    assert "has no channel motion.y" in text


def test_pytorch_gets_it(whole):
    torch = pytest.importorskip("torch")
    item, frame = Dataset(whole).torch(("F", "F_occluded", "F_motion"))[1], Dataset(whole)[1]
    assert [(name, item[name].shape, item[name].dtype) for name in ("F", "F_occluded", "F_motion")] == [
        ("F", (2, 27, 48), torch.float32),
        ("F_occluded", (1, 27, 48), torch.float32),
        ("F_motion", (3, 27, 48), torch.float32),
    ]
    np.testing.assert_array_equal(item["F"].numpy(), np.moveaxis(frame.F, -1, 0))


def test_the_report_shows_it_by_the_wheel(whole, tmp_path):
    """Red to the right, yellow down; white at rest, black where it is unknown."""
    write_report(Dataset(whole), tmp_path / "report.html")
    assert "Optical flow to the next frame" in (tmp_path / "report.html").read_text()
    colors = flow_colors(np.array([[[9.0, 0.0], [0.0, 9.0], [0.0, 0.0], [np.nan, np.nan]]]))
    assert colors[0, 0].tolist() == [255, 0, 0]
    assert colors[0, 1, 0] == 255
    assert colors[0, 1, 1] > 200
    assert colors[0, 1, 2] == 0
    assert colors[0, 2:].tolist() == [[255] * 3, [0] * 3]
