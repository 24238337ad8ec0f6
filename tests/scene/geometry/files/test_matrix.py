"""The table of docs/meshes.md: each of its cells is what happens.

A case makes a file in a folder and returns its path, and perhaps a function that looks at the mesh that comes of it.
"""

import math
import re
import warnings
from pathlib import Path

import DracoPy
import numpy as np
import pytest
import trimesh
from made_meshes import (
    BOARD,
    BOUND,
    L_SHAPE,
    QUARTERS,
    SAMPLER,
    TWO,
    UV,
    VERTEX,
    Gltf,
    colour_at,
    dae,
    dae_effect,
    dae_places,
    dae_source,
    picture,
    ply,
    rows,
)

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.images import srgb_to_linear

PAGE = Path(__file__).parents[4] / "docs" / "meshes.md"
FORMATS = {"glTF": "glb", "OBJ": "obj", "PLY": "ply", "DAE": "dae", "STL": "stl", "OFF": "off"}
CASES: dict[tuple[str, str], list] = {}


def cells() -> list[tuple[str, str, str]]:
    """Feature, format and what happens, of all cells that say something."""
    lines = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in PAGE.read_text().splitlines()
        if line.startswith("|") and "---" not in line
    ]
    (_, *formats), *table = lines
    return [
        (feature, kind, word)
        for feature, *words in table
        for kind, word in zip(formats, words, strict=True)
        if word != "–"
    ]


def case(feature, *formats, says=None):
    """Register the function that makes the file of a cell, or of several: it is given the format then."""

    def register(make):
        for kind in formats:
            CASES.setdefault((feature, kind), []).append((make, says))
        return make

    return register


def made(make, kind, folder):
    """Path and what to look at, of a case."""
    result = make(folder) if make.__code__.co_argcount == 1 else make(folder, kind)
    return result if isinstance(result, tuple) else (result, lambda mesh: None)


@pytest.mark.parametrize(("feature", "kind", "word"), cells(), ids=lambda x: x)
def test_what_the_table_says_happens(tmp_path, monkeypatch, feature, kind, word):
    monkeypatch.setenv("VAROS_WARP_MAX_TEXTURE_PIXELS", "10000")
    for number, (make, says) in enumerate(CASES[feature, kind]):
        folder = tmp_path / str(number)
        folder.mkdir()
        path, check = made(make, kind, folder)
        up = "z" if kind == "glTF" and feature != "up axis and unit" else None
        if word == "refused":
            with pytest.raises(InputError, match=says) as refusal:
                load_mesh(path, "objects.0.file", up)
            assert "objects.0.file" in refusal.value.message
            assert refusal.value.remedy
            continue
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            mesh = load_mesh(path, "objects.0.file", up)
        words = [str(warning.message) for warning in told]
        assert bool(words) == (word == "warned"), words
        assert all(text.startswith(f"objects.0.file: {path.name}: ") for text in words)
        if says:
            assert re.search(says, words[0])
        check(mesh)


def test_every_case_is_in_the_table():
    assert set(CASES) == {(feature, kind) for feature, kind, _ in cells()}


# --------------------------------------------------------------------------------------------------------- what to see


def area(mesh) -> float:
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).area


def has_area(expected, size=None):
    """A look at the area [m2], and at the extent [m]."""

    def look(mesh):
        assert area(mesh) == pytest.approx(expected, rel=1e-6)
        if size is not None:
            np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), size, rtol=1e-6)

    return look


def is_quarters(mesh):
    """QUARTERS fills the board, upright."""
    for x, y, expected in (
        (-0.5, 0.5, QUARTERS[0, 0]),
        (0.5, 0.5, QUARTERS[0, 1]),
        (-0.5, -0.5, QUARTERS[1, 0]),
        (0.5, -0.5, QUARTERS[1, 1]),
    ):
        np.testing.assert_allclose(colour_at(mesh, x, y), expected / 255.0, atol=1e-6)


def is_colour(expected, x=0.3, y=0.1):
    return lambda mesh: np.testing.assert_allclose(colour_at(mesh, x, y), expected, atol=1e-6)


def is_grey(mesh):
    assert mesh.skin is None or np.allclose(colour_at(mesh, 0.3, 0.1), 0.5)


def repeats_twice(mesh):
    """Coordinates of 0..2 on the board: each quarter of it shows the whole picture."""
    for x, y in ((-0.75, 0.75), (0.25, 0.75), (-0.75, -0.25), (0.25, -0.25)):
        np.testing.assert_allclose(colour_at(mesh, x, y), [1.0, 0.0, 0.0], atol=1e-6)


# -------------------------------------------------------------------------------------------------------- OBJ, OFF ...


def obj(folder, text, mtl=None, image=True, name="q.png"):
    """An OBJ; with ``mtl``, beside m.mtl and a picture."""
    if mtl is not None:
        (folder / "m.mtl").write_text(mtl)
        text = f"mtllib m.mtl\n{text}"
    if image:
        (folder / name).write_bytes(picture())
    path = folder / "m.obj"
    path.write_text(text)
    return path


V = "".join(f"v {x} {y} {z}\n" for x, y, z in BOARD)
VT = "".join(f"vt {u} {v}\n" for u, v in UV)
QUAD = "f 1/1 2/2 3/3 4/4\n"


def off(folder, places, faces, head="OFF", vertex_tail="", face_tail=""):
    path = folder / "m.off"
    body = "\n".join(" ".join(map(repr, map(float, p))) + vertex_tail for p in places) + "\n"
    body += "\n".join(f"{len(f)} {' '.join(map(str, f))}{face_tail}" for f in faces)
    path.write_text(f"{head}\n{len(places)} {len(faces)} 0\n{body}\n")
    return path


def dae_file(folder, text):
    path = folder / "m.dae"
    path.write_text(text)
    (folder / "q.png").write_bytes(picture())
    return path


def ply_file(folder, text):
    path = folder / "m.ply"
    path.write_text(text)
    return path


XYZ = "double x,double y,double z"
RING = "list uchar int vertex_indices"
FLAT = np.column_stack([L_SHAPE, np.zeros(6)])
BOWTIE = np.array([[0.0, 0, 0], [2, 2, 0], [2, 0, 0], [0, 1.0, 0]])


