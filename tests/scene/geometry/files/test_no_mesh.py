"""Files without a mesh under a mesh's name, and meshes without triangles, are refused for what they are."""

import pytest
from mesh_cases.table import obj

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import FORMATS, load_mesh

POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a2\nsize 12345\n"


@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize(
    ("text", "problem"),
    [(POINTER, "pointer of Git LFS"), ("\n<!DOCTYPE html>\n<html></html>", "web page"), ("<HTML></HTML>", "web page")],
)
def test_what_stands_in_for_a_mesh_is_refused_for_what_it_is(tmp_path, suffix, text, problem):
    path = tmp_path / f"m{suffix}"
    path.write_text(text)
    with pytest.raises(InputError, match=problem) as refusal:
        load_mesh(path, "objects.0.file")
    assert "objects.0.file" in refusal.value.message
    assert refusal.value.remedy


def test_vertices_that_are_not_finite_are_told_where_no_triangle_is_left(tmp_path):
    """A polygon that is not convex cannot be filled without them."""
    text = "v 0 0 0\nv 2 0 0\nv nan 1 0\nv 1 1 0\nv 0 2 0\nf 1 2 3 4 5\n"
    with pytest.raises(InputError, match=r"1 of .*vertices.* NaN"):
        load_mesh(obj(tmp_path, text, image=False))
