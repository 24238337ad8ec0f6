"""OFF whose colours are not where, or not what, its header says."""

import numpy as np
import pytest
from made_meshes import BOARD
from mesh_cases.table import is_colour, is_grey, loaded, off

from varos_warp.scene.images import srgb_to_linear

RING = [[0, 1, 2, 3]]


@pytest.mark.parametrize(
    ("head", "tail"), [("OFF", " 255 0 0"), ("NOFF", " 0 0 1 255 0 0 255"), ("STOFF", " 0 0 1 0 0")]
)
def test_numbers_behind_vertices_without_colours_are_told(tmp_path, head, tail):
    mesh, told = loaded(off(tmp_path, BOARD, RING, head, tail))
    is_grey(mesh)
    assert told == [f"numbers behind its vertices are left out: colours need a C in the header ({head})"]


@pytest.mark.parametrize(("head", "tail"), [("OFF", ""), ("NOFF", " 0 0 1"), ("STOFF", " 0 0")])
def test_vertices_as_the_header_has_them_are_read_without_a_word(tmp_path, head, tail):
    assert loaded(off(tmp_path, BOARD, RING, head, tail))[1] == []


@pytest.mark.parametrize(("head", "vertex", "face"), [("COFF", " 1 0 1 1", ""), ("OFF", "", " 1 0 1")])
def test_whole_colours_none_above_1_are_taken_as_real_numbers(tmp_path, head, vertex, face):
    """As 8 bits they would be black."""
    mesh, told = loaded(off(tmp_path, BOARD, RING, head, vertex, face))
    is_colour([1, 0, 1])(mesh)
    assert told == ["its colours are whole numbers, but none is above 1: they are taken as real numbers of 0..1"]


def test_black_is_read_without_a_word_of_bits(tmp_path):
    mesh, told = loaded(off(tmp_path, BOARD, RING, "COFF", " 0 0 0 255", ""))
    is_colour([0, 0, 0])(mesh)
    assert not any("whole numbers" in words for words in told)


@pytest.mark.parametrize(
    ("head", "vertex", "face"), [("COFF", " 2 0 0 255", ""), ("COFF", " 1 0 0 255", ""), ("OFF", "", " 1 0 0 255")]
)
def test_colours_near_black_are_of_8_bits_where_a_number_or_an_alpha_says_so(tmp_path, head, vertex, face):
    mesh, told = loaded(off(tmp_path, BOARD, RING, head, vertex, face))
    first = int((vertex or face).split()[0])
    is_colour(srgb_to_linear(np.array([first, 0, 0]) / 255.0))(mesh)
    assert told == []
