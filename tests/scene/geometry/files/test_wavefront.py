"""OBJ and MTL as programs write them: names with # or of old encodings, backslashes, masks, colours, odd numbers."""

import os
import sys
import time

import numpy as np
import pytest
from made_meshes import BOARD, QUARTERS, UV, picture
from mesh_cases.colours import masked_picture
from mesh_cases.table import QUAD, VT, V, is_colour, is_quarters, loaded, obj
from PIL import Image

from varos_warp.errors import InputError
from varos_warp.scene.geometry.files.named import named_by
from varos_warp.scene.geometry.files.obj import read_obj
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.images import srgb_to_linear

USED = V + VT + "usemtl a\n" + QUAD


# --------------------------------------------------------------------------------------------------------------- names


@pytest.mark.parametrize(
    ("defined", "used"),
    [("red#1", "red#1"), ("red #1", "red #1"), ("red", "red # the hull"), ("red # of the hull", "red")],
)
def test_names_may_hold_a_hash_and_a_comment_may_follow_them(tmp_path, defined, used):
    library = f"newmtl {defined}\nKd 1 0 0 # red\nnewmtl red#2\nKd 0 1 0\n"
    mesh, told = loaded(obj(tmp_path, V + f"usemtl {used}\nf 1 2 3 4 # all\n", library))
    assert told == []
    is_colour([1, 0, 0])(mesh)


def test_a_library_may_have_a_hash_in_its_name(tmp_path):
    (tmp_path / "m#1.mtl").write_text("newmtl a\nKd 1 0 0\n")
    path = obj(tmp_path, "mtllib m#1.mtl\n" + V + "usemtl a\nf 1 2 3 4\n")
    is_colour([1, 0, 0])(loaded(path)[0])
    assert named_by(path) == [tmp_path / "m#1.mtl"]


def test_a_comment_that_ends_in_a_backslash_swallows_nothing(tmp_path):
    text = "# from C:\\\n" + V + "o C:\\models\\\nusemtl a\nf 1 2 3 \\\n  4 # all\n"
    mesh, told = loaded(obj(tmp_path, text, "# in C:\\\nnewmtl a\\\nKd 1 0 \\\n 0\n".replace("a\\", "a")))
    assert told == []
    assert len(mesh.faces) == 2
    is_colour([1, 0, 0])(mesh)


def test_a_material_whose_name_ends_in_a_backslash_keeps_its_colour(tmp_path):
    mesh, told = loaded(obj(tmp_path, V + "usemtl C:\\x\\\nf 1 2 3 4\n", "newmtl C:\\x\\\nKd 1 0 0\n"))
    assert told == []
    is_colour([1, 0, 0])(mesh)


@pytest.mark.skipif(sys.platform == "win32", reason="names of files are no bytes there")
def test_names_of_old_encodings_are_found_by_their_bytes_and_told_as_text(tmp_path):
    """Two materials whose names differ only in such a byte stay two."""
    folder = os.fsencode(tmp_path) + b"/"
    with open(folder + b"gr\xfcn.png", "wb") as file:
        file.write(picture())
    library = b"newmtl s\xfc\nKd 0 1 0\nnewmtl s\xf6\nmap_Kd gr\xfcn.png\nnewmtl b\nmap_Kd wei\xdf.png\n"
    with open(folder + b"h\xfclle.mtl", "wb") as file:
        file.write(library)
    path = tmp_path / "m.obj"
    body = V + VT + "".join(f"v {x + 3} {y} {z}\n" for x, y, z in BOARD)
    path.write_bytes(
        b"mtllib h\xfclle.mtl\n"
        + body.encode()
        + b"usemtl s\xf6\n"
        + QUAD.encode()
        + b"usemtl b\nf 5/1 6/2 7/3\nusemtl \xe9\nf 5 7 8\n"
    )
    mesh, told = loaded(path)
    is_quarters(mesh)
    assert any(r"map_Kd wei\xdf.png is not there (wei\xdf.png)" in words for words in told)
    assert any(r"no library has the material \xe9" in words for words in told)
    assert "".join(told).encode("utf-8")  # fit to be written
    assert os.fsencode(named_by(path)[1].name) == b"gr\xfcn.png"


def test_a_material_that_no_library_has_is_told_whatever_there_is(tmp_path):
    for folder, library in enumerate([None, "", "newmtl b\nKd 1 0 0\n"]):
        (tmp_path / str(folder)).mkdir()
        _, told = loaded(obj(tmp_path / str(folder), V + "usemtl a\nf 1 2 3 4\n", library))
        assert len(told) == 1
        assert " a: what " in told[0]
        assert told[0].endswith("colour is grey") or told[0].endswith("colours is grey")


