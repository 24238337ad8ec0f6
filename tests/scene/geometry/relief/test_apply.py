"""Relief of a whole scene: which parts get it, how copies share it, what is told, and what stays as it was."""

from itertools import pairwise

import numpy as np
import pytest

from varos_warp.device import launch
from varos_warp.scene.description import Scene
from varos_warp.scene.device import DeviceScene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.geometry.build import build_parts
from varos_warp.scene.geometry.parts import Instances

CAMERA = {"id": "M0", "resolution": [640, 360], "sensor_mm": [4.8, 2.7], "focal_mm": 4.8}
STONE = {"kind": "boulder", "diameter": 1.0, "position": [0, 3, 0], "material": "rock"}


def scene(**more) -> Scene:
    return scene_from_dict(
        {
            "trajectory": {"poses": [{"position": [0, 0, 0.5]}]},
            "vehicle": {"cameras": [CAMERA]},
            "terrain": {"kind": "procedural", "size_m": 10, "resolution": 21, "relief_m": 0.2},
            "materials": {"rock": {"kind": "layered", "relief": "rock"}, "grey": {}},
            **more,
        }
    )


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
    made = scene(scatter=[block], vehicle={"cameras": [{**CAMERA, "resolution": [160, 90]}]})
    parts = build_parts(made)
    groups = [part for part in parts if isinstance(part, Instances)]
    assert len(groups) > 1
    assert sorted(np.concatenate([group.numbers for group in groups])) == list(range(30))
    away = [np.linalg.norm(group.T_w_o[:, :3, 3] - [0, 0, 0.5], axis=1) for group in groups]
    assert all(len(a.faces) >= len(b.faces) for a, b in pairwise(groups))
    assert max(away[0]) < max(away[-1])
    names = DeviceScene(made, parts, "cpu").part_names
    assert names == ["terrain", *(f"scatter.0.{i}" for i in range(30))]


