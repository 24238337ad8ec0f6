"""The adaptive exposure follows the light without flicker, and depends on the frames only, not on their order."""

import numpy as np
import pytest

from varos_warp.render.image import exposure
from varos_warp.render.image.exposure import Statistics, gains, statistics


def image(scale=1.0, seed=0):
    rng = np.random.default_rng(seed)
    return (scale * rng.gamma(2.0, 0.1, (48, 64, 3))).astype(np.float32)


def of(gain):
    """Statistics whose own gain is ``gain``."""
    return Statistics(exposure.KEY_VALUE / gain, 1e-9)


def test_twice_the_light_means_half_the_gain():
    one, two = statistics(image()), statistics(2 * image())
    np.testing.assert_allclose(two.target_gain, one.target_gain / 2, rtol=1e-12)


def test_an_even_grey_image_is_exposed_to_the_key_value():
    grey = statistics(np.full((8, 8, 3), 0.02, np.float32))
    np.testing.assert_allclose(grey.target_gain * 0.02, exposure.KEY_VALUE, rtol=1e-6)


def test_highlights_bound_the_gain_so_that_at_most_one_percent_burns_out():
    picture = image(1e-4)
    picture[:6] = 1.0  # 12 % bright, the rest nearly black
    stats = statistics(picture)
    assert stats.target_gain == 1.0 / stats.highlight
    assert np.mean(picture.max(-1) * stats.target_gain > 1.0 + 1e-6) <= 0.01 + 1 / picture[..., 0].size


def test_a_few_fireflies_do_not_change_the_gain_much():
    calm = image()
    wild = calm.copy()
    wild.reshape(-1, 3)[::701] = 1e4  # 5 of 3072 pixels
    assert abs(np.log(statistics(wild).target_gain / statistics(calm).target_gain)) < 0.03


def test_darkness_behind_the_light_does_not_ask_for_more_and_more_gain():
    """Black water of radiance 1e-6 or 1e-12 gives the same picture, so it must give the same gain."""
    picture = image()
    picture[:24] = 1e-6
    darker = picture.copy()
    darker[:24] = 1e-12
    assert statistics(picture) == statistics(darker)


def test_a_step_of_light_changes_the_gain_no_faster_than_the_gaussian_allows():
    """Largest slope of a step of height S under a Gaussian of standard deviation T is S / (T sqrt(2 pi))."""
    time = np.arange(200) / 10.0
    result = gains("adaptive", "A", time, [of(1.0)] * 100 + [of(8.0)] * 100)
    step = np.diff(np.log(result))
    bound = np.log(8.0) * 0.1 / (exposure.TIME_CONSTANT_S * np.sqrt(2 * np.pi))
    assert (step >= -1e-12).all()
    assert 0.97 * bound < step.max() <= bound
    np.testing.assert_allclose(result[[0, -1]], [1.0, 8.0], rtol=1e-6)


def test_noise_in_the_statistics_is_averaged_down_as_a_gaussian_filter_does():
    """Variance of the mean with Gaussian weights: dt / (2 T sqrt(pi)); of its step: about (dt/T)^2/2 of that."""
    rng = np.random.default_rng(3)
    sigma, dt, count = 0.2, 0.1, 4000
    result = np.log(gains("adaptive", "A", np.arange(count) * dt, [of(g) for g in np.exp(rng.normal(0, sigma, count))]))
    expected = sigma * np.sqrt(dt / (2 * exposure.TIME_CONSTANT_S * np.sqrt(np.pi)))
    # about count * dt / (T sqrt(2 pi)) independent values: their standard deviation is known to 1 / sqrt(2 n)
    n = count * dt / (exposure.TIME_CONSTANT_S * np.sqrt(2 * np.pi))
    assert abs(result.std() / expected - 1) < 4 / np.sqrt(2 * n)
    flicker = np.diff(result).std()
    assert flicker < 0.05 * sigma
    assert abs(flicker / (expected * dt / exposure.TIME_CONSTANT_S / np.sqrt(2)) - 1) < 4 / np.sqrt(2 * n)


def test_smoothing_is_symmetric_in_time():
    rng = np.random.default_rng(1)
    time, frames = np.arange(50) / 10.0, [of(g) for g in rng.uniform(0.5, 5, 50)]
    forward = gains("adaptive", "A", time, frames)
    backward = gains("adaptive", "A", time, frames[::-1])[::-1]
    np.testing.assert_allclose(forward, backward, rtol=1e-13)


def test_a_constant_sequence_keeps_its_gain_to_the_first_and_last_frame():
    np.testing.assert_allclose(gains("adaptive", "A", np.arange(30) / 10.0, [of(2.5)] * 30), 2.5, rtol=1e-13)


def test_black_frames_take_the_gain_of_their_neighbours_and_a_black_sequence_takes_one():
    black = statistics(np.zeros((4, 4, 3), np.float32))
    assert np.isnan(black.target_gain)
    np.testing.assert_allclose(gains("adaptive", "A", np.arange(3.0), [of(2.0), black, of(2.0)]), 2.0, rtol=1e-13)
    np.testing.assert_array_equal(gains("adaptive", "A", np.arange(3.0), [black] * 3), 1.0)
    far = gains("adaptive", "A", np.array([0.0, 1000.0]), [of(2.0), black])
    np.testing.assert_allclose(far, 2.0, rtol=1e-13)


@pytest.mark.parametrize(
    ("setting", "output", "expected"),
    [(0.7, "A", 0.7), (3.0, "B", 3.0), ("constant", "B", 1.0), ("constant", "A", 2.0)],
)
def test_fixed_and_constant_exposures_do_not_change_over_the_sequence(setting, output, expected):
    result = gains(setting, output, np.arange(3.0), [of(1.0), of(2.0), of(50.0)])
    np.testing.assert_allclose(result, expected, rtol=1e-12)


def test_constant_exposure_shows_half_reflectance_under_unit_ambient_light_as_188():
    from varos_warp.products.images.radiance import encode_color

    assert (encode_color(np.full((1, 1, 3), 0.5), exposure.known_gain("constant", "B")) == 188).all()
