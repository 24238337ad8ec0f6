"""The forecast of failing steps, what it is made from and held against, and datasets that differ in their seed."""

import json

import numpy as np
import pytest
import textured
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from benchmarks import failure_forecast
from varos_warp.cli import app
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness import page, seeds
from varos_warp.dataset.readiness.frames.light import black_level
from varos_warp.dataset.readiness.job import of_one_sea, readiness
from varos_warp.dataset.readiness.measure import by_frame
from varos_warp.dataset.readiness.odometry import forecast
from varos_warp.dataset.readiness.odometry.score import STANDS, WRONG_TURN, WRONG_WAY, failed

FRAMES = slice(0, 8)
"""Of 20."""
ONE = ("L0",)
"""Camera of the sweep: what fails, and the forecast of it, is of the odometry by one."""


def as_of_a_sweep(root, **how):
    """As a sweep over two waters and two seeds leaves it; the noise of the pixels stands for what seeds change."""
    versions = []
    for water, c in (("clear", 0.1), ("murky", 1.2)):
        for seed in (1, 2):
            textured.write(root / f"{water}-{seed}", c, noise=0.004 * seed, outputs="AD", cameras=ONE, **how)
            versions.append(
                {
                    "name": f"{water}-{seed}",
                    "overrides": {"water": water, "seed": seed},
                    "datasets": [{"folder": f"{water}-{seed}", "state": "complete"}],
                }
            )
    (root / "sweep.json").write_text(json.dumps({"versions": versions}), encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    return as_of_a_sweep(tmp_path_factory.mktemp("sweep"), frames=FRAMES)


@pytest.fixture(scope="module")
def found(sweep):
    return readiness([sweep], seeds=1)


def test_the_forecast_ranks_clear_water_before_murky_on_a_floor_that_it_was_not_fitted_on(found):
    """Only its rank: under a veil with hardly any noise, which no scene of the fit has, its chances are too high."""
    chance, seen = (
        [each.failure_chance() for each in found],
        [each.odometry["mono"].plain()["failed_share"] for each in found],
    )
    assert seen[0] == seen[1] == 0.0
    assert min(seen[2:]) > 0.8
    assert max(chance[:2]) < min(chance[2:])


@pytest.fixture(scope="module")
def without_truth(tmp_path_factory):
    """As the first of the sweep, without D."""
    return textured.write(
        tmp_path_factory.mktemp("blind") / "data", 0.1, noise=0.004, outputs="A", cameras=ONE, frames=FRAMES
    )


def test_the_forecast_does_not_know_the_truth(found, without_truth, monkeypatch):
    """Without D and F, and where poses cannot be read, it is the same to the last digit."""
    told = found[0]
    assert told.root.name == "clear-1"

    def no_truth(*_, **__):
        raise AssertionError("the truth was asked for")

    for name in ("views", "T_w_c", "planar_depth", "depth", "flow"):
        monkeypatch.setattr(Dataset, name, no_truth)
    blind = by_frame(Dataset(without_truth), "L0")
    assert forecast.failure_chances(blind) == told.by_frame["failure_chance"]


def test_a_step_fails_by_its_direction_its_turn_or_where_the_frame_is_lost():
    true = np.tile(np.eye(4), (5, 1, 1))
    true[:, 0, 3] = [0.0, 1.0, 1.0 + 0.5 * STANDS, 2.0, 3.0]
    found = np.linalg.inv(true)
    found[:, :3, 3] *= 7.0
    lost = np.zeros(5, bool)
    assert not failed(found, lost, true).any(), "a scale is no failure"
    assert failed(found, np.arange(5) == 3, true).tolist() == [False, False, True, False]
    for angle, fails in ((0.9 * WRONG_WAY, False), (1.1 * WRONG_WAY, True)):
        off = found.copy()
        off[1:, 1, 3] = off[1, 0, 3] * np.tan(angle)  # the first step points elsewhere
        assert failed(off, lost, true).tolist() == [fails, False, False, False]
    off = found.copy()
    off[2:, 1, 3] += 10.0  # the short step alone
    assert not failed(off, lost, true)[1]
    for angle, fails in ((0.9 * WRONG_TURN, False), (1.1 * WRONG_TURN, True)):
        off = found.copy()
        off[4:, :3, :3] = Rotation.from_rotvec([angle, 0, 0]).as_matrix()
        assert failed(off, lost, true).tolist() == [False, False, False, fails]


def test_black_level_is_what_a_veil_lifts():
    picture = np.linspace(0.0, 1.0, 1001)[:, None, None] * np.ones(3)
    assert black_level(picture) == pytest.approx(0.01 / 0.5, rel=1e-6)
    assert black_level(picture + 0.5) == pytest.approx(0.51 / 1.0, rel=1e-6)
    assert black_level(np.zeros((4, 4, 3))) is None


def test_the_shipped_forecast_follows_from_the_table():
    told = json.loads(forecast.FILE.read_text(encoding="utf-8"))
    again = failure_forecast.result()
    for name in ("mean", "scale", "coefficients"):
        assert told[name] == pytest.approx(again[name], abs=2e-4)
    assert told["held_out"]["auc"] == pytest.approx(again["held_out"]["auc"], abs=2e-4)
    assert not set(told["fitted_on"]["scenes"]) & set(told["held_out"]["scenes"])


def test_auc_is_the_chance_of_the_right_order():
    failing = np.array([False, False, True, True])
    assert failure_forecast.auc(np.array([1.0, 2.0, 3.0, 4.0]), failing) == 1.0
    assert failure_forecast.auc(np.array([4.0, 3.0, 2.0, 1.0]), failing) == 0.0
    assert failure_forecast.auc(np.array([1.0, 2.0, 2.0, 3.0]), failing) == 3.5 / 4
    assert np.isnan(failure_forecast.auc(np.arange(4.0), failing | True))


def test_the_regression_recovers_the_law_that_drew_the_failures():
    """Within five standard errors, which are those of the inverse of Fisher's information."""
    rng = np.random.default_rng(4)
    x, law = rng.normal(size=(20_000, 5)), np.array([-1.0, 0.5, 0.0, 0.2, -0.3])
    p = 1 / (1 + np.exp(-(x @ law + 0.4)))
    model = failure_forecast.fitted(x, rng.random(len(x)) < p)
    design = np.column_stack([x, np.ones(len(x))])
    error = np.sqrt(np.diag(np.linalg.inv(design.T * (p * (1 - p)) @ design)))
    slope = model.coefficients / model.scale
    np.testing.assert_array_less(np.abs(slope - law), 5 * error[:5])
    assert abs(model.intercept - model.mean @ slope - 0.4) < 5 * error[5]
    np.testing.assert_allclose(model.chance(x).mean(), p.mean(), atol=5 * 0.5 / np.sqrt(len(x)))


def test_the_bootstrap_draws_datasets_not_frames():
    """Frames that repeat each other tell no more than one of them."""
    rng = np.random.default_rng(2)
    score, failing, dataset = rng.normal(size=12), np.arange(12) % 2 > 0, np.array([f"d{i}" for i in range(12)])
    once = failure_forecast.bootstrap(score, failing, dataset)
    assert failure_forecast.bootstrap(*(np.repeat(v, 9) for v in (score, failing, dataset))) == pytest.approx(once)


def test_datasets_that_differ_in_their_seed_alone_are_one_with_a_standard_error(sweep, found):
    names = of_one_sea([sweep])
    assert len(names) == 4
    assert len(set(names.values())) == 2
    [clear, murky] = seeds.over_seeds(found)
    assert [len(group["datasets"]) for group in (clear, murky)] == [2, 2]
    contrast = [each.medians()["contrast"] for each in found[:2]]
    assert contrast[0] != contrast[1]
    assert clear["mean"]["contrast"] == pytest.approx(np.mean(contrast))
    assert clear["stderr"]["contrast"] == pytest.approx(abs(contrast[0] - contrast[1]) / 2)
    header, rows = page.comparison(found)
    assert [len(row) for row in rows] == [len(header)] * 2
    assert "(2 seeds)" in rows[0][0]
    assert "±" in rows[0][header.index("RMS contrast of A")]


def test_the_command_tells_of_datasets_that_differ_in_their_seed_alone(tmp_path):
    """Of three small frames each."""
    sweep = as_of_a_sweep(tmp_path / "sweep", frames=slice(0, 3), resolution=(160, 120))
    done = CliRunner().invoke(
        app, ["readiness", str(sweep), "--json", "--seeds", "1", "--quiet", "-o", str(tmp_path / "page.html")]
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    pairs = [[str(sweep / f"{water}-{seed}") for seed in (1, 2)] for water in ("clear", "murky")]
    assert [group["datasets"] for group in told["over_seeds"]] == pairs
    assert all(0 <= each["failure_chance"] <= 1 for each in told["datasets"])


def test_the_same_seed_twice_is_no_spread(tmp_path):
    """Whether both name it, or one has that of the scene."""
    asked = {"a": {}, "b": {"seed": 3}, "c": {"seed": 4}, "d": {"x": 1}, "e": {"x": 1, "seed": 3}}
    versions = [{"name": name, "overrides": of, "datasets": [{"folder": name}]} for name, of in asked.items()]
    (tmp_path / "sweep.json").write_text(json.dumps({"versions": versions}))
    for name, of in asked.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "dataset.json").write_text(json.dumps({"seed": of.get("seed", 3)}))
    assert sorted(folder.name for folder in of_one_sea([tmp_path])) == ["a", "c"]


def test_a_mean_over_seeds_is_not_that_of_those_that_did_well():
    assert seeds.mean_and_error([1.0, None]) == (None, None)
    assert seeds.mean_and_error([1.0]) == (1.0, None)
    assert seeds.mean_and_error([1.0, 3.0]) == (2.0, pytest.approx(1.0))
