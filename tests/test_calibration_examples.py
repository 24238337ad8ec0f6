"""The examples of docs/howto/calibration.md find what the scene has, within their own standard errors."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import DATA, load_scene

EXAMPLES = Path(__file__).parents[1] / "examples" / "calibration"
NORMAL, NOISE_PX, SEEDS = (0.05, -0.03, 1.0), 0.05, 8


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The template with a port that is not straight: its dataset, without images, and the corners."""
    root = tmp_path_factory.mktemp("ports")
    scene = load_scene(DATA / "templates/calibration.yaml", [f"vehicle.cameras.0.port.normal={list(NORMAL)}",
                                                             "terrain.material=stand", "objects.3.material=stand"])
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
