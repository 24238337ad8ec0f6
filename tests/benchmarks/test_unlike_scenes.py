"""Every scene can be built and seen, and the measures tell of synthetic images what is known of them."""

import json

import numpy as np
import pytest

from benchmarks.light import many_seeds, scores
from benchmarks.light.scenes import SCENES, build, build_planned
from benchmarks.light.scores import Estimate
from varos_warp.errors import InputError
from varos_warp.render.renderer import FrameRenderer

N, SHAPE = 20, (40, 48, 3)
TRUTH = 1.0 + np.arange(48)[None, :, None] / 48 * np.ones(SHAPE)


def noisy(sigma, count=N, seed=1):
    """Independent images around the truth."""
    return TRUTH + sigma * np.random.default_rng(seed).standard_normal((count, *SHAPE))


EXACT = Estimate(np.stack([TRUTH, TRUTH]))


@pytest.mark.parametrize("name", SCENES)
def test_scenes_build_and_are_lit(name):
    built = build(name, (24, 14))
    assert all(np.isfinite(part.vertices).all() for part in built.parts)
    how = {"outputs": "A", "spp": 4, "seed": 3, "integrator": "path", "denoise": "none"}
    image = FrameRenderer(built.scene, "cpu", built.parts).render(built.T_w_v, **how).A
    assert image.radiance.shape == (14, 24, 3)
    assert image.radiance.mean() > 0.0


@pytest.mark.parametrize("name", ["coastal", "closed_room"])
def test_no_block_is_off_by_half(name, tmp_path):
    """In 12 denoised images; benchmarks/light/many_seeds.py looked at 1000 (docs/results.md)."""
    kept = tmp_path / "holes.json"
    many_seeds.main(["holes", "--scenes", name, "--seeds", "12", "--resolution", "48x28", "--json", str(kept)])
    row = json.loads(kept.read_text())["rows"][name]
    assert row["images_half_off"] == 0.0
    assert row["blocks_beyond_ten_times"] == 0.0
    assert row["reference_blocks"] < 0.1


def test_error_bars_and_times_of_many_seeds(capsys, monkeypatch):
    """Each subject tells of each scene what its name says; plans of a tolerance that few samples keep."""
    monkeypatch.setattr(many_seeds, "SEEDS_OF_REFERENCE", 2)
    small = ["--scenes", "paper_room", "--resolution", "24x14", "--seeds", "3", "--spp", "2", "--rates", "0.5,2"]
    small += ["--reference-spp", "16", "--tolerance", "0.2"]
    expected = {"bars": "field z_variance", "means": "block_z", "choice": "over_best", "tolerance": "kept", "rate": "2"}
    for subject, key in expected.items():
        many_seeds.main([subject, *small])
        name, row = capsys.readouterr().out.strip().splitlines()[-1].split(" ", 1)
        assert name == "paper_room"
        assert key in json.loads(row)


def test_an_unknown_scene_is_refused():
    for make in (build, build_planned):
        with pytest.raises(InputError, match="no such scene"):
            make("atlantis")


def test_scenes_for_plans_are_files_with_their_changes_at_their_own_size():
    scene = build_planned("fixed_camera").scene
    assert scene.render.tolerance == 0.03
    assert scene.render.spp is None
    assert scene.vehicle.cameras[0].mount == "world"
    assert scene.vehicle.cameras[0].resolution == (320, 180)
    assert build_planned("no_water").scene.water == "none"


def test_gaussian_noise_that_claims_itself_is_calibrated():
    images = noisy(0.1)
    told = scores.calibration(images, np.full_like(images, 0.1))
    for name in ("z_variance", "z_trimmed", "z_pooled"):
        assert told[name] == pytest.approx(1.0, abs=0.02)
    assert told["beyond_4"] < 5e-4
    assert told["claims_nothing"] == 0.0
    np.testing.assert_allclose(scores.spread_over_claimed(images, np.full_like(images, 0.1)), 1.0, atol=0.5)


def test_half_of_the_error_claimed_is_four_times_the_variance():
    images = noisy(0.1)
    told = scores.calibration(images, np.full_like(images, 0.05))
    assert told["z_variance"] == pytest.approx(4.0, rel=0.02)
    assert told["z_trimmed"] == pytest.approx(4.0, rel=0.02)


def test_a_heavy_tail_is_in_the_variance_but_not_in_the_trimmed_one():
    images = noisy(0.1)
    images[:, :2, :4] += 100.0 * np.sign(np.random.default_rng(2).standard_normal((N, 2, 4, 3)))
    told = scores.calibration(images, np.full_like(images, 0.1))
    assert told["z_variance"] > 1000.0
    assert told["z_trimmed"] == pytest.approx(1.0, abs=0.05)
    assert told["beyond_4"] == pytest.approx(8 / (40 * 48), rel=0.05)


def test_a_pixel_that_claims_no_error_is_counted():
    images, stderr = noisy(0.1), np.full((N, *SHAPE), 0.1)
    stderr[:, 0] = 0.0
    told = scores.calibration(images, stderr)
    assert told["claims_nothing"] == pytest.approx(1 / 40)
    assert told["z_variance"] == pytest.approx(1.0, abs=0.02)


def test_noise_and_error_are_relative_to_the_mean_of_the_image():
    images = noisy(0.15)
    np.testing.assert_allclose(scores.noise(images, EXACT), 0.15 / TRUTH.mean(), rtol=0.02)
    np.testing.assert_allclose(scores.relative_rmse(images, EXACT), 0.15 / TRUTH.mean(), rtol=0.02)


def test_the_noise_of_the_reference_is_taken_off():
    reference = Estimate(noisy(0.4, 16, seed=4))
    np.testing.assert_allclose(scores.relative_rmse(noisy(0.15), reference), 0.15 / TRUTH.mean(), rtol=0.05)


def test_one_dark_block_in_one_image_is_found():
    images = np.repeat(TRUTH[None], N, axis=0)
    images[3, 8:16, 16:24, 1] = -0.2
    row = scores.block_row(images, EXACT)
    truth = TRUTH[8:16, 16:24, 1].mean()
    assert row["block_worst"] == pytest.approx((truth + 0.2) / truth)
    assert row["half_off"] == pytest.approx(1 / N)
    assert row["block_99"] == 0.0


def test_the_error_of_a_dark_block_is_a_share_of_the_image():
    truth = TRUTH.copy()
    truth[:8, :8] = 1e-6
    image = truth.copy()
    image[:8, :8] = 0.01
    errors = scores.block_errors(image[None], Estimate(np.stack([truth, truth])))
    assert errors[0, 0, 0, 0] == pytest.approx(0.01 / (0.1 * truth[..., 0].mean()), rel=1e-3)
    assert np.all(errors.reshape(-1, 3)[1:] == 0.0)


def test_a_bias_is_told_and_noise_is_not():
    clean = scores.bias(Estimate(noisy(0.1)), Estimate(noisy(0.1, 12, seed=7)))
    assert abs(clean["block_z"]) < 4.5
    assert clean["block_z_rms"] == pytest.approx(1.0, abs=0.2)
    off = noisy(0.1)
    off[:, 8:16, 8:16, 2] += 0.05
    told = scores.bias(Estimate(off), Estimate(noisy(0.1, 12, seed=7)))
    assert told["block_z"] > 4.5
    assert told["block_z_at"] == [1, 1, 2]
