"""Files that a scene or its meshes name and that are not there are told before anything is rendered."""

import json

import pytest
import trimesh
from PIL import Image

from varos_warp.errors import InputError
from varos_warp.scene.load import scene_from_dict
from varos_warp.scene.named_files import check_textures, require_files


def scene(folder, **changes):
    return scene_from_dict({"trajectory": {"poses": [{"position": [0, 0, 0]}]}} | changes, folder)


@pytest.mark.parametrize(("changes", "key"), [
    ({"terrain": {"file": "lost.ply"}}, "terrain.file"),
    ({"terrain": {"file": ["there.ply", "lost.ply"]}}, "terrain.file"),
    ({"objects": [{"file": "there.ply"}, {"file": "lost.ply"}]}, "objects.1.file"),
    ({"terrain": {"kind": "procedural"}, "scatter": [{"object": {"file": "lost.ply"}, "count": 1}]},
     "scatter.0.object.file"),
    ({"materials": {"wall": {"kind": "slope_blend", "steep": {"texture": "lost.ply"}}}},
     "materials.wall.steep.texture")])
def test_a_missing_mesh_or_image_is_refused_by_its_key(tmp_path, changes, key):
    (tmp_path / "there.ply").touch()
    with pytest.raises(InputError, match="there is no such") as error:
        require_files(scene(tmp_path, **changes))
    assert error.value.key == key
    (tmp_path / "lost.ply").touch()
    require_files(scene(tmp_path, **changes))


def test_all_missing_files_are_told_at_once(tmp_path):
    with pytest.raises(InputError, match=r"Missing, too: objects\.1\.file \(b\.obj\), objects\.2\.file \(c\.stl\)"):
        require_files(scene(tmp_path, objects=[{"file": "a.dae"}, {"file": "b.obj"}, {"file": "c.stl"}]))


def obj(folder, image="wood.png"):
    (folder / "box.obj").write_text("mtllib box.mtl\n" + trimesh.creation.box().export(file_type="obj"))
    (folder / "box.mtl").write_text(f"newmtl wood\nKd 1 1 1\nmap_Kd -blendu on {image}\n")
    return "box.obj"


def gltf(folder, image="my%20wood.png"):
    images = [{"uri": image}, {"uri": "data:image/png;base64,AAAA"}, {"bufferView": 0}]
    (folder / "box.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "images": images}))
    return "box.gltf"


@pytest.mark.parametrize(("make", "image"), [(obj, "wood.png"), (gltf, "my wood.png")])
def test_a_texture_that_a_mesh_names_is_missed(tmp_path, make, image):
    with_own_look = scene(tmp_path, objects=[{"file": make(tmp_path)}])
    assert any(f"names {image}, which is not there" in warning for warning in check_textures(with_own_look))
    Image.new("RGB", (2, 2)).save(tmp_path / image)
    assert check_textures(with_own_look) == []


def test_a_missing_material_library_is_told(tmp_path):
    name = obj(tmp_path)
    (tmp_path / "box.mtl").unlink()
    assert "objects.0.file: box.obj names box.mtl" in check_textures(scene(tmp_path, objects=[{"file": name}]))[0]


def test_textures_of_a_mesh_with_a_material_do_not_matter(tmp_path):
    assert check_textures(scene(tmp_path, objects=[{"file": obj(tmp_path), "material": "grey"}],
                                materials={"grey": {}})) == []


def test_textures_of_a_dae_file_are_told_to_be_unread(tmp_path):
    (tmp_path / "box.dae").write_text("<COLLADA><image><init_from>wood.png</init_from></image></COLLADA>")
    warning, = check_textures(scene(tmp_path, objects=[{"file": "box.dae"}]))
    assert "those of DAE files are not read" in warning
