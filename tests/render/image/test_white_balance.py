"""White balance of single frames and of sequences, against closed forms."""

import numpy as np
import pytest

from varos_warp.products.images.radiance import decode_color, encode_color
from varos_warp.render.image import exposure
from varos_warp.render.image.camera_noise import noisy_color
from varos_warp.render.image.exposure import GREY_WORLD, Rule, centre_weights
from varos_warp.scene.description.exposure import PercentileMeter
from varos_warp.scene.description.noise_profile import CameraNoise
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.optics.camera import camera_model

METER = PercentileMeter(meter="percentile", percentile=98.0, level=0.9)
TINT = np.array([0.5, 1.0, 2.0])
"""Powers of two, so that half floats hold them exactly; grey world's gains are [2, 1, 1/2]."""


def picture(tint=TINT, seed=0):
    """Half floats of one shade by a tint, exactly."""
    shade = np.random.default_rng(seed).gamma(2.0, 0.1, (48, 64, 1)).astype(np.float16)
    return (shade * np.asarray(tint, np.float16)).astype(np.float16)


def balance_of(rule, frames, time_s=None):
    time_s = np.arange(float(len(frames))) if time_s is None else time_s
    found = rule.gains("A", time_s, [rule.statistics(frame) for frame in frames])
    return found / found[:, 1:2]


@pytest.mark.parametrize("gain", ["adaptive", "constant", 3.0, METER])
def test_grey_world_makes_the_weighted_means_of_the_channels_equal(gain):
    frame = np.random.default_rng(1).gamma(2.0, [0.02, 0.05, 0.04], (48, 64, 3)).astype(np.float16)
    rule = Rule(gain, GREY_WORLD)
    (found,) = rule.gains("A", np.zeros(1), [rule.statistics(frame)])
    means = np.tensordot(centre_weights(48, 64), found * frame.astype(float), 2)
    np.testing.assert_allclose(means, means[1], rtol=1e-12)
    if gain == 3.0:
        assert found[1] == 3.0


@pytest.mark.parametrize("gain", ["adaptive", METER])
def test_a_tinted_frame_is_exposed_as_the_grey_one_that_it_becomes(gain):
    """Green's gain, too: highlight, mean and log-average of the balanced frame follow from those of its channels."""
    tinted, grey = Rule(gain, GREY_WORLD), Rule(gain)
    (found,) = tinted.gains("A", np.zeros(1), [tinted.statistics(picture())])
    (expected,) = grey.gains("A", np.zeros(1), [grey.statistics(picture([1.0, 1.0, 1.0]))])
    np.testing.assert_allclose(found, expected / TINT, rtol=1e-12)


def test_no_channel_clips_more_than_the_meter_leaves():
    frame = np.random.default_rng(2).gamma(0.5, [0.02, 0.05, 0.01], (48, 64, 3)).astype(np.float16)
    rule = Rule(METER, GREY_WORLD)
    (found,) = rule.gains("A", np.zeros(1), [rule.statistics(frame)])
    above = np.tensordot(centre_weights(48, 64), found * frame.astype(float) > METER.level * (1 + 1e-9), 2)
    shares = above / centre_weights(48, 64).sum()
    assert (shares <= 0.02).all()
    assert shares.max() > 0.015  # one channel reaches the level


def test_gains_are_bounded_where_a_channel_is_dark_or_black():
    np.testing.assert_array_equal(balance_of(Rule(1.0, GREY_WORLD), [picture([0.03125, 1.0, 8.0])]), [[4.0, 1.0, 0.25]])
    np.testing.assert_array_equal(balance_of(Rule(1.0, GREY_WORLD), [picture([0.0, 1.0, 1.0])]), [[4.0, 1.0, 1.0]])


def test_it_is_smoothed_over_time_as_the_gain_is():
    """Two frames one second apart: weights 1 and exp(-1/2) of the logarithms."""
    frames = [picture([0.5, 1.0, 1.0]), picture([1.0, 1.0, 1.0])]
    near = 1.0 / (1.0 + np.exp(-0.5))
    red = 2.0 ** np.array([near, 1.0 - near])
    found = balance_of(Rule(1.0, GREY_WORLD), frames)
    np.testing.assert_allclose(found, np.stack([red, np.ones(2), np.ones(2)], -1), rtol=1e-12)
    constant = balance_of(Rule("constant", GREY_WORLD), frames)
    np.testing.assert_allclose(constant, np.tile([np.sqrt(2.0), 1.0, 1.0], (2, 1)), rtol=1e-12)


@pytest.mark.parametrize("gain", ["adaptive", METER])
def test_black_frames_take_the_balance_of_their_neighbours(gain):
    frames = [picture(), np.zeros((48, 64, 3), np.float16)]
    np.testing.assert_allclose(balance_of(Rule(gain, GREY_WORLD), frames), np.tile(1.0 / TINT, (2, 1)), rtol=1e-12)
    np.testing.assert_array_equal(balance_of(Rule(gain, GREY_WORLD), frames[1:]), np.ones((1, 3)))


def test_constant_balance_is_known_before_any_frame():
    assert Rule(2.0, (3.0, 1.0, 0.5)).known("A") == (6.0, 2.0, 1.0)
    assert Rule(2.0, GREY_WORLD).known("A") is None
    assert Rule(2.0).known("A") == 2.0
    assert Rule("adaptive", (3.0, 1.0, 0.5)).known("A") is None


def test_eight_bits_of_a_balanced_image_are_read_back_to_their_rounding():
    """The slope of the sRGB curve's inverse is at most 1.055 * 2.4: half a step of 1/255 each way."""
    frame, gain = picture().astype(np.float32), (1.0, 0.5, 0.25)
    matrix = np.array([[1.6, -0.5, -0.1], [-0.2, 1.5, -0.3], [0.0, -0.6, 1.6]])
    step = 0.5 / 255.0 * 2.4
    seen = frame * gain < 1.0
    error = np.abs(decode_color(encode_color(frame, gain), gain) - frame) * gain
    assert error[seen].max() <= step
    by_matrix = decode_color(encode_color(frame, gain, matrix), gain, matrix)
    inside = (frame * gain < 1.0).all(-1)
    assert np.abs((by_matrix - frame) * gain)[inside].max() <= step * np.abs(np.linalg.inv(matrix)).sum(1).max()


def test_noise_comes_before_the_balance():
    """The sensor is exposed by the smallest gain; the numbers of the other channels are multiplied, and their noise."""
    model = CameraNoise(electrons_per_dn=2.0, bits=12, shot_noise=True)
    view, level, gain = camera_model(Camera(resolution=(400, 400))), 0.1, (4.0, 2.0, 1.0)
    radiance = np.broadcast_to(np.float32(level / np.array(gain)), (400, 400, 3))
    pixels = noisy_color(model, radiance, gain, view, 0.0, np.random.default_rng(0))
    linear = decode_color(pixels, 1.0).astype(float)
    white = 2.0 * 4095
    # Poisson's variance of the raw signal level / part, times part^2; 8 bits and 12 bits are finer by far
    expected = np.array([np.sqrt(level / part / white) * part for part in gain])
    np.testing.assert_allclose(linear.mean((0, 1)), level, rtol=0.005)
    np.testing.assert_allclose(linear.std((0, 1)), expected, rtol=0.05)
    bright = noisy_color(model, np.full((4, 4, 3), 50.0, np.float32), gain, view, 0.0, np.random.default_rng(0))
    assert (bright == 255).all()


def test_a_gain_in_words():
    assert exposure.in_words(1.23456) == "1.23"
    assert exposure.in_words((2.0, 1.0, 0.5)) == "2 / 1 / 0.5"