def test_a_material_without_a_colour_is_told(tmp_path):
    _, told = loaded(obj(tmp_path, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nNs 10\n"))
    assert told == ["no Kd or map_Kd of a: what it colours is grey"]


def test_long_lines_take_no_long(tmp_path):
    """Blanks in a row: a time that grows with the square of the length would be minutes."""
    blanks = " " * 300_000
    path = obj(tmp_path, f"mtllib m.mtl{blanks}x\n" + V + f"usemtl a{blanks}\nf 1 2 3{blanks}4\n# {blanks}x\n")
    start = time.process_time()
    loaded(path)
    named_by(path)
    assert time.process_time() - start < 5.0


# --------------------------------------------------------------------------------------------------------------- masks


def test_a_mask_without_a_texture_cuts_holes_into_the_plain_colour(tmp_path):
    (tmp_path / "d.png").write_bytes(picture(np.array([[[0] * 3, [255] * 3], [[255] * 3, [255] * 3]])))
    mesh, told = loaded(obj(tmp_path, USED, "newmtl a\nKd 0.8 0.1 0.2\nmap_d d.png\n"))
    assert mesh.skin.has_holes
    alpha = mesh.skin.pages[0].alpha
    assert (alpha[4, 4], alpha[-4, 4]) == (0, 255)
    is_colour([0.8, 0.1, 0.2], 0.5, 0.5)(mesh)
    assert "read as a mask" in told[0]
    assert tmp_path / "d.png" in named_by(tmp_path / "m.obj")


LEVELS = {"r": 120, "g": 100, "b": 50, "m": 25}


@pytest.mark.parametrize(
    ("option", "expected"),
    [
        ("", 25),
        ("-imfchan m", 25),
        ("-imfchan r", 120),
        ("-imfchan g", 100),
        ("-imfchan b", 50),
        ("-imfchan l", round(0.299 * 120 + 0.587 * 100 + 0.114 * 50)),
    ],
)
def test_a_mask_is_the_channel_that_it_names_or_its_alpha(tmp_path, option, expected):
    """Brightness is that of ITU-R BT.601, as Pillow documents its mode L."""
    (tmp_path / "d.png").write_bytes(picture(np.array([[list(LEVELS.values())]])))
    mesh, _ = loaded(obj(tmp_path, USED, f"newmtl a\nmap_Kd q.png\nmap_d {option} d.png\n"))
    np.testing.assert_allclose(mesh.skin.pages[0].alpha, expected, atol=1.0)


def test_a_mask_whose_alpha_is_opaque_is_its_brightness(tmp_path):
    (tmp_path / "d.png").write_bytes(picture(np.array([[[90, 90, 90, 255]]])))
    mesh, _ = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd q.png\nmap_d d.png\n"))
    np.testing.assert_allclose(mesh.skin.pages[0].alpha, 90, atol=1.0)


def test_a_picture_may_mask_itself(tmp_path):
    (tmp_path / "p.png").write_bytes(picture(masked_picture()))
    mesh, _ = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd p.png\nmap_d p.png\n"))
    alpha = mesh.skin.pages[0].alpha
    assert (alpha[4, 4], alpha[-4, 4]) == (0, 255)


def test_depth_as_a_mask_is_told(tmp_path):
    _, told = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd q.png\nmap_d -imfchan z q.png\n"))
    assert "not modelled of m.mtl: -imfchan z of map_d" in told


def test_of_two_masks_the_one_that_is_not_read_is_told(tmp_path):
    _, told = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd q.png\nmap_d q.png\nmap_Tr q.png\n"))
    assert "not modelled of m.mtl: map_d beside map_Tr" in told


def test_options_of_a_mask_that_differ_are_told(tmp_path):
    for number, options in enumerate(("-s 2 2", "-o 0.5", "-clamp on")):
        (tmp_path / str(number)).mkdir()
        _, told = loaded(obj(tmp_path / str(number), USED, f"newmtl a\nmap_Kd q.png\nmap_d {options} q.png\n"))
        assert any("map_d and map_Kd of a differ" in words for words in told)
    (tmp_path / "same").mkdir()
    _, told = loaded(obj(tmp_path / "same", USED, "newmtl a\nmap_Kd -s 2 2 q.png\nmap_d -s 2 2 q.png\n"))
    assert not any("differ" in words for words in told)


def test_a_mask_may_have_tiles(tmp_path):
    for tile, level in ((1001, 255), (1002, 0)):
        (tmp_path / f"d.{tile}.png").write_bytes(picture(np.full((1, 1, 3), level)))
        (tmp_path / f"t.{tile}.png").write_bytes(picture(QUARTERS))
    text = V + VT + "".join(f"v {x + 3} {y} {z}\n" for x, y, z in BOARD)
    text += "".join(f"vt {u + 1} {v}\n" for u, v in UV)
    text += "usemtl a\n" + QUAD + "f 5/5 6/6 7/7 8/8\n"
    for colour in ("map_Kd t.<UDIM>.png\n", "Kd 1 0 0\n"):
        path = obj(tmp_path, text, f"newmtl a\n{colour}map_d d.<UDIM>.png\n")
        skin = loaded(path)[0].skin
        page = skin.page[2:]
        assert (skin.pages[page[0]].alpha == 0).all()
        assert all(tmp_path / f"d.{tile}.png" in named_by(path) for tile in (1001, 1002))


def test_a_mask_that_is_not_there_leaves_the_texture(tmp_path):
    mesh, told = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd q.png\nmap_d gone.png\n"))
    is_quarters(mesh)
    assert not mesh.skin.has_holes
    assert any("mask of map_Kd q.png is not there (gone.png)" in words for words in told)


def test_a_map_without_a_name_is_left_out(tmp_path):
    mesh, told = loaded(obj(tmp_path, USED, "newmtl a\nKd 1 0 0\nmap_Kd\nmap_d  \n"))
    is_colour([1, 0, 0])(mesh)
    assert told == ["map_kd of m.mtl names no file, and is left out", "map_d of m.mtl names no file, and is left out"]


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("Ke 1 0 0", "emission"),
        ("Ke 0 0 0", None),
        ("map_Ke q.png", "emission"),
        ("Pm 1.0", "metal"),
        ("Pm 0", None),
        ("Pr 0.3", "roughness"),
        ("map_Pr q.png", "roughness"),
        ("map_Pm q.png", "metal"),
    ],
)
def test_light_and_metal_of_a_material_are_told(tmp_path, line, told):
    _, words = loaded(obj(tmp_path, V + "usemtl a\nf 1 2 3 4\n", f"newmtl a\nKd 1 1 1\n{line}\n"))
    assert words == ([] if told is None else [f"not modelled of m.mtl: {told}"])


