"""Classes of objects: the key ``class``, what it is without, and one spelling of each."""

import pytest

from varos_warp.errors import InputError
from varos_warp.scene.description.classes import class_of
from varos_warp.scene.file.load import load_scene, scene_from_dict, scene_to_dict

ROCK = {"kind": "boulder"}


def scene(*objects, **more):
    return scene_from_dict({"trajectory": {"poses": [{"position": [0, 0, 0]}]}, "objects": list(objects), **more})


@pytest.mark.parametrize(
    ("block", "expected"),
    [
        ({**ROCK, "class": "Sea stack"}, "Sea stack"),
        (ROCK, "boulder"),
        ({"file": "m/Gas Pipe-2.PLY"}, "gas_pipe_2"),
        ({"file": "C:\\m\\Rock.obj"}, "rock"),
        ({"file": "seabed/terrain.ply"}, "terrain_object"),
        ({"file": "water.ply"}, "water_object"),
        ({"file": "größe.ply"}, "grösse"),
        ({"file": "-.ply"}, "mesh"),
        ({"kind": "calibration_board", "square_m": 0.05}, "calibration_board"),
    ],
)
def test_a_class_is_what_is_given_or_the_name_of_the_file_or_the_kind(block, expected):
    assert class_of(scene(block).objects[0]) == expected


def test_a_dataset_of_a_scene_without_classes_is_as_it_was_and_one_with_them_comes_back():
    terrain = {"kind": "procedural", "class": "seabed"}
    written = scene_to_dict(scene(ROCK, {**ROCK, "class": "rock"}, terrain=terrain))
    assert [block.get("class") for block in written["objects"]] == [None, "rock"]
    assert "class" not in written["objects"][0]
    assert not any("class_" in block for block in (*written["objects"], written["terrain"]))
    again = scene_from_dict(written)
    assert scene_to_dict(again) == written
    assert class_of(again.terrain, True) == "seabed"
    assert class_of(scene(terrain={"kind": "procedural"}).terrain, True) == "terrain"


@pytest.mark.parametrize(
    ("objects", "more", "words"),
    [
        (
            ({**ROCK, "class": "Rock"}, {**ROCK, "class": "rock"}),
            {},
            r"objects\.1\.class: 'rock' is 'Rock' of objects\.0",
        ),
        (
            (ROCK, {**ROCK, "class": "Boulder"}),
            {},
            r"objects\.1\.class: 'Boulder' is 'boulder' of objects\.0 in another",
        ),
        (
            ({**ROCK, "class": "BOULDER"}, ROCK),
            {},
            r"objects\.0\.class: 'BOULDER' is 'boulder' of objects\.1 in another",
        ),
        (({**ROCK, "class": "gas pipe"}, {"file": "gas_pipe.ply"}), {}, r"'gas pipe' is 'gas_pipe' of objects\.1"),
        (
            ({**ROCK, "class": "Terrain"},),
            {"terrain": {"kind": "procedural"}},
            r"objects\.0\.class: .* that of the terr",
        ),
        ((ROCK,), {"terrain": {"kind": "procedural", "class": "boulder"}}, r"terrain\.class: .* class of objects\.0"),
        (({**ROCK, "class": "Water"},), {}, r"objects\.0\.class: .*where nothing is seen"),
        ((), {"terrain": {"kind": "procedural", "class": "water"}}, r"terrain\.class: .*where nothing is seen"),
        (
            ({**ROCK, "class": "Barnacle"},),
            {"growth": [{"on": ["objects.0"], "kind": "barnacle"}], "render": {"segments": "fine"}},
            r"'Barnacle' is 'barnacle' of growth\.0",
        ),
        (({**ROCK, "class": " x"},), {}, "text without blanks at its ends"),
        (({**ROCK, "class": ""},), {}, "class"),
        (({**ROCK, "class": 3},), {}, "Put quotes around it"),
        (({**ROCK, "clas": "x"},), {}, "Did you mean 'class'"),
    ],
)
def test_one_class_in_two_spellings_or_of_a_surface_is_refused(objects, more, words):
    with pytest.raises(InputError, match=words):
        scene(*objects, **more)


def test_files_of_like_names_are_one_class_and_never_refused():
    loaded = scene(
        {"file": "a/Rock.ply"}, {"file": "b/rock.obj"}, {"file": "terrain.ply"}, terrain={"kind": "procedural"}
    )
    assert [class_of(block) for block in loaded.objects] == ["rock", "rock", "terrain_object"]


def test_the_message_names_the_line_of_the_file(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(
        "trajectory: {poses: [{position: [0, 0, 0]}]}\nobjects:\n  - {kind: boulder, class: rock}\n"
        "  - {kind: boulder, class: ROCK}\n"
    )
    with pytest.raises(InputError, match=r"scene\.yaml:4: objects\.1\.class"):
        load_scene(path)
