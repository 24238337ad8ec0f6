"""Grids that do not say where they lie, PNG, TIFF and NPY, take their place and heights from keys of the scene."""

import numpy as np
import pytest
import tifffile
from PIL import Image

from varos_warp.errors import InputError
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.geometry.survey import read_survey

GREY = np.array([[0, 51, 102], [153, 204, 255]])


def read(path, **keys):
    return read_survey(Heights(kind="heights", file=str(path), **keys))


def refusal(path, **keys):
    with pytest.raises(InputError) as caught:
        read(path, **keys)
    return caught.value


def save(path, values):
    if path.suffix == ".npy":
        np.save(path, values)
    elif path.suffix == ".png":
        Image.fromarray(values).save(path)
    else:
        tifffile.imwrite(path, values, metadata=None, photometric="minisblack")
    return path


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_black_and_white_have_the_heights_that_are_given(tmp_path, ending, dtype):
    path = save(tmp_path / f"a.{ending}", (GREY * (np.iinfo(dtype).max // 255)).astype(dtype))
    survey = read(path, pixel_m=2.0, height_range_m=[-40.0, -20.0])
    expected = [[-2, 1, -40], [0, 1, -36], [2, 1, -32], [-2, -1, -28], [0, -1, -24], [2, -1, -20]]
    np.testing.assert_allclose(survey.vertices, expected, atol=1e-12)
    deep_white = read(path, pixel_m=2.0, height_range_m=[-20.0, -40.0], height_offset_m=1.0)
    np.testing.assert_allclose(deep_white.vertices[:, 2], -20.0 + 1.0 - 4.0 * np.arange(6), atol=1e-12)


@pytest.mark.parametrize("ending", ["png", "tif"])
def test_steps_of_grey_are_multiplied(tmp_path, ending):
    path = save(tmp_path / f"a.{ending}", (GREY * 200).astype(np.uint16))
    survey = read(path, pixel_m=1.0, height_scale=0.01, positive="down", height_offset_m=-5.0)
    np.testing.assert_allclose(survey.vertices[:, 2], -5.0 - 2.0 * GREY.ravel())


@pytest.mark.parametrize("ending", ["png", "tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_grey_that_may_mean_anything_is_asked_for(tmp_path, ending, dtype):
    error = refusal(save(tmp_path / f"a.{ending}", GREY.astype(dtype)), pixel_m=1.0)
    assert error.key == "terrain.height_scale"
    assert "height_range_m" in error.remedy


@pytest.mark.parametrize(("first_row", "north"), [("north", 0), ("south", 1)])
def test_the_first_row_lies_where_it_is_said_to(tmp_path, first_row, north):
    survey = read(save(tmp_path / "a.npy", GREY.astype(float)), pixel_m=[3.0, 2.0], first_row=first_row)
    northern = survey.vertices[survey.vertices[:, 1] == 1.0]
    assert northern[np.argsort(northern[:, 0])].tolist() == [
        [-3, 1, GREY[north, 0]],
        [0, 1, GREY[north, 1]],
        [3, 1, GREY[north, 2]],
    ]


def test_an_array_does_not_say_which_row_is_north(tmp_path):
    assert refusal(save(tmp_path / "a.npy", GREY.astype(float)), pixel_m=1.0).key == "terrain.first_row"


@pytest.mark.parametrize("dtype", ["<f4", ">f8", "<f2", "<i4", ">u2"])
def test_arrays_of_numbers_are_heights(tmp_path, dtype):
    path = save(tmp_path / "a.npy", np.asfortranarray(GREY.astype(dtype)))
    survey = read(path, pixel_m=1.0, first_row="north")
    assert survey.vertices[:, 2].tolist() == GREY.ravel().tolist()


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((2, 2, 3)),
        np.zeros(4),
        np.zeros((2, 2), complex),
        np.array([["a", "b"]]),
        np.zeros((2, 2), [("x", float)]),
    ],
    ids=["3d", "1d", "complex", "text", "records"],
)
def test_other_arrays_are_refused(tmp_path, values):
    assert "not heights on a grid" in refusal(save(tmp_path / "a.npy", values), pixel_m=1.0, first_row="north").message


def test_objects_and_archives_are_not_unpacked(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[{}, None]]), allow_pickle=True)
    assert "cannot be read" in refusal(tmp_path / "a.npy", pixel_m=1.0, first_row="north").message
    with (tmp_path / "b.npy").open("wb") as file:
        np.savez(file, z=GREY)
    assert "archive" in refusal(tmp_path / "b.npy", pixel_m=1.0, first_row="north").message


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "P", "1"])
def test_coloured_pictures_are_refused(tmp_path, mode):
    Image.fromarray(GREY.astype(np.uint8)).convert(mode).save(tmp_path / "a.png")
    assert "not heights" in refusal(tmp_path / "a.png", pixel_m=1.0, height_scale=1.0).message


