"""Errors of blocks from single estimates of their variance."""

import numpy as np
import pytest

from varos_warp.render.image.films import tile_pixels
from varos_warp.render.image.frame import block_error, without_noise


@pytest.mark.parametrize("shape", [(20, 41), (9, 17), (64, 64)])
def test_blocks_that_the_edge_cuts_claim_their_own_error(shape):
    """White noise: the variance of a block is that of a pixel over their number; chi-square estimates of one degree."""
    pixels, tries = tile_pixels(*shape), 2000
    truth = 1.0 / pixels[..., None]
    single = truth * np.random.default_rng(1).chisquare(1, (tries, *pixels.shape, 3))
    claimed = np.mean([block_error(one, pixels).astype(float) ** 2 for one in single], axis=0)
    assert np.abs(claimed / truth - 1.0).max() < 5.0 * np.sqrt(2.0 / tries)


def test_blocks_after_one_sample_are_unknown():
    assert np.isinf(block_error(np.full((2, 3, 3), np.inf), tile_pixels(16, 24))).all()


def test_a_known_image_has_no_error():
    image = without_noise(np.ones((9, 17, 3), np.float32))
    assert image.block_error.shape == (2, 3, 3)
    assert not image.block_error.any()