# ------------------------------------------------------------------------------------------------------------- numbers


def coloured(tail):
    """The board with numbers behind x, y, z."""
    return "".join(f"v {x} {y} {z} {tail}\n" for x, y, z in BOARD) + "f 1 2 3 4\n"


def test_seven_numbers_are_a_place_and_a_colour_with_alpha(tmp_path):
    mesh, told = loaded(obj(tmp_path, coloured("0.5 0.25 0 0.75")))
    is_colour(srgb_to_linear(np.array([0.5, 0.25, 0.0])))(mesh)
    assert told == ["its vertices of 7 numbers are taken as x y z r g b a, without the alpha"]


@pytest.mark.parametrize(
    ("tail", "told"),
    [("1", None), ("2", "weights"), ("1 1", "vertices of 5 numbers"), ("1 1 1 1 1", "vertices of 8 numbers")],
)
def test_other_numbers_behind_a_place_are_told(tmp_path, tail, told):
    mesh, words = loaded(obj(tmp_path, coloured(tail)))
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [2, 2, 0])
    assert [told in text for text in words] == ([] if told is None else [True])


@pytest.mark.parametrize("tail", ["", " nan nan nan"])
def test_vertices_without_colours_have_that_of_their_material(tmp_path, tail):
    """As of exporters that write colours for the objects that have them."""
    text = V.replace("\n", " 1 0 0\n") + "".join(f"v {x + 3} {y} {z}{tail}\n" for x, y, z in BOARD)
    mesh, told = loaded(obj(tmp_path, text + "usemtl a\nf 1 2 3 4\nf 5 6 7 8\n", "newmtl a\nKd 0 0.5 0\n"))
    is_colour([1, 0, 0])(mesh)
    is_colour([0, 0.5, 0], 3.3, 0.1)(mesh)
    assert "some of its vertices have no colour: they are grey, or as their material is" in told


def test_colours_of_vertices_are_there_where_the_texture_is_not(tmp_path):
    text = coloured("1 0 0").replace("f 1 2 3 4\n", VT + "usemtl a\n" + QUAD)
    mesh, told = loaded(obj(tmp_path, text, "newmtl a\nKd 0.5 0.5 0.5\nmap_Kd gone.png\n"))
    is_colour([1, 0, 0])(mesh)
    assert any("is not there" in words for words in told)


