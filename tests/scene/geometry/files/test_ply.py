"""PLY as programs write it: strips with textures, names in capitals, colours of odd types, faces without texture."""

import numpy as np
import pytest
from made_meshes import BOARD, UV, picture, ply, rows
from mesh_cases.table import RING, XYZ, is_colour, is_quarters, loaded, ply_file

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.images import srgb_to_linear

TEXTURED = "comment TextureFile q.png\n"


def painted(kind, values, names=("red", "green", "blue")):
    """The board, whose vertices have a colour."""
    text = "\n".join(f"{x} {y} {z} {values}" for x, y, z in BOARD)
    return ply(XYZ + "".join(f",{kind} {name}" for name in names), text, RING, "4 0 1 2 3")


def test_strips_have_their_texture(tmp_path):
    (tmp_path / "q.png").write_bytes(picture())
    text = (
        ply(
            f"{XYZ},float s,float t",
            rows(np.column_stack([BOARD, UV])),
            RING,
            "0",
            comments=TEXTURED,
            more="element tristrips 1\nproperty list int int vertex_indices\n",
        )
        + "4 0 1 3 2\n"
    )
    mesh, told = loaded(ply_file(tmp_path, text))
    assert told == []
    is_quarters(mesh)


def test_names_may_be_in_capitals(tmp_path):
    text = painted("uchar", "255 0 0", ("Red", "Green", "Blue")).replace("vertex_indices", "Vertex_Indices")
    mesh, told = loaded(ply_file(tmp_path, text.replace("double x", "double X")))
    assert told == []
    is_colour([1, 0, 0])(mesh)


def test_a_name_that_is_known_goes_before_one_in_capitals(tmp_path):
    text = painted("double", "7", ("X",))
    np.testing.assert_allclose(np.ptp(loaded(ply_file(tmp_path, text))[0].vertices, axis=0), [2, 2, 0])


@pytest.mark.parametrize("kind", ["int", "uint", "ushort", "short"])
def test_colours_of_many_bits_none_of_which_is_above_255_are_of_8(tmp_path, kind):
    mesh, told = loaded(ply_file(tmp_path, painted(kind, "188 137 0")))
    is_colour(srgb_to_linear(np.array([188, 137, 0]) / 255.0))(mesh)
    assert len(told) == 1
    assert "none is above 255" in told[0]


def test_black_in_many_bits_is_black_without_a_word(tmp_path):
    path = ply_file(tmp_path, painted("ushort", "0 0 0") + "")
    assert not any("above 255" in words for words in loaded(path)[1])


@pytest.mark.parametrize("name", ["ambient_red", "f_dc_0", "colour", "Specular_Blue", "rgb"])
def test_properties_like_colours_that_are_not_read_are_told(tmp_path, name):
    _, told = loaded(ply_file(tmp_path, painted("float", "1", (name,))))
    assert told == [f"properties with names of colours are not read: vertex {name.lower()}"]


@pytest.mark.parametrize("name", ["confidence", "predicted", "nx", "alpha", "radius"])
def test_other_properties_are_left_out_without_a_word(tmp_path, name):
    assert loaded(ply_file(tmp_path, painted("float", "1", (name,))))[1] == []


def test_colours_of_corners_are_told(tmp_path):
    """As MeshLab writes them ("wedge colors")."""
    text = ply(XYZ, rows(BOARD), f"{RING},list uchar float color", "4 0 1 2 3 12 " + "1 " * 12)
    assert loaded(ply_file(tmp_path, text))[1] == ["properties with names of colours are not read: face color"]


def test_colours_of_faces_go_before_those_of_vertices(tmp_path):
    text = (
        painted("uchar", "0 0 255")
        .replace(
            "vertex_indices\n",
            "vertex_indices\n" + "".join(f"property uchar {name}\n" for name in ("red", "green", "blue")),
        )
        .replace("4 0 1 2 3", "4 0 1 2 3 255 0 0")
    )
    mesh, told = loaded(ply_file(tmp_path, text))
    is_colour([1, 0, 0])(mesh)
    assert told == ["the colours of its faces go before those of its vertices"]


def test_the_header_ends_at_its_own_line(tmp_path):
    text = ply(XYZ, rows(BOARD), RING, "4 0 1 2 3", comments="comment see end_header below\nobj_info end_header\n")
    assert len(loaded(ply_file(tmp_path, text))[0].faces) == 2


def test_faces_with_texture_minus_1_have_none(tmp_path):
    (tmp_path / "q.png").write_bytes(picture())
    both = np.concatenate([BOARD, BOARD + [3, 0, 0]])
    text = ply(
        XYZ,
        rows(both),
        f"{RING},list uchar float texcoord,int texnumber",
        "4 0 1 2 3 8 0 0 1 0 1 1 0 1 0\n4 4 5 6 7 8 0 0 1 0 1 1 0 1 -1",
        comments=TEXTURED,
    )
    mesh, told = loaded(ply_file(tmp_path, text))
    assert told == []
    is_quarters(mesh)
    is_colour([0.5] * 3, 3.3, 0.1)(mesh)
    with pytest.raises(InputError, match="texture -2 of 1"):
        load_mesh(ply_file(tmp_path, text.replace(" -1", " -2")))


def test_a_texture_of_an_old_encoding_is_found_by_its_bytes(tmp_path):
    text = ply(
        f"{XYZ},float s,float t",
        rows(np.column_stack([BOARD, UV])),
        RING,
        "4 0 1 2 3",
        comments="comment TextureFile gr\xfcn.png\n",
    )
    path = tmp_path / "m.ply"
    path.write_bytes(text.encode("latin1"))
    (tmp_path / b"gr\xfcn.png".decode("utf-8", "surrogateescape")).write_bytes(picture())
    mesh, told = loaded(path)
    assert told == []
    is_quarters(mesh)


@pytest.mark.parametrize("kind", ["int", "uint"])
def test_colours_of_32_bits_none_of_which_is_above_65535_are_of_16(tmp_path, kind):
    mesh, told = loaded(ply_file(tmp_path, painted(kind, "65535 32768 0")))
    is_colour(srgb_to_linear(np.array([65535, 32768, 0]) / 65535.0))(mesh)
    assert told == ["its colours are stored in 32 bits, but none is above 65535: they are taken as such of 16 bits"]


def test_colours_of_32_bits_above_65535_have_their_whole_range(tmp_path):
    mesh, told = loaded(ply_file(tmp_path, painted("uint", "4294967295 65536 0")))
    is_colour(srgb_to_linear(np.array([1.0, 65536 / 4294967295, 0.0])))(mesh)
    assert told == []


def test_rows_behind_those_that_the_header_counts_are_told(tmp_path):
    text = ply(XYZ, rows(BOARD), RING, "3 0 1 2")
    mesh, told = loaded(ply_file(tmp_path, text + "3 0 2 3\n"))
    assert len(mesh.faces) == 1
    assert told == ["4 words behind the rows that its header counts are left out"]


@pytest.mark.parametrize(
    ("tail", "told"),
    [(b"", []), (b"\n", []), (b"\0" * 13, ["13 bytes behind the rows that its header counts are left out"])],
)
def test_bytes_behind_a_binary_body_are_told(tmp_path, tail, told):
    head, _, _ = ply(XYZ, rows(BOARD), RING, "3 0 1 2").partition("end_header\n")
    body = BOARD.astype("<f8").tobytes() + b"\3" + np.array([0, 1, 2], "<i4").tobytes()
    path = tmp_path / "m.ply"
    path.write_bytes((head.replace("ascii", "binary_little_endian") + "end_header\n").encode() + body + tail)
    assert loaded(path)[1] == told