def test_too_few_triangles_are_told_with_the_factor(tmp_path):
    (tmp_path / "plate.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    plate = {"file": str(tmp_path / "plate.obj"), "position": [-0.5, 1.5, 0], "material": "rock"}
    with pytest.warns(UserWarning, match=r"render\.max_triangles: 1000 triangles are few .* times as long"):
        parts = build_parts(scene(objects=[plate], render={"max_triangles": 1000}))
    assert parts[1].relief["edge_factor"] > 2.0
    assert 500 < len(parts[1].faces) < 2000


def test_what_passes_near_a_camera_is_as_fine_as_it_must_be_there(tmp_path):
    """Its stops are far away on both sides, its way passes 1.5 m before the camera."""
    (tmp_path / "plate.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    path = [{"time_s": 0, "position": [-20, 1.5, 0.5]}, {"time_s": 20, "position": [20, 1.5, 0.5]}]
    moving = {"file": str(tmp_path / "plate.obj"), "material": "rock", "path": path}
    few = {"cameras": [{**CAMERA, "resolution": [160, 90]}]}
    (passing,) = build_parts(scene(objects=[moving], terrain=None, vehicle=few))
    edges = np.linalg.norm(passing.vertices[passing.faces[:, 0]] - passing.vertices[passing.faces[:, 1]], axis=1)
    assert edges.mean() < 3.0 * 1.5 / 160


def test_drifts_without_relief_are_refused():
    with pytest.raises(ValueError, match=r"terrain\.around_objects: drifts and moats are form"):
        scene(terrain={"kind": "procedural", "around_objects": True, "material": "grey"})


def test_open_meshes_are_warned_of(tmp_path):
    (tmp_path / "open.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    plate = {"file": str(tmp_path / "open.obj"), "position": [0, 3, 0], "material": "rock"}
    parts = build_parts(scene(objects=[plate]))
    assert any("its mesh has holes (4 open edges)" in words for words in parts[1].doubts)


def test_all_vehicles_see_the_same_ground():
    """Their bodies, of which each sees another's, are of different sizes, and the bound is short."""
    bodies = [{"kind": "boulder", "diameter": d, "material": "rock"} for d in (1.5, 0.5)]
    vehicles = [
        {"id": str(i), "cameras": [CAMERA], "body": body, "trajectory": {"poses": [{"position": [0, 3.0 * i, 1]}]}}
        for i, body in enumerate(bodies)
    ]
    grounds = [
        build_parts(
            scene_from_dict(
                {
                    "terrain": {"kind": "procedural", "size_m": 4, "resolution": 9, "material": "rock"},
                    "observer": observer,
                    "materials": {"rock": {"kind": "layered", "relief": "rock"}},
                    "vehicles": vehicles,
                    "render": {"max_triangles": 20_000},
                }
            )
        )[0]
        for observer in ("0", "1")
    ]
    np.testing.assert_array_equal(grounds[0].vertices, grounds[1].vertices)


@pytest.mark.parametrize(
    ("faces", "words"),
    [
        ("f 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n", "faces look inwards"),
        ("f 1 3 2\nf 1 3 4\nf 1 4 2\nf 2 4 3\n", "others outwards"),
        ("f 1 2 3\nf 3 2 1\n", "back to back"),
    ],
)
def test_meshes_without_an_outside_are_warned_of(tmp_path, faces, words):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n" + faces)
    parts = build_parts(scene(objects=[{"file": str(tmp_path / "a.obj"), "position": [0, 3, 0], "material": "rock"}]))
    assert any(words in doubt for doubt in parts[1].doubts)


def test_a_part_too_thin_for_its_form_is_told_by_name(tmp_path):
    box = "".join(f"v {x} {y} {z}\n" for x in (0, 1) for y in (0, 1) for z in (0, 0.02))
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    (tmp_path / "slab.obj").write_text(box + faces)
    slab = {"file": str(tmp_path / "slab.obj"), "position": [-0.5, 2.5, 3], "material": "rock"}
    parts = build_parts(scene(objects=[slab, {**STONE, "position": [3, 3, 0]}]))
    assert any("20 mm thin" in doubt for doubt in parts[1].doubts)
    assert not any("thin" in doubt for doubt in parts[2].doubts)


def test_steep_on_the_material_of_an_object_is_refused_with_its_key():
    with pytest.raises(ValueError, match=r"materials\.rock\.steep: .*objects\.0 has this material"):
        scene(objects=[STONE], materials={"rock": {"kind": "layered", "relief": "sand", "steep": "rock"}})


def test_steep_on_the_material_of_the_ground_is_not():
    ground = {"kind": "procedural", "size_m": 10, "resolution": 21, "material": "sand"}
    made = scene(terrain=ground, materials={"sand": {"kind": "layered", "relief": "sand", "steep": "rock"}})
    assert made.materials["sand"].steep == "rock"


def test_bytes_do_not_depend_on_the_number_of_threads(monkeypatch, tmp_path):
    block = {"object": {k: v for k, v in STONE.items() if k != "position"}, "count": 4}
    made = []
    for threads in (1, 5):
        monkeypatch.setenv("VAROS_WARP_CACHE", str(tmp_path / str(threads)))  # or the second were read, not made
        monkeypatch.setattr(launch, "usable_cores", lambda count=threads: count)
        monkeypatch.setattr(launch, "CHUNK", 1 << 10)
        terrain = {
            "kind": "procedural",
            "size_m": 10,
            "resolution": 21,
            "relief_m": 0.2,
            "around_objects": True,
            "material": "rock",
        }
        made.append(
            build_parts(scene(terrain=terrain, objects=[STONE], scatter=[block], render={"max_triangles": 30_000}))
        )
    for one, many in zip(*made, strict=True):
        for name in ("vertices", "faces", "normals"):
            np.testing.assert_array_equal(getattr(one, name), getattr(many, name))
        np.testing.assert_array_equal(one.skin.corners, many.skin.corners)
