"""The examples of docs/howto/calibration.md find what the scene has, within their own standard errors."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import DATA, load_scene

EXAMPLES = Path(__file__).parents[1] / "examples" / "calibration"
REMEDY = "varos-warp export --to corners"
NORMAL, NOISE_PX, SEEDS = (0.05, -0.03, 1.0), 0.05, 8


@pytest.fixture(autouse=True)
def beside(monkeypatch):
    """A script that is run finds what lies beside it."""
    monkeypatch.syspath_prepend(str(EXAMPLES))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The template with a port that is not straight: its dataset, without images, and the corners."""
    root = tmp_path_factory.mktemp("ports")
    scene = load_scene(
        DATA / "templates/calibration.yaml",
        [f"vehicle.cameras.0.port.normal={list(NORMAL)}", "terrain.material=stand", "objects.3.material=stand"],
    )
    produce(scene, root / "data", images=False, quiet=True)
    export(root / "data", "corners", root / "corners")
    return root


def test_a_fit_finds_distance_and_normal_of_a_flat_port(made):
    """Without noise to seven digits; with it the errors of all seeds, by their covariance, are chi-squared."""
    example = runpy.run_path(str(EXAMPLES / "flat_port.py"))
    camera, (board, points) = Dataset(made / "data").camera("L0"), example["views"](made / "corners/camL0.csv")
    true = np.array([*NORMAL[:2], camera["port"]["distance_m"]])
    exact, _ = example["FlatPort"](camera, board, points).fit(NOISE_PX)
    np.testing.assert_allclose(exact, true, atol=1e-7)
    square = 0.0
    for seed in range(SEEDS):
        noise = np.random.default_rng(seed).normal(0.0, NOISE_PX, points.shape)
        got, covariance = example["FlatPort"](camera, board, points + noise).fit(NOISE_PX)
        square += (got - true) @ np.linalg.solve(covariance, got - true)
    assert chi2.ppf(5e-4, 3 * SEEDS) < square < chi2.ppf(1.0 - 5e-4, 3 * SEEDS)


