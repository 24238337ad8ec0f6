"""Corners of boards: the rays of their image points meet them, and nothing else before them."""

import csv

import numpy as np
import pytest
import yaml
from silhouette_truth import distances, meshes
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError
from varos_warp.scene.description.world import CalibrationBoard
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.assets import boards
from varos_warp.scene.geometry.build import build_parts

AWAY = [
    {"time_s": 0, "position": [0.9, 2.4, 0.3], "rotation_euler_deg": [0, 20, 30]},
    {"time_s": 1, "position": [-1.5, 2.0, 0.5], "rotation_euler_deg": [15, -20, 10]},
]
SCENE = {
    "name": "boards",
    "objects": [
        {"kind": "calibration_board", "square_m": 0.1, "rows": 4, "columns": 7, "position": [0, 2, 0], "scale": 1.1},
        {"kind": "pipe", "radius": 0.15, "length": 1.0, "position": [0.1, 1.5, -0.1], "chord_error_m": 0.02},
        {"kind": "calibration_board", "pattern": "aprilgrid", "rows": 3, "columns": 2, "tag_m": 0.2, "path": AWAY},
        {"kind": "calibration_board", "square_m": 0.05, "position": [-0.7, 2, 0.5], "rotation_euler_deg": [0, 0, 170]},
        {"kind": "calibration_board", "square_m": 0.05, "position": [0, -2, 0]},
    ],  # behind the cameras
    "vehicle": {
        "cameras": [
            {"id": "M0", "resolution": [64, 36]},
            {
                "id": "M1",
                "resolution": [48, 27],
                "rotation_euler_deg": [-10, 0, 0],
                "distortion": {"model": "kannala_brandt", "k": [-0.02, 0.003, 0, 0]},
                "port": {"kind": "dome", "radius_m": 0.05, "centre": [0.002, 0, 0.003]},
            },
            {"id": "R0", "resolution": [48, 27], "exposure": {"time_s": 0.004, "readout_s": 0.06}},
            {
                "id": "F0",
                "resolution": [64, 36],
                "distortion": {"model": "brown_conrady", "k": [-0.1, 0.02, 0.001, 0, 0]},
                "port": {"kind": "flat", "distance_m": 0.02, "thickness_m": 0.006, "normal": [0.03, 0, 1]},
            },
        ]
    },
    "trajectory": {
        "poses": [
            {"time_s": 0, "position": [0, 0, 0]},
            {"time_s": 1, "position": [0.6, 0.2, 0], "rotation_euler_deg": [0, 0, 20]},
        ]
    },
    "render": {"frame_rate_hz": 4},
}
BOARDS = ["objects.0", "objects.2", "objects.3", "objects.4"]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("boards") / "data"
    produce(scene_from_dict(SCENE), out, images=False, quiet=True)
    return Dataset(out)


@pytest.fixture(scope="module")
def exported(simulated, tmp_path_factory):
    out = tmp_path_factory.mktemp("corners") / "out"
    export(simulated.root, "corners", out)
    return out


@pytest.fixture(scope="module")  # made before what a test alone has stands in for the course
def strewn(tmp_path_factory):
    """The root of a dataset with copies of a board, too."""
    out = tmp_path_factory.mktemp("strewn") / "data"
    copies = {"object": {"kind": "calibration_board", "square_m": 0.02}, "count": 2, "area": [-1, 3, 1, 4]}
    ground = {"kind": "procedural", "size_m": 20, "resolution": 17, "position": [0, 0, -2]}
    produce(scene_from_dict(SCENE | {"scatter": [copies], "terrain": ground}), out, images=False, quiet=True)
    return out


def table(path):
    """Rows of a table by frame and board: image points as our rays take them, states, places on it and in the world."""
    found = {}
    for row in csv.DictReader(path.read_text().splitlines()):
        found.setdefault((int(row["frame"]), row["board"]), []).append(row)
    return {
        key: (
            np.array([[row["u [px]"], row["v [px]"]] for row in rows], float) + 0.5,
            np.array([row["state"] for row in rows]),
            *(
                np.array([[row[f"{of}_{axis} [m]"] for axis in "xyz"] for row in rows], float)
                for of in ("board", "world")
            ),
            [int(row["corner"]) for row in rows],
        )
        for key, rows in found.items()
    }


def seen_from(data, camera, frame, uv):
    """Rays through image points at the times of their rows, from the vehicle's motion; times [ns]."""
    about, time_ns = data.camera(camera), int(data.time_ns(camera)[frame])
    readout = (about.get("exposure") or {"readout_s": 0.0})["readout_s"]
    row = uv[:, 1].clip(0.5, about["height"] - 0.5)  # no row is exposed before the first or after the last
    when = time_ns + np.rint((row / about["height"] - 0.5) * readout * 1e9).astype(np.int64)
    T = data.trajectory().from_before(when).poses() @ np.array(about["T_v_c"])
    rays = data.camera_model(camera).rays(uv)
    start, d = (np.einsum("nij,nj->ni", T[:, :3, :3], x) for x in rays[:2])
    return start + T[:, :3, 3], d, when