def polygon(folder, kind, places):
    """One polygon in a format that has them."""
    ring = list(range(len(places)))
    if kind == "OBJ":
        lines = "".join(f"v {' '.join(map(repr, map(float, p)))}\n" for p in places)
        return obj(folder, lines + "f " + " ".join(str(i + 1) for i in ring) + "\n", image=False)
    if kind == "PLY":
        return ply_file(folder, ply(XYZ, rows(places), RING, f"{len(ring)} " + " ".join(map(str, ring))))
    if kind == "DAE":
        return dae_file(
            folder,
            dae(
                dae_places(places) + f'<polylist count="1">{VERTEX}<vcount>{len(ring)}</vcount>'
                f"<p>{' '.join(map(str, ring))}</p></polylist>"
            ),
        )
    return off(folder, places, [ring])


# ------------------------------------------------------------------------------------------------------------ geometry


@case("triangles", "glTF", "OBJ", "PLY", "DAE", "STL", "OFF")
def triangles(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh()
        return gltf.save(folder / "m.glb"), has_area(4.0, [2, 2, 0])
    if kind == "OBJ":
        return obj(folder, V + "f 1 2 3\nf -4 -2 -1\n", image=False), has_area(4.0, [2, 2, 0])
    if kind == "DAE":
        return dae_file(folder, dae(dae_places() + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>')), (
            has_area(4.0, [2, 2, 0])
        )
    path = folder / f"m.{FORMATS[kind]}"
    trimesh.Trimesh(BOARD, TWO, process=False).export(path)
    return path, has_area(4.0, [2, 2, 0])


@case("strips and fans", "glTF", "PLY", "DAE")
def strips_and_fans(folder, kind):
    strip, fan = [0, 1, 3, 2], [0, 1, 2, 3]
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(faces=strip, mode=5)
        gltf.mesh(BOARD + [3, 0, 0], faces=fan, mode=6)
        return gltf.save(folder / "m.glb"), upright(8.0)
    if kind == "PLY":
        text = ply(
            XYZ, rows(BOARD), RING, "3 0 1 2", more="element tristrips 1\nproperty list int int vertex_indices\n"
        )
        return ply_file(folder, text.replace("3 0 1 2", "0") + "9 0 1 3 -1 0 1 3 2 -1\n"), upright(6.0)
    both = f'<tristrips count="1">{VERTEX}<p>0 1 3 2</p></tristrips><trifans count="1">{VERTEX}<p>0 1 2 3</p></trifans>'
    return dae_file(folder, dae(dae_places() + both)), upright(8.0)


def upright(expected):
    """A look at the area of faces that all look up."""

    def look(mesh):
        normals = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).face_normals
        np.testing.assert_allclose(normals, np.broadcast_to([0, 0, 1.0], normals.shape), atol=1e-12)
        assert area(mesh) == pytest.approx(expected)

    return look


@case("convex polygons", "OBJ", "PLY", "DAE", "OFF")
def convex(folder, kind):
    angles = np.arange(7) * 2 * np.pi / 7
    ring = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    return polygon(folder, kind, ring), upright(3.5 * math.sin(2 * math.pi / 7))


@case("concave polygons", "OBJ", "PLY", "DAE", "OFF")
def concave(folder, kind):
    turned = np.roll(FLAT, 2, axis=0)  # begins where a fan would be wrong
    return polygon(folder, kind, turned), upright(3.0)


@case("polygons with holes", "DAE")
def with_holes(folder):
    inner = np.array([[-0.5, -0.5, 0], [-0.5, 0.5, 0], [0.5, 0.5, 0], [0.5, -0.5, 0]])
    text = f'<polygons count="2">{VERTEX}<ph><p>0 1 2 3</p><h>4 5 6 7</h></ph><p>8 9 10 11</p></polygons>'
    return dae_file(folder, dae(dae_places(np.concatenate([BOARD, inner, BOARD + [5, 0, 0]])) + text)), upright(7.0)


@case("polygons that cross themselves", "OBJ", "PLY", "DAE", "OFF", says="1 of its polygons cross themselves")
def crossing(folder, kind):
    return polygon(folder, kind, BOWTIE)


@case("points and lines beside a surface", "glTF", "OBJ", "PLY", "DAE", says="left out: only surfaces")
def lines_too(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh()
        gltf.mesh(faces=[0, 1], mode=1)
        return gltf.save(folder / "m.glb"), has_area(4.0)
    if kind == "OBJ":
        return obj(folder, V + "f 1 2 3 4\nl 1 2\np 1\n", image=False), has_area(4.0)
    if kind == "PLY":
        text = ply(
            XYZ, rows(BOARD), RING, "4 0 1 2 3", more="element edge 1\nproperty int vertex1\nproperty int vertex2\n"
        )
        return ply_file(folder, text + "0 1\n"), has_area(4.0)
    text = f'<lines count="1">{VERTEX}<p>0 1</p></lines><triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>'
    return dae_file(folder, dae(dae_places() + text)), has_area(4.0)


@case("nothing but points or lines", "glTF", "OBJ", "PLY", "DAE", "OFF", says="no triangles")
def only_lines(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(faces=[0, 1], mode=1)
        return gltf.save(folder / "m.glb")
    if kind == "OBJ":
        return obj(folder, V + "l 1 2\n", image=False)
    if kind == "PLY":
        return ply_file(
            folder,
            f"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
            f"property float z\nend_header\n{rows(BOARD)}\n",
        )
    if kind == "OFF":
        return off(folder, BOARD, [])
    return dae_file(folder, dae(dae_places() + f'<lines count="1">{VERTEX}<p>0 1</p></lines>'))


@case("free-form curves and surfaces", "OBJ", "DAE", says="left out")
def free_form(folder, kind):
    if kind == "OBJ":
        return obj(folder, V + "f 1 2 3 4\ncstype bezier\ndeg 1 1\nsurf 0 1 0 1 1 2 4 3\nend\n", image=False), has_area(
            4.0
        )
    spline = dae(
        dae_places() + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>',
        scene=('<node id="n"><instance_geometry url="#g"/><instance_geometry url="#b"/></node>'),
    )
    spline = spline.replace("</library_geometries>", '<geometry id="b"><brep/></geometry></library_geometries>')
    return dae_file(folder, spline), has_area(4.0)


FAR = BOARD + [400123.123456, 6100456.654321, -31.25]


@case("places in double precision", "glTF", "OBJ", "PLY", "DAE", "OFF")
def doubles(folder, kind):
    def exact(mesh):
        np.testing.assert_allclose(np.sort(mesh.vertices, axis=0), np.sort(FAR, axis=0), rtol=0, atol=1e-9)

    if kind == "glTF":  # its positions are single precision, the matrices of its nodes are not
        gltf = Gltf()
        gltf.mesh(node=False)
        gltf.node(mesh=0, translation=[400123.123456, 6100456.654321, -31.25])
        return gltf.save(folder / "m.glb"), exact
    return polygon(folder, kind, FAR), exact


@case("nodes that move, turn, scale, mirror", "glTF", "DAE")
def nodes(folder, kind):
    expected = np.array([[10.0, 19, 30], [10, 21, 30]])  # x and y change places, mirrored and moved

    def look(mesh):
        np.testing.assert_allclose([mesh.vertices.min(0)[1], mesh.vertices.max(0)[1]], expected[:, 1], atol=1e-12)
        assert np.ptp(mesh.vertices[:, 0]) == pytest.approx(6.0)
        upright(12.0)(mesh)

    if kind == "glTF":
        gltf = Gltf(scenes=[{"nodes": [1]}])
        gltf.mesh(node=False)
        gltf.node(mesh=0, rotation=[0, 0, math.sqrt(0.5), math.sqrt(0.5)], scale=[1, -3, 1])
        gltf.node(children=[0], translation=[10, 20, 30])
        return gltf.save(folder / "m.glb"), look
    node = "<translate>10 20 30</translate><rotate>0 0 1 90</rotate><scale>1 -3 1</scale>"
    return dae_file(
        folder, dae(dae_places() + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>', node=node)
    ), look


@case("copies of a mesh", "glTF", "DAE")
def copies(folder, kind):
    if kind == "glTF":
        gltf = Gltf().uses("EXT_mesh_gpu_instancing")
        gltf.mesh(node=False)
        gltf.node(
            mesh=0,
            extensions={
                "EXT_mesh_gpu_instancing": {
                    "attributes": {
                        "TRANSLATION": gltf.accessor([[0.0, 0, 0], [5, 0, 0], [0, 5, 0]]),
                        "SCALE": gltf.accessor([[1.0, 1, 1], [2, 2, 2], [1, 1, 1]]),
                        "ROTATION": gltf.accessor(
                            [[0, 0, 0, 32767], [0, 0, 0, 32767], [0, 0, 32767, 0]], "i2", normalized=True
                        ),
                    }
                }
            },
        )
        return gltf.save(folder / "m.glb"), upright(24.0)
    scene = (
        '<node id="n"><instance_geometry url="#g"/></node><node id="o"><translate>5 0 0</translate>'
        '<scale>2 2 2</scale><instance_node url="#n"/></node>'
    )
    return dae_file(
        folder, dae(dae_places() + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>', scene=scene)
    ), upright(20.0)


@case("sparse, strided, offset arrays", "glTF", "DAE")
def sparse(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        padded = np.zeros((4, 8), "<f4")
        padded[:, 2:5] = BOARD * [1, 1, 0]
        padded[2, 2:5] = -9.0  # sparse values replace it
        view = gltf.view(padded.tobytes(), byteStride=32)
        values = {
            "count": 1,
            "indices": {"bufferView": gltf.view(np.uint16([2]).tobytes()), "componentType": 5123},
            "values": {"bufferView": gltf.view(BOARD[2].astype("<f4").tobytes())},
        }
        gltf.mesh(gltf.accessor(BOARD, bufferView=view, byteOffset=8, sparse=values))
        return gltf.save(folder / "m.glb"), upright(4.0)
    padded = np.column_stack([BOARD[:, 0], np.full(4, 7.0), BOARD[:, 1:], np.full((4, 2), 7.0)])
    text = dae_source("p", padded, params="X-YZ--").replace("7.0 7.0</float", "7.0 7.0</float")
    text += '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
    return dae_file(folder, dae(text + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>')), upright(4.0)


@case("integers that stand for fractions", "glTF")
def quantised(folder):
    gltf = Gltf().uses("KHR_mesh_quantization")
    places = gltf.accessor(32767 * BOARD, "i2", normalized=True, min=[-32767, -32767, 0], max=[32767, 32767, 0])
    gltf.mesh(
        places,
        attributes={"TEXCOORD_0": gltf.uv(255 * UV * [1, 1] + [0, -254], "u1", normalized=True)},
        material=gltf.textured(),
    )
    uv = np.column_stack([65535 * UV[:, 0], 65535 * (1 - UV[:, 1])])
    gltf.document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = gltf.accessor(uv, "u2", normalized=True)
    return gltf.save(folder / "m.glb"), lambda mesh: (upright(4.0)(mesh), is_quarters(mesh))


@case("integers that stand for fractions", "glTF")
def quantised_but_not_normalised(folder):
    gltf = Gltf().uses("KHR_mesh_quantization")
    gltf.mesh(gltf.accessor(100 * BOARD, "i1"), node=False)
    gltf.node(mesh=0, scale=[0.01, 0.01, 0.01])
    return gltf.save(folder / "m.glb"), upright(4.0)


@case("positions that are not what the file says of them", "glTF", says="not what its min and max say")
def lying_extent(folder):
    gltf = Gltf()
    gltf.mesh(gltf.accessor(BOARD, min=[-1, -1, 0], max=[2, 1, 0]))
    return gltf.save(folder / "m.glb"), upright(4.0)


@case("morph targets at their default weights", "glTF", "DAE")
def morphs(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        target = gltf.accessor(BOARD)
        gltf.mesh(targets=[{"POSITION": target}])
        gltf.document["meshes"][0]["weights"] = [0.5]
        return gltf.save(folder / "m.glb"), upright(9.0)
    return controlled(folder, '<morph source="#g" method="NORMALIZED"/>')


def controlled(folder, inside):
    """A COLLADA mesh behind a controller."""
    text = dae(
        dae_places() + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>',
        scene='<node id="n"><instance_controller url="#c"/></node>',
    )
    text = text.replace(
        "<library_visual",
        f'<library_controllers><controller id="c">{inside}</controller></library_controllers><library_visual',
        1,
    )
    return dae_file(folder, text), upright(4.0)


@case("skins at their joints", "glTF", "DAE")
def skins(folder, kind):
    if kind == "DAE":
        return controlled(
            folder, '<skin source="#g"><bind_shape_matrix>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix></skin>'
        )
    gltf = Gltf(scenes=[{"nodes": [0, 1, 2]}])
    joints = gltf.accessor([[0, 1, 0, 0]] * 4, "u1")
    weights = gltf.accessor([[0.5, 0.5, 0, 0]] * 4)
    gltf.mesh(attributes={"JOINTS_0": joints, "WEIGHTS_0": weights}, node=False)
    gltf.node(mesh=0, skin=0, translation=[100, 0, 0])  # which a skin leaves out
    gltf.node(scale=[2, 2, 2])
    gltf.node(translation=[0, 0, 8])
    inverse = np.eye(4)
    gltf.document["skins"] = [
        {"joints": [1, 2], "inverseBindMatrices": gltf.accessor(np.stack([inverse.T.ravel(), inverse.T.ravel()]))}
    ]
    return gltf.save(folder / "m.glb"), lambda mesh: (
        upright(9.0)(mesh),
        np.testing.assert_allclose(mesh.vertices.mean(axis=0), [0, 0, 4], atol=1e-6),
    )


@case("animations", "glTF", "DAE", says="animations are not read")
def animations(folder, kind):
    if kind == "glTF":
        gltf = Gltf(animations=[{"channels": [], "samplers": []}])
        gltf.mesh()
        return gltf.save(folder / "m.glb"), upright(4.0)
    return dae_file(
        folder,
        dae(
            dae_places() + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>',
            before="<library_animations/>",
        ),
    ), upright(4.0)


@case("lights of the file", "glTF", says="lights of the file do not shine")
def lights(folder):
    gltf = Gltf().uses("KHR_lights_punctual", required=False)
    gltf.mesh()
    return gltf.save(folder / "m.glb"), upright(4.0)


@case("Draco compression", "glTF")
def draco(folder):
    gltf = Gltf().uses("KHR_draco_mesh_compression")
    data = DracoPy.encode(
        BOARD.astype(np.float32),
        TWO.astype(np.uint32),
        quantization_bits=14,
        tex_coord=np.column_stack([UV[:, 0], 1 - UV[:, 1]]),
    )
    view = gltf.view(data)
    gltf.mesh(
        gltf.accessor(BOARD, bufferView=None),
        gltf.accessor(TWO.ravel(), "u2", bufferView=None),
        gltf.textured(),
        {"TEXCOORD_0": gltf.accessor(UV, bufferView=None)},
        extensions={"KHR_draco_mesh_compression": {"bufferView": view, "attributes": {"POSITION": 1, "TEXCOORD_0": 0}}},
    )
    return gltf.save(folder / "m.glb"), lambda mesh: (
        is_quarters(mesh),
        np.testing.assert_allclose(area(mesh), 4.0, rtol=2e-4),
    )


@case("meshopt compression", "glTF", says="EXT_meshopt_compression.*gltf-transform copy")
def meshopt(folder):
    gltf = Gltf().uses("EXT_meshopt_compression")
    gltf.mesh()
    return gltf.save(folder / "m.glb")


@case("an unknown extension that the file requires", "glTF", says="requires this extension")
def unknown_required(folder):
    gltf = Gltf().uses("ACME_surfaces")
    gltf.mesh()
    return gltf.save(folder / "m.glb")


@case("an unknown extension that the file uses", "glTF", says="ACME_surfaces")
def unknown_used(folder):
    gltf = Gltf().uses("ACME_surfaces", required=False)
    gltf.mesh()
    return gltf.save(folder / "m.glb"), upright(4.0)


@case("up axis and unit", "glTF", "DAE")
def up_and_unit(folder, kind):
    def look(mesh):  # what was z is -y
        np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [2, 0, 2], atol=1e-12)
        np.testing.assert_allclose(mesh.vertices[:, 1], -0.25, atol=1e-12)
        assert (mesh.facts.up_axis, mesh.facts.up_is_guess) == ("y", False)

    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(BOARD + [0, 0, 0.25])
        return gltf.save(folder / "m.glb"), look
    text = dae(
        dae_places(100 * (BOARD + [0, 0, 0.25])) + f'<triangles count="2">{VERTEX}<p>0 1 2 0 2 3</p></triangles>',
        asset='<unit meter="0.01"/><up_axis>Y_UP</up_axis>',
    )
    return dae_file(folder, text), look


# ------------------------------------------------------------------------------------------------------------- colours


def dae_board(folder, diffuse, params="", extra="", uv=UV, bind="", colours=None, second=None):
    """A board with a material, coordinates and perhaps colours."""
    inputs, geometry, index = VERTEX, dae_places(), [[0, 1, 2, 0, 2, 3]]
    for semantic, name, values, letters, number in (
        ("TEXCOORD", "t", uv, "ST", 0),
        ("TEXCOORD", "w", second, "ST", 1),
        ("COLOR", "c", colours, "RGB", 0),
    ):
        if values is not None:
            geometry = dae_source(name, values, letters) + geometry
            inputs += f'<input semantic="{semantic}" source="#{name}" offset="{len(index)}" set="{number}"/>'
            index.append(index[0])
    p = " ".join(map(str, np.array(index).T.ravel()))
    geometry += f'<triangles material="x" count="2">{inputs}<p>{p}</p></triangles>'
    return dae_file(folder, dae(geometry, before=dae_effect(diffuse, params, extra), materials=BOUND.format(bind)))


TEXTURE = '<texture texture="a" texcoord="U"/>'


@case("one colour for a material", "glTF", "OBJ", "DAE")
def plain(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.1, 0.2, 1]}}))
        return gltf.save(folder / "m.glb"), is_colour([0.8, 0.1, 0.2])
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 0.8 0.1 0.2\n"), is_colour([0.8, 0.1, 0.2])
    return dae_board(folder, "<color>0.8 0.1 0.2 1</color>"), is_colour([0.8, 0.1, 0.2])


@case("one colour for a material", "OBJ")
def some_with_a_map(folder):
    text = V + VT + "v 3 -1 0\nv 5 -1 0\nv 5 1 0\nusemtl a\n" + QUAD + "usemtl b\nf 5/1 6/2 7/3\n"
    return obj(folder, text, "newmtl a\nmap_Kd q.png\nnewmtl b\nKd 0 0.8 0\n"), lambda mesh: (
        is_quarters(mesh),
        is_colour([0, 0.8, 0], 4.5, 0.0)(mesh),
    )


@case("one colour for a material", "glTF")
def specular_glossiness(folder):
    gltf = Gltf().uses("KHR_materials_pbrSpecularGlossiness")
    gltf.mesh(
        material=gltf.add(
            "materials",
            {"extensions": {"KHR_materials_pbrSpecularGlossiness": {"diffuseFactor": [0.25, 0.5, 1.0, 1.0]}}},
        )
    )
    return gltf.save(folder / "m.glb"), is_colour([0.25, 0.5, 1.0])


@case("one colour for a material", "glTF")
def white_by_default(folder):
    gltf = Gltf()
    gltf.mesh(material=gltf.add("materials", {}))
    return gltf.save(folder / "m.glb"), is_colour([1.0, 1.0, 1.0])


def textured(folder, kind, *, data=None, uv=UV, name="q.png"):
    """The board with a picture on it."""
    data = picture() if data is None else data
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured(data), attributes={"TEXCOORD_0": gltf.uv(uv)})
        return gltf.save(folder / "m.glb")
    if kind == "OBJ":
        vt = "".join(f"vt {u} {v}\n" for u, v in uv)
        path = obj(folder, V + vt + "usemtl a\n" + QUAD, f"newmtl a\nmap_Kd {name}\n")
    elif kind == "PLY":
        path = ply_file(
            folder,
            ply(
                f"{XYZ},float s,float t",
                rows(np.column_stack([BOARD, uv])),
                RING,
                "4 0 1 2 3",
                comments=f"comment TextureFile {name}\n",
            ),
        )
    else:
        path = dae_board(folder, TEXTURE, SAMPLER.format(""), uv=np.asarray(uv))
        path.write_text(path.read_text().replace("q.png", name))
    (folder / name).write_bytes(data)
    return path


@case("a texture", "glTF", "OBJ", "PLY", "DAE")
def texture(folder, kind):
    return textured(folder, kind), is_quarters


@case("a texture", "PLY")
def texture_of_faces(folder):
    text = ply(
        XYZ,
        rows(BOARD),
        f"{RING},list uchar float texcoord,int texnumber",
        "4 0 1 2 3 8 0 0 1 0 1 1 0 1 1",
        comments="comment TextureFile a.png\ncomment TextureFile my q.png\n",
    )
    (folder / "my q.png").write_bytes(picture())
    return ply_file(folder, text), is_quarters


@case("a texture", "glTF")
def texture_beside(folder):
    gltf = Gltf(
        images=[{"uri": "my%20q.png"}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    gltf.mesh(material=0, attributes={"TEXCOORD_0": gltf.uv()})
    (folder / "my q.png").write_bytes(picture())
    return gltf.save(folder / "m.glb"), is_quarters


@case("a texture and a factor", "glTF", "OBJ")
def factor(folder, kind):
    expected = is_colour([0.0, 0.5, 0.0], 0.5, 0.5)
    if kind == "OBJ":
        return obj(folder, V + VT + "usemtl a\n" + QUAD, "newmtl a\nKd 1 0.5 0.25\nmap_Kd q.png\n"), expected
    gltf = Gltf()
    gltf.mesh(
        material=gltf.textured(pbrMetallicRoughness={"baseColorFactor": [1, 0.5, 0.25, 1]}),
        attributes={"TEXCOORD_0": gltf.uv()},
    )
    gltf.mesh(
        BOARD + [3, 0, 0],
        material=gltf.textured(pbrMetallicRoughness={"baseColorFactor": [1, 1, 1, 1]}),
        attributes={"TEXCOORD_0": gltf.uv()},
    )
    return gltf.save(folder / "m.glb"), lambda mesh: (expected(mesh), is_colour([0.0, 1.0, 0.0], 3.5, 0.5)(mesh))


@case("several textures that repeat", "glTF", "OBJ", "PLY", "DAE")
def several(folder, kind):
    grey = picture(np.full((1, 1, 3), 188))
    (folder / "g.png").write_bytes(grey)
    both = np.concatenate([BOARD, BOARD + [3, 0, 0]])

    def look(mesh):
        repeats_twice(mesh)
        is_colour([srgb_to_linear(188 / 255.0)] * 3, 3.3, 0.1)(mesh)

    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured(), attributes={"TEXCOORD_0": gltf.uv(2 * UV)})
        gltf.mesh(BOARD + [3, 0, 0], material=gltf.textured(grey), attributes={"TEXCOORD_0": gltf.uv(2 * UV)})
        return gltf.save(folder / "m.glb"), look
    if kind == "OBJ":
        text = "".join(f"v {x} {y} {z}\n" for x, y, z in both) + "".join(f"vt {u} {v}\n" for u, v in 2 * UV)
        text += "usemtl a\nf 1/1 2/2 3/3 4/4\nusemtl b\nf 5/1 6/2 7/3 8/4\n"
        return obj(folder, text, "newmtl a\nmap_Kd q.png\nnewmtl b\nmap_Kd g.png\n"), look
    if kind == "PLY":
        (folder / "q.png").write_bytes(picture())
        text = ply(
            XYZ,
            rows(both),
            f"{RING},list uchar float texcoord,uchar texnumber",
            "4 0 1 2 3 8 0 0 2 0 2 2 0 2 0\n4 4 5 6 7 8 0 0 2 0 2 2 0 2 1",
            comments="comment TextureFile q.png\ncomment TextureFile g.png\n",
        )
        return ply_file(folder, text), look
    path = dae_board(folder, TEXTURE, SAMPLER.format(""), uv=2 * UV)
    text, second = path.read_text(), dae_effect(TEXTURE, SAMPLER.format("")).replace("q.png", "g.png")
    for name in ("i", "e", "m"):
        second = second.replace(f'id="{name}"', f'id="{name}2"').replace(f'"#{name}"', f'"#{name}2"')
    second = second.replace("<init_from>i<", "<init_from>i2<")
    geometry = re.search(r"<geometry .*</geometry>", text, re.S)[0].replace('id="g"', 'id="h"')
    for name in ("p", "pa", "t", "ta", "v"):
        geometry = geometry.replace(f'id="{name}"', f'id="{name}2"').replace(f'"#{name}"', f'"#{name}2"')
    node = (
        '<node id="o"><translate>3 0 0</translate><instance_geometry url="#h">'
        + BOUND.format("").replace("#m", "#m2")
        + "</instance_geometry></node></visual_scene>"
    )
    text = text.replace("<library_geometries>", second + "<library_geometries>").replace("</visual_scene>", node)
    return dae_file(folder, text.replace("</library_geometries>", geometry + "</library_geometries>")), look


@case("coordinates moved, scaled, turned", "glTF", "OBJ")
def transformed(folder, kind):
    if kind == "OBJ":
        text = V + VT + "usemtl a\n" + QUAD
        return obj(folder, text, "newmtl a\nmap_Kd -s 2 2 1 -o 1 -3 0 q.png\n"), repeats_twice
    gltf = Gltf().uses("KHR_texture_transform")
    info = {"extensions": {"KHR_texture_transform": {"scale": [2, 2], "offset": [3, -1]}}}
    gltf.mesh(material=gltf.textured(info=info), attributes={"TEXCOORD_0": gltf.uv()})
    return gltf.save(folder / "m.glb"), repeats_twice


@case("coordinates moved, scaled, turned", "glTF")
def turned(folder):
    """By a quarter: where u, v (v down) were 0.25, 0.25 they are 0.25, 0.75 after the offset (issue 1563 of glTF)."""
    gltf = Gltf().uses("KHR_texture_transform")
    info = {"extensions": {"KHR_texture_transform": {"rotation": math.pi / 2, "offset": [0, 1], "texCoord": 1}}}
    gltf.mesh(material=gltf.textured(info=info), attributes={"TEXCOORD_0": gltf.uv(0 * UV), "TEXCOORD_1": gltf.uv()})
    return gltf.save(folder / "m.glb"), lambda mesh: (
        is_colour([0, 0, 1.0], -0.5, 0.5)(mesh),
        is_colour([1.0, 0, 0], 0.5, 0.5)(mesh),
    )


@case("a second set of coordinates", "glTF", "DAE")
def second_set(folder, kind):
    if kind == "DAE":
        bind = '<bind_vertex_input semantic="U" input_semantic="TEXCOORD" input_set="1"/>'
        return dae_board(folder, TEXTURE, SAMPLER.format(""), uv=0 * UV, second=UV, bind=bind), is_quarters
    gltf = Gltf()
    gltf.mesh(
        material=gltf.textured(info={"texCoord": 1}),
        attributes={"TEXCOORD_0": gltf.uv(0 * UV), "TEXCOORD_1": gltf.uv()},
    )
    return gltf.save(folder / "m.glb"), is_quarters


@case("textures that clamp or mirror", "glTF", "OBJ", "DAE")
def clamps(folder, kind):
    clamped = 4.0 * UV - 1.5  # the picture fills the middle 1/16 of the board
    if kind == "OBJ":
        vt = "".join(f"vt {u} {v}\n" for u, v in clamped)
        return obj(folder, V + vt + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd -clamp on q.png\n"), is_quarters
    if kind == "DAE":
        return dae_board(
            folder, TEXTURE, SAMPLER.format("<wrap_s>CLAMP</wrap_s><wrap_t>CLAMP</wrap_t>"), uv=clamped
        ), is_quarters
    gltf = Gltf()
    gltf.mesh(
        material=gltf.textured(sampler={"wrapS": 33648, "wrapT": 33071}),
        attributes={"TEXCOORD_0": gltf.uv(np.column_stack([2 * UV[:, 0], clamped[:, 1]]))},
    )

    def look(mesh):  # mirrored along u: red, green, green, red
        for x, expected in ((-0.75, [1, 0, 0]), (-0.25, [0, 1, 0]), (0.25, [0, 1, 0]), (0.75, [1, 0, 0])):
            is_colour(expected, x, 0.5)(mesh)

    return gltf.save(folder / "m.glb"), look


@case("UDIM tiles", "OBJ")
def udim(folder):
    for number, colour in ((1001, [255, 0, 0]), (1002, [0, 255, 0]), (1011, [0, 0, 255])):
        (folder / f"t.{number}.png").write_bytes(picture(np.full((1, 1, 3), colour)))
    places = np.concatenate([BOARD, BOARD + [3, 0, 0], BOARD + [6, 0, 0]])
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in places)
    text += "".join(f"vt {u} {v}\n" for u, v in np.concatenate([UV, UV + [1, 0], UV + [0, 1]]))
    text += "usemtl a\n" + "".join(
        "f " + " ".join(f"{4 * k + i}/{4 * k + i}" for i in range(1, 5)) + "\n" for k in range(3)
    )
    return obj(folder, text, "newmtl a\nmap_Kd t.<UDIM>.png\n"), lambda mesh: (
        is_colour([1, 0, 0])(mesh),
        is_colour([0, 1, 0], 3.1)(mesh),
        is_colour([0, 0, 1], 6.1)(mesh),
    )


HALF = np.tile([0.5, 0.25, 0.0], (4, 1))
SHADES = np.array([188, 137, 0]) / 255.0


@case("colours of vertices, 8 bits", "glTF", "PLY", "OFF")
def bytes_of_vertices(folder, kind):
    expected = srgb_to_linear(SHADES)
    if kind == "OFF":
        return off(folder, BOARD, [[0, 1, 2, 3]], "COFF", " 188 137 0 255"), is_colour(expected)
    if kind == "PLY":
        return ply_file(
            folder,
            ply(
                f"{XYZ},uchar red,uchar green,uchar blue",
                rows(np.column_stack([BOARD, np.tile([188, 137, 0], (4, 1))]).astype(object)),
                RING,
                "4 0 1 2 3",
            ).replace("188.0 137.0 0.0", "188 137 0"),
        ), is_colour(expected)
    gltf = Gltf()  # linear, whatever the type
    gltf.mesh(attributes={"COLOR_0": gltf.accessor(np.tile([128, 64, 0, 255], (4, 1)), "u1", normalized=True)})
    return gltf.save(folder / "m.glb"), is_colour(np.array([128, 64, 0]) / 255.0)


@case("colours of vertices, 16 bits", "glTF", "PLY")
def words_of_vertices(folder, kind):
    if kind == "PLY":
        row = np.rint(65535 * SHADES).astype(int)
        text = ply(
            f"{XYZ},ushort diffuse_red,ushort diffuse_green,ushort diffuse_blue",
            "\n".join(f"{x} {y} {z} {row[0]} {row[1]} {row[2]}" for x, y, z in BOARD),
            RING,
            "4 0 1 2 3",
        )
        return ply_file(folder, text), lambda mesh: np.testing.assert_allclose(
            colour_at(mesh, 0.3, 0.1), srgb_to_linear(SHADES), atol=2e-5
        )
    gltf = Gltf()
    gltf.mesh(attributes={"COLOR_0": gltf.accessor(np.rint(65535 * HALF), "u2", normalized=True)})
    return gltf.save(folder / "m.glb"), lambda mesh: np.testing.assert_allclose(
        colour_at(mesh, 0.3, 0.1), HALF[0], atol=2e-5
    )


@case("colours of vertices, real numbers", "glTF", "OBJ", "PLY", "DAE", "OFF")
def reals_of_vertices(folder, kind):
    linear = is_colour(HALF[0])
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(
            material=gltf.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 1, 1]}}),
            attributes={"COLOR_0": gltf.accessor(HALF)},
        )
        return gltf.save(folder / "m.glb"), is_colour([0.5, 0.125, 0.0])
    if kind == "OBJ":  # as MeshLab and Meshroom write bytes of sRGB
        text = "".join(f"v {x} {y} {z} {SHADES[0]!r} {SHADES[1]!r} 0\n" for x, y, z in BOARD).replace("np.float64(", "")
        return obj(folder, text.replace(")", "") + "f 1 2 3 4\n", image=False), is_colour(srgb_to_linear(SHADES))
    if kind == "PLY":
        return ply_file(
            folder, ply(f"{XYZ},float r,float g,float b", rows(np.column_stack([BOARD, HALF])), RING, "4 0 1 2 3")
        ), linear
    if kind == "DAE":
        return dae_board(folder, "<color>1 1 1 1</color>", uv=None, colours=HALF), linear
    return off(folder, BOARD, [[0, 1, 2, 3]], "COFF", " 0.5 0.25 0.0 1.0"), linear


