"""Denoising lowers the error, keeps the local mean, and gives the same bytes every time."""

import os
import subprocess
import sys
import textwrap
import warnings
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh
import warp as wp
from scipy.ndimage import map_coordinates, uniform_filter

from varos_warp.device.launcher import Launcher
from varos_warp.errors import InputError
from varos_warp.kernels.film.denoise import LEAST_ALBEDO, add_enlarged, add_mixed, halve
from varos_warp.kernels.film.develop import weigh_guides
from varos_warp.kernels.film.film import IN_BLOCK
from varos_warp.render.image import denoise as module
from varos_warp.render.image import oidn
from varos_warp.render.image.denoise import FAR, HALF_BELOW, NEAR, PART_QUALITY, QUALITY, Denoiser, denoise_image
from varos_warp.render.options import LAYERS
from varos_warp.render.radiance import RadianceRenderer
from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import euler_to_matrix, transform
from varos_warp.scene.geometry.parts import Part


def scene(spp=16, seed=0, shape=(96, 128)):
    """Truth, noisy estimate and its standard error: two tones with an edge under gamma noise (as of ``spp`` paths)."""
    truth = np.full((*shape, 3), 0.05, np.float32)
    truth[:, shape[1] // 2 :] = 0.6
    truth *= np.linspace(0.5, 1.5, shape[0], dtype=np.float32)[:, None, None]
    noisy = np.random.default_rng(seed).gamma(spp, truth / spp).astype(np.float32)
    return truth, noisy, (truth / np.sqrt(spp)).astype(np.float32)


def denoise(radiance, stderr, method):
    """A whole image, denoised."""
    return denoise_image(
        SimpleNamespace(
            snow=None, radiance=radiance, stderr=stderr, correction=None, base_variance=None, albedo=None, normal=None
        ),
        method,
    )


def part_denoised(part, quality=PART_QUALITY, **guides):
    """What is positive of a part of an image, by Open Image Denoise on the CPU."""
    arrays, result = on("cpu", part=part, **guides), wp.zeros(part.shape[:2], dtype=wp.vec3, device="cpu")
    Denoiser(Launcher("cpu")).add_denoised(result, arrays.pop("part"), 1.0, quality, arrays)
    return result.numpy()


def rmse(image, truth):
    return np.sqrt(np.mean(np.square((image - truth) / truth)))


@pytest.mark.parametrize("guided", [False, True])
def test_tiles_of_open_image_denoise_and_its_guides_give_the_bytes_of_the_whole(monkeypatch, guided):
    pyoidn = pytest.importorskip("pyoidn")
    rng = np.random.default_rng(3)
    noisy = rng.gamma(2.0, 0.5, (900, 300, 3)).astype(np.float32)  # of a mean that needs no scale
    guides = {"albedo": rng.random(noisy.shape, np.float32), "normal": np.full(noisy.shape, 0.5, np.float32)}
    guides = guides if guided else {}
    whole = pyoidn.denoise(noisy, hdr=True, quality=PART_QUALITY, clean_aux=guided, **guides)
    monkeypatch.setattr(oidn, "MOST_MB", 1)
    tiled = part_denoised(noisy, **guides)
    assert whole.tobytes() == tiled.tobytes()


@pytest.mark.parametrize(("method", "factor"), [("oidn", 4.0), ("nlm", 2.0)])
def test_denoising_lowers_the_relative_error(method, factor):
    if method == "oidn":
        pytest.importorskip("pyoidn")
    truth, noisy, stderr = scene()
    assert rmse(denoise(noisy, stderr, method), truth) < rmse(noisy, truth) / factor


@pytest.mark.parametrize("shape", [(9, 1), (1, 9), (1, 1)])
def test_nlm_takes_images_a_pixel_wide(shape):
    truth, noisy, stderr = scene(shape=shape)
    result = denoise(noisy, stderr, "nlm")
    assert result.shape == noisy.shape
    assert rmse(result, truth) < 2.0 * rmse(noisy, truth)


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


@pytest.mark.parametrize("quality", [QUALITY, PART_QUALITY])
def test_bytes_of_open_image_denoise_do_not_depend_on_the_number_of_threads(quality):
    pyoidn = pytest.importorskip("pyoidn")
    _, noisy, _ = scene(shape=(180, 320))
    results = [pyoidn.denoise(noisy, hdr=True, quality=quality).tobytes()]
    for threads in (1, 2):
        device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU)
        device.set_int("numThreads", threads)
        device.commit()
        result = np.empty_like(noisy)
        filter = pyoidn.Filter(device, "RT")
        filter.set_image("color", noisy, pyoidn.OIDN_FORMAT_FLOAT3)
        filter.set_image("output", result, pyoidn.OIDN_FORMAT_FLOAT3)
        filter.set_bool("hdr", True)
        filter.set_quality(getattr(pyoidn, f"OIDN_QUALITY_{quality.upper()}"))
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


