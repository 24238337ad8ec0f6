"""The table of what the segmentation image numbers."""

from varos_warp.products.images.segments import segment_table
from varos_warp.scene.file.load import scene_from_dict


def scene():
    return scene_from_dict(
        {
            "terrain": {"kind": "procedural", "material": "floor"},
            "objects": [{"kind": "pipe", "radius": 0.1, "length": 1.0, "material": "steel"}, {"kind": "boulder"}],
            "materials": {"floor": {"kind": "slope_blend"}, "steel": {"kind": "diffuse"}},
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
        }
    )


def test_every_part_has_a_row_with_its_block():
    rows = segment_table(scene(), ["terrain", "objects.0", "objects.1"])
    assert rows == [
        {"id": 1, "key": "terrain", "kind": "terrain", "material": "floor", "material_id": 1},
        {"id": 2, "key": "objects.0", "kind": "pipe", "material": "steel", "material_id": 2},
        {"id": 3, "key": "objects.1", "kind": "boulder", "material": None, "material_id": 0},
    ]


def test_parts_that_are_not_of_the_scene_file_have_a_number_too():
    assert segment_table(scene(), ["model.obj", "objects.7"])[1] == {
        "id": 2,
        "key": "objects.7",
        "kind": "",
        "material": None,
        "material_id": 0,
    }