@case("colours of faces", "PLY", "STL", "OFF")
def of_faces(folder, kind):
    both, quads = np.concatenate([BOARD, BOARD + [3, 0, 0]]), [[0, 1, 2, 3], [4, 5, 6, 7]]
    if kind == "STL":
        path = folder / "m.stl"
        trimesh.Trimesh(BOARD, TWO, process=False).export(path)
        data = bytearray(path.read_bytes())
        data[84 + 48 : 84 + 50] = b"\xff\xff"
        path.write_bytes(data)
        return path, upright(4.0)
    if kind == "OFF":
        path = off(folder, both, quads)
        path.write_text(
            path.read_text().replace("4 0 1 2 3", "4 0 1 2 3 255 0 0").replace("4 4 5 6 7", "4 4 5 6 7 0 255 0")
        )
    else:
        path = ply_file(
            folder,
            ply(XYZ, rows(both), f"{RING},uchar red,uchar green,uchar blue", "4 0 1 2 3 255 0 0\n4 4 5 6 7 0 255 0"),
        )
    return path, lambda mesh: (is_colour([1, 0, 0])(mesh), is_colour([0, 1, 0], 3.1)(mesh), upright(8.0)(mesh))


@case("colours of vertices on a texture", "glTF", "PLY", "DAE")
def tinted(folder, kind):
    expected = is_colour([0.0, 0.25, 0.0], 0.5, 0.5)
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured(), attributes={"COLOR_0": gltf.accessor(HALF), "TEXCOORD_0": gltf.uv()})
        return gltf.save(folder / "m.glb"), expected
    if kind == "PLY":
        (folder / "q.png").write_bytes(picture())
        return ply_file(
            folder,
            ply(
                f"{XYZ},float s,float t,float red,float green,float blue",
                rows(np.column_stack([BOARD, UV, HALF])),
                RING,
                "4 0 1 2 3",
                comments="comment TextureFile q.png\n",
            ),
        ), expected
    return dae_board(folder, TEXTURE, SAMPLER.format(""), colours=HALF), expected


