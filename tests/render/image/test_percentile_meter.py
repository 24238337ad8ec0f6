"""Exposure by a meter: a percentile of the highlights, weighted towards the centre, comes to its level."""

import numpy as np
import pytest

from varos_warp.render.image import exposure
from varos_warp.render.image.exposure import Statistics, centre_weights, gains, statistics, weighted_percentile
from varos_warp.scene.description.exposure import Exposure, PercentileMeter

METER = PercentileMeter(meter="percentile")


def image(scale=1.0, seed=0):
    rng = np.random.default_rng(seed)
    return (scale * rng.gamma(2.0, 0.1, (48, 64, 3))).astype(np.float16)


def test_an_even_image_is_exposed_to_the_level():
    found = statistics(np.full((8, 8, 3), 0.02, np.float16), METER)
    (gain,) = gains(METER, "A", np.zeros(1), [found])
    assert gain * float(np.float16(0.02)) == pytest.approx(0.95, rel=1e-12)


def test_the_share_of_weight_above_the_level_is_what_the_percentile_leaves():
    """To the weight of the pixels that have the value itself."""
    picture = image()
    (gain,) = gains(METER, "A", np.zeros(1), [statistics(picture, METER)])
    brightest, weight = picture.astype(float).max(-1) * gain, centre_weights(48, 64)
    above, at = (
        weight[chosen].sum() / weight.sum()
        for chosen in (brightest > 0.95 * (1 + 1e-9), np.isclose(brightest, 0.95, 1e-9))
    )
    assert above <= 0.015 <= above + at
    assert at < 0.005


@pytest.mark.parametrize("percentile", [0.5, 50.0, 99.0, 100.0])
def test_by_looking_up_bits_it_is_what_sorting_gives(percentile):
    values = image(seed=3)[..., 0].astype(float)
    order = np.argsort(values, axis=None)
    weight = np.cumsum(centre_weights(*values.shape).ravel()[order])
    number = np.searchsorted(weight, percentile / 100 * weight[-1] * (1 - 1e-12))
    assert weighted_percentile(values, percentile) == values.ravel()[order][number]


def test_weights_are_symmetric_and_fall_to_a_quarter_at_the_edges():
    weight = centre_weights(900, 1600)
    np.testing.assert_array_equal(weight, weight[::-1, ::-1])
    np.testing.assert_allclose(
        [weight[450, 800], weight[450, 0], weight[0, 800], weight[0, 0]], [1.0, 0.25, 0.25, 0.0625], atol=3e-3
    )


def test_a_bright_patch_in_the_middle_counts_more_than_one_in_the_corner():
    """1.4 % of the pixels: less than the percentile leaves in a corner, more in the middle."""
    dark = np.full((100, 100, 3), 0.01, np.float16)
    middle, corner = dark.copy(), dark.copy()
    middle[44:56, 44:56] = 1.0
    corner[:12, :12] = 1.0
    assert [statistics(picture, METER).metered for picture in (middle, corner)] == [1.0, float(np.float16(0.01))]


def test_dark_water_behind_the_highlights_stays_as_dark_as_it_is():
    """A tenth of the image bright, the rest a hundredth of that."""
    picture = np.full((40, 40, 3), 0.01, np.float16)
    picture[12:25, 12:25] = 1.0
    (by_meter,) = gains(METER, "A", np.zeros(1), [statistics(picture, METER)])
    assert by_meter * picture[0, 0, 0] == pytest.approx(0.0095, rel=1e-3)


def test_twice_the_light_means_half_the_gain():
    one, two = (statistics(image(scale), METER).metered_gain(METER) for scale in (1.0, 2.0))
    assert two == one / 2


def test_it_is_smoothed_over_time_as_adaptive_exposure_is():
    time = np.arange(50) / 10.0
    read = np.exp(np.random.default_rng(5).normal(size=50))
    found = gains(METER, "A", time, [Statistics(1.0, 1.0, value, 1.0) for value in read])
    same = gains("adaptive", "A", time, [Statistics(exposure.KEY_VALUE / 0.95 * value, 1e-9) for value in read])
    np.testing.assert_allclose(found, same, rtol=1e-12)


def test_milky_water_without_highlights_comes_to_the_mean_and_highlights_to_their_level():
    meter = PercentileMeter(meter="percentile", mean=0.1)
    milk = statistics(np.full((20, 20, 3), 0.25, np.float16), meter)
    assert milk.metered_gain(meter) * 0.25 == pytest.approx(0.1, rel=1e-12)
    assert milk.metered_gain(METER) * 0.25 == pytest.approx(0.95, rel=1e-12)
    picture = np.full((40, 40, 3), 0.01, np.float16)
    picture[18:22, 17:23] = 0.5
    assert statistics(picture, meter).metered_gain(meter) == 0.95 / 0.5


def test_the_mean_is_that_of_the_luminance_by_the_weights_of_the_percentile():
    picture = image(seed=2)
    weight = centre_weights(48, 64)
    expected = np.average(picture.astype(float) @ [0.2126, 0.7152, 0.0722], weights=weight)
    assert statistics(picture, METER).mean == pytest.approx(expected, rel=1e-12)


def test_black_frames_take_the_gain_of_others():
    read = [Statistics(1.0, 1.0, 0.1, 0.1), Statistics(np.nan, np.nan, 0.0, 0.0), Statistics(1.0, 1.0, 0.5, 0.1)]
    found = gains(METER, "A", np.arange(3) * 100.0, read)
    np.testing.assert_allclose(found[[0, 2]], [9.5, 1.9], rtol=1e-12)
    assert 1.9 <= found[1] <= 9.5
    np.testing.assert_array_equal(gains(METER, "A", np.zeros(1), [read[1]]), 1.0)


def test_a_small_thing_before_nothing_is_exposed_by_its_brightest_pixel():
    """Without water what is behind it is 0, and so is the percentile."""
    picture = np.zeros((40, 40, 3), np.float16)
    picture[20, 20:22] = 0.25, 0.5, 0.125
    assert statistics(picture, METER).metered_gain(METER) == 0.95 / 0.5
    assert np.isnan(statistics(np.zeros((4, 4, 3), np.float16), METER).metered_gain(METER))


def test_a_scene_without_a_meter_says_what_it_said():
    assert Exposure().model_dump(mode="json") == {"A": "adaptive", "B": "constant"}
    assert METER.model_dump() == {"meter": "percentile", "percentile": 98.5, "level": 0.95}