def test_keywords_in_capitals_are_told(tmp_path):
    with pytest.raises(InputError, match="keywords are in capitals"):
        load_mesh(obj(tmp_path, V.upper() + "F 1 2 3 4\n"))
    assert loaded(obj(tmp_path, V + "f 1 2 3\nF 1 3 4\n"))[1] == [
        "its lines that begin with F are left out: keywords of OBJ are small letters"
    ]


def test_a_mask_of_16_bits_has_its_channels(tmp_path):
    Image.fromarray(np.full((2, 2), 20000, np.uint16)).save(tmp_path / "d.png")
    mesh, _ = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd q.png\nmap_d -imfchan r d.png\n"))
    np.testing.assert_allclose(mesh.skin.pages[0].alpha, 20000 / 257, atol=1.0)


@pytest.mark.parametrize(
    ("tail", "expected"),
    [
        ("1.0000001 0.5 0", [1.0, 0.5, 0.0]),
        ("1.001 -1e-4 0", [1.0, 0.0, 0.0]),
        ("1 0 1", [1.0, 0.0, 1.0]),
        ("255 51 0", [1.0, 0.2, 0.0]),
        ("2 0 0", [2 / 255, 0.0, 0.0]),
    ],
)
def test_colours_are_0_to_1_or_whole_numbers_of_0_to_255(tmp_path, tail, expected):
    mesh, told = loaded(obj(tmp_path, coloured(tail)))
    is_colour(srgb_to_linear(np.array(expected)))(mesh)
    assert told == []


@pytest.mark.parametrize("tail", ["1.2 0.5 0", "1.002 0 0", "128.5 0 0", "256 0 0", "-0.1 0 0", "255 -1 0"])
def test_other_colours_are_refused_but_where_the_scene_has_a_material(tmp_path, tail):
    path = obj(tmp_path, coloured(tail))
    with pytest.raises(InputError, match=r"neither within 0\.\.1 nor whole numbers of 0\.\.255") as refusal:
        load_mesh(path, "objects.0.file")
    assert (refusal.value.file, refusal.value.key) == (path, "objects.0.file: v")
    assert len(read_obj(path, with_colours=False).pieces) == 1


def test_numbers_stay_in_the_line_that_has_them(tmp_path):
    """Lines of 6, 3, 9 and 6 numbers are 6 on average."""
    tails = (" 1 0 0", "", " 1 0 0 0 0 0", " 1 0 0")
    text = "".join(f"v {x} {y} {z}{tail}\n" for (x, y, z), tail in zip(BOARD, tails, strict=True)) + "f 1 2 3 4\n"
    mesh, told = loaded(obj(tmp_path, text))
    np.testing.assert_array_equal(np.unique(mesh.vertices, axis=0), np.unique(BOARD, axis=0))
    assert any("some of its vertices have no colour" in words for words in told)
    assert any("vertices of 9 numbers" in words for words in told)