def masked_picture():
    """QUARTERS whose red quarter is transparent."""
    alpha = np.full((2, 2, 1), 255)
    alpha[0, 0] = 0
    return np.concatenate([QUARTERS, alpha], axis=2)


@case("masks", "glTF", "OBJ")
def masks(folder, kind):
    def look(mesh):
        assert mesh.skin.has_holes
        assert mesh.skin.pages[0].alpha[4, 4] == 0
        assert mesh.skin.pages[0].alpha[-4, 4] == 255
        is_colour([0.0, 1.0, 0.0], 0.5, 0.5)(mesh)

    if kind == "OBJ":
        (folder / "d.png").write_bytes(picture(np.array([[[0] * 3, [255] * 3], [[255] * 3, [255] * 3]])))
        return obj(folder, V + VT + "usemtl a\n" + QUAD, "newmtl a\nmap_Kd q.png\nmap_d d.png\n"), look
    gltf = Gltf()
    gltf.mesh(material=gltf.textured(picture(masked_picture()), alphaMode="MASK"), attributes={"TEXCOORD_0": gltf.uv()})
    return gltf.save(folder / "m.glb"), look


@case("masks", "glTF")
def mask_by_factor(folder):
    """Nothing is left of a mesh whose alpha is below the cutoff, and all of one whose alpha is not."""
    gltf = Gltf()
    for k, alpha in enumerate((0.4, 0.6)):
        gltf.mesh(
            BOARD + [3 * k, 0, 0],
            material=gltf.add(
                "materials", {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}}
            ),
        )
    return gltf.save(folder / "m.glb"), lambda mesh: (upright(4.0)(mesh), is_colour([1, 1, 1], 3.1)(mesh))


