"""The encodings of A, B, C and D are what the paper says and lose no more than rounding."""

from types import SimpleNamespace

import numpy as np
import pytest

from varos_warp.products.images.depth import decode_depth, encode_depth
from varos_warp.products.images.normals import decode_normal, encode_normal
from varos_warp.products.images.radiance import WATER_IMAGE, decode_color, encode_color, srgb_oetf, to_half


def unit_vectors(count, seed=0):
    v = np.random.default_rng(seed).normal(size=(count, 1, 3))
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def test_srgb_curve_goes_through_its_published_points():
    """IEC 61966-2-1: 0 and 1 are fixed, 18 % grey is 0.4613561, the two branches meet at 0.0031308."""
    np.testing.assert_allclose(srgb_oetf(np.array([0.0, 1.0, 0.18, 0.5])), [0.0, 1.0, 0.4613561, 0.7353570], atol=1e-7)
    below, above = srgb_oetf(np.array([0.0031308, 0.0031308 + 1e-9]))
    assert abs(above - below) < 1e-6


def test_every_8_bit_colour_survives_decoding_and_encoding():
    pixels = np.stack(np.meshgrid(np.arange(256), np.arange(3), indexing="ij"), -1)[..., :1].repeat(3, -1)
    pixels = pixels.astype(np.uint8)
    for gain in (0.37, 1.0, 12.5):
        again = encode_color(decode_color(pixels, gain), gain)
        np.testing.assert_array_equal(again, pixels)


def test_gain_multiplies_linear_light():
    radiance = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)
    np.testing.assert_array_equal(encode_color(radiance, 0.5), encode_color(radiance / 2, 1.0))


def test_colour_beyond_white_and_infinity_are_white_not_wrapped():
    radiance = np.array([[[1.0, 7.0, np.inf]]], np.float32)
    assert encode_color(radiance, 3e38).tolist() == [[[255, 255, 255]]]


def test_normals_come_back_within_half_a_step_of_8_bit():
    normal = unit_vectors(2000)
    pixels = encode_normal(normal)
    assert np.abs(pixels / 127.5 - 1.0 - normal).max() <= 0.5 / 127.5 + 1e-12
    cosine = np.clip(np.sum(decode_normal(pixels) * normal, -1), -1, 1)
    assert np.degrees(np.arccos(cosine)).max() < np.degrees(np.sqrt(3) * 0.5 / 127.5)


def test_no_unit_normal_is_taken_for_background():
    assert np.any(encode_normal(unit_vectors(5000, seed=1)) > 0, axis=-1).all()
    assert encode_normal(np.zeros((2, 2, 3))).tolist() == np.zeros((2, 2, 3)).tolist()
    assert not decode_normal(np.zeros((2, 2, 3), np.uint8)).any()


def normals_by_the_formula(pixels):
    """The formula of the dataset's README, in float64."""
    normal = pixels / 127.5 - 1.0
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    normal[~pixels.any(axis=-1)] = 0.0
    return normal


def test_decoded_normals_are_the_formula_to_the_rounding_of_float32_in_less_than_half_its_time():
    """Two roundings of numbers up to 1 and that of the length's inverse: 2^-24 each. Times are the best of 7."""
    pixels = np.random.default_rng(1).integers(0, 256, (360, 640, 3), np.uint8)
    pixels[:40] = 0
    pixels[40, :8] = np.array(np.meshgrid([0, 255], [0, 255], [0, 255])).reshape(3, 8).T
    found, expected = decode_normal(pixels), normals_by_the_formula(pixels)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, rtol=0, atol=3 * 2.0**-24)


def test_depth_resolution_is_that_of_equation_1():
    """It is 25 m / 65535 = 0.381 mm, and decoding is off by at most half of it (plus float32)."""
    depth = np.random.default_rng(0).uniform(0.0, 24.99, (50, 60))
    pixels = encode_depth(depth, (0.0, 25.0))
    error = np.abs(decode_depth(pixels, (0.0, 25.0)) - depth).max()
    assert 0.49 * 25 / 65535 < error <= 0.5 * 25 / 65535 + 25 * 2.0**-24


def test_depth_beyond_the_ends_behind_the_lens_and_nothing_hit_are_65535():
    depth = np.array([[25.0, 25.1, np.inf, -1.0, 0.0, 12.5]])
    pixels = encode_depth(depth, (0.0, 25.0))
    assert pixels.tolist() == [[65535, 65535, 65535, 65535, 0, 32768]]
    assert np.isinf(decode_depth(pixels, (0.0, 25.0))[0, :4]).all()


def test_depth_range_may_start_beyond_zero():
    pixels = encode_depth(np.array([[2.0, 3.0, 4.0]]), (2.0, 4.0))
    assert pixels.tolist() == [[0, 32768, 65535]]
    assert abs(decode_depth(pixels, (2.0, 4.0))[0, 1] - 3.0) < 2 / 65535


@pytest.mark.parametrize(
    "encode",
    [lambda image: encode_color(image, 1.0), encode_normal, lambda image: encode_depth(image[..., 0], (0.0, 25.0))],
)
def test_nan_is_never_written(encode):
    with pytest.raises(ValueError, match="NaN"):
        encode(np.full((3, 4, 3), np.nan))


def test_half_floats_are_clamped_and_counted_when_too_bright():
    half, clamped = to_half(np.array([1.0, 65504.0, 65505.0, 1e30, np.inf], np.float32))
    assert clamped == 3
    assert half.tolist() == [1.0, 65504.0, 65504.0, 65504.0, 65504.0]
    with pytest.raises(ValueError, match="NaN"):
        to_half(np.array([np.nan], np.float32))


def test_half_floats_keep_11_bits():
    values = np.random.default_rng(0).uniform(1e-4, 6e4, 1000).astype(np.float32)
    half, clamped = to_half(values)
    assert clamped == 0
    assert np.abs(half.astype(float) / values - 1).max() <= 2.0**-11


def test_linear_channels_hold_radiance_error_and_layers():
    rgb = np.random.default_rng(0).random((2, 3, 3)).astype(np.float32)
    channels = WATER_IMAGE.floats(SimpleNamespace(radiance=rgb, stderr=rgb / 10, layers={"direct": rgb / 2}))
    assert list(channels) == ["R", "G", "B", "stderr.R", "stderr.G", "stderr.B", "direct.R", "direct.G", "direct.B"]
    np.testing.assert_array_equal(channels["stderr.G"], rgb[..., 1] / 10)


def test_depth_behind_the_lens_is_none():
    """What a fisheye of more than 180 degrees sees behind its lens has a planar depth below 0, not that of the lens."""
    assert encode_depth(np.array([[-0.5, 0.0, 5.0]]), (0.0, 25.0)).tolist() == [[65535, 0, 13107]]
