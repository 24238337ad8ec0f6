"""Where the splats of tiles begin."""

import numpy as np
import pytest
import warp as wp

from varos_warp.kernels.particles.gather import find_tiles


@pytest.mark.parametrize("tiles", [[0], [3], [1, 3], [0, 0, 2, 2, 2, 5]])
def test_every_splat_is_of_the_tile_that_it_shows_in(tiles):
    """The last one too; what lies behind the sorted tiles is left over."""
    listed = wp.array(np.array([*tiles, 9, 0], np.int32), dtype=int, device="cpu")
    starts = wp.empty(8, dtype=int, device="cpu")
    wp.launch(find_tiles, 8, [listed, len(tiles)], [starts], device="cpu")
    assert np.array_equal(starts.numpy(), np.searchsorted(tiles, np.arange(8)))
