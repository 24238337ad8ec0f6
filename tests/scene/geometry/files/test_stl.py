"""STL files that break off, go on behind their end, or begin as the other kind does."""

import io

import numpy as np
import pytest
import trimesh
from made_meshes import BOARD, TWO
from mesh_cases.table import area, loaded

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import load_mesh

FACET = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {1} 0 0\nvertex {0} 1 0\nendloop\nendfacet\n"


def solids(*names):
    """A text of one triangle of half a square metre for each solid."""
    return "".join(f"solid {name}\n{FACET.format(2 * k, 2 * k + 1)}endsolid {name}\n" for k, name in enumerate(names))


def binary(header=b"", tail=b""):
    """The board of 4 m^2."""
    file = io.BytesIO()
    trimesh.Trimesh(BOARD, TWO, process=False).export(file, file_type="stl")
    return header.ljust(80, b" ") + file.getvalue()[80:] + tail


def saved(folder, data):
    path = folder / "m.stl"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


@pytest.mark.parametrize("names", [("a",), ("a", "b", ""), ("vertex 7", "facet loop", "solid endfacet")])
def test_a_text_has_all_its_solids_whatever_their_names(tmp_path, names):
    mesh, told = loaded(saved(tmp_path, solids(*names)))
    assert told == []
    assert area(mesh) == pytest.approx(0.5 * len(names))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_the_lines_of_a_text_end_as_on_any_system(tmp_path, end):
    mesh, told = loaded(saved(tmp_path, solids("a", "b").upper().replace("\n", end)))
    assert told == []
    assert area(mesh) == pytest.approx(1.0)


@pytest.mark.parametrize("line", range(2, 9))
def test_a_text_whose_second_solid_breaks_off_is_refused(tmp_path, line):
    """After every line of the second solid but its last."""
    first, second = solids("a"), solids("b").splitlines(keepends=True)
    with pytest.raises(InputError, match=r"begins|vertices is"):
        load_mesh(saved(tmp_path, first + "".join(second[:line])))


def test_a_text_that_breaks_off_within_a_number_is_refused(tmp_path):
    with pytest.raises(InputError, match="begins"):
        load_mesh(saved(tmp_path, solids("a", "b")[:-70]))


def test_a_text_with_a_quad_is_refused(tmp_path):
    with pytest.raises(InputError, match="count of vertices is 4, not 3"):
        load_mesh(saved(tmp_path, solids("a").replace("endloop", "vertex 1 1 0\nendloop")))


def test_a_text_with_a_facet_of_4_vertices_and_one_of_2_is_refused(tmp_path):
    first, second = solids("a"), solids("b")
    text = first.replace("endloop", "vertex 1 1 0\nendloop") + second.replace("vertex 1 0 0\n", "")
    with pytest.raises(InputError, match="count of vertices is 4, not 3"):
        load_mesh(saved(tmp_path, text))


def test_a_vertex_outside_of_all_facets_is_refused(tmp_path):
    with pytest.raises(InputError, match="vertex before its first facet"):
        load_mesh(saved(tmp_path, solids("a").replace("solid a\n", "solid a\nvertex 0 0 0\n", 1)))


def test_a_binary_file_may_begin_as_a_text_does(tmp_path):
    mesh, told = loaded(saved(tmp_path, binary(b"solid facet normal")))
    assert told == []
    assert area(mesh) == pytest.approx(4.0)


@pytest.mark.parametrize("header", [b"", b"solid a"])
def test_bytes_behind_the_triangles_are_told(tmp_path, header):
    mesh, told = loaded(saved(tmp_path, binary(header, b"\0" * 7)))
    assert area(mesh) == pytest.approx(4.0)
    assert told == ["7 bytes behind its 2 triangles are left out"]


@pytest.mark.parametrize("header", [b"", b"solid a"])
def test_a_binary_file_that_breaks_off_is_refused(tmp_path, header):
    with pytest.raises(InputError, match="says that it has 2 triangles, of which 1 are there"):
        load_mesh(saved(tmp_path, binary(header)[:-1]))


def test_a_binary_file_whose_count_was_never_written_is_refused(tmp_path):
    data = bytearray(binary())
    data[80:84] = bytes(4)
    with pytest.raises(InputError, match="says that it has 0 triangles, but 100 bytes follow"):
        load_mesh(saved(tmp_path, bytes(data)))


def test_places_are_those_of_the_file(tmp_path):
    mesh, _ = loaded(saved(tmp_path, solids("a", "b")))
    np.testing.assert_array_equal(np.unique(mesh.vertices[:, 0]), [0.0, 1.0, 2.0, 3.0])
