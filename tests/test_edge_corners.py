"""Corners of rendered boards lie where the camera's model has them, to the noise of samples; the example finds K."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from varos_warp.dataset.run.produce import produce
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import DATA, load_scene
from varos_warp.scene.frames import pose_matrix

SCRIPT = str(Path(__file__).parents[1] / "examples" / "calibration" / "edge_corners.py")
POSES = (0, 1, 2, 8)
"""Tilted up and down, turned to the side, and by a quarter."""
SMALL = [
    "vehicle.cameras.0.resolution=[160,120]",
    "objects.0.rows=3",
    "objects.0.columns=4",
    "objects.0.square_m=0.1",
    "render.outputs=[B]",
    "render.spp_b=20",
    "render.denoise_b=none",
    "render.dither=null",
    "render.exposure={B: {meter: percentile, percentile: 99, level: 0.8}}",
    "terrain.material=floor",
]


@pytest.fixture(scope="module")
def offsets():
    """Corners by the example's fit less those of the camera's model, and these from the image's middle [M, 2]."""
    scene, refined = load_scene(DATA / "templates/calibration_camera.yaml", SMALL), runpy.run_path(SCRIPT)["refined"]
    renderer, off, places = FrameRenderer(scene, "cpu"), [], []
    x, z = np.meshgrid((np.arange(4) - 1.5) * 0.1, (np.arange(3) - 1.0) * 0.1)
    board = np.stack([x.ravel(), z.ravel()], -1)
    for number in POSES:
        T_w_v = pose_matrix(scene.trajectory.poses[number])
        true = renderer.project(np.stack([x.ravel(), np.zeros(12), z.ravel()], -1), T_w_v)
        image = renderer.render(T_w_v, outputs="B", spp_b=64, denoise_b="none", frame=number).B.radiance.mean(axis=-1)
        found = refined(image.astype(float), board, true - 0.5 + 0.2) + 0.5
        seen = np.isfinite(found[:, 0])
        off.append((found - true)[seen])
        places.append((true - [80.0, 60.0])[seen])
    return np.concatenate(off), np.concatenate(places)


def test_no_corner_is_shifted_and_none_scaled(offsets):
    """Means and slopes within four standard errors: shifts of 0.02 pixels and scales of 5e-4 would be seen."""
    off, places = offsets
    error = off.std(axis=0) / np.sqrt(len(off))
    assert len(off) >= 40
    assert (error < 0.005).all()
    assert (np.abs(off.mean(axis=0)) < 4.0 * error).all()
    slope = (off * places).sum() / (places**2).sum()
    spread = off.std() / np.sqrt((places**2).sum())
    assert spread < 1.3e-4
    assert abs(slope) < 4.0 * spread


def test_the_example_finds_k_within_its_standard_errors(tmp_path, capsys):
    main = runpy.run_path(SCRIPT)["main"]
    produce(load_scene(DATA / "templates/calibration_camera.yaml", SMALL), tmp_path / "data", device="cpu", quiet=True)
    assert main([str(tmp_path / "data"), "--images", "B", "--rows", "3", "--columns", "4"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    numbers = [line.replace("+-", " ").replace(", true", "").split()[2:] for line in lines]
    for got, error, true in np.array(numbers, float):
        assert 0.0 < error < 0.3
        assert abs(got - true) < 4.0 * error


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["nowhere"], "nowhere"),
        (["data", "--camera", "Q7"], "no such camera"),
        (["nowhere", "--rows", "2"], "at least 3"),
        (["data", "--rows", "3"], "0 of 1 images show the board"),
    ],
)
def test_what_the_example_cannot_take_is_refused(tmp_path, capsys, monkeypatch, arguments, says):
    monkeypatch.chdir(tmp_path)
    if arguments[0] == "data":
        changes = [*SMALL, "vehicle.cameras.0.resolution=[16,12]", "trajectory.poses=[{position: [0, -3, 0]}]"]
        produce(load_scene(DATA / "templates/calibration_camera.yaml", changes), "data", device="cpu", quiet=True)
    with pytest.raises(SystemExit) as end:
        runpy.run_path(SCRIPT)["main"]([*arguments, "--images", "B"])
    assert end.value.code == 2
    assert says in capsys.readouterr().err
