"""Mesh files of every format come in alike; what cannot be used is refused by name."""

import logging
from pathlib import Path

import numpy as np
import pytest
import trimesh

from varos_warp.errors import InputError
from varos_warp.scene.file.load import load_scene, scene_from_dict
from varos_warp.scene.geometry.build import build_parts, build_single_parts
from varos_warp.scene.geometry.mesh_files import load_mesh, write_ply
from varos_warp.scene.geometry.terrain import write_ply

EXAMPLE = Path(__file__).parents[3] / "examples" / "munkholmen"
UTM = np.array([569_012.345678, 7_035_678.901234, -50.0])
WEDGE = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])

DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2024-01-01T00:00:00</created><modified>2024-01-01T00:00:00</modified>{asset}</asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="12">{positions}</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="4"><input semantic="VERTEX" source="#v" offset="0"/><vcount>3 3 3 3</vcount>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></polylist></mesh></geometry></library_geometries>
<library_nodes/>
<library_visual_scenes><visual_scene id="s"><node id="n">{transforms}<instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>
"""


def dae(path, positions=WEDGE, asset='<unit name="meter" meter="1"/><up_axis>Z_UP</up_axis>', transforms="") -> Path:
    text = " ".join(repr(float(x)) for x in np.ravel(positions))
    path.write_text(DAE.format(asset=asset, positions=text, transforms=transforms))
    return path


def by_position(vertices):
    return vertices[np.lexsort(vertices.T)]


def volume(mesh):
    return trimesh.Trimesh(*mesh, process=False).volume


@pytest.mark.parametrize("suffix", ["dae", "obj", "ply", "stl", "glb"])
def test_every_format_gives_the_same_mesh(tmp_path, suffix):
    path = tmp_path / f"wedge.{suffix}"
    dae(path) if suffix == "dae" else trimesh.Trimesh(WEDGE, FACES, process=False).export(path)
    mesh = load_mesh(path)[:2]
    np.testing.assert_allclose(by_position(mesh[0]), by_position(WEDGE), atol=1e-7)
    assert mesh[0].dtype == np.float64
    assert mesh[1].dtype == np.int32
    assert volume(mesh) == pytest.approx(1.0)


def test_utm_coordinates_survive_in_every_format_that_has_double_precision(tmp_path):
    write_ply(tmp_path / "a.ply", WEDGE + UTM, FACES)
    (tmp_path / "a.obj").write_text(
        "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in (WEDGE + UTM).tolist())
        + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES + 1)
    )
    dae(tmp_path / "a.dae", WEDGE + UTM)
    moved = dae(tmp_path / "b.dae", transforms="<translate>{} {} {}</translate>".format(*UTM.tolist()))
    for path in (tmp_path / "a.ply", tmp_path / "a.obj", tmp_path / "a.dae", moved):
        local = load_mesh(path)[0] - UTM
        np.testing.assert_allclose(by_position(local.round(6)), by_position(WEDGE), atol=1e-12, err_msg=path.name)
        np.testing.assert_allclose(local, local.round(6), atol=2e-9, err_msg=path.name)


@pytest.mark.parametrize(("axis", "expected"), [("Z_UP", [1, 2, 3]), ("Y_UP", [1, -3, 2]), ("X_UP", [-2, -3, 1])])
def test_dae_up_axis_turns_the_mesh_without_mirroring_it(tmp_path, axis, expected):
    path = dae(tmp_path / "a.dae", WEDGE, f"<up_axis>{axis}</up_axis>")
    vertices, faces = load_mesh(path)[:2]
    assert volume((vertices, faces)) == pytest.approx(1.0)
    np.testing.assert_allclose(vertices.sum(axis=0), expected)
    np.testing.assert_allclose(load_mesh(path, up_axis="z")[0].sum(axis=0), [1, 2, 3])


def test_dae_unit_scales_to_metres(tmp_path):
    path = dae(tmp_path / "a.dae", 1000 * WEDGE, '<unit name="millimeter" meter="0.001"/><up_axis>Z_UP</up_axis>')
    np.testing.assert_allclose(by_position(load_mesh(path)[0]), by_position(WEDGE))


def test_dae_node_transforms_apply_in_order_and_mirrors_keep_outside_outside(tmp_path):
    steps = "<translate>10 0 0</translate><rotate>0 0 1 90</rotate><scale>1 1 -2</scale>"
    path = dae(tmp_path / "a.dae", transforms=steps)
    mesh = load_mesh(path)[:2]
    expected = np.column_stack([10 - WEDGE[:, 1], WEDGE[:, 0], -2 * WEDGE[:, 2]])
    np.testing.assert_allclose(by_position(mesh[0].round(12)), by_position(expected), atol=1e-12)
    assert volume(mesh) == pytest.approx(2.0)


def test_gltf_is_y_up_unless_trimesh_wrote_it(tmp_path):
    path = tmp_path / "a.glb"
    trimesh.Trimesh(WEDGE, FACES, process=False).export(path)
    path.write_bytes(path.read_bytes().replace(b"trimesh", b"blender"))
    np.testing.assert_allclose(load_mesh(path)[0].sum(axis=0), [1, -3, 2])


def test_a_scene_graph_is_flattened_with_its_transforms(tmp_path):
    graph = trimesh.Scene()
    wedge = trimesh.Trimesh(WEDGE, FACES, process=False)
    graph.add_geometry(wedge, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    graph.add_geometry(wedge, transform=trimesh.transformations.translation_matrix([0, 7, 0]))
    graph.export(tmp_path / "a.glb")
    vertices, faces = load_mesh(tmp_path / "a.glb")[:2]
    assert len(faces) == 8
    np.testing.assert_allclose(vertices.max(axis=0), [6, 9, 3])


def test_dae_agrees_with_trimesh_on_the_meshes_of_the_example():
    for name in ("munkholmen_seabed", "valve", "bop_panel"):
        path = EXAMPLE / "meshes" / f"{name}.dae"
        vertices, faces = load_mesh(path)[:2]
        other = trimesh.load_scene(path).to_mesh()
        # trimesh has float32 positions, and takes the seabed's scale of 0.999998 for one.
        np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], other.bounds, rtol=3e-6, atol=1e-6)
        assert trimesh.Trimesh(vertices, faces, process=False).area == pytest.approx(other.area, rel=1e-4)


# --------------------------------------------------------------------------------------------------------- bad files


def refusal(path) -> InputError:
    with pytest.raises(InputError) as caught:
        load_mesh(path, "objects.3.file")
    assert Path(caught.value.file) == path
    assert caught.value.key == "objects.3.file"
    assert caught.value.remedy
    return caught.value


def test_a_missing_file_a_folder_and_an_unknown_format_are_refused(tmp_path):
    assert "no such mesh file" in refusal(tmp_path / "nowhere.ply").message
    (tmp_path / "folder.ply").mkdir()
    assert "folder" in refusal(tmp_path / "folder.ply").message
    (tmp_path / "a.blend").write_text("x")
    assert ".dae, .obj" in (said := refusal(tmp_path / "a.blend").message)
    assert "Open it in Blender and export it: File > Export > glTF 2.0 (.glb)" in said


@pytest.mark.parametrize("suffix", ["dae", "obj", "ply", "stl", "glb"])
@pytest.mark.parametrize("content", [b"", b"hello, this is no mesh", b"\x00\xff\x13" * 100, b"ply\nformat ascii 1.0\n"])
def test_empty_and_garbled_files_are_refused(tmp_path, suffix, content):
    path = tmp_path / f"bad.{suffix}"
    path.write_bytes(content)
    error = refusal(path)
    assert ("(0 bytes)" in error.message) == (content == b"")


def test_what_a_reader_logs_of_a_damaged_file_is_not_on_the_terminal(tmp_path, monkeypatch, capsys):
    """Of normals that it cannot read trimesh logs a traceback; without handlers Python writes that to stderr."""
    text = trimesh.Trimesh(WEDGE, FACES, process=False).export(file_type="stl_ascii")
    (tmp_path / "a.stl").write_text(text.replace("facet normal ", "facet normal x", 1))
    monkeypatch.setattr(logging.getLogger(), "handlers", [])
    load_mesh(tmp_path / "a.stl")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("suffix", ["dae", "obj", "ply", "stl"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_vertices_that_are_not_finite_are_refused(tmp_path, suffix, value):
    vertices = WEDGE.copy()
    vertices[2, 1] = value
    path = tmp_path / f"bad.{suffix}"
    if suffix == "dae":
        dae(path, vertices)
    elif suffix == "obj":
        path.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in vertices) + "f 1 2 3\nf 1 2 4\n")
    elif suffix == "ply":
        write_ply(path, vertices, FACES)
    else:
        trimesh.Trimesh(vertices, FACES, process=False).export(path)
    assert "NaN or infinite" in refusal(path).message


def test_meshes_without_triangles_or_without_area_are_refused(tmp_path):
    path = tmp_path / "a.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    refusal(path)
    path.write_text("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n")
    assert "zero area" in refusal(path).message
    write_ply(tmp_path / "points.ply", WEDGE, np.zeros((0, 3), int))
    refusal(tmp_path / "points.ply")


def test_a_face_that_names_a_missing_vertex_is_refused(tmp_path):
    write_ply(tmp_path / "a.ply", WEDGE, FACES + 1)
    refusal(tmp_path / "a.ply")


def test_a_truncated_file_is_refused(tmp_path):
    for suffix in ("ply", "stl", "glb"):
        path = tmp_path / f"a.{suffix}"
        trimesh.creation.icosphere().export(path)
        path.write_bytes(path.read_bytes()[:-100])
        refusal(path)


# ------------------------------------------------------------------------------------------------------------- parts


def small_scene(tmp_path, **blocks):
    poses = {"poses": [{"position": [0, 0, 0]}]}
    return scene_from_dict({"trajectory": poses, **blocks}, tmp_path)


def test_parts_are_scaled_then_turned_about_fixed_x_y_z_then_moved(tmp_path):
    write_ply(tmp_path / "w.ply", WEDGE, FACES)
    block = {"file": "w.ply", "scale": [1, 1, 2], "rotation_euler_deg": [90, 0, 90], "position": UTM.tolist()}
    (part,) = build_parts(small_scene(tmp_path, objects=[block]))
    x, y, z = (WEDGE * [1, 1, 2]).T
    about_x = np.column_stack([x, -z, y])
    about_z = np.column_stack([-about_x[:, 1], about_x[:, 0], about_x[:, 2]])
    np.testing.assert_allclose(by_position(part.vertices - UTM), by_position(about_z), atol=2e-9)
    assert part.name == "objects.0"
    assert part.origin == tuple(UTM)
    assert part.smooth_angle == pytest.approx(np.pi / 6)


def test_parts_carry_the_material_that_is_named_and_gray_where_none_is(tmp_path):
    scene = small_scene(
        tmp_path,
        materials={"m": {"reflectance": [0.1, 0.2, 0.3]}},
        terrain={"kind": "procedural", "resolution": 9, "material": "m"},
        objects=[{"kind": "nut", "size": "M8"}],
    )
    terrain, nut = build_parts(scene)
    assert terrain.material.reflectance == (0.1, 0.2, 0.3)
    assert nut.material.reflectance == (0.5, 0.5, 0.5)
    assert (terrain.name, nut.name) == ("terrain", "objects.0")


def test_a_terrain_of_several_files_is_joined(tmp_path):
    write_ply(tmp_path / "a.ply", WEDGE, FACES)
    write_ply(tmp_path / "b.ply", WEDGE + [10, 0, 0], FACES)
    (part,) = build_parts(small_scene(tmp_path, terrain={"file": ["a.ply", "b.ply"]}))
    assert (len(part.vertices), len(part.faces)) == (8, 8)


def test_a_missing_mesh_names_its_key_in_the_scene(tmp_path):
    scene = small_scene(tmp_path, objects=[{"kind": "nut", "size": "M8"}, {"file": "gone.ply"}])
    with pytest.raises(InputError) as caught:
        build_parts(scene)
    assert caught.value.key == "objects.1.file"
    assert str(tmp_path / "gone.ply") in caught.value.message


def test_the_example_has_its_terrain_in_metres_around_the_course():
    scene = load_scene(EXAMPLE / "scene.yaml")
    (terrain,) = build_single_parts(scene.model_copy(update={"objects": []}))
    np.testing.assert_allclose(terrain.vertices[:, :2].min(axis=0), [850, 270])
    np.testing.assert_allclose(terrain.vertices[:, :2].max(axis=0), [930, 350])
    assert len(scene.trajectory.waypoints) == 20


def test_area_that_merging_loses_is_told(tmp_path):
    """A board of 1 m with a corner of 2 nm: its vertices become one, and the rest remains."""
    small = 2e-9 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]) + [5, 0, 0]
    write_ply(tmp_path / "a.ply", np.concatenate([1e-5 * np.eye(3), small]), np.array([[0, 1, 2], [3, 4, 5]]))
    assert load_mesh(tmp_path / "a.ply").facts.lost == 1
    both = np.concatenate([1e-9 * np.eye(3), 3e-8 * np.eye(3)])
    write_ply(tmp_path / "b.ply", both, np.array([[0, 1, 2], [3, 4, 5]]))
    with pytest.warns(UserWarning, match=r"file: b.ply: 0.11% of its area is lost"):
        assert load_mesh(tmp_path / "b.ply").facts.area_lost == pytest.approx(1 / 901, rel=1e-3)