def test_the_fit_prints_what_it_finds_beside_the_truth(made, capsys):
    main = runpy.run_path(str(EXAMPLES / "flat_port.py"))["main"]
    assert main([str(made / "data"), str(made / "corners/camL0.csv")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["normal x/z", "normal y/z", "distance [m]"]
    assert lines[2].endswith("true 0.02000")


OFFSET_S, CORNER_NOISE_PX = 7e-3, 0.4
"""Noise beside which what readings of 200 a second leave, a fifth of a standard error, is little."""


def excited(root, rate_hz):
    """The course for a camera with an IMU, at 5 images a second, whose IMU has constant biases."""
    noise = "{accelerometer_bias: [0.1, -0.05, 0.08], gyroscope_bias: [0.004, -0.003, 0.005]}"
    changes = ["render.frame_rate_hz=5", f"vehicle.imu.noise={noise}", f"vehicle.imu.rate_hz={rate_hz}"]
    produce(load_scene(DATA / "templates/calibration_imu.yaml", changes), root / "data", images=False, quiet=True)
    export(root / "data", "corners", root / "corners")
    return root


def errors(root, noise_px):
    """What is fitted less the truth [13], and its covariance for `CORNER_NOISE_PX`."""
    example, data = runpy.run_path(str(EXAMPLES / "camera_imu.py")), Dataset(root / "data")
    board, stamps_s, points = example["corners"](root / "corners/camM0.csv")
    points = points + np.random.default_rng(1).normal(0.0, noise_px, points.shape)
    fit = example["CameraImu"](
        data.intrinsics("M0", "opencv"),
        board,
        stamps_s - OFFSET_S,
        points,
        example["readings_of"](root / "data", 0),
        9.81,
        4.0,
    )
    R, x, covariance = fit.fit(CORNER_NOISE_PX)
    true = np.linalg.inv(data.camera("M0")["T_v_c"]) @ np.array(data.meta["sensors"]["imu0"]["T_v_s"])
    turned = Rotation.from_matrix(R @ true[:3, :3].T).as_rotvec()
    return np.concatenate(
        [turned, x[:10] - [*true[:3, 3], OFFSET_S, 0.004, -0.003, 0.005, 0.1, -0.05, 0.08]]
    ), covariance[:13, :13]


def test_a_fit_finds_pose_of_a_camera_on_an_imu_time_offset_and_biases(tmp_path):
    """Without noise to the second order of the step of the readings; with noise the errors are chi-squared."""
    coarse, fine = excited(tmp_path / "coarse", 100), excited(tmp_path / "fine", 200)
    error, covariance = errors(fine, CORNER_NOISE_PX)
    assert chi2.ppf(5e-4, 13) < error @ np.linalg.solve(covariance, error) < chi2.ppf(1.0 - 5e-4, 13)
    sizes = [np.linalg.norm(errors(root, 0.0)[0] / np.sqrt(np.diag(covariance))) for root in (coarse, fine)]
    assert 3.0 < sizes[0] / sizes[1] < 5.0


@pytest.mark.parametrize(
    ("options", "camera", "says"),
    [
        (["--part", "0"], {}, "--part is at least 0.1"),
        (["--offset-ms", "nan"], {}, "--offset-ms a number"),
        ([], {"port": {"kind": "flat"}}, "a port, or"),
        ([], {"mount": "world"}, "stands in the world"),
    ],
)
def test_what_the_fit_of_an_imu_cannot_take_is_refused(tmp_path, capsys, options, camera, says):
    assert says in refusal("camera_imu", tmp_path, capsys, camera, options)


def refusal(name, folder, capsys, camera, options=(), table="", file="camM0.csv"):
    """What a script says of a dataset with a camera and of its table, when it ends with status 2."""
    about = {"cameras": [{"id": "M0", "mount": "vehicle", "distortion": "none", **camera}]}
    (folder / "dataset.json").write_text(json.dumps(about))
    (folder / file).write_text(table)
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]([str(folder), str(folder / file), *options])
    assert end.value.code == 2
    return capsys.readouterr().err


HEAD = "frame,timestamp [ns],board,corner,u [px],v [px],state,board_x [m],board_y [m],board_z [m]\n"
FLAT = {"port": {"kind": "flat"}}


@pytest.mark.parametrize(("name", "kind"), [("camera_imu", {}), ("flat_port", FLAT)])
@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"file": "camL0.csv"}, "camL0.csv is no table of this dataset's cameras: camM0.csv"),
        ({"table": "a,b\n1,2\n"}, f"camM0.csv is no table that `{REMEDY}` wrote: "),
        ({"table": HEAD + "0,0,objects.0,0,many,2,visible,0,0,0\n"}, f"camM0.csv is no table that `{REMEDY}` wrote: "),
        ({"table": HEAD}, "camM0.csv has no corners"),
        ({"options": ["--noise", "-1"]}, "--noise is at least 0"),
        ({"camera": {"distortion": "rational"}}, "camM0.csv is of a camera with distortion"),
        ({"camera": {"exposure": {"time_s": 0.01, "readout_s": 0.02}}}, "camM0.csv is of a rolling shutter"),
    ],
)
def test_both_fits_tell_a_wrong_table_by_name(tmp_path, capsys, name, kind, changes, says):
    assert says in refusal(name, tmp_path, capsys, **{**changes, "camera": kind | changes.get("camera", {})})


def test_the_fit_of_a_port_tells_of_none_and_of_a_board_that_is_nowhere_whole(tmp_path, capsys):
    assert "without a flat port" in refusal("flat_port", tmp_path, capsys, {"port": {"kind": "dome"}})
    hidden = HEAD + "0,0,objects.0,0,1,2,hidden,0,0,0\n"
    assert "no frame shows all corners" in refusal("flat_port", tmp_path, capsys, FLAT, table=hidden)
    (tmp_path / "dataset.json").write_text("{")
    with pytest.raises(SystemExit):
        runpy.run_path(str(EXAMPLES / "flat_port.py"))["main"]([str(tmp_path), "camM0.csv"])
    assert f"{tmp_path} is no dataset" in capsys.readouterr().err
