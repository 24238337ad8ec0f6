"""C against D, of ground with relief that is finer than a pixel: C sees it, and a slope of D over two pixels not."""

import numpy as np
import pytest
from scipy import ndimage

from varos_warp.dataset.validate import surfaces
from varos_warp.dataset.validate.outcome import Validation

SHAPE, FINE = (27, 48), 8
"""Pixels, and points of the ground to each along a side."""


def ground(roughness):
    """C [H, W, 3] and normals of D of hills 20 pixels long with a relief of half a pixel, seen from straight above."""
    row, col = np.indices([FINE * n for n in SHAPE]) / FINE  # [pixels]
    relief = ndimage.gaussian_filter(np.random.default_rng(1).standard_normal(row.shape), 0.25 * FINE)
    z = np.sin(col * np.pi / 10) + np.sin(row * np.pi / 10) + roughness * relief / relief.std()
    slopes = [np.gradient(z, 1.0 / FINE, axis=axis)[FINE // 2 :: FINE, FINE // 2 :: FINE] for axis in (1, 0)]
    seen = z[FINE // 2 :: FINE, FINE // 2 :: FINE]
    coarse = [np.gradient(seen, axis=axis) for axis in (1, 0)]
    C, D = (np.stack([-x, -y, np.ones(SHAPE)], -1) for x, y in (slopes, coarse))
    return tuple(n / np.linalg.norm(n, axis=-1, keepdims=True) for n in (C, D))


def problems(normal, slope):
    found = Validation(None)
    surfaces.check_slopes(found, "M0", surfaces.slope_sums(normal, slope, 1e-4, 0, SHAPE[0]))
    return [problem for problem in found.problems if "correlation" in problem]


@pytest.mark.parametrize("roughness", [0.0, 0.05, 0.1, 0.2, 0.4, 1.0])
def test_sound_ground_agrees_however_rough_it_is_within_a_pixel(roughness):
    """By a limit that does not know of a pixel's size, the three roughest were told of."""
    assert problems(*ground(roughness)) == []


@pytest.mark.parametrize("roughness", [0.0, 0.05, 0.1])
@pytest.mark.parametrize("axis", [0, 1], ids="xy")
def test_a_flipped_axis_is_found_where_most_of_the_relief_is_larger_than_a_pixel(roughness, axis):
    normal, slope = ground(roughness)
    normal[..., axis] *= -1.0
    (problem,) = problems(normal, slope)
    assert f"slopes of D, {'xy'[axis]}" in problem


def test_what_is_finer_than_a_pixel_is_all_of_white_noise_and_little_of_a_long_wave():
    """Half the mean square of a difference: the variance of noise; of a wave of n pixels along one of two sides, half
    of 1 - cos(2 pi / n) times its variance.
    """
    used = np.ones((200, 200), bool)
    noise = np.random.default_rng(2).standard_normal((200, 200, 3))
    assert surfaces.fineness(noise, used) / (noise**2).sum((0, 1)) == pytest.approx(1.0, abs=0.02)
    wave = np.repeat(np.sin(2 * np.pi * np.arange(200) / 20)[None, :, None], 200, 0)
    share = surfaces.fineness(wave, used) / (wave**2).sum((0, 1))
    assert share == pytest.approx(0.5 * (1 - np.cos(2 * np.pi / 20)), rel=0.02)


@pytest.mark.parametrize(
    ("here", "aside", "told"), [(31, 32, False), (3100, 3200, False), (3100, 3400, True), (31, 70, True), (0, 30, True)]
)
def test_borders_that_are_everywhere_meet_jumps_aside_as_often_but_for_chance(here, aside, told):
    """Counts n and m of independent pixels differ by root(n + m) at random."""
    found = Validation(None)
    surfaces.check_borders(found, "M0", "C", np.array([[here, aside, 0, 0, 0], [0, 0, 0, 0, 0]]))
    assert bool(found.problems) == told


def test_borders_of_objects_are_not_everywhere():
    found = Validation(None)
    surfaces.check_borders(found, "M0", "S", np.array([[31, 32, 0, 0, 0], [0, 0, 0, 0, 0]]))
    assert found.problems
