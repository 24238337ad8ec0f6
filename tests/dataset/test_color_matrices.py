"""Datasets of cameras with a colour matrix: 8 bits are sRGB, all that is linear is of the camera's channels."""

import shutil

import numpy as np
import pytest

from varos_warp.dataset.noise_pass import add_noise
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.dataset.validate import validate
from varos_warp.products.images.radiance import srgb_oetf
from varos_warp.scene.description.noise_profile import NoiseProfile
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.spectra.matrix import color_matrix

SENSOR = {"electrons_per_dn": 2.6, "bits": 12, "read_noise_electrons": 3.0}
"""Noise without vignetting, which would be darker."""


@pytest.fixture(autouse=True)
def stand_ins():
    """None here: images are the package's own."""


def scene_of(folder, matrix="auto", **render):
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "size_m": 20, "resolution": 17, "seed": 1},
            "objects": [{"kind": "color_chart", "position": [0, 1.0, 0.2], "scale": 2.0}],
            "water": {"spectral": {"jerlov": "IB"}},
            "vehicle": {
                "lights": [{"spectrum": "led_b4", "power_W": 20.0}],
                "cameras": [
                    {"id": "M0", "resolution": [48, 27], "response": "nikon_5100"}
                    | ({"color_matrix": matrix} if matrix else {})
                ],
            },
            "trajectory": {"poses": [{"position": [0, 0, 0.2]}]},
            "render": {"outputs": ["A", "B"], "spp": 1, "integrator": "path", "linear_exr": True, "denoise": "none"}
            | render,
        },
        folder,
    )


def made(folder, *arguments, seed=1, **render):
    scene = scene_of(folder, *arguments, **render).model_copy(update={"seed": seed})
    produce(scene, folder / "out", device="cpu", quiet=True)
    return scene, Dataset(folder / "out")


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return made(tmp_path_factory.mktemp("plain"), None)[1]


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    return made(tmp_path_factory.mktemp("matrix"))


def test_linear_images_are_the_same_and_8_bits_are_those_of_the_matrix(plain, own):
    scene, data = own
    matrix, (frame, raw) = color_matrix(scene, scene.vehicle.cameras[0]), (data[0], plain[0])
    np.testing.assert_array_equal(data.color_matrix(), matrix)
    assert plain.color_matrix() is None
    for letter in "AB":
        linear = data.linear(letter, 0)
        np.testing.assert_array_equal(linear, plain.linear(letter, 0))
        assert frame.gain(letter) == raw.gain(letter)
        exact = 255.0 * srgb_oetf(frame.gain(letter) * linear.astype(float) @ matrix.T)
        assert np.abs(data.pixels(letter, 0) - exact).max() < 0.5 + 1e-3
        assert np.abs(data.pixels(letter, 0).astype(int) - plain.pixels(letter, 0)).max() > 10
    np.testing.assert_array_equal(frame.A_stderr, raw.A_stderr)


def test_8_bits_become_the_camera_s_channels_again(own):
    """Where nothing is cut: to the rounding of 8 bits."""
    _, data = own
    pixels, linear = data.pixels("B", 0), data.linear("B", 0)
    whole = ((pixels > 5) & (pixels < 255)).all(axis=-1)
    assert whole.mean() > 0.2
    np.testing.assert_allclose(data.image("B", 0)[whole], linear[whole], atol=0.02)


def test_validate_finds_them_sound_and_those_without_the_matrix_not(own, plain, tmp_path):
    _, data = own
    assert validate(data.root).problems == []
    copied = shutil.copytree(data.root, tmp_path / "copy")
    (copied / "checksums").unlink()
    path = data.layout.image("M0", "A", 0).relative_to(data.root)
    shutil.copy(plain.root / path, copied / path)
    assert any("A" in problem for problem in validate(copied).problems)


@pytest.mark.parametrize("how", [{"dither": "tpdf"}, {"noise": SENSOR}], ids=["dither", "noise"])
def test_dither_and_noise_go_through_it_too(tmp_path, own, how):
    """A little else than without, in the mean of each channel: the matrix changes them by more than 3."""
    _, data = made(tmp_path, **how)
    assert validate(data.root).problems == []
    changed = data.pixels("A", 0).astype(int) - own[1].pixels("A", 0)
    assert changed.any()
    assert (np.abs(changed.mean(axis=(0, 1))) < 1.0).all()
    if "noise" in how:  # what is without it has the matrix as well
        np.testing.assert_array_equal(data.pixels("A", 0, truth=True), own[1].pixels("A", 0))


def test_noise_that_is_added_later_is_that_of_the_scene(tmp_path, own):
    noisy = add_noise(own[1].root, NoiseProfile(name="mine", camera=SENSOR), tmp_path / "noisy", seed=1, quiet=True)
    assert validate(noisy.root).problems == []
    _, same = made(tmp_path, noise=SENSOR, seed=1)
    np.testing.assert_array_equal(noisy.pixels("A", 0), same.pixels("A", 0))
