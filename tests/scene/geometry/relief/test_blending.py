import numpy as np
import pytest

from varos_warp.scene.geometry.noise import fbm
from varos_warp.scene.geometry.relief.recipes.blending import (
    domes,
    dots,
    hashed,
    height_blend,
    mix,
    patches,
    smoothstep,
)


def test_patches_cover_about_their_share():
    noise = fbm(np.random.default_rng(1).uniform(-100.0, 100.0, (50_000, 3)), 1.0, 5, seed=1)
    for share in (0.1, 0.3, 0.5, 0.8):
        assert patches(noise, share, 0.02).mean() == pytest.approx(share, abs=0.03)
    assert not patches(noise, 0.0).any()
    assert patches(noise, 1.0).all()


def test_weights_of_layers_add_up_to_one():
    rng = np.random.default_rng(1)
    masks, heights = rng.random((3, 1000)), rng.normal(0.0, 0.1, (3, 1000))
    weights = height_blend(masks, heights)
    np.testing.assert_allclose(weights.sum(axis=0), 1.0)
    assert weights.min() >= 0.0


def test_what_stands_out_of_silt_shows():
    """Half covered: the highest grains are bare and the lowest places are not."""
    relief = np.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    half = np.full(5, 0.5)
    np.testing.assert_allclose(height_blend([half, half], [relief, np.zeros(5)])[1], [1.0, 1.0, 0.5, 0.0, 0.0])


def test_smoothstep_is_half_in_the_middle_and_flat_at_its_ends():
    np.testing.assert_allclose(
        smoothstep(1.0, 3.0, np.array([0.0, 1.0, 1.001, 2.0, 2.999, 4.0])), [0.0, 0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-6
    )
    assert smoothstep(0.14, 0.0, np.array([0.0]))[0] == 1.0


def test_colours_are_mixed_linearly():
    np.testing.assert_allclose(mix((0.0, 0.2, 1.0), (1.0, 0.4, 0.0), np.array([0.25])), [[0.25, 0.25, 0.75]])


def test_domes_are_half_balls_and_dots_are_discs():
    near = np.array([0.0, 0.3, 0.5, 0.7])
    np.testing.assert_allclose(domes(near, 0.5), [1.0, 0.8, 0.0, 0.0])
    np.testing.assert_allclose(dots(near, 0.5), [1.0, 1.0, 0.5, 0.0])


def test_hashes_of_whole_numbers_are_uniform():
    values = hashed(np.arange(-50_000, 50_000), 7)
    assert np.all((values >= 0.0) & (values < 1.0))
    assert np.abs(np.histogram(values, 10, (0.0, 1.0))[0] - 10_000).max() < 5.0 * 95.0  # sqrt(n p q) = 95
    assert abs(np.corrcoef(values[1:], values[:-1])[0, 1]) < 5.0 / np.sqrt(100_000)
