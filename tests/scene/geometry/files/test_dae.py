"""COLLADA as programs write it: their own placings of textures, ways of transparency, sets that nothing binds."""

import re

import pytest
from made_meshes import SAMPLER, UV
from mesh_cases.colours import TEXTURE, dae_board
from mesh_cases.table import dae_file, is_quarters, loaded

from varos_warp.errors import InputError
from varos_warp.scene.geometry.files.dae import read_dae
from varos_warp.scene.geometry.mesh_files import load_mesh

EXTRA = '<texture texture="a" texcoord="U"><extra><technique profile="MAYA">{}</technique></extra></texture>'


@pytest.mark.parametrize(
    ("inside", "told"),
    [
        ("<wrapU sid='w'>TRUE</wrapU><repeatU>1</repeatU><offsetV>0.0</offsetV><mirrorU>FALSE</mirrorU>", None),
        ("<repeatU>2</repeatU><repeatV>1</repeatV>", "repeatU"),
        ("<offsetU>0.5</offsetU>", "offsetU"),
        ("<rotateUV>90</rotateUV>", "rotateUV"),
        ("<wrapV>FALSE</wrapV>", "wrapV"),
    ],
)
def test_placings_of_a_program_are_told_where_they_place_anything(tmp_path, inside, told):
    mesh, words = loaded(dae_board(tmp_path, EXTRA.format(inside), SAMPLER.format("")))
    is_quarters(mesh)
    assert words == ([] if told is None else [f"what its <extra> says of where textures lie is not read: {told}"])


@pytest.mark.parametrize(
    ("mode", "colour", "weight", "is_opaque"),
    [
        ("", "1 1 1 1", "1", True),
        ("", "1 1 1 0.5", "1", False),
        ("", "1 1 1 1", "0.5", False),
        ('opaque="A_ONE"', "0 0 0 1", "1", True),
        ('opaque="RGB_ZERO"', "0 0 0 1", "1", True),
        ('opaque="RGB_ZERO"', "0.5 0.5 0.5 1", "1", False),
        ('opaque="RGB_ZERO"', "1 1 1 1", "0", True),
        ('opaque="A_ZERO"', "1 1 1 0", "1", True),
        ('opaque="A_ZERO"', "1 1 1 1", "1", False),
        ('opaque="RGB_ONE"', "1 1 1 0", "1", True),
        ('opaque="RGB_ONE"', "1 0 1 1", "1", False),
    ],
)
def test_transparency_is_told_in_every_mode(tmp_path, mode, colour, weight, is_opaque):
    """As the table of "Determining transparency" in COLLADA 1.5 has it."""
    extra = (
        f"<transparent {mode}><color>{colour}</color></transparent><transparency><float>{weight}</float></transparency>"
    )
    told = loaded(dae_board(tmp_path, "<color>1 1 1 1</color>", extra=extra))[1]
    assert told == ([] if is_opaque else ["it has transparent materials, which are opaque here"])


def test_a_texture_that_takes_no_one_of_several_sets_is_told(tmp_path):
    mesh, told = loaded(dae_board(tmp_path, TEXTURE, SAMPLER.format(""), second=0 * UV))
    is_quarters(mesh)
    assert len(told) == 1
    assert "which of the 2 sets" in told[0]


def test_a_document_that_shows_no_scene_is_refused_for_that(tmp_path):
    path = dae_board(tmp_path, "<color>1 1 1 1</color>")
    dae_file(tmp_path, path.read_text().replace('<scene><instance_visual_scene url="#s"/></scene>', ""))
    with pytest.raises(InputError, match="no <scene>"):
        load_mesh(path)


@pytest.mark.parametrize(
    ("axis", "up", "told"),
    [
        ("Z_UP", "z", []),
        ("z_up", "z", []),
        (" X_Up ", "x", []),
        ("UP_Z", "y", ["asset.up_axis is 'UP_Z', which COLLADA does not have: Y_UP is taken"]),
    ],
)
def test_the_up_axis_may_be_in_small_letters(tmp_path, axis, up, told):
    path = dae_board(tmp_path, "<color>1 1 1 1</color>")
    text = re.sub("<up_axis>.*?</up_axis>", f"<up_axis>{axis}</up_axis>", path.read_text())
    assert axis in text
    path.write_text(text)
    file = read_dae(path, with_colours=True)
    assert (file.up_axis, file.notes) == (up, told)