def test_a_picture_of_another_format_with_the_ending_of_a_png_is_refused(tmp_path):
    Image.fromarray(GREY.astype(np.uint8)).save(tmp_path / "a.png", format="JPEG")
    assert "cannot be read as a PNG" in refusal(tmp_path / "a.png", pixel_m=1.0, height_scale=1.0).message


@pytest.mark.parametrize("name", ["a.png", "a.npy", "a.tif"])
def test_more_heights_than_the_limit_are_refused(tmp_path, monkeypatch, name):
    monkeypatch.setenv("VAROS_WARP_MAX_HEIGHTS", "5")
    path = save(tmp_path / name, GREY.astype(np.uint16))
    keys = {"first_row": "north"} if name == "a.npy" else {"height_scale": 1.0}
    assert "VAROS_WARP_MAX_HEIGHTS=6" in refusal(path, pixel_m=1.0, **keys).message


def test_a_range_of_heights_is_for_grey_only(tmp_path):
    path = save(tmp_path / "a.tif", GREY.astype(np.float32))
    assert refusal(path, pixel_m=1.0, height_range_m=[0, 1]).key == "terrain.height_range_m"


@pytest.mark.parametrize("name", ["a.pgw", "a.PGW", "a.pngw", "a.wld"])
def test_a_world_file_beside_a_picture_tells_where_it_lies(tmp_path, name):
    path = save(tmp_path / "a.png", GREY.astype(np.uint8))
    (tmp_path / name).write_text("0.5\n0\n0\n-0.25\n400000\n6100000\n")
    survey = read(path, height_scale=1.0)
    assert survey.facts["extent_m"] == [400000.0, 6099999.75, 400001.0, 6100000.0]
    assert refusal(path, height_scale=1.0, pixel_m=0.5).key == "terrain.pixel_m"
    (tmp_path / name).write_text("0.5\n0\n0\n0\n400000\n6100000\n")
    assert "six numbers" in refusal(path, height_scale=1.0).message


@pytest.mark.parametrize(("dtype", "clear"), [(np.uint8, 102), (np.uint16, 102 * 200)])
def test_the_grey_that_a_picture_says_is_transparent_is_a_hole(tmp_path, dtype, clear):
    values = (GREY * (200 if dtype == np.uint16 else 1)).astype(dtype)
    Image.fromarray(values).save(tmp_path / "a.png", transparency=clear)
    survey = read(tmp_path / "a.png", pixel_m=1.0, height_scale=1.0)
    assert survey.facts["missing"] == 1
    assert survey.vertices[:, 2].tolist() == values[:, :2].ravel().tolist()


@pytest.mark.parametrize(
    ("zeros", "keys", "told"),
    [
        (3, {}, True),
        (3, {"nodata": 255.0}, False),
        (0, {}, False),
        (48, {}, False),
        (5, {"height_scale": 2.0}, True),
        (5, {"height_range_m": [-9.0, -1.0]}, True),
    ],
)
def test_many_values_of_zero_are_asked_about(tmp_path, zeros, keys, told):
    values = np.arange(10, 40, dtype=np.uint8).reshape(5, 6)
    values.ravel()[:zeros] = 0
    path = save(tmp_path / "a.png", values)
    keys = keys if "height_range_m" in keys else {"height_scale": 1.0, **keys}
    found = [note for note in read(path, pixel_m=1.0, **keys).warnings if "give nodata: 0" in note]
    assert len(found) == told


def test_heights_that_are_all_above_zero_are_asked_about(tmp_path):
    path = save(tmp_path / "a.npy", GREY + 5.0)
    place = {"pixel_m": 1.0, "first_row": "north"}
    assert any("if they are depths, give positive: down" in words for words in read(path, **place).warnings)
    for keys in ({"positive": "up"}, {"positive": "down"}, {"origin": [0, 0, 30]}, {"height_offset_m": -300.0}):
        assert not any("depths" in words for words in read(path, **place, **keys).warnings)
