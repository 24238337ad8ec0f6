"""Cases of shape."""

import math

import DracoPy
import numpy as np
import pytest
import trimesh
from made_meshes import (
    BOARD,
    TWO,
    UV,
    VERTEX,
    Gltf,
    dae,
    dae_places,
    dae_source,
    ply,
    rows,
)

from mesh_cases.table import (
    BOWTIE,
    FLAT,
    FORMATS,
    RING,
    XYZ,
    V,
    area,
    case,
    dae_file,
    has_area,
    is_quarters,
    obj,
    off,
    ply_file,
    polygon,
)

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
