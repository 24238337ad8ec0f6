"""Readiness on a floor whose texture, flow and course are known, through water of three turbidities."""

import json

import numpy as np
import pytest
import standins
import textured
from typer.testing import CliRunner

from varos_warp.cli import app
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.frames.excitation import excitation, frame_means
from varos_warp.dataset.readiness.frames.light import rms_contrast
from varos_warp.dataset.readiness.job import readiness
from varos_warp.dataset.readiness.odometry.score import aligned, score
from varos_warp.dataset.run.produce import produce
from varos_warp.errors import InputError

TURBIDITIES = (0.0, 0.25, 0.6)
"""Extinction [1/m]."""


@pytest.fixture(scope="module")
def seas(tmp_path_factory):
    """A dataset of each turbidity, with layers; the whole course in clear water, where odometry is held to it."""
    folder = tmp_path_factory.mktemp("seas")
    return [
        textured.write(folder / f"c{i}", c, noise=0.004, linear_exr=True, frames=slice(0, 6 if c else None))
        for i, c in enumerate(TURBIDITIES)
    ]


@pytest.fixture(scope="module")
def found(seas):
    return readiness(seas, seeds=2)


def test_in_clear_water_features_are_found_again_where_true_flow_takes_them(found):
    clear = found[0].medians()
    for kind in ("orb", "sift"):
        assert clear[f"{kind}_count"] > 100
        assert clear[f"{kind}_repeatability"] > max(0.8, clear[f"{kind}_chance"] + 0.2)
        assert clear[f"{kind}_inlier_share"] > 0.8


def test_readiness_falls_with_turbidity(found):
    medians = [one.medians() for one in found]
    for name in ("sift_count", "sift_inlier_share", "sift_matches", "contrast"):
        values = [m.get(name) or 0.0 for m in medians]  # where nothing is found, nothing is measured
        assert values == sorted(values, reverse=True), name
        assert values[0] > values[-1], name
    veil = [m["veil_over_signal"] for m in medians]
    assert veil[0] < veil[1] < veil[2]


def test_a_visual_odometry_in_clear_water_errs_by_less_than_half_a_percent(found):
    for name, odometry in found[0].odometry.items():
        assert max(odometry.lost) == 0, name
        assert max(odometry.ate_share) < 0.005, name
    assert len(found[0].odometry) == 2, "mono and stereo"


def test_contrast_is_the_deviation_over_the_mean():
    board = np.indices((16, 16)).sum(0) % 2 * 0.6 + 0.2
    assert rms_contrast(np.repeat(board[..., None], 3, -1)) == pytest.approx(0.3 / 0.5, rel=1e-6)


def test_alignment_recovers_a_similarity_and_errors_are_what_is_left():
    rng = np.random.default_rng(1)
    truth = np.cumsum(rng.normal(size=(50, 3)), 0)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    np.testing.assert_allclose(aligned(0.3 * truth @ q.T + [1, 2, 3], truth, True), truth, atol=1e-12)
    assert score(0.3 * truth @ q.T, truth, True).ate_m < 1e-12
    assert score(0.3 * truth @ q.T, truth, False).ate_m > 0.1, "a scale is no rotation"


def test_excitation_is_the_deviation_of_the_readings(seas):
    data = Dataset(seas[0])
    told, times = excitation(data), data.views()[0]
    read = data.imu(int(times[0]), int(times[-1]) + 1)
    np.testing.assert_allclose(told["specific_force_rms"], read["acceleration"].std(0), rtol=1e-12)
    means = frame_means(
        np.array([0, 5, 10, 15, 20, 29]), np.arange(6.0)[:, None] * np.ones(3), np.array([0, 10, 20, 30])
    )
    np.testing.assert_allclose(means, np.array([0.5, 2.5, 4.5])[:, None] * np.ones(3))


def test_the_command_prints_a_table_and_writes_a_page(tmp_path):
    """Of three small frames each."""
    import cv2  # noqa: F401 - the command needs it

    small = {"frames": slice(0, 3), "resolution": (160, 120)}
    seas = [textured.write(tmp_path / f"c{i}", c, noise=0.004, **small) for i, c in enumerate((0.0, 0.25))]
    page = tmp_path / "page.html"
    done = CliRunner().invoke(app, ["readiness", *map(str, seas), "-o", str(page), "--seeds", "1", "--quiet"])
    assert done.exit_code == 0, done.output
    assert "<html" in page.read_text(encoding="utf-8").lower()
    assert all(words in done.stdout for words in (f"{seas[0]}: loop closures", f"{seas[1]}: loop closures", str(page)))
    done = CliRunner().invoke(app, ["readiness", str(seas[0]), "--json", "--seeds", "1", "--quiet", "-o", str(page)])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)


def test_cameras_of_unlike_resolution_are_no_stereo_pair_and_another_one_is(tmp_path, monkeypatch):
    standins.install(monkeypatch)
    for names, stereo in (("LM", False), ("LMN", True)):
        sizes = {"L": [64, 36], "M": [48, 36], "N": [64, 36]}
        cameras = [{"id": f"{k}0", "position": [0.1 * i, 0, 0], "resolution": sizes[k]} for i, k in enumerate(names)]
        scene = standins.make_scene(vehicle={"cameras": cameras}, render={"outputs": ["A", "D"]})
        produce(scene, tmp_path / names, quiet=True)
        (found,) = readiness([tmp_path / names], "L0", seeds=1)
        assert [run.cameras for run in found.odometry.values()] == [["L0"], ["L0", "N0"]][: 1 + stereo]
        assert any("differ in resolution" in words for words in found.left_out) != stereo


@pytest.mark.parametrize(("outputs", "words"), [("D", "no A"), ("AD", "two frames")])
def test_what_cannot_be_measured_is_refused(tmp_path, outputs, words):
    scene = textured.textured_scene(outputs=outputs)
    produce(
        scene,
        tmp_path / "data",
        quiet=True,
        renderer=textured.TexturedRenderer(scene),
        frames=slice(0, len(outputs) % 2 + 1),
    )
    with pytest.raises(InputError, match=words):
        readiness([tmp_path / "data"])
    assert standins.tree(tmp_path / "data")
