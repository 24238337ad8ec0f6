"""The profile of a splat: its sum over pixels, however long and however turned."""

import numpy as np
import pytest
import warp as wp

from varos_warp.kernels.particles.splat import Splat, profile_sum


@wp.kernel(enable_backward=False)
def sums_of(splats: wp.array(dtype=Splat), sums: wp.array(dtype=float)):
    sums[wp.tid()] = profile_sum(splats[wp.tid()])


def summed(x, y, along, radius):
    """The same by numpy, pixel by pixel."""
    reach = np.abs(along) + radius + 2
    col, row = np.meshgrid(np.arange(int(x - reach[0]) - 1, int(x + reach[0]) + 2) + 0.5,
                           np.arange(int(y - reach[1]) - 1, int(y + reach[1]) + 2) + 0.5)
    share = np.clip(((col - x) * along[0] + (row - y) * along[1]) / max(along @ along, 1e-9), -1, 1)
    distance = np.hypot(col - x - share * along[0], row - y - share * along[1])
    return np.clip(radius + 0.5 - distance, 0, 1).sum()


@pytest.mark.parametrize("length", [0, 30, 300, 1000])
@pytest.mark.parametrize("turn_deg", [0, 45, 90, 17])
@pytest.mark.parametrize("radius", [0.75, 3.0])
def test_the_sum_of_a_streak_is_that_of_its_pixels(length, turn_deg, radius):
    """A long one's by its integral, from which the sum differs by the places of its ends and rows in their pixels."""
    turn, splat = np.radians(turn_deg), Splat()
    along = 0.5 * length * np.array([np.cos(turn), np.sin(turn)])
    splat.x, splat.y, splat.along, splat.radius = 100.3, 80.6, wp.vec2(*along), radius
    sums = wp.empty(1, dtype=float, device="cpu")
    wp.launch(sums_of, 1, [wp.array([splat], dtype=Splat, device="cpu")], [sums], device="cpu")
    rel = 1e-5 if length < 100 else 0.01
    assert sums.numpy()[0] == pytest.approx(summed(100.3, 80.6, along, radius), rel=rel)
