"""glTF files that are nearly right: what they lack is told or refused by name."""

import numpy as np
import pytest
from made_meshes import BOARD, Gltf
from mesh_cases.table import area, is_colour, loaded

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import load_mesh


def coloured(factor):
    gltf = Gltf()
    gltf.mesh(material=gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": factor}}))
    return gltf


def test_a_factor_that_rounding_left_above_1_is_1(tmp_path):
    mesh, told = loaded(coloured([1.0000001, 1, 0.5, 1.0000001]).save(tmp_path / "m.glb"), "z")
    assert told == []
    is_colour([1, 1, 0.5])(mesh)


@pytest.mark.parametrize(
    ("factor", "problem"),
    [
        ([1, 1, 1], "not 4 numbers"),
        (0.5, "not 4 numbers"),
        ([0.5], "not 4 numbers"),
        ([1.1, 1, 1, 1], "not within 0..1"),
    ],
)
def test_a_factor_of_other_than_4_numbers_is_refused(tmp_path, factor, problem):
    with pytest.raises(InputError, match=problem) as refusal:
        load_mesh(coloured(factor).save(tmp_path / "m.glb"), "file")
    assert "materials.0" in refusal.value.key


@pytest.mark.parametrize(
    ("material", "told"), [({"emissiveFactor": [1, 0, 0]}, "emission"), ({"emissiveFactor": [0, 0, 0]}, None)]
)
def test_emission_is_told(tmp_path, material, told):
    gltf = Gltf()
    gltf.mesh(material=gltf.add("materials", material))
    words = loaded(gltf.save(tmp_path / "m.glb"), "z")[1]
    assert [told in text for text in words] == ([] if told is None else [True])


def test_a_quaternion_of_zeros_is_refused(tmp_path):
    gltf = Gltf()
    gltf.mesh(node=False)
    gltf.node(mesh=0, rotation=[0, 0, 0, 0])
    with pytest.raises(InputError, match="is no rotation") as refusal:
        load_mesh(gltf.save(tmp_path / "m.glb"), "file")
    assert "nodes.0.rotation" in refusal.value.key


def test_a_joint_outside_of_the_scene_is_refused(tmp_path):
    gltf = Gltf(scenes=[{"nodes": [0]}])
    gltf.mesh(
        attributes={
            "JOINTS_0": gltf.accessor([[0, 0, 0, 0]] * 4, "u1"),
            "WEIGHTS_0": gltf.accessor([[1, 0, 0, 0]] * 4),
        },
        node=False,
    )
    gltf.node(mesh=0, skin=0)
    gltf.node()
    gltf.document["skins"] = [{"joints": [1], "inverseBindMatrices": gltf.accessor([np.eye(4).ravel()])}]
    with pytest.raises(InputError, match="joint 1, which is not a node of the scene") as refusal:
        load_mesh(gltf.save(tmp_path / "m.glb"), "file")
    assert "skins.0.joints" in refusal.value.key


def copies(attributes):
    gltf = Gltf().uses("EXT_mesh_gpu_instancing")
    gltf.mesh(node=False)
    made = {name: gltf.accessor(values) for name, values in attributes.items()}
    gltf.node(mesh=0, extensions={"EXT_mesh_gpu_instancing": {"attributes": made}})
    return gltf


def test_copies_are_as_many_as_any_of_their_attributes_has(tmp_path):
    mesh, told = loaded(copies({"_ID": [1.0, 2.0]}).save(tmp_path / "m.glb"), "z")
    assert area(mesh) == pytest.approx(8.0)
    assert len(told) == 1
    assert "_ID of EXT_mesh_gpu_instancing is not read" in told[0]


def test_copies_whose_attributes_differ_in_number_are_refused(tmp_path):
    with pytest.raises(InputError, match="different counts"):
        load_mesh(copies({"TRANSLATION": BOARD, "SCALE": BOARD[:2] + 2.0}).save(tmp_path / "m.glb"))


def painted(values, kind, **more):
    gltf = Gltf()
    gltf.mesh(attributes={"COLOR_0": gltf.accessor([values] * 4, kind, **more)})
    return gltf


@pytest.mark.parametrize(("kind", "top"), [("u1", 255), ("u2", 65535)])
def test_integer_colours_that_are_not_normalized_are_taken_so(tmp_path, kind, top):
    """Section 3.7.2.1 has no other; taken as they stand, all but 0 would be white."""
    mesh, told = loaded(painted([top, top // 5, 0, top], kind).save(tmp_path / "m.glb"), "z")
    is_colour([1.0, 0.2, 0.0])(mesh)
    assert told == [
        "COLOR_0 holds integers that are not normalized, which glTF does not have: they are taken as normalized"
    ]
    (tmp_path / "sound").mkdir()
    mesh, told = loaded(painted([top, top // 5, 0, top], kind, normalized=True).save(tmp_path / "sound/m.glb"), "z")
    is_colour([1.0, 0.2, 0.0])(mesh)
    assert told == []


@pytest.mark.parametrize("more", [{}, {"normalized": True}])
def test_colours_of_other_integers_are_refused(tmp_path, more):
    with pytest.raises(InputError, match="COLOR_0 of a type that glTF does not have") as refusal:
        load_mesh(painted([100, 20, 0, 100], "i1", **more).save(tmp_path / "m.glb"), "file")
    assert "accessors." in refusal.value.key


def test_an_unknown_way_of_alpha_is_told(tmp_path):
    gltf = Gltf()
    gltf.mesh(material=gltf.add("materials", {"alphaMode": "mask"}))
    told = loaded(gltf.save(tmp_path / "m.glb"), "z")[1]
    assert told == [
        "not modelled: alphaMode 'mask', which glTF does not have (OPAQUE, MASK, BLEND); surfaces are "
        "Lambertian and opaque"
    ]