def test_coordinates_of_a_texture_stay_in_their_line(tmp_path):
    """Lines of 2, 1, 3 and 2 numbers are 2 on average; v is 0 where it is missing."""
    lines = "vt 0 0\nvt 1\nvt 1 1 0\nvt 0 1\n"
    mesh, told = loaded(obj(tmp_path, V + lines + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd q.png\n"))
    assert told == []
    is_quarters(mesh)


def test_a_fourth_number_of_a_coordinate_is_told(tmp_path):
    lines = VT.replace("\n", " 0 7\n", 1)
    mesh, told = loaded(obj(tmp_path, V + lines + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd q.png\n"))
    assert told == ["it has texture coordinates (vt) of 4 numbers, of which the first 2 (u v) are taken"]
    is_quarters(mesh)


def test_a_place_of_two_numbers_is_refused(tmp_path):
    with pytest.raises(InputError, match="a vertex of 2 numbers: 1 2"):
        load_mesh(obj(tmp_path, "v 0 0 0\nv 1 2\nv 1 2 3 1\nf 1 2 3\n"))


def test_a_coordinate_without_numbers_is_refused(tmp_path):
    with pytest.raises(InputError, match="a texture coordinate of 0 numbers"):
        load_mesh(obj(tmp_path, V + "vt 0 0\nvt \n" + "usemtl a\nf 1/1 2/1 3/2\n", "newmtl a\nmap_Kd q.png\n"))


# ---------------------------------------------------------------------------------------------------------------- maps


def test_a_comment_may_follow_the_name_of_a_map(tmp_path):
    (tmp_path / "m.png").write_bytes(picture(masked_picture()))
    path = obj(tmp_path, USED, "newmtl a\nmap_Kd q.png # the colour\nmap_d m.png\t# mask\n")
    mesh, told = loaded(path)
    is_colour(QUARTERS[0, 1] / 255.0, 0.5, 0.5)(mesh)
    assert mesh.skin.has_holes
    assert not any("not there" in words for words in told)
    assert {tmp_path / "q.png", tmp_path / "m.png"} < {*named_by(path)}


def test_a_comment_may_follow_the_name_of_tiles(tmp_path):
    (tmp_path / "t.1001.png").write_bytes(picture())
    mesh, told = loaded(obj(tmp_path, USED, "newmtl a\nmap_Kd t.<UDIM>.png # tiles\n"))
    is_quarters(mesh)
    assert told == []


def test_a_picture_may_have_a_hash_behind_a_blank(tmp_path):
    path = obj(tmp_path, USED, "newmtl a\nmap_Kd q #1.png\n", name="q #1.png")
    (tmp_path / "q").write_bytes(b"no picture")
    is_quarters(loaded(path)[0])


@pytest.mark.parametrize(("tail", "expected"), [("", [0.5] * 3), (" 1 0 0", [1, 0, 0])])
def test_a_mask_cuts_where_the_picture_is_not_there(tmp_path, tail, expected):
    (tmp_path / "d.png").write_bytes(picture(np.array([[[0] * 3, [255] * 3], [[255] * 3, [255] * 3]])))
    text = V.replace("\n", f"{tail}\n") + VT + "usemtl a\n" + QUAD
    mesh, told = loaded(obj(tmp_path, text, "newmtl a\nKd 0.9 0.1 0.1\nmap_Kd gone.png\nmap_d d.png\n"))
    assert mesh.skin.has_holes
    alpha = mesh.skin.pages[0].alpha
    assert (alpha[4, 4], alpha[-4, 4]) == (0, 255)
    is_colour(expected, 0.5, 0.5)(mesh)
    assert any("map_Kd gone.png is not there" in words for words in told)
    assert not any("one colour" in words for words in told)


def test_transparency_of_a_map_is_the_reverse_of_its_opacity(tmp_path):
    """Tr = 1 - d."""
    (tmp_path / "d.png").write_bytes(picture(np.array([[[0] * 3, [255] * 3], [[255] * 3, [255] * 3]])))
    mesh, told = loaded(obj(tmp_path, USED, "newmtl a\nKd 1 1 1\nmap_Tr d.png\n"))
    alpha = mesh.skin.pages[0].alpha
    assert (alpha[4, 4], alpha[-4, 4]) == (255, 0)
    assert any(
        "map_Tr of m.mtl is read as a mask: holes where it" in words and "is above 0.5" in words for words in told
    )


@pytest.mark.parametrize(
    ("line", "told"),
    [("map_opacity q.png", ["not modelled of m.mtl: map_opacity"]), ("map_Ka q.png", []), ("map_aat on", [])],
)
def test_maps_of_other_names_are_told(tmp_path, line, told):
    assert loaded(obj(tmp_path, V + "usemtl a\nf 1 2 3 4\n", f"newmtl a\nKd 1 1 1\n{line}\n"))[1] == told


@pytest.mark.parametrize(("shift", "is_told"), [(-1, True), (0, False), (9, True)])
def test_coordinates_outside_of_all_tiles_are_told(tmp_path, shift, is_told):
    for tile in (1001, 1010):
        (tmp_path / f"t.{tile}.png").write_bytes(picture())
    lines = "".join(f"vt {u + shift + (shift > 0)} {v}\n" for u, v in UV)
    told = loaded(obj(tmp_path, V + lines + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd t.<UDIM>.png\n"))[1]
    assert any("outside of the tiles" in words for words in told) == is_told


@pytest.mark.parametrize("value", ["1e300", "-1e12"])
@pytest.mark.parametrize("name", ["q.png", "-clamp on q.png"])
def test_coordinates_too_far_away_to_tell_texels_apart_are_refused(tmp_path, value, name):
    path = obj(
        tmp_path, V + f"vt {value} 0\nvt 1 0\nvt 1 1\nvt 0 1\n" + "usemtl a\n" + QUAD, f"newmtl a\nmap_Kd {name}\n"
    )
    with pytest.raises(InputError, match="texture coordinates beyond"):
        load_mesh(path, "objects.0.file")
