"""Images of a scene: read once, decoded, resized, and refused with one message where they cannot be used."""

import numpy as np
import pytest
from PIL import Image

from varos_warp.errors import InputError
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.images import linear
from varos_warp.scene.materials.textures import (
    Textures,
    bake_ground,
    ground_resolution,
    ground_tile,
    read_image,
    tile_pyramid,
)


def scene(tmp_path, **texture):
    block = {"kind": "slope_blend", "flat": texture}
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "resolution": 9, "material": "ground"},
            "materials": {"ground": block},
            "vehicle": {"cameras": [{"resolution": [320, 180]}]},
            "trajectory": {"poses": [{"position": [0, 0, 3]}]},
        },
        tmp_path,
    )


def save(path, values, **options):
    Image.fromarray(np.asarray(values)).save(path, **options)
    return path


def test_srgb_is_decoded(tmp_path):
    """IEC 61966-2-1: code 188 is 0.5029, code 10 still on the straight part."""
    path = save(tmp_path / "a.png", np.array([[[188, 10, 255], [0, 128, 64]]], np.uint8))
    expected = [[0.502887, 10 / 255 / 12.92, 1.0], [0.0, 0.215861, 0.051269]]
    np.testing.assert_allclose(read_image(path)[0], expected, atol=1e-6)


@pytest.mark.parametrize("mode", ["L", "RGBA", "P", "CMYK", "LA", "1", "I;16"])
def test_images_of_every_mode_come_as_three_linear_channels(tmp_path, mode):
    if mode == "I;16":
        image = Image.fromarray(np.full((4, 4), 65535, np.uint16))
    else:
        image = Image.new("RGB", (4, 4), (255, 255, 255)).convert(mode)
    image.save(tmp_path / "a.tif")
    read = read_image(tmp_path / "a.tif")
    assert read.shape == (4, 4, 3)
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, 1.0, atol=0.01)


def test_pictures_keep_their_size(tmp_path):
    values = np.random.default_rng(1).integers(0, 256, (100, 300, 3)).astype(np.uint8)
    np.testing.assert_array_equal(read_image(save(tmp_path / "a.png", values)), linear(values))


def test_missing_and_damaged_images_and_folders_are_refused_by_name(tmp_path):
    good = save(tmp_path / "good.png", np.random.default_rng(1).integers(0, 255, (64, 64, 3)).astype(np.uint8))
    (tmp_path / "cut.png").write_bytes(good.read_bytes()[:-4000])
    (tmp_path / "text.jpg").write_text("no image")
    (tmp_path / "empty.png").write_bytes(b"")
    (tmp_path / "folder.png").mkdir()
    for name, problem in {
        "nowhere.png": "no such image",
        "cut.png": "cannot be read",
        "text.jpg": "cannot be read",
        "empty.png": "cannot be read",
        "folder.png": "folder",
    }.items():
        s = scene(tmp_path, texture=name)
        parts = build_parts(s)
        with pytest.raises(InputError, match=problem) as caught:
            DeviceScene(s, parts, "cpu")
        assert caught.value.file == tmp_path / name
        assert caught.value.key == "materials.ground.flat.texture"
        assert caught.value.remedy


def test_an_image_file_lies_beside_the_scene_file_and_is_uploaded_once(tmp_path):
    save(tmp_path / "a.png", np.full((16, 16, 3), 100, np.uint8))
    s = scene(tmp_path, texture="a.png")
    textures = Textures(s, "cpu")
    one, two = (textures.tile("a.png", "key", size) for size in (1.0, 2.0))
    assert one.texels.ptr == two.texels.ptr
    assert one.width == 16


def test_ground_is_seeded_periodic_and_made_once():
    rock = bake_ground("rock", 256)
    np.testing.assert_array_equal(rock, bake_ground("rock", 256))
    assert ground_tile("rock", 256) is ground_tile("rock", 256)
    for kind in ("sand", "rock"):
        tile = bake_ground(kind, 512)
        assert np.all((tile >= 0.0) & (tile <= 1.0))
        inside = np.abs(np.diff(tile, axis=1)).mean()
        for across in (tile[:, 0] - tile[:, -1], tile[0] - tile[-1]):
            assert np.abs(across).mean() == pytest.approx(inside, rel=0.15)
    assert bake_ground("sand", 512).mean() > 1.2 * bake_ground("rock", 512).mean()


def test_the_resolution_follows_from_the_tile_and_the_pixel():
    assert ground_resolution(1.2, 1 / 985) == 1024
    assert ground_resolution(2.0, 1 / 985) == 2048
    assert ground_resolution(0.01, 1e-3) == 1024
    assert ground_resolution(1e4, 1e-3) == 2048


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 1), (3, 5)])
def test_the_smallest_images_are_tiles_too(shape):
    pyramid = tile_pyramid(np.full((*shape, 3), 0.3, np.float32), 1)
    np.testing.assert_allclose(pyramid.colours @ pyramid.basis.T, 0.3, atol=1e-6)


def test_a_tile_of_one_colour_stays_that_colour():
    pyramid = tile_pyramid(np.full((8, 8, 3), (0.1, 0.2, 0.3)))
    np.testing.assert_allclose(
        pyramid.colours @ pyramid.basis.T, np.broadcast_to((0.1, 0.2, 0.3), (4, 512, 3)), atol=1e-6
    )
    assert pyramid.texels.nbytes == 4 * (64 + 16 + 4 + 1)