def test_torch_is_not_imported_to_denoise_and_may_be_by_others(tmp_path):
    """Where it is installed its import takes seconds; who gives tensors to the library still can."""
    pytest.importorskip("pyoidn")
    (tmp_path / "torch.py").write_text("raise SystemExit('torch was imported')\n")
    code = """
        import numpy as np, sys
        from varos_warp.render.image.denoise import denoise_image
        from varos_warp.render.image.frame import RadianceImage
        image = np.ones((8, 8, 3), np.float32)
        denoise_image(RadianceImage(image, 0.1 * image), "oidn")
        assert "torch" not in sys.modules
        from pyoidn.utils import require_torch
        require_torch()
    """
    path = os.pathsep.join([str(tmp_path), *sys.path])
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], check=True, env=os.environ | {"PYTHONPATH": path})


# -------------------------------------------------------------------------------------------- only what has the noise


SPREAD = 3.0
"""Noise of the corrections below: its standard deviation over the mean of its positive part."""


def layered(spp=16, seed=0, shape=(96, 128), guides=False):
    """Truth and image of a strong, noise-free texture under a noisy correction with both signs.

    Bright on the left, dark on the right, and taken away in the middle. The noise is gamma, as skewed as that of a
    path tracer.
    """
    rng = np.random.default_rng(seed)
    texture = rng.uniform(0.2, 0.8, (*shape, 3)).astype(np.float32)
    level = np.full((*shape, 3), 0.1, np.float32)
    level[:, shape[1] // 2 :] = 0.02
    taken = np.zeros((*shape, 3), np.float32)
    taken[:, shape[1] // 3 : 2 * shape[1] // 3] = 0.03
    k = spp / SPREAD**2
    correction = (rng.gamma(k, level / k) - rng.gamma(k, np.maximum(taken, 1e-9) / k)).astype(np.float32)
    stderr = (SPREAD * np.sqrt(level**2 + taken**2) / np.sqrt(spp)).astype(np.float32)
    albedo = np.full((*shape, 3), 0.4, np.float32) if guides else None
    normal = np.full((*shape, 3), (0.0, 0.0, 1.0), np.float32) if guides else None
    image = SimpleNamespace(
        snow=None,
        radiance=texture + correction,
        stderr=stderr,
        correction=correction,
        subpaths=np.inf,
        base_variance=np.zeros_like(stderr),
        albedo=albedo,
        normal=normal,
    )
    return texture + level - taken, image


def rms(x):
    return np.sqrt(np.mean(np.square(x, dtype=np.float64)))


def needs(method):
    if method == "oidn":
        pytest.importorskip("pyoidn")


@pytest.mark.parametrize(("method", "guides", "factor"), [("oidn", False, 6), ("oidn", True, 6), ("nlm", False, 3)])
def test_a_texture_survives_and_the_noise_of_the_correction_goes(method, guides, factor):
    """The texture changes from pixel to pixel: denoised with the rest it would be lost, as the last line shows."""
    needs(method)
    truth, image = layered(guides=guides)
    noise = rms(image.radiance - truth)
    assert rms(denoise_image(image, method) - truth) < noise / factor
    assert rms(denoise(image.radiance, image.stderr, method) - truth) > noise / 2


def of_few_subpaths(image, seed=7):
    """The image with a correction of a sample in one pixel of each block of 2 x 2, which weighs four times there."""
    taken = np.zeros(image.correction.shape[:2], np.float32)
    rows, cols = (side // 2 for side in taken.shape)
    which = np.random.default_rng(seed).integers(0, 4, (rows, cols))
    taken[2 * np.arange(rows)[:, None] + which // 2, 2 * np.arange(cols) + which % 2] = 4.0
    correction = taken[..., None] * image.correction
    radiance = image.radiance - image.correction + correction
    return SimpleNamespace(**vars(image) | {"radiance": radiance, "correction": correction, "subpaths": 0.25})


@pytest.mark.parametrize("guides", [False, True])
def test_a_correction_of_few_subpaths_errs_less_at_half_its_size(guides):
    """The mean of both signs stays within three standard errors of the samples' own."""
    needs("oidn")
    truth, image = layered(guides=guides)
    image = of_few_subpaths(image)
    half = denoise_image(image, "oidn")
    whole = denoise_image(SimpleNamespace(**vars(image) | {"subpaths": np.inf}), "oidn")
    assert rms(half - truth) < 0.9 * rms(whole - truth)
    off = (image.correction - (truth - image.radiance + image.correction)).reshape(-1, 3)
    assert (np.abs((half - image.radiance).mean((0, 1))) < 3.0 * off.std(0) / np.sqrt(len(off))).all()


def test_half_the_size_is_means_of_blocks_and_comes_back_interpolated():
    rng = np.random.default_rng(8)
    image = rng.random((7, 10, 3), np.float32)
    small, large = wp.zeros((4, 5), dtype=wp.vec3, device="cpu"), wp.zeros((7, 10), dtype=wp.vec3, device="cpu")
    arrays = on("cpu", image=image)
    wp.launch(halve, small.shape, [arrays["image"], small], device="cpu")
    blocks = np.array([[image[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].mean((0, 1)) for j in range(5)] for i in range(4)])
    np.testing.assert_allclose(small.numpy(), blocks, rtol=1e-6)
    wp.launch(add_enlarged, large.shape, [small, large], device="cpu")
    at = np.meshgrid(*((np.arange(side) + 0.5) / 2 - 0.5 for side in large.shape), indexing="ij")
    expected = [map_coordinates(blocks[..., c], at, order=1, mode="nearest") for c in range(3)]
    np.testing.assert_allclose(large.numpy(), np.moveaxis(expected, 0, -1), rtol=1e-5)


def squares(shape, bright, dark):
    """Squares of six pixels in turn, float32 [H, W, 3]."""
    y, x = np.indices(shape) // 6
    return np.where((x + y)[..., None] % 2 == 0, np.float32(bright), np.float32(dark)) * np.ones(3, np.float32)


def guided(base, level, albedo, direct):
    """Image of ``base`` under a correction with the mean ``level``, with guides of which ``direct`` counts."""
    k = 0.5
    correction = np.random.default_rng(2).gamma(k, level / k).astype(np.float32)
    image = SimpleNamespace(
        snow=None,
        radiance=base + correction,
        correction=correction,
        subpaths=np.inf,
        stderr=level / np.float32(np.sqrt(k)),
        base_variance=np.zeros_like(base),
    )
    inputs = on(
        "cpu", direct=direct, radiance=image.radiance, correction=correction, albedo=albedo, normal=np.zeros_like(base)
    )
    weighed = on("cpu", albedo=albedo, normal=albedo)
    wp.launch(weigh_guides, base.shape[:2], [*inputs.values()], [*weighed.values()], device="cpu")
    return SimpleNamespace(**vars(image), **{name: guide.numpy() for name, guide in weighed.items()})


def test_a_texture_that_water_hides_draws_nothing_into_the_correction():
    """The light has no squares, the surface behind the water has. Its albedo at full strength would draw 45 % of it.

    What is left is within 4 standard errors of what noise does to means of the squares.
    """
    pytest.importorskip("pyoidn")
    shape = (96, 128)
    flat, albedo = np.ones((*shape, 3), np.float32), squares(shape, 0.8, 0.16)
    image = guided(0.5 * flat, 0.3 * flat, albedo, direct=0.0 * flat)
    hidden = denoise_image(image, "oidn") - 0.5
    drawn = part_denoised(image.correction, albedo=albedo, normal=0.0 * flat)
    bright = albedo > 0.5
    contrast = [(c[bright].mean() - c[~bright].mean()) / 0.3 for c in (hidden, drawn)]
    assert abs(contrast[0]) < 4.0 * np.sqrt(2.0 / 0.5 * 2.0 / albedo.size)
    assert contrast[1] > 0.3


def test_a_texture_that_is_seen_keeps_its_edges_in_the_correction():
    """All light of the base comes from surfaces, and the correction has the same squares under strong noise."""
    pytest.importorskip("pyoidn")
    base = squares((96, 128), 1.0, 0.2)
    image = guided(base, 0.3 * base, 0.8 * base, direct=base)
    truth = 1.3 * base
    unguided = SimpleNamespace(**vars(image) | {"albedo": None})
    assert rms(denoise_image(image, "oidn") - truth) < 0.7 * rms(denoise_image(unguided, "oidn") - truth)


def test_a_guide_is_half_albedo_and_half_the_base_over_itself_plus_its_mean():
    base = np.float32([[[0.0, 1.0, -1.0], [4.0, 3.0, 1.0]]])  # means of what is positive: 2, 2 and 0.5
    albedo, normal = np.full_like(base, 0.6), np.zeros_like(base)
    for scale in (1.0, 1e-30):
        arrays = on("cpu", base=np.float32(scale) * base, albedo=albedo, normal=normal)
        guides = Denoiser(Launcher("cpu"))._correction_guides(**arrays)
        expected = 0.3 + 0.5 * np.float32([[[0.0, 1 / 3, 0.0], [2 / 3, 0.6, 2 / 3]]])
        np.testing.assert_allclose(guides["albedo"].numpy(), expected, rtol=1e-6)
        assert guides["normal"] is arrays["normal"]


@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_what_is_not_correction_passes_to_the_bit(method):
    """Whatever lies under a correction, the denoiser adds the same to it; without a correction nothing changes."""
    needs(method)
    truth, image = layered()
    base = np.random.default_rng(3).integers(1, 1 << 12, truth.shape).astype(np.float32) / 2**10
    coarse = np.round(image.correction * 2**12) / 2**12  # sums with it are exact
    one = SimpleNamespace(**vars(image) | {"correction": coarse, "radiance": coarse + 4.0})
    two = SimpleNamespace(**vars(image) | {"correction": coarse, "radiance": coarse + 4.0 + base})
    np.testing.assert_allclose(denoise_image(two, method) - denoise_image(one, method), base, atol=2e-6, rtol=0)
    none = SimpleNamespace(**vars(image) | {"correction": 0 * image.correction})
    assert denoise_image(none, method).tobytes() == none.radiance.tobytes()


@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_negative_values_do_not_brighten_the_image(method):
    """Where the correction takes away as much as it gives, what is denoised is noise around zero.

    Its mean stays within 4 standard errors and 1 % of what is given; clipped, it would be too bright by two thirds.
    """
    needs(method)
    rng = np.random.default_rng(7)
    shape, spp = (120, 160, 3), 4
    k = spp / SPREAD**2
    correction = (0.05 * (rng.gamma(k, 1 / k, shape) - rng.gamma(k, 1 / k, shape))).astype(np.float32)
    image = SimpleNamespace(
        snow=None,
        radiance=np.float32(1.0) + correction,
        stderr=np.full(shape, 0.05 * SPREAD, np.float32),
        correction=correction,
        subpaths=np.inf,
        base_variance=np.zeros(shape, np.float32),
        albedo=None,
        normal=None,
    )
    error = correction.std() / np.sqrt(correction.size)
    bias = denoise_image(image, method).mean(dtype=np.float64) - image.radiance.mean(dtype=np.float64)
    assert abs(bias) < 4 * error + 0.01 * 0.05
    assert np.maximum(correction, 0).mean() - correction.mean() > 0.03


@pytest.mark.parametrize("level", [0.2, -0.2])
@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_a_constant_correction_stays_constant(method, level):
    """Away from the border, where the networks see the black beyond it: up to a fifth is lost in the last pixels."""
    needs(method)
    correction = np.full((32, 48, 3), level, np.float32)
    stderr = np.full_like(correction, 0.01)
    image = SimpleNamespace(
        snow=None,
        radiance=1 + correction,
        stderr=stderr,
        correction=correction,
        subpaths=np.inf,
        base_variance=np.zeros_like(stderr),
        albedo=None,
        normal=None,
    )
    inside = np.s_[8:-8, 8:-8]
    np.testing.assert_allclose(denoise_image(image, method)[inside] - 1, correction[inside], rtol=0.02)
    np.testing.assert_allclose(denoise_image(image, method) - 1, correction, rtol=0.3)


def test_an_image_without_a_correction_is_denoised_as_a_whole():
    _, noisy, stderr = scene()
    image = SimpleNamespace(
        snow=None, radiance=noisy, stderr=stderr, correction=None, base_variance=None, albedo=None, normal=None
    )
    for method in ("oidn", "nlm", "none"):
        needs(method)
        assert denoise_image(image, method).tobytes() == denoise(noisy, stderr, method).tobytes()


def test_of_b_the_light_on_surfaces_is_denoised_and_no_texture_blurs():
    """Dividing by the albedo and multiplying again is all that an albedo without normals does."""
    needs("oidn")
    _, light, stderr = scene()
    rng = np.random.default_rng(5)
    albedo = rng.uniform(0.002, 1.0, light.shape).astype(np.float32)
    black = rng.random(light.shape[:2]) < 0.1
    albedo[black] = 0.0
    known = {"snow": None, "stderr": stderr, "correction": None, "base_variance": None, "normal": None}
    image = SimpleNamespace(radiance=albedo * light, albedo=albedo, **known)
    light[black] = 0.0
    plain = SimpleNamespace(radiance=light, albedo=None, **known)
    expected = np.maximum(albedo, LEAST_ALBEDO) * denoise_image(plain, "oidn")
    np.testing.assert_allclose(denoise_image(image, "oidn"), expected, rtol=2e-3, atol=1e-5)


def test_the_result_is_never_negative_and_none_changes_nothing():
    _, image = layered()
    image.radiance = image.radiance - 0.5
    assert denoise_image(image, "nlm").min() == 0.0
    assert denoise_image(image, "none").tobytes() == image.radiance.tobytes()


def test_corrections_that_are_not_finite_and_unknown_methods_are_refused():
    _, image = layered()
    with pytest.raises(ValueError, match="must be oidn, nlm or none"):
        denoise_image(image, "blur")
    image.correction[3, 4, 1] = np.inf
    for method in ("oidn", "nlm"):
        with pytest.raises(ValueError, match="1 values are not finite"):
            denoise_image(image, method)


# ------------------------------------------------------------------------------------------------------ on a device


def on(device, **images):
    return {name: wp.array(image, dtype=wp.vec3, device=device) for name, image in images.items() if image is not None}


def device_denoised(denoiser, image):
    names = ("radiance", "correction", "base_variance", "albedo", "normal")
    return denoiser.denoise(**on(denoiser.device, **{name: getattr(image, name) for name in names})).numpy()


def kinds_of_images():
    """With a correction, with guides, plain, black, and of another size."""
    for how in ({}, {"guides": True}, {"shape": (45, 77), "seed": 4}):
        yield layered(**how)[1]
    yield SimpleNamespace(
        snow=None, radiance=scene()[1], stderr=scene()[2], correction=None, base_variance=None, albedo=None, normal=None
    )
    yield SimpleNamespace(**vars(layered()[1]) | {"correction": np.zeros((96, 128, 3), np.float32)})
    _, image = layered(guides=True)
    image.base_variance = image.stderr**2
    image.base_variance[:, ::5] = 0.0
    yield image
    yield SimpleNamespace(**vars(image) | {"base_variance": np.full_like(image.stderr, np.inf)})


@pytest.fixture(scope="module")
def cpu_denoiser():
    pytest.importorskip("pyoidn")
    return Denoiser(Launcher("cpu"))


def by_package(image, quality, albedo=None, normal=None):
    """What the package ``pyoidn`` makes of what is positive of an image, at a mean near 1."""
    import pyoidn

    image = np.maximum(image, np.float32(0.0))
    if not image.any():
        return image
    scale = np.float32(2.0 ** -np.round(np.log2(image.mean(dtype=np.float64))))
    guides = {} if albedo is None else {"albedo": albedo, "normal": normal}
    return pyoidn.denoise(scale * image, hdr=True, quality=quality, clean_aux=bool(guides), **guides) / scale


def around(image, side):
    """Means over squares, cut by the edges of the image."""

    def mean(values):
        return uniform_filter(values, (side, side, 1), mode="constant")

    return mean(image.astype(np.float64)) / mean(np.ones(image.shape))


def in_numpy(image):
    """What the kernels do, in numpy and float64 where they are."""
    if image.correction is None:
        return by_package(image.radiance, QUALITY, image.albedo, image.normal)
    base = image.radiance - image.correction
    clean = by_package(base, PART_QUALITY)
    apart = around((base - clean).astype(np.float64) ** 2, NEAR)
    with np.errstate(invalid="ignore"):  # infinite variance
        noise = np.maximum(around(image.base_variance, NEAR), around(image.base_variance, FAR))
        share = np.divide(apart - noise, apart, out=np.zeros_like(apart), where=apart > noise)
    result, guides = clean + share.astype(np.float32) * (base - clean), {}
    if image.albedo is not None:
        light = np.maximum(result, 0.0)
        shown = light / (light + light.mean((0, 1), np.float64).astype(np.float32))
        guides = {"albedo": np.float32(0.5) * (image.albedo + shown), "normal": image.normal}
    for sign in (1.0, -1.0):
        result += np.float32(sign) * by_package(np.float32(sign) * image.correction, PART_QUALITY, **guides)
    return np.maximum(result, 0.0)


def test_kernels_denoise_as_numpy_and_the_package_do(cpu_denoiser):
    """To the last digits: the same network, and the same powers of two before and after it."""
    for image in kinds_of_images():
        if not np.isinf(image.base_variance if image.correction is not None else 0.0).any():
            expected = in_numpy(image)
            for found in (device_denoised(cpu_denoiser, image), denoise_image(image, "oidn")):
                np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)


def test_a_base_of_which_nothing_is_known_is_what_the_denoiser_left(cpu_denoiser):
    *_, image = kinds_of_images()
    image.correction = 0.0 * image.correction
    np.testing.assert_allclose(
        device_denoised(cpu_denoiser, image), by_package(image.radiance, PART_QUALITY), rtol=1e-6
    )


def test_images_that_threads_denoise_side_by_side_have_the_bytes_of_each_by_itself():
    """As those that write do on a CPU."""
    pytest.importorskip("pyoidn")
    images = [*kinds_of_images()] * 2
    with ThreadPoolExecutor(4) as pool:
        for image, found in zip(images, pool.map(lambda image: denoise_image(image, "oidn"), images), strict=True):
            assert found.tobytes() == denoise_image(image, "oidn").tobytes()


@pytest.mark.parametrize(("device", "kept"), [("cpu", 0), pytest.param("cuda:0", 4, marks=pytest.mark.gpu)])
def test_a_gpu_keeps_one_filter_for_each_size_and_kind_and_a_cpu_none(device, kept):
    pytest.importorskip("pyoidn")
    denoiser = Denoiser(Launcher(device))
    for _ in range(2):
        for image in kinds_of_images():
            device_denoised(denoiser, image)
        assert len(denoiser.filters._kept) == kept


def test_the_unit_of_light_does_not_matter_on_a_device(cpu_denoiser):
    _, image = layered()
    expected = device_denoised(cpu_denoiser, image)
    for scale in (np.float32(2.0**-40), np.float32(2.0**40)):
        image.radiance, image.correction = (scale * layered()[1].radiance, scale * layered()[1].correction)
        np.testing.assert_allclose(device_denoised(cpu_denoiser, image) / scale, expected, rtol=1e-5)


def oidn_through_host(color):
    """What Open Image Denoise makes of an image on the first CUDA device, copied there and back."""
    import pyoidn

    height, width, _ = color.shape
    device = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CUDA)
    device.commit()
    there, back = (pyoidn.Buffer(device, color.nbytes, pyoidn.OIDN_STORAGE_DEVICE) for _ in range(2))
    there.write(0, color.nbytes, np.ascontiguousarray(color).reshape(-1).view(np.uint8))
    filter = pyoidn.Filter(device, "RT")
    filter.set_image("color", there, pyoidn.OIDN_FORMAT_FLOAT3, width, height)
    filter.set_image("output", back, pyoidn.OIDN_FORMAT_FLOAT3, width, height)
    filter.set_bool("hdr", True)
    filter.set_quality(pyoidn.OIDN_QUALITY_HIGH)
    filter.commit()
    filter.execute()
    assert device.get_error() is None
    result = np.empty(color.size, np.float32)
    back.read(0, color.nbytes, result.view(np.uint8))
    for held in (filter, there, back, device):
        held.release()
    return result.reshape(color.shape)


POSE = transform(euler_to_matrix((-30, 0, 0)), [0.0, 0.0, 0.0])


def rough_scene(material):
    """A box on a floor before two lamps; small, for it is rendered."""
    return scene_from_dict(
        {
            "water": {
                "coefficients": {
                    "sigma_s": [0.00175, 0.01825, 0.043125],
                    "sigma_a": [0.12325, 0.039739, 0.0],
                    "phase": {"g": 0.8},
                }
            },
            "vehicle": {
                "lights": [{"kind": "spot", "position": [x, -0.1, 0.0], "direction": [0, 1, 0]} for x in (-0.15, 0.15)],
                "cameras": [{"id": "M0", "resolution": [32, 20], "sensor_mm": [4.416, 2.76]}],
            },
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "materials": {"a": material},
        }
    )


def floor_and_box(material):
    floor = trimesh.creation.box((20, 20, 1)).apply_translation((0, 0, -2.0))
    box = trimesh.creation.box((0.6, 0.6, 0.6)).apply_translation((0.2, 2.2, -1.2))
    return [
        Part(name, np.asarray(mesh.vertices), np.asarray(mesh.faces, np.int32), material)
        for name, mesh in (("floor", floor), ("box", box))
    ]


PLAIN = {"kind": "diffuse", "reflectance": [0.4, 0.3, 0.2]}


@pytest.fixture(scope="module")
def renderers():
    """Of a plain and of a textured scene."""
    scenes = [rough_scene(kind) for kind in (PLAIN, {"kind": "rust", "base": [0.6, 0.4, 0.1], "amount": 0.4})]
    return [FrameRenderer(scene, "cpu", floor_and_box(scene.materials["a"])) for scene in scenes]


@pytest.mark.parametrize("spp", [0.25, 4])
@pytest.mark.parametrize("method", ["oidn", "nlm", "none"])
def test_a_renderer_denoises_as_its_image_is_denoised_later(renderers, method, spp):
    needs(method)
    for renderer in renderers:
        how = {"integrator": "field", "denoise": method, "denoise_b": method}
        frame = renderer.render(POSE, outputs="AB", spp=spp, spp_b=4, **how)
        assert (frame.A.subpaths < HALF_BELOW) == (spp < 1)
        for image in (frame.A, frame.B):
            assert image.denoised.tobytes() == denoise_image(image, method).tobytes()


def test_an_image_tells_how_many_subpaths_it_is_of(renderers, monkeypatch):
    """Those that its film counts, by block; as many as samples without the field, and none without light of theirs."""
    counts, develop = [], RadianceRenderer._developed
    monkeypatch.setattr(
        RadianceRenderer,
        "_developed",
        lambda self, films, kinds=(): (counts.append(films[-1].count.numpy()), develop(self, films, kinds))[1],
    )
    for spp in (0.5, 1.5, 4):
        image = renderers[0].render(POSE, outputs="A", spp=spp, integrator="field").A
        assert image.subpaths == pytest.approx(counts[-1].mean() / IN_BLOCK, rel=1e-12)
    assert renderers[0].render(POSE, outputs="A", spp=3, integrator="path").A.subpaths == 3
    assert renderers[0].render(POSE, outputs="A", spp=3, layers=("direct",)).A.subpaths == np.inf
    assert renderers[0].render(POSE, outputs="A", spp=2, integrator="reference").A.subpaths == np.inf


def test_nothing_is_denoised_unless_asked_for_and_unknown_methods_are_bad_input(renderers):
    frame = renderers[0].render(POSE, outputs="AB", spp=2, spp_b=2, integrator="field")
    assert frame.A.denoised is None
    assert frame.B.denoised is None
    for key in ("denoise", "denoise_b"):
        with pytest.raises(InputError, match="blur"):
            renderers[0].render(POSE, outputs="A", **{key: "blur"})


def test_guides_of_a_count_as_much_as_light_comes_from_surfaces(renderers):
    """By the share of direct light in all but the correction; the rest is the water's, of albedo 1 and no normal."""
    for renderer in renderers:
        frame = renderer.render(POSE, outputs="ABC", spp=2, integrator="field", layers=LAYERS)
        image, hit = frame.A, np.any(frame.C.normal != 0, axis=-1)
        base = image.radiance - image.correction
        share = np.divide(image.layers["direct"], base, out=np.zeros_like(base), where=base > 0).clip(0, 1)
        assert share[hit].max() > 0.05
        np.testing.assert_allclose(image.normal, share.mean(-1, keepdims=True) * frame.C.normal, atol=1e-6)
        assert (image.albedo[~hit] == 1.0).all()
        np.testing.assert_array_less(1.0 - share - 1e-6, image.albedo)
        seen = share > 0.02
        np.testing.assert_array_less(image.albedo[seen], 1.0)


def test_only_the_field_guides_and_only_what_takes_guides(renderers):
    """Without the field the base is noise itself; non-local means look at nothing else than the image."""
    for how in ({"integrator": "path"}, {"denoise": "nlm"}, {"denoise": "none"}):
        image = renderers[1].render(POSE, outputs="A", **{"spp": 2, "integrator": "field"} | how).A
        assert image.albedo is None
        assert image.normal is None


def test_the_albedo_that_guides_b_has_edges_as_smooth_as_the_image():
    """On a box alone every place sees the open sky, so that B is the albedo of its samples."""
    pytest.importorskip("pyoidn")
    scene_ = rough_scene(PLAIN)
    box = floor_and_box(scene_.materials["a"])[1:]
    image = FrameRenderer(scene_, "cpu", box).render(POSE, outputs="B", spp_b=4, denoise_b="oidn").B
    assert np.array_equal(image.radiance, image.albedo)
    red = image.albedo[..., 0]
    assert ((red > 0.41) & (red < 0.99)).any()


@pytest.mark.parametrize("integrator", ["field", "path"])
def test_the_correction_of_paths_is_part_of_the_scattered_layers(renderers, integrator):
    assert renderers[0].render(POSE, outputs="A", spp=2, integrator=integrator).A.correction.any()
    image = renderers[0].render(POSE, outputs="A", spp=2, integrator=integrator, layers=("direct",)).A
    assert not image.correction.any()


def test_the_reference_has_no_correction(renderers):
    assert renderers[0].render(POSE, outputs="A", spp=2, integrator="reference").A.correction is None


def test_the_correction_of_paths_without_the_field_is_their_multiple_layer(renderers):
    image = renderers[0].render(POSE, outputs="A", spp=2, integrator="path", layers=("direct", "single", "multiple")).A
    assert image.correction.tobytes() == image.layers["multiple"].tobytes()


@pytest.mark.gpu
def test_a_renderer_on_a_gpu_denoises_as_the_host_does():
    """Half floats there: 2^-11 in each of some sixteen layers of the network adds up to 0.2 % (rms).

    Of the largest value.
    """
    pytest.importorskip("pyoidn")
    for kind in (PLAIN, {"kind": "rust", "amount": 0.4}):
        scene_ = rough_scene(kind)
        renderer = FrameRenderer(scene_, "cuda:0", floor_and_box(scene_.materials["a"]))
        frame = renderer.render(POSE, outputs="AB", spp=4, integrator="field", denoise="oidn", denoise_b="oidn")
        for image in (frame.A, frame.B):
            expected = denoise_image(image, "oidn")
            assert rms(image.denoised - expected) < 2e-3 * expected.max()


@pytest.mark.gpu
def test_a_gpu_denoises_as_the_package_does_through_the_host():
    """The same network on the same device, so within the rounding of half floats in which it works, 2^-11."""
    pytest.importorskip("pyoidn")
    _, noisy, stderr = scene(shape=(180, 320))
    scale = 2.0 ** -np.round(np.log2(noisy.mean(dtype=np.float64)))
    expected = oidn_through_host(np.float32(scale) * noisy) / np.float32(scale)
    image = SimpleNamespace(
        snow=None, radiance=noisy, stderr=stderr, correction=None, base_variance=None, albedo=None, normal=None
    )
    np.testing.assert_allclose(device_denoised(Denoiser(Launcher("cuda:0")), image), expected, rtol=2**-11)


@pytest.mark.gpu
def test_a_gpu_denoises_as_the_cpu_does():
    """Half floats there, floats here: what they differ by is less than a tenth of the error that is left."""
    pytest.importorskip("pyoidn")
    denoiser = Denoiser(Launcher("cuda:0"))
    for guides in (False, True):
        for seed in range(3):  # the filters are used again
            truth, image = layered(seed=seed, guides=guides, shape=(180, 320))
            expected = denoise_image(image, "oidn")
            off = rms(device_denoised(denoiser, image) - expected)
            assert off < 0.1 * rms(expected - truth)


@pytest.mark.gpu
@pytest.mark.parametrize("integrator", ["field", "path"])
def test_what_stays_on_a_gpu_changes_nothing_in_the_denoised_image(integrator):
    pytest.importorskip("pyoidn")
    scene_ = rough_scene({"kind": "rust", "amount": 0.4})
    renderer = FrameRenderer(scene_, "cuda:0", floor_and_box(scene_.materials["a"]))
    how = {"outputs": "AB", "spp": 4, "integrator": integrator, "denoise": "oidn", "denoise_b": "oidn"}
    whole, brief, both = (
        renderer.render(POSE, copied=copied, **how) for copied in (None, ["denoised"], ["radiance", "denoised"])
    )
    for one, other, third in ((whole.A, brief.A, both.A), (whole.B, brief.B, both.B)):
        assert other.radiance is None is third.stderr
        assert one.spp == other.spp == third.spp
        np.testing.assert_array_equal(third.radiance, one.radiance)
        np.testing.assert_array_equal(third.denoised, other.denoised)
        np.testing.assert_allclose(other.denoised, one.denoised, rtol=2**-11)  # half floats in the network


# ------------------------------------------------------------------------------------------------- what is sharp stays


def mix(smooth, noisy, variance):
    """As a base is mixed."""
    launcher, arrays = Launcher("cpu"), on("cpu", smooth=smooth, noisy=noisy, variance=variance)
    mixed = wp.zeros_like(arrays["smooth"])
    launcher.rows(add_mixed, mixed.shape, {**arrays, "near": NEAR, "far": FAR, "image": mixed})
    return mixed.numpy()


def mirrored(sigma=0.2, spp=16, seed=2):
    """Truth with points of light, a noisy image, what a denoiser might leave of the truth, and the noise's variance."""
    rng = np.random.default_rng(seed)
    truth = np.full((96, 128, 3), 1.0, np.float32)
    truth[8::16, 8::16] = 9.0
    noisy = truth + (sigma * rng.normal(size=(spp, *truth.shape)) * np.sqrt(truth)).astype(np.float32)
    variance = noisy.var(axis=0, ddof=1) / spp
    return truth, noisy.mean(axis=0), uniform_filter(truth, (5, 5, 1)), variance


def test_mixing_by_the_variance_leaves_less_error_than_either_image():
    """About points that a denoiser has spread they come back; where it was right, it stays so.

    There the noise explains nearly all that is between the two: what chance adds to it over 3 x 3 pixels brings back a
    part of the noise, less than half of it.
    """
    truth, noisy, smooth, variance = mirrored()
    mixed = mix(smooth, noisy, variance)
    assert rms(mixed - truth) < 0.2 * rms(smooth - truth)
    flat = uniform_filter(truth, (7, 7, 1)) == 1.0
    assert flat.mean() > 0.5
    assert rms((mixed - truth)[flat]) < 0.5 * rms((noisy - truth)[flat])
    np.testing.assert_allclose(mixed[8::16, 8::16], noisy[8::16, 8::16], rtol=0.02)


@pytest.mark.parametrize("spp", [8, 32])
@pytest.mark.parametrize(
    "draw",
    [
        lambda rng, shape: 0.5 + 0.5 * (rng.random(shape) < 0.005) / 0.005,
        lambda rng, shape: rng.lognormal(-1.125, 1.5, shape),
    ],
    ids=["rare", "lognormal"],
)
def test_mixing_does_not_darken_what_few_bright_samples_light(draw, spp):
    """Mean 1, half of it from one sample in 200, or lognormal; the denoised image is right.

    Where no bright sample came, mean and variance are both too low: with the variance of 3 x 3 pixels alone a third of
    the light was lost. What is left is within 3 % of the light and the standard error of the noisy mean.
    """
    rng = np.random.default_rng(5)
    samples = draw(rng, (spp, 96, 128, 3))
    noisy, variance = samples.mean(axis=0), samples.var(axis=0, ddof=1) / spp
    mixed = mix(np.ones_like(noisy), noisy, variance)
    assert abs(mixed.mean() - 1.0) < 0.03 + 3.0 * np.sqrt(variance.mean() / variance.size)
    assert rms(mixed - 1.0) < 0.3 * rms(noisy - 1.0)


def test_mixing_leaves_alone_what_is_not_known_and_what_is_certain():
    truth, noisy, smooth, variance = mirrored()
    variance[:, :64] = np.inf
    assert mix(smooth, noisy, variance)[:, :64].tobytes() == smooth[:, :64].tobytes()
    np.testing.assert_allclose(mix(smooth, noisy, 0.0 * truth), noisy, rtol=1e-6)


@pytest.mark.parametrize("method", ["oidn", "nlm"])
def test_a_noisy_base_is_denoised_where_it_is_noisy_and_keeps_its_detail_where_it_is_not(method):
    """Gamma noise of four samples on the left half of the base, a texture that is certain on the right.

    Chance brings a part of the noise back, less than half of it.
    """
    needs(method)
    truth, image = layered()
    _, width, _ = truth.shape
    rng = np.random.default_rng(11)
    base = image.radiance - image.correction
    left = np.s_[:, : width // 2 - 8]
    base[left] = 0.5
    noisy = base.copy()
    noisy[left] *= rng.gamma(4.0, 0.25, noisy[left].shape)
    image.base_variance[left] = 0.5**2 / 4.0
    image.correction *= np.float32(0.0)
    image.radiance = noisy
    left_off, right_off = ((denoise_image(image, method) - base)[part] for part in (left, np.s_[:, width // 2 + 8 :]))
    assert rms(left_off) < rms((noisy - base)[left]) / 2.0
    assert rms(right_off) < 1e-6