@case("transparency", "glTF", "OBJ", "DAE")
def transparency(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.add("materials", {"alphaMode": "BLEND"}))
        return gltf.save(folder / "m.glb"), upright(4.0)
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 1 1 1\nd 0.5\n"), upright(4.0)
    return dae_board(
        folder, "<color>1 1 1 1</color>", extra="<transparency><float>0.5</float></transparency>"
    ), upright(4.0)


@case("metal, bumps, emission", "glTF", "OBJ", says="not modelled")
def not_modelled(folder, kind):
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nKd 1 1 1\nmap_Bump q.png\nnorm q.png\n"), upright(
            4.0
        )
    gltf = Gltf()
    gltf.mesh(
        material=gltf.add(
            "materials",
            {
                "pbrMetallicRoughness": {"metallicFactor": 1.0},
                "normalTexture": {"index": 0},
                "emissiveTexture": {"index": 0},
            },
        )
    )
    return gltf.save(folder / "m.glb"), upright(4.0)


@case("several material libraries", "OBJ")
def libraries(folder):
    (folder / "my b.mtl").write_text("newmtl b\nKd 0 1 0\n")
    (folder / "c.mtl").write_text("newmtl c\nKd 0 0 1\n")
    text = "".join(f"v {x} {y} {z}\n" for x, y, z in np.concatenate([BOARD, BOARD + [3, 0, 0], BOARD + [6, 0, 0]]))
    text = (
        "mtllib my b.mtl\n"
        + text
        + "usemtl a\nf 1 2 3 4\nusemtl b\nf 5 6 7 8\nmtllib x.mtl c.mtl\nusemtl c\nf 9 10 11 12\n"
    )
    (folder / "x.mtl").write_text("")
    return obj(folder, text, "newmtl a\nKd 1 0 0\n"), lambda mesh: (
        is_colour([1, 0, 0])(mesh),
        is_colour([0, 1, 0], 3.1)(mesh),
        is_colour([0, 0, 1], 6.1)(mesh),
    )


