"""Cameras with a shutter: poses of rows in the dataset, read and checked; blur that checks of sharp images bear."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from hills import ShutterRenderer, height, hills_scene
from standins import install, tree

from varos_warp.dataset.export import export
from varos_warp.dataset.reader import rows
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import alignment, blur, validate, views
from varos_warp.errors import InputError
from varos_warp.scene.file.load import scene_to_dict
from varos_warp.scene.optics.shutter import row_offsets_s

ROLLING = {"time_s": 0.004, "readout_s": 0.03}
SIZE = [96, 54]


def made_with(out, outputs="BCDF", shutter=ROLLING, size=SIZE, **how):
    scene = hills_scene(outputs, exposure=shutter, resolution=size, sensor_mm=[4.416, 2.484])
    produce(scene, out, quiet=True, renderer=ShutterRenderer(scene), **how)
    return out


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A complete dataset of a rolling shutter; read it, do not change it."""
    with pytest.MonkeyPatch.context() as patch:
        install(patch)
        return made_with(tmp_path_factory.mktemp("rolling") / "data")


@pytest.fixture
def copy(whole, unchecked):
    return unchecked(whole)


@pytest.fixture(scope="module")
def of_d(tmp_path_factory):
    """As `whole`, of D alone, for damage that the vehicle's motion tells."""
    with pytest.MonkeyPatch.context() as patch:
        install(patch)
        return made_with(tmp_path_factory.mktemp("rolling") / "d", "D")


@pytest.fixture
def copy_of_d(of_d, unchecked):
    return unchecked(of_d)


# ------------------------------------------------------------------------------------------------------- in the dataset


def test_poses_of_rows_are_the_vehicles_at_the_middle_of_each_rows_exposure(whole):
    """Of the first frame, too, half of whose rows are exposed before the sequence begins."""
    data = Dataset(whole)
    T_v_c = np.array(data.camera()["T_v_c"])
    offset_ns = np.rint(1e9 * ((np.arange(54) + 0.5) / 54 - 0.5) * 0.03).astype(int)
    for frame in (data[0], data[3]):
        assert np.array_equal(frame.row_times_ns, frame.time_ns + offset_ns)
        expected = data.trajectory().from_before(frame.time_ns + offset_ns).poses() @ T_v_c
        np.testing.assert_allclose(frame.T_w_c_rows, expected, atol=1e-12)
        assert frame.exposure_s == 0.004
    table = np.load(data.layout.row_poses("M0"))
    assert (table.shape, table.dtype) == ((10, 54, 7), np.float64)
    np.testing.assert_allclose(table[3, 10, :3], data[3].T_w_c_rows[10, :3, 3], atol=1e-15)


def test_what_pixels_see_by_the_poses_of_their_rows_is_the_ground(whole):
    """By D, numpy and the file alone; by the pose of the time stamp it is not."""
    data, frame = Dataset(whole), Dataset(whole)[5]
    v, u = np.nonzero(np.isfinite(frame.D))
    ray = np.column_stack([u + 0.5, v + 0.5, np.ones(len(u))]) @ np.linalg.inv(frame.K_center_half).T
    seen = ray * frame.D[v, u, None]
    step = data.meta["depth"]["scale_m"]

    def off(T):
        x, y, z = (np.einsum("nij,nj->ni", T[:, :3, :3], seen) + T[:, :3, 3]).T
        return np.abs(z - height(x, y)).max()

    assert off(frame.T_w_c_rows[v]) < 2 * step  # the slope of the ground is less than 1.5
    assert off(np.tile(frame.T_w_c, (len(v), 1, 1))) > 20 * step


def test_points_are_projected_back_to_the_pixels_that_see_them(whole):
    data = Dataset(whole)
    row, col = (x.ravel() for x in np.indices(SIZE[::-1]))
    T = rows.sight(data, 4)
    points = points_at(data.camera_model(), T, row, col, np.linspace(2.0, 9.0, row.size))
    u, v, _ = project(points, data.camera_model(), T).T
    np.testing.assert_allclose(u, col + 0.5, atol=1e-5)
    np.testing.assert_allclose(v, row + 0.5, atol=1e-5)


def test_a_camera_says_what_its_shutter_does(whole):
    data = Dataset(whole)
    exposure = data.camera()["exposure"]
    assert exposure == {
        **ROLLING,
        "line_delay_s": 0.03 / 54,
        "time_stamp": "middle of the exposure of the middle row",
        "row_poses": "vehicle0/cam0/camM0_poses/camM0_poses_rows.npy",
    }
    assert yaml.safe_load(data.layout.camera_file("M0", ".yaml").read_text())["exposure"] == exposure
    assert "camXX_poses_rows.npy" in data.meta["conventions"]["exposure"]
    readme = (whole / "README.txt").read_text()
    assert "line_delay" in readme
    assert "nothing is averaged" not in readme
    assert max(map(len, readme.splitlines())) <= 130


