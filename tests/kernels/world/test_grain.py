"""Grain: the tone of a surface from place to place."""

import numpy as np
import pytest
import warp as wp

from varos_warp.kernels.world.texture import grain_tone

GRAIN = 0.4


@wp.kernel(enable_backward=False)
def tones_at(grain: float, p: wp.array(dtype=wp.vec3), footprint: float, tone: wp.array(dtype=float)):
    i = wp.tid()
    tone[i] = grain_tone(wp.uint32(7), grain, p[i], footprint)


def tones(footprint, count=200_000):
    points = np.random.default_rng(1).uniform(-5.0, 5.0, (count, 3))
    tone = wp.empty(count, dtype=float, device="cpu")
    places = wp.array(points, dtype=wp.vec3, device="cpu")
    wp.launch(tones_at, count, [GRAIN, places, footprint], [tone], device="cpu")
    return tone.numpy().astype(float)


@pytest.mark.parametrize("footprint", [0.0, 1e-3, 2e-3])
def test_the_mean_of_grain_is_one_and_it_stays_within_its_bounds(footprint):
    """Places are drawn by chance all over 10 m, so the mean's standard error is that of independent numbers."""
    tone = tones(footprint)
    assert abs(tone.mean() - 1.0) < 4.0 * tone.std() / np.sqrt(len(tone))
    assert tone.std() > 0.02
    assert np.abs(tone - 1.0).max() <= 0.8 + 1e-6


def test_grain_fades_where_it_is_not_resolved():
    deviations = [tones(footprint, 20_000).std() for footprint in (0.0, 8e-4, 2e-3, 2.8e-3, 0.1)]
    assert np.all(np.diff(deviations) <= 0.0)
    assert deviations[-1] == 0.0
