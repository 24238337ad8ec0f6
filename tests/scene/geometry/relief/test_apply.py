"""Relief of a whole scene: which parts get it, how copies share it, what is told, and what stays as it was."""

from itertools import pairwise

import numpy as np
import pytest

from varos_warp.scene.description import Scene
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Instances

CAMERA = {"id": "M0", "resolution": [640, 360], "sensor_mm": [4.8, 2.7], "focal_mm": 4.8}
STONE = {"kind": "boulder", "diameter": 1.0, "position": [0, 3, 0], "material": "rock"}


def scene(**more) -> Scene:
    return scene_from_dict({
        "trajectory": {"poses": [{"position": [0, 0, 0.5]}]}, "vehicle": {"cameras": [CAMERA]},
        "terrain": {"kind": "procedural", "size_m": 10, "resolution": 21, "relief_m": 0.2},
        "materials": {"rock": {"kind": "layered", "relief": "rock"}, "grey": {}}, **more})


def test_parts_of_other_materials_stay_as_they_are():
    plain = build_parts(scene(objects=[{**STONE, "material": "grey"}]))
    mixed = build_parts(scene(objects=[{**STONE, "material": "grey"}, STONE]))
    for before, after in zip(plain, mixed, strict=False):
        np.testing.assert_array_equal(before.vertices, after.vertices)
        np.testing.assert_array_equal(before.faces, after.faces)
        assert after.relief is None
    assert mixed[2].relief["triangles"] == len(mixed[2].faces) > len(plain[1].faces)
    assert mixed[2].before.name == "objects.1"


def test_two_stones_of_one_seed_and_material_have_surfaces_of_their_own():
    one, two = build_parts(scene(objects=[STONE, {**STONE, "position": [0.5, 3, 0]}]))[1:]
    assert one.vertices.shape != two.vertices.shape or np.ptp(one.vertices - two.vertices, axis=0).max() > 1e-3


def test_near_copies_have_a_finer_mesh_than_far_ones_and_all_keep_their_numbers():
    block = {"object": {k: v for k, v in STONE.items() if k != "position"}, "count": 30}
    groups = [part for part in build_parts(scene(scatter=[block])) if isinstance(part, Instances)]
    assert len(groups) > 1
    assert sorted(np.concatenate([group.numbers for group in groups])) == list(range(30))
    away = [np.linalg.norm(group.T_w_o[:, :3, 3] - [0, 0, 0.5], axis=1) for group in groups]
    assert all(len(a.faces) >= len(b.faces) for a, b in pairwise(groups))
    assert max(away[0]) < max(away[-1])
    names = DeviceScene(scene(scatter=[block]), build_parts(scene(scatter=[block])), "cpu").part_names
    assert names == ["terrain", *(f"scatter.0.{i}" for i in range(30))]


def test_too_few_triangles_are_told_with_the_factor():
    with pytest.warns(UserWarning, match=r"render\.max_triangles: 1000 triangles are few .* times as long"):
        parts = build_parts(scene(objects=[STONE], render={"max_triangles": 1000}))
    assert parts[1].relief["edge_factor"] > 2.0


def test_drifts_without_relief_are_refused():
    with pytest.raises(ValueError, match=r"terrain\.around_objects: drifts and moats are form"):
        scene(terrain={"kind": "procedural", "around_objects": True, "material": "grey"})


def test_open_meshes_are_warned_of(tmp_path):
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    plate = {"file": str(tmp_path / "open.obj"), "position": [0, 3, 0], "material": "rock"}
    parts = build_parts(scene(objects=[plate]))
    assert any("its mesh has holes (4 open edges)" in words for words in parts[1].doubts)