OLD = {"time_s": "exposure_s"}


def as_older_versions_wrote_it(about):
    """What is said of a camera, with the times of its exposure under ``shutter``."""
    times = {OLD.get(key, key): value for key, value in about["exposure"].items()}
    return {"shutter" if key == "exposure" else key: about[key] for key in about} | {"shutter": times}


def test_datasets_of_older_versions_are_read_and_checked(whole, tmp_path):
    old = Path(shutil.copytree(whole, tmp_path / "old"))
    meta = json.loads((old / "dataset.json").read_text())
    for carrier in (meta, meta["scene"]["vehicle"]):
        carrier["cameras"] = [as_older_versions_wrote_it(camera) for camera in carrier["cameras"]]
    (old / "dataset.json").write_text(json.dumps(meta))
    path = Dataset(old).layout.camera_file("M0", ".yaml")
    about = as_older_versions_wrote_it(yaml.safe_load(path.read_text()))
    path.write_text(yaml.safe_dump(about, sort_keys=False))
    assert "time_s:" not in path.read_text()
    shutil.rmtree(old / "checksums", ignore_errors=True)
    data, new = Dataset(old), Dataset(whole)
    assert data.camera() == new.camera()
    assert (data[1].exposure_s, data[1].row_times_ns.tolist()) == (0.004, new[1].row_times_ns.tolist())
    assert [line for line in validate(old, quiet=True).problems if "checksum" not in line] == []


def test_the_older_key_gives_the_same_dataset(whole, tmp_path):
    """A scene with ``shutter`` is the same scene, which its dataset states with ``exposure``."""
    scene = hills_scene("BCDF", shutter={"exposure_s": 0.004, "readout_s": 0.03}, resolution=SIZE)
    assert scene == hills_scene("BCDF", exposure=ROLLING, resolution=SIZE)
    assert "shutter" not in scene_to_dict(scene)["vehicle"]["cameras"][0]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"shutter": {"exposure_s": 0.01}, "exposure": {"time_s": 0.01}}, r"\.shutter.*exposure\.time_s.*leave out"),
        ({"shutter": {"exposure_s": 0.01}, "exposure": {"readout_s": 0}}, r"\.shutter.*exposure\.readout_s.*leave"),
        ({"shutter": {"exposure_s": -1}}, r"\.shutter\.exposure_s = -1"),
        ({"shutter": {"time_s": 1}}, r"\.shutter\.time_s.*unknown key"),
        ({"exposure": {"exposure_s": 1}}, r"\.exposure\.exposure_s.*unknown key"),
        ({"exposure": {"time_s": 61}}, r"\.exposure\.time_s = 61"),
        ({"exposure": {"gain": -1}}, r"\.exposure\.gain = -1"),
        ({"exposure": {"gain": {"meter": "median"}}}, r"\.exposure\.gain\.meter"),
        ({"exposure": {"white_balance": "gray"}}, r"\.exposure\.white_balance.*grey_world"),
    ],
)
def test_what_an_exposure_cannot_be_is_refused_by_name(keys, said):
    with pytest.raises(InputError, match=r"vehicle\.cameras\.0" + said):
        hills_scene("D", **keys)


def test_an_older_shutter_stands_beside_a_gain():
    (camera,) = hills_scene("D", shutter={"exposure_s": 0.01}, exposure={"gain": 2.0}).vehicle.cameras
    assert (camera.exposure.time_s, camera.exposure.readout_s, camera.exposure.gain) == (0.01, 0.0, 2.0)


def test_without_a_shutter_all_rows_are_of_one_pose(hilly):
    data = Dataset(hilly)
    assert not data.layout.row_poses("M0").exists()
    assert not {"exposure"} & (data.camera().keys() | data.meta["conventions"].keys())
    assert np.array_equal(data[2].T_w_c_rows, np.tile(data[2].T_w_c, (80, 1, 1)))
    assert np.unique(data[2].row_times_ns).tolist() == [data[2].time_ns]
    assert data[2].exposure_s == 0.0


