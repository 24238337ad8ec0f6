"""The profile of a splat: its sum over pixels, however long and however turned."""

import numpy as np
import pytest
import warp as wp
from flakes import soft_edge

from varos_warp.kernels.particles.splat import Splat, profile_sum


@wp.kernel(enable_backward=False)
def sums_of(splats: wp.array(dtype=Splat), sums: wp.array(dtype=float)):
    sums[wp.tid()] = profile_sum(splats[wp.tid()])


def summed(x, y, along, radius, edge):
    """The same by numpy, pixel by pixel."""
    reach = np.abs(along) + radius + edge + 2
    col, row = np.meshgrid(
        np.arange(int(x - reach[0]) - 1, int(x + reach[0]) + 2) + 0.5,
        np.arange(int(y - reach[1]) - 1, int(y + reach[1]) + 2) + 0.5,
    )
    share = np.clip(((col - x) * along[0] + (row - y) * along[1]) / max(along @ along, 1e-9), -1, 1)
    distance = np.hypot(col - x - share * along[0], row - y - share * along[1])
    return soft_edge(distance - radius, edge).sum()


def sum_in_kernel(splats):
    """Of each splat, float32 [N]."""
    sums = wp.empty(len(splats), dtype=float, device="cpu")
    wp.launch(sums_of, len(splats), [wp.array(splats, dtype=Splat, device="cpu")], [sums], device="cpu")
    return sums.numpy()


@pytest.mark.parametrize("length", [0, 30, 300, 1000])
@pytest.mark.parametrize("turn_deg", [0, 45, 90, 17])
@pytest.mark.parametrize(("radius", "edge"), [(1.0, 2.0), (3.0, 2.0), (3.0, 5.0)])
def test_the_sum_of_a_streak_is_that_of_its_pixels(length, turn_deg, radius, edge):
    """A long one's by its integral, from which the sum differs by the places of its ends and rows in their pixels."""
    turn, splat = np.radians(turn_deg), Splat()
    along = 0.5 * length * np.array([np.cos(turn), np.sin(turn)])
    splat.x, splat.y, splat.along, splat.radius, splat.edge = 100.3, 80.6, wp.vec2(*along), radius, edge
    splat.reach = wp.vec2(radius + edge / 2, radius + edge / 2)
    rel = 1e-5 if length < 100 else 0.01
    assert sum_in_kernel([splat])[0] == pytest.approx(summed(100.3, 80.6, along, radius, edge), rel=rel)


def test_a_wide_disc_has_the_area_of_its_integral():
    """Which is pi (R^2 + w^2 / 24), to which pixels of a soft edge sum up closely."""
    splat = Splat()
    splat.x, splat.y, splat.radius, splat.edge, splat.reach = 300.2, 300.7, 70.0, 60.0, wp.vec2(100.0, 100.0)
    assert sum_in_kernel([splat])[0] == pytest.approx(summed(300.2, 300.7, np.zeros(2), 70.0, 60.0), rel=1e-4)
