"""Kelp: blades that are split into straps, each plant in a state of its own."""

import itertools

import numpy as np
import pytest

from varos_warp.scene.geometry.growth.plants import ROWS, kelp
from varos_warp.scene.geometry.growth.solids import Sheet

SEEDS = range(6)


def straps(seed):
    return [strip for strip in kelp(np.random.default_rng(seed)).strips if isinstance(strip, Sheet)]


@pytest.mark.parametrize("seed", SEEDS)
def test_straps_are_one_blade_up_to_their_splits(seed):
    """The first rows of neighbours share their rim, but for rounding; the last rows do not."""
    some = straps(seed)
    for one, next_ in itertools.pairwise(some):
        rows = int(0.14 * (ROWS - 1))  # where splits begin
        np.testing.assert_allclose(one.points[:rows, -1], next_.points[:rows, 0], atol=1e-12)
        last = min(len(one.points), len(next_.points)) - 1
        assert np.linalg.norm(one.points[last, -1] - next_.points[last, 0]) > 1e-3


def test_plants_differ_in_straps_size_and_tone():
    plants = [straps(seed) for seed in SEEDS]
    assert len({len(some) for some in plants}) >= 4
    tones = [np.mean([strap.colours.mean() for strap in some]) for some in plants]
    assert max(tones) > 1.25 * min(tones)
    longest = [max(len(strap.points) for strap in some) for some in plants]
    shortest = [min(len(strap.points) for strap in some) for some in plants]
    assert min(short / long for short, long in zip(shortest, longest, strict=True)) < 0.6, "some are torn"


def test_straps_are_mottled_and_paler_where_they_are_old():
    """Bleached, and with crusts: clean at their bases, which grow."""
    base, tip = [], []
    for seed in SEEDS:
        for strap in straps(seed):
            tone = strap.tones.mean(axis=2)
            assert (tone - tone.mean(axis=1, keepdims=True)).std() > 0.06 * tone.mean(), "besides what changes along it"
            third = len(tone) // 3
            base.append(tone[:third].mean())
            tip.append(tone[-third:].mean())
    assert np.mean(tip) > 1.3 * np.mean(base)