def test_a_camera_that_stands_in_the_world_needs_no_poses_of_rows(tmp_path):
    scene = hills_scene(
        "D", exposure=ROLLING, resolution=SIZE, mount="world", look_at=[0, 3, -3], rotation_euler_deg=[0, 0, 0]
    )
    produce(scene, tmp_path / "d", images=False, quiet=True)
    data = Dataset(tmp_path / "d")
    assert not data.layout.row_poses("M0").exists()
    assert np.array_equal(data[1].T_w_c_rows[7], data[1].T_w_c)
    assert len(np.unique(data[1].row_times_ns)) == 54


def test_frames_that_come_later_make_the_same_bytes(tmp_path):
    """Of a small camera."""
    whole = made_with(tmp_path / "whole", size=[48, 27])
    out = made_with(tmp_path / "data", size=[48, 27], frames=slice(3, 5))
    assert np.array_equal(np.load(Dataset(out).layout.row_poses("M0")), rows.read(Dataset(whole))[3:5])
    assert validate(out, quiet=True).problems == []
    made_with(out, size=[48, 27], frames=slice(0, 10, 2), shard=(0, 2))
    made_with(out, size=[48, 27], frames=slice(0, 10, 2), shard=(1, 2))
    made_with(out, size=[48, 27])
    assert tree(out) == tree(whole)


# ------------------------------------------------------------------------------------------------------------- validate


def test_a_rolling_shutter_is_valid_and_would_not_be_by_the_poses_of_the_time_stamps(whole, monkeypatch):
    assert validate(whole, quiet=True).problems == []
    monkeypatch.setattr(rows, "is_rolling", lambda about: False)
    assert any("camM0_F" in problem for problem in validate(whole, quiet=True).problems)


def one_row(table):
    table[4, 20, 1] += 1e-6


def turned(table):
    table[4, 20, 4:] += 1e-8
    table[4, 20, 3:] /= np.linalg.norm(table[4, 20, 3:])


def negative(table):
    table[4, :, 3:] *= -1


def swapped(table):
    table[[4, 5]] = table[[5, 4]]


def upside_down(table):
    table[:] = table[:, ::-1].copy()


def no_number(table):
    table[4, 20, 1] = np.nan


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (one_row, "row 20 of frame 4 is not where the vehicle's motion has it"),
        (turned, "row 20 of frame 4 is not where"),
        (no_number, "row 20 of frame 4 is not where"),
        (negative, "frame 4 has quaternions that are not of length 1 with w >= 0"),
        (swapped, "of frame 5 is not where"),
        (upside_down, "of frame 0 is not where"),
    ],
)
def test_damaged_poses_of_rows_are_named(copy_of_d, damage, problem):
    path = Dataset(copy_of_d).layout.row_poses("M0")
    table = np.load(path)
    damage(table)
    np.save(path, table)
    problems = validate(copy_of_d, quiet=True).problems
    assert any(problem in found and "camM0_poses_rows.npy" in found for found in problems), problems


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda path, table: path.unlink(), "there is no such file"),
        (lambda path, table: path.write_bytes(path.read_bytes()[:-100]), "cannot be read"),
        (lambda path, table: path.write_bytes(b""), "cannot be read"),
        (lambda path, table: np.save(path, table[:5]), "not float64 (10, 54, 7)"),
        (lambda path, table: np.save(path, table.astype(np.float32)), "not float64 (10, 54, 7)"),
        (lambda path, table: np.save(path, np.array([{}]), allow_pickle=True), "cannot be read"),
    ],
)
def test_a_file_of_rows_that_cannot_be_used_is_named(copy_of_d, damage, problem):
    path = Dataset(copy_of_d).layout.row_poses("M0")
    damage(path, np.load(path))
    assert any(problem in found and path.name in found for found in validate(copy_of_d, quiet=True).problems)
    with pytest.raises(InputError, match=path.name):
        Dataset(copy_of_d)[0].T_w_c_rows  # noqa: B018


def test_where_no_vehicle_is_on_record_the_images_tell(tmp_path):
    out = made_with(tmp_path / "data", "DF", sensors=False, frames=slice(4))
    assert validate(out, quiet=True).problems == []
    (out / "checksums").unlink()
    path = Dataset(out).layout.row_poses("M0")
    table = np.load(path)
    upside_down(table)
    np.save(path, table)
    assert any("does not follow from D and the poses" in problem for problem in validate(out, quiet=True).problems)
    table[:, :, 0] += 0.05
    np.save(path, table)
    assert any("of frame 0 is not where" in problem for problem in validate(out, quiet=True).problems)