@pytest.mark.parametrize("camera", ["M0", "M1", "R0", "F0"])
def test_rays_of_image_points_meet_the_corners_and_nothing_before_them(simulated, exported, camera):
    """Against float64 rays through every triangle, at the time of each corner's row, boards themselves too."""
    rows, states, checked = table(exported / f"cam{camera}.csv"), set(), []
    assert set(rows) == {(frame, key) for frame in range(5) for key in BOARDS}
    about, scene = simulated.camera(camera), scene_from_dict(SCENE)
    parts = build_parts(scene)
    for (frame, _), (uv, state, _, world, numbers) in rows.items():
        assert numbers == list(range(len(uv)))
        seen = np.isfinite(uv).all(axis=1)
        np.testing.assert_array_equal(seen, state != "unseen")
        inside = (uv >= 0).all(axis=1) & (uv <= [about["width"], about["height"]]).all(axis=1)
        np.testing.assert_array_equal(inside, np.isin(state, ["visible", "hidden"]))
        start, d, when = seen_from(simulated, camera, frame, uv[inside])
        # a point between two rows is seen from between their poses, along a line, where the course is curved: 0.1 um
        np.testing.assert_allclose(np.cross(world[inside] - start, d), 0.0, atol=1e-6)
        far = np.linalg.norm(world[inside] - start, axis=1)
        for k in range(0, len(when), 5) if frame in (0, 3) else ():
            solid = [
                distances(*mesh, start[k : k + 1], d[k : k + 1])[0]
                for meshes_of in meshes(scene, when[k], parts).values()
                for mesh in meshes_of
            ]
            checked.append(state[inside][k])
            assert (checked[-1] == "hidden") == (min(solid) < far[k] - 1e-4), (frame, k)  # the board is 5 mm thick
        states |= set(state.tolist())
    assert set(checked) == {"visible", "hidden"}
    assert states == {"visible", "hidden", "outside", *(() if camera == "M1" else ("unseen",))}  # it sees behind itself


def test_corners_stand_where_the_scene_has_the_board(exported, simulated):
    """At every frame, with the board's scale, and of what moves with its poses; from a camera without readout."""
    rows = table(exported / "camM0.csv")
    T = {"objects.0": np.tile(np.eye(4), (5, 1, 1)), "objects.2": simulated.poses("objects.2")[1]}
    T["objects.0"][:, :3, 3] = [0, 2, 0]
    for key, poses in T.items():
        for frame in range(5):
            _, _, own, world, _ = rows[frame, key]
            np.testing.assert_allclose(world, own @ poses[frame, :3, :3].T + poses[frame, :3, 3], atol=1e-12)
    np.testing.assert_allclose(rows[0, "objects.0"][2][[0, -1]], [[-0.33, 0, -0.165], [0.33, 0, 0.165]], atol=1e-12)


@pytest.mark.parametrize(("pattern", "size"), [("checkerboard", {"square_m": 0.05}), ("aprilgrid", {"tag_m": 0.08})])
def test_each_corner_lies_between_two_dark_and_two_light_cells(pattern, size):
    """Diagonally: of a checkerboard, and of an AprilGrid between the corner of a tag and the black square beside it."""
    block = CalibrationBoard(kind="calibration_board", pattern=pattern, rows=3, columns=4, **size)
    vertices, faces, skin = boards.board(block)
    centres, dark = vertices[faces].mean(axis=1), skin.corners[:, 0, 0] < 0.5
    front, found = centres[:, 1] == 0.0, boards.corners(block)
    assert len(found) == {"checkerboard": 12, "aprilgrid": 48}[pattern]
    for corner in found:
        around = front & (np.abs(vertices[faces] - corner).max(axis=2).min(axis=1) < 1e-9)
        quadrant = np.sign(centres[around] - corner)[:, [0, 2]]
        assert len(np.unique(dark[around] == (quadrant.prod(axis=1) > 0))) == 1
        assert len(np.unique(quadrant, axis=0)) == 4


def test_targets_are_kalibrs(exported):
    """Their keys are those of aslam_cv's target files; measures are with the board's scale."""
    board, grid = (yaml.safe_load((exported / "targets" / f"objects.{i}.yaml").read_text()) for i in (0, 2))
    assert board == {
        "target_type": "checkerboard",
        "targetCols": 7,
        "targetRows": 4,
        "rowSpacingMeters": pytest.approx(0.11),
        "colSpacingMeters": pytest.approx(0.11),
    }
    assert grid == {"target_type": "aprilgrid", "tagCols": 2, "tagRows": 3, "tagSize": 0.2, "tagSpacing": 0.3}


def test_a_clock_that_is_set_moves_the_stamps_and_no_corner(simulated, exported, tmp_path):
    export(simulated.root, "corners", tmp_path / "out", start_ns=10**9, cameras=["R0"])
    assert [path.name for path in (tmp_path / "out").glob("cam*")] == ["camR0.csv"]
    later, first = (
        [line.split(",") for line in (folder / "camR0.csv").read_text().splitlines()[1:]]
        for folder in (tmp_path / "out", exported)
    )
    assert [row[:1] + row[2:] for row in later] == [row[:1] + row[2:] for row in first]
    assert {int(a[1]) - int(b[1]) for a, b in zip(later, first, strict=True)} == {10**9}


def test_a_scene_without_a_board_is_refused(written, tmp_path):
    result = CliRunner().invoke(app, ["export", str(written), "--to", "corners", "-o", str(tmp_path / "out")])
    assert result.exit_code == 2
    assert "no calibration board among its objects" in result.output
    assert not (tmp_path / "out").exists()


def test_boards_that_are_strewn_are_told_of(strewn, tmp_path):
    with pytest.warns(UserWarning, match=r"scatter\.0: corners of boards that are strewn are left out"):
        export(strewn, "corners", tmp_path / "out", cameras=["M0"])


def test_without_the_files_of_the_scene_nothing_is_claimed(simulated, tmp_path, monkeypatch):
    def lost(*_):
        raise InputError("meshes/wreck.obj is not at hand, or not as it was")

    monkeypatch.setattr("varos_warp.dataset.export.corners.rebuilt", lost)
    with pytest.raises(InputError, match=r"what hides corners cannot be known.*--scene-dir"):
        export(simulated.root, "corners", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
