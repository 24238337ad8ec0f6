"""Denoising lowers the error, keeps the local mean, and gives the same bytes every time."""

import sys
import warnings

import numpy as np
import pytest

from varos_warp.render import denoise as module
from varos_warp.render.denoise import denoise


def scene(spp=16, seed=0, shape=(96, 128)):
    """Truth, noisy estimate and its standard error: two tones with an edge under gamma noise (as of ``spp`` paths)."""
    truth = np.full((*shape, 3), 0.05, np.float32)
    truth[:, shape[1] // 2:] = 0.6
    truth *= np.linspace(0.5, 1.5, shape[0], dtype=np.float32)[:, None, None]
    noisy = np.random.default_rng(seed).gamma(spp, truth / spp).astype(np.float32)
    return truth, noisy, (truth / np.sqrt(spp)).astype(np.float32)


def rmse(image, truth):
    return np.sqrt(np.mean(np.square((image - truth) / truth)))


@pytest.mark.parametrize(("method", "factor"), [("oidn", 4.0), ("nlm", 2.0)])
def test_denoising_lowers_the_relative_error(method, factor):
    if method == "oidn":
        pytest.importorskip("pyoidn")
    truth, noisy, stderr = scene()
    assert rmse(denoise(noisy, stderr, method), truth) < rmse(noisy, truth) / factor


def test_nlm_keeps_the_mean_of_the_light_on_both_sides_of_an_edge():
    """Within 4 standard errors of the noisy mean; without the correction it would be 1.6 % too dark, 20 of them."""
    truth, noisy, stderr = scene(shape=(160, 240))
    result = denoise(noisy, stderr, "nlm")
    for half in (np.s_[:, :100], np.s_[:, 140:]):
        error = np.sqrt(np.mean(np.square(stderr[half] / truth[half])) / truth[half].size)
        assert abs(np.mean(result[half] / truth[half]) - 1) < 4 * error + 1e-4


def test_nlm_meets_noise_that_is_stronger_in_some_places():
    """Open places with 2 % noise and shadows with 40 %: both get better, each at its own strength."""
    truth, _, _ = scene()
    spp = np.where(np.arange(128) < 64, 6, 2500)[None, :, None]
    noisy = np.random.default_rng(5).gamma(spp, truth / spp).astype(np.float32)
    result = denoise(noisy, (truth / np.sqrt(spp)).astype(np.float32), "nlm")
    for part in (np.s_[:, :56], np.s_[:, 72:]):
        assert rmse(result[part], truth[part]) < rmse(noisy[part], truth[part]) / 2


def test_nlm_keeps_an_edge_sharp():
    truth, noisy, stderr = scene(spp=400)
    result = denoise(noisy, stderr, "nlm")
    columns = np.s_[:, 62:66]
    assert rmse(result[columns], truth[columns]) < rmse(noisy[columns], truth[columns])


@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_same_input_gives_same_bytes(method):
    if method == "oidn":
        pytest.importorskip("pyoidn")
    _, noisy, stderr = scene()
    assert denoise(noisy, stderr, method).tobytes() == denoise(noisy, stderr, method).tobytes()


def test_bytes_of_open_image_denoise_do_not_depend_on_the_number_of_threads():
    pyoidn = pytest.importorskip("pyoidn")
    _, noisy, _ = scene(shape=(180, 320))
    results = [pyoidn.denoise(noisy, hdr=True, quality="high").tobytes()]
    for threads in (1, 2):
        device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
        device.set_int("numThreads", threads)
        device.commit()
        result = np.empty_like(noisy)
        filter = pyoidn.Filter(device, "RT")
        filter.set_image("color", noisy, pyoidn.OIDN_FORMAT_FLOAT3)
        filter.set_image("output", result, pyoidn.OIDN_FORMAT_FLOAT3)
        filter.set_bool("hdr", True)
        filter.set_quality(pyoidn.OIDN_QUALITY_HIGH)
        filter.commit()
        filter.execute()
        assert device.get_error() is None
        results.append(result.tobytes())
        filter.release()
        device.release()
    assert results[0] == results[1] == results[2]


@pytest.mark.parametrize("scale", [2.0**-40, 2.0**10, 2.0**40])
@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_the_unit_of_light_does_not_matter(method, scale):
    if method == "oidn":
        pytest.importorskip("pyoidn")
    _, noisy, stderr = scene()
    scaled = denoise(np.float32(scale) * noisy, np.float32(scale) * stderr, method)
    np.testing.assert_allclose(scaled / scale, denoise(noisy, stderr, method), rtol=1e-4)


@pytest.mark.parametrize("method", ["oidn", "nlm", "none"])
def test_a_black_image_and_a_noise_free_image_pass(method):
    black = np.zeros((16, 16, 3), np.float32)
    np.testing.assert_allclose(denoise(black, black, method), 0.0, atol=1e-6)
    grey = np.full((16, 16, 3), 0.3, np.float32)
    np.testing.assert_allclose(denoise(grey, black, method), 0.3, rtol=0.02)


@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_one_sample_per_pixel_of_unknown_error_is_denoised_too(method):
    if method == "oidn":
        pytest.importorskip("pyoidn")
    truth, noisy, _ = scene(spp=1)
    result = denoise(noisy, np.full_like(noisy, np.inf), method)
    assert np.isfinite(result).all()
    assert rmse(result, truth) < 0.6 * rmse(noisy, truth)


def test_none_changes_nothing():
    _, noisy, stderr = scene()
    assert denoise(noisy, stderr, "none").tobytes() == noisy.tobytes()


def test_values_that_are_not_finite_are_refused():
    _, noisy, stderr = scene()
    noisy[3, 4, 1] = np.nan
    for method in ("oidn", "nlm"):
        with pytest.raises(ValueError, match="1 values are not finite"):
            denoise(noisy, stderr, method)


def test_without_open_image_denoise_nlm_takes_its_place_and_says_so_once(monkeypatch):
    _, noisy, stderr = scene()
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    module.available_method.cache_clear()
    try:
        with pytest.warns(UserWarning, match="non-local means takes its place"):
            first = denoise(noisy, stderr, "oidn")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            denoise(noisy, stderr, "oidn")
        assert first.tobytes() == denoise(noisy, stderr, "nlm").tobytes()
    finally:
        module.available_method.cache_clear()