def test_another_readout_in_dataset_json_is_found(copy_of_d):
    meta = json.loads((copy_of_d / "dataset.json").read_text())
    meta["cameras"][0]["exposure"]["readout_s"] = 0.02
    (copy_of_d / "dataset.json").write_text(json.dumps(meta))
    problems = validate(copy_of_d, quiet=True).problems
    assert any("exposure.readout_s" in problem for problem in problems)
    assert any("is not where the vehicle's motion has it" in problem for problem in problems)


def test_blur_does_not_fail_the_checks_of_b(tmp_path, monkeypatch):
    """The exposure is 0.5 s, in which the course bends; without regard to it, B would not be where poses have it."""
    out = made_with(tmp_path / "data", "BCD", {"time_s": 0.5}, size=[144, 81], frames=slice(0, 10, 3))
    assert validate(out, quiet=True).problems == []
    for module in (alignment, views):
        monkeypatch.setattr(module, "blur_of", lambda *_: blur.SHARP)
    assert any("B against D, K and poses" in problem for problem in validate(out, quiet=True).problems)


def test_a_streak_is_what_a_point_passes_in_the_exposure(tmp_path):
    out = made_with(tmp_path / "data", outputs="D", shutter={"time_s": 0.2})
    data = Dataset(out)
    depth = data.planar_depth(4)
    found = blur.blur_of(data, 4, "M0", depth)
    row, col, z = (x[::50] for x in np.nonzero(np.isfinite(depth)) + (depth[np.isfinite(depth)],))
    points = points_at(data.camera_model(), data.T_w_c(4), row, col, z)
    T_v_c = np.array(data.camera()["T_v_c"])
    ends = [
        project(points, data.camera_model(), T @ T_v_c)[:, :2]
        for T in data.trajectory().at(data[4].time_ns + np.array([-100_000_000, 100_000_000])).poses()
    ]
    np.testing.assert_allclose(found.streak, (ends[1] - ends[0]).mean(0), atol=0.1)  # of other points
    assert np.hypot(*found.streak) > 2.0
    assert 0.0 < found.displaced < 0.2 * np.hypot(*found.streak)


# -------------------------------------------------------------------------------------------------------------- exports


def test_kalibr_gets_the_line_delay_and_openvins_the_time_stamps(whole, tmp_path):
    """Kalibr: t_imu = t_cam + timeshift + v line_delay. OpenVINS and ORB-SLAM3 know no rolling shutter."""
    with pytest.warns(UserWarning, match="knows no rolling shutter: poses of M0 are of the time stamp"):
        export(whole, "euroc", tmp_path / "out", images="B")
    chain = yaml.safe_load((tmp_path / "out/kalibr_camchain.yaml").read_text())["cam0"]
    scene = hills_scene(exposure=ROLLING, resolution=SIZE)
    np.testing.assert_allclose(
        chain["timeshift_cam_imu"] + np.arange(54) * chain["line_delay"],
        row_offsets_s(scene.vehicle.cameras[0]),
        atol=1e-15,
    )
    other = yaml.safe_load((tmp_path / "out/openvins/kalibr_imucam_chain.yaml").read_text().partition("\n")[2])["cam0"]
    assert other["timeshift_cam_imu"] == 0.0
    assert "line_delay" not in other


@pytest.mark.parametrize("form", ["tum", "kitti", "colmap", "nerfstudio"])
def test_a_note_and_the_poses_of_rows_lie_beside_every_export(whole, tmp_path, form):
    with pytest.warns(UserWarning, match="knows no rolling shutter"):
        export(whole, form, tmp_path / "out", images="B")
    note = (tmp_path / "out/shutter/README.txt").read_text()
    assert "M0: rolling shutter, first row first: exposure time_s 0.004, readout_s 0.03" in note
    assert (tmp_path / "out/shutter/camM0_poses_rows.npy").samefile(Dataset(whole).layout.row_poses("M0"))


def test_points_of_a_rolling_shutter_lie_on_the_ground(whole, tmp_path):
    with pytest.warns(UserWarning, match="knows no rolling shutter"):
        export(whole, "colmap", tmp_path / "out", images="B")
    lines = (tmp_path / "out/sparse/0/points3D.txt").read_text().splitlines()[1:]
    x, y, z = np.array([line.split()[1:4] for line in lines], float).T
    assert np.abs(z - height(x, y)).max() < 2 * Dataset(whole).meta["depth"]["scale_m"]


def test_exports_of_global_shutters_of_an_instant_have_no_note(hilly, tmp_path):
    export(hilly, "colmap", tmp_path / "out")
    assert not (tmp_path / "out/shutter").exists()