@case("coordinates without a texture", "glTF", "OBJ", "PLY", "DAE")
def bare_uv(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(attributes={"TEXCOORD_0": gltf.uv()})
        return gltf.save(folder / "m.glb"), is_grey
    if kind == "OBJ":
        return obj(folder, V + VT + QUAD, image=False), is_grey
    if kind == "PLY":
        return ply_file(
            folder, ply(f"{XYZ},float s,float t", rows(np.column_stack([BOARD, UV])), RING, "4 0 1 2 3")
        ), is_grey
    return dae_board(folder, "<color>0.5 0.5 0.5 1</color>"), is_grey


@case("a texture without coordinates", "glTF", "OBJ", "PLY", "DAE")
def bare_texture(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(material=gltf.textured())
        return gltf.save(folder / "m.glb"), upright(4.0)
    if kind == "OBJ":
        return obj(folder, V + "usemtl a\nf 1 2 3 4\n", "newmtl a\nmap_Kd q.png\n"), is_grey
    if kind == "PLY":
        return ply_file(
            folder, ply(XYZ, rows(BOARD), RING, "4 0 1 2 3", comments="comment TextureFile q.png\n")
        ), is_grey
    return dae_board(folder, TEXTURE, SAMPLER.format(""), uv=None), is_grey


@case("a texture file that is not there", "glTF", "OBJ", "PLY", "DAE", says=r"is not there \(gone.png\)")
def gone(folder, kind):
    if kind == "glTF":
        gltf = Gltf(
            images=[{"uri": "gone.png"}],
            textures=[{"source": 0}],
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        )
        gltf.mesh(material=0, attributes={"TEXCOORD_0": gltf.uv()})
        return gltf.save(folder / "m.glb"), is_grey
    path = textured(folder, kind, name="gone.png")
    (folder / "gone.png").unlink()
    return path, is_grey


@case("a material library that is not there", "OBJ", says="gone.mtl, which is not there")
def gone_library(folder):
    return obj(folder, "mtllib gone.mtl\n" + V + VT + "usemtl a\n" + QUAD, image=False), is_grey


@case("a picture over the limit", "glTF", "OBJ", "PLY", "DAE", says="texture pixels are more than the limit")
def too_large(folder, kind):
    return textured(folder, kind, data=picture(np.zeros((1, 1, 3)), side=200))


@case("a picture of an unknown kind", "glTF", "OBJ", "PLY", "DAE", says="cannot be read as an image|32 bits a channel")
def odd_picture(folder, kind):
    return textured(folder, kind, data=b"no picture at all")


@case("a picture of an unknown kind", "OBJ", "PLY", "DAE", says="32 bits a channel")
def real_picture(folder, kind):
    import io

    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(np.full((4, 4), 0.5, np.float32)).save(file, "TIFF")
    return textured(folder, kind, data=file.getvalue())


@case("WebP pictures", "glTF", "OBJ", "PLY", "DAE")
def webp(folder, kind):
    data = picture(kind="WEBP", lossless=True)
    if kind != "glTF":
        return textured(folder, kind, data=data, name="q.webp"), is_quarters
    gltf = Gltf().uses("EXT_texture_webp")
    material = gltf.textured(data, mime="image/webp")
    gltf.document["textures"][0] = {"extensions": {"EXT_texture_webp": {"source": 0}}}
    gltf.mesh(material=material, attributes={"TEXCOORD_0": gltf.uv()})
    return gltf.save(folder / "m.glb"), is_quarters


@case("KTX2 pictures", "glTF", says="KHR_texture_basisu.*ktxdecompress")
def ktx2(folder):
    gltf = Gltf().uses("KHR_texture_basisu")
    gltf.mesh()
    return gltf.save(folder / "m.glb")


# -------------------------------------------------------------------------------------------------------------- damage


@case("a face that names a vertex that is not there", "glTF", "OBJ", "PLY", "DAE", "OFF", says=r"vertex \d+ of 4")
def beyond(folder, kind):
    if kind == "glTF":
        gltf = Gltf()
        gltf.mesh(faces=[[0, 1, 4]])
        return gltf.save(folder / "m.glb")
    if kind == "OBJ":
        return obj(folder, V + "f 1 2 5\n", image=False)
    if kind == "PLY":
        return ply_file(folder, ply(XYZ, rows(BOARD), RING, "3 0 1 4"))
    if kind == "DAE":
        return dae_file(folder, dae(dae_places() + f'<triangles count="1">{VERTEX}<p>0 1 4</p></triangles>'))
    return off(folder, BOARD, [[0, 1, 4]])


@case("a face that names a vertex that is not there", "OBJ", says=r"vertex -\d of 4")
def before_the_first(folder):
    return obj(folder, V + "f -1 -2 -9\n", image=False)


@case(
    "coordinates of a texture that are not finite", "glTF", "OBJ", "PLY", "DAE", says="coordinates that are not finite"
)
def not_finite(folder, kind):
    uv = UV.copy()
    uv[2, 0] = np.nan
    return textured(folder, kind, uv=uv)


@case("a file that breaks off", "glTF", "PLY", "DAE", "STL", "OFF")
def broken_off(folder, kind):
    path, _ = triangles(folder, kind)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) * 2 // 3])
    return path
