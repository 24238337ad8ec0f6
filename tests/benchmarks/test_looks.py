"""Statistics of pictures are those of the noise, ramps and clipped areas that they are made of."""

import json

import numpy as np
import pytest
from PIL import Image

from benchmarks.looks import gradient_moments, look_of, main, power_slopes, read_picture
from varos_warp.dataset import files
from varos_warp.products.images.radiance import encode_color


def noise(slope, side=256, seed=0, width=None):
    """Normal noise whose power falls with this exponent of frequency, mean 0.3 and standard deviation 0.05."""
    shape = (side, width or side)
    rng = np.random.default_rng(seed)
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(shape[1]), np.fft.fftfreq(shape[0])))
    f[0, 0] = 1.0
    spectrum = np.fft.fft2(rng.standard_normal(shape)) * f ** (slope / 2)
    spectrum[0, 0] = 0.0
    values = np.fft.ifft2(spectrum).real
    return 0.3 + 0.05 * values / values.std()


@pytest.mark.parametrize("slope", [0.0, -1.0, -2.0, -2.5])
def test_noise_of_a_known_slope_has_that_slope(slope):
    """The mean of 16 pictures, whose scatter tells its standard error: a twentieth, where slopes differ by halves."""
    found = np.array([power_slopes(noise(slope, seed=seed)) for seed in range(16)])
    error = found.std(0, ddof=1) / 4
    assert (error < 0.05).all()
    assert (np.abs(found.mean(0) - slope) < 4 * error).all()


def test_it_does_not_matter_which_side_of_a_picture_is_longer():
    wide = noise(-2.0, 128, width=256)
    assert power_slopes(wide) == pytest.approx(power_slopes(wide.T), rel=1e-9)


def test_the_window_keeps_the_edges_of_a_ramp_out_of_the_spectrum():
    """A ramp that is not periodic would add a slope of -2 along its axis; noise of slope 0 stays so under a window."""
    ramp = np.linspace(0.0, 0.2, 256) + noise(0.0)
    assert abs(power_slopes(ramp)[0]) < 0.1


def test_gradients_of_normal_steps_have_their_deviation_and_a_kurtosis_of_3():
    rng = np.random.default_rng(1)
    steps = rng.normal(0.0, 0.002, (400, 400))
    luminance = np.exp(np.cumsum(steps, axis=1)) - 0.01
    std, kurtosis = gradient_moments(luminance)
    assert abs(std / 0.002 - 1) < 5 / np.sqrt(2 * steps.size)
    assert abs(kurtosis - 3.0) < 5 * np.sqrt(24 / steps.size)


def test_one_edge_on_nothing_has_the_kurtosis_of_a_rare_step():
    """A difference that is one of two numbers, with the chance p of one: (1 - 3 p + 3 p^2) / (p (1 - p))."""
    picture = np.full((80, 101), 0.1)
    picture[:, 50:] = 0.2
    p = 1 / 100
    expected = (1 - 3 * p + 3 * p**2) / (p * (1 - p))
    assert gradient_moments(picture)[1] == pytest.approx(expected, rel=1e-9)
    assert gradient_moments(np.full((80, 101), 0.1)) == (0.0, 0.0)


def test_shares_of_white_and_black_are_those_of_their_areas():
    picture = np.repeat(noise(-2.0, 100)[..., None], 3, -1)
    picture[:10] = 1.0
    picture[10:30] = 0.001
    picture[30:50, :, 0] = 1.0  # one channel alone is not clipped
    found = look_of(picture)
    assert (found.clipped, found.dark) == (0.1, 0.2)


def test_files_are_read_by_their_curve_and_their_gain(tmp_path):
    linear = np.repeat(noise(-2.0, 64)[..., None], 3, -1).astype(np.float16)
    Image.fromarray(encode_color(linear, 2.0)).save(tmp_path / "a.png")
    files.write_exr(tmp_path / "a.exr", {"RGB": linear})
    one, other = read_picture(tmp_path / "a.png"), read_picture(tmp_path / "a.exr", 2.0)
    assert np.abs(one - other).max() < 0.5 / 255 * 2.4
    np.testing.assert_allclose(other, np.clip(2.0 * linear.astype(float), 0, 1))


def test_the_command_prints_a_table_and_refuses_what_is_no_picture(tmp_path, capsys):
    Image.fromarray(encode_color(np.repeat(noise(-2.0)[..., None], 3, -1), 1.0)).save(tmp_path / "a.png")
    assert main([str(tmp_path / "a.png"), "-o", str(tmp_path / "looks.json")]) == 0
    assert "power slope" in capsys.readouterr().out
    assert -2.5 < json.loads((tmp_path / "looks.json").read_text())[str(tmp_path / "a.png")]["power_slope"] < -1.5
    (tmp_path / "b.png").write_bytes(b"no picture")
    Image.fromarray(np.zeros((80, 80, 3), np.uint8)).save(tmp_path / "black.png")
    for name in ("b.png", "none.png", "black.png"):
        assert main([str(tmp_path / name)]) == 2
        assert name in capsys.readouterr().err
