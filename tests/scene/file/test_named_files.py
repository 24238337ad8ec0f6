"""Files that a scene or its meshes name and that are not there are told before anything is rendered."""

import os

import pytest

from varos_warp.errors import InputError
from varos_warp.scene.file.load import load_scene, scene_from_dict
from varos_warp.scene.file.named_files import require_files
from varos_warp.scene.file.source import located
from varos_warp.scene.geometry.placed import object_part
from varos_warp.scene.hull import vehicle_radius
from varos_warp.scene.lights.distribution import distribution
from varos_warp.sim.clock import select


def scene(folder, **changes):
    return scene_from_dict({"trajectory": {"poses": [{"position": [0, 0, 0]}]}} | changes, folder)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"terrain": {"file": "lost.ply"}}, "terrain.file"),
        ({"terrain": {"file": ["there.ply", "lost.ply"]}}, "terrain.file"),
        ({"objects": [{"file": "there.ply"}, {"file": "lost.ply"}]}, "objects.1.file"),
        (
            {"terrain": {"kind": "procedural"}, "scatter": [{"object": {"file": "lost.ply"}, "count": 1}]},
            "scatter.0.object.file",
        ),
        (
            {"materials": {"wall": {"kind": "slope_blend", "steep": {"texture": "lost.ply"}}}},
            "materials.wall.steep.texture",
        ),
    ],
)
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


SCENE = """
trajectory: {poses: [{position: [0, 0, 0]}]}
terrain:
  file:
    - floor.obj
    - flor.obj
objects:
  - {file: floor.obj}
vehicle:
  lights:
    - {kind: profile, file: lamp.csv}
  net_buoyancy: -1000
"""


def refusal(path, task, overrides=()):
    """What is said when a task for a scene file, loaded before, fails."""
    scene = load_scene(path, overrides)
    with pytest.raises(InputError) as error, located(scene):
        task(scene)
    return error.value.message.replace(str(path.parent), "HERE")


def test_what_is_found_after_loading_is_told_with_file_line_and_value_of_the_scene(tmp_path):
    path, floor = tmp_path / "scene.yaml", tmp_path / "floor.obj"
    path.write_text(SCENE)
    floor.touch()
    assert refusal(path, require_files) == (
        "HERE/scene.yaml:6: terrain.file.1 = 'flor.obj': there is no such mesh "
        "file (HERE/flor.obj). Did you mean 'floor.obj'?"
    )
    folder = refusal(path, require_files, ["terrain.file=."])
    assert "there is no such mesh file: this is a folder" in folder
    assert refusal(path, require_files, ["terrain.file=flor.obj"]).startswith("--set terrain.file=flor.obj: terrain.")
    lamp = refusal(path, lambda scene: distribution(scene.lights[0], scene))
    assert lamp.startswith("HERE/scene.yaml:11: vehicle.lights.0.file = 'lamp.csv': there is no such")
    assert refusal(path, build_object).startswith(
        "HERE/scene.yaml:8: objects.0.file = 'floor.obj': the mesh file is empty (0 bytes) (HERE/floor.obj). Copy"
    )
    assert refusal(path, vehicle_radius).startswith("HERE/scene.yaml:12: vehicle.net_buoyancy = -1000.0: would leave")
    (tmp_path / "lamp.csv").write_text("angle_deg,intensity\n0,1\n9,-1\n")
    assert "HERE/lamp.csv:3: vehicle.lights.0.file" in refusal(path, lambda scene: distribution(scene.lights[0], scene))


def test_what_is_not_of_the_scene_stays_as_it_is_told(tmp_path):
    def refuse(scene):
        raise InputError("are too old", file=tmp_path / "dataset.json", key="render.outputs", value="A")

    (tmp_path / "scene.yaml").write_text(SCENE)
    assert refusal(tmp_path / "scene.yaml", refuse) == "HERE/dataset.json: render.outputs = 'A': are too old"
    option = refusal(tmp_path / "scene.yaml", lambda scene: select(slice(5, 9), 2))
    assert option.startswith("frames = '5:9': names no frame")


def build_object(scene):
    object_part(scene, scene.objects[0], "objects.0")


@pytest.mark.skipif(os.sep != "/", reason="backslashes part folders")
@pytest.mark.parametrize(
    "block",
    [
        {"terrain": {"file": "parts\\rock.obj"}},
        {"objects": [{"file": "parts\\rock.obj"}]},
        {"materials": {"wall": {"kind": "slope_blend", "flat": {"texture": "parts\\rock.obj"}}}},
        {"vehicle": {"lights": [{"kind": "profile", "file": "parts\\rock.obj"}]}},
    ],
)
def test_a_backslash_is_told_of_and_whether_the_file_is_there_with_a_slash(tmp_path, block):
    """Of a scene that was written on Windows."""
    made = scene(tmp_path, **block)

    def read():
        require_files(made)
        distribution(made.lights[0], made)

    with pytest.raises(InputError, match=r"Write / instead of \\, which works everywhere: a backslash parts no"):
        read()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/rock.obj").touch()
    with pytest.raises(InputError, match=r"Write / instead of \\, which works everywhere: the file is there"):
        read()


def test_a_backslash_that_yaml_took_for_a_sign_is_told_of(tmp_path):
    """In double quotes: a carriage return, and what YAML has no sign for."""
    text = 'trajectory: {poses: [{position: [0, 0, 0]}]}\nterrain: {file: "parts\\%s"}'
    path = tmp_path / "scene.yaml"
    path.write_text(text % "rock.obj")
    said = refusal(path, require_files)
    assert "YAML takes \\ in double quotes for the beginning of a sign: write / instead." in said
    path.write_text(text % "map.obj")
    with pytest.raises(InputError, match=r"unknown escape character. Write / instead of \\ in paths"):
        load_scene(path)
