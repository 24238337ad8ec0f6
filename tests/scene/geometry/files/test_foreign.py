"""Files that other programs write, and what other programs read in them: area, extent, and colours at 20 places."""

import io
import struct
import warnings

import collada
import meshio
import mitsuba
import numpy as np
import pygltflib
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial, SimpleMaterial

from varos_warp.scene.geometry.mesh_files import load_mesh
from varos_warp.scene.images import linear, srgb_to_linear

BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.7)
BOX = trimesh.creation.box((1.0, 2.0, 3.0))
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
"""Faces of BOX, outwards."""
SHADES = np.clip(np.rint(255 * (0.5 + 0.6 * BALL.vertices)), 0, 255).astype(np.uint8)
"""Colours of the vertices of BALL."""
UV = 0.5 + 0.45 * BALL.vertices[:, :2] / 0.7
GRADIENT = np.stack([*np.meshgrid(np.arange(64) * 4, np.arange(64) * 4), np.full((64, 64), 99)], -1).astype(np.uint8)
"""A picture in which every colour tells its place, rows from the top."""


def painted():
    mesh = BALL.copy()
    mesh.visual = ColorVisuals(mesh, vertex_colors=np.column_stack([SHADES, np.full(len(SHADES), 255)]))
    return mesh


def mapped(material):
    return trimesh.Trimesh(BALL.vertices, BALL.faces, process=False, visual=TextureVisuals(uv=UV, material=material))


def by_trimesh(mesh, name, **options):
    def write(folder):
        if name.endswith(".gltf"):
            for file, data in trimesh.Scene(mesh).export(file_type="gltf").items():
                (folder / file).write_bytes(data)
            return folder / "model.gltf"
        mesh.export(folder / name, **options)
        return folder / name

    return write


def by_meshio(name, cells, points=BALL.vertices, **options):
    def write(folder):
        meshio.write(folder / name, meshio.Mesh(points, cells), **options)
        return folder / name

    return write


def by_pygltflib(colours=None, uv=None):
    def write(folder):
        blobs, gltf = [BALL.faces.astype("<u2").tobytes(), BALL.vertices.astype("<f4").tobytes()], pygltflib.GLTF2()
        attributes = pygltflib.Attributes(POSITION=1)
        gltf.accessors = [
            pygltflib.Accessor(bufferView=0, componentType=5123, count=BALL.faces.size, type="SCALAR"),
            pygltflib.Accessor(
                bufferView=1,
                componentType=5126,
                count=len(BALL.vertices),
                type="VEC3",
                min=BALL.vertices.min(0).tolist(),
                max=BALL.vertices.max(0).tolist(),
            ),
        ]
        for values, width, name in ((colours, "VEC3", "COLOR_0"), (uv, "VEC2", "TEXCOORD_0")):
            if values is not None:
                setattr(attributes, name, len(blobs))
                gltf.accessors.append(
                    pygltflib.Accessor(bufferView=len(blobs), componentType=5126, count=len(values), type=width)
                )
                blobs.append(np.asarray(values, "<f4").tobytes())
        primitive = pygltflib.Primitive(attributes=attributes, indices=0)
        if uv is not None:
            file = io.BytesIO()
            Image.fromarray(GRADIENT).save(file, "PNG")
            gltf.images = [pygltflib.Image(bufferView=len(blobs), mimeType="image/png")]
            gltf.textures, blobs = [pygltflib.Texture(source=0)], [*blobs, file.getvalue()]
            gltf.materials = [
                pygltflib.Material(
                    pbrMetallicRoughness=pygltflib.PbrMetallicRoughness(
                        metallicFactor=0.0, baseColorTexture=pygltflib.TextureInfo(index=0)
                    )
                )
            ]
            primitive.material = 0
        gltf.meshes, gltf.nodes = [pygltflib.Mesh(primitives=[primitive])], [pygltflib.Node(mesh=0)]
        gltf.scenes, gltf.scene, whole = [pygltflib.Scene(nodes=[0])], 0, b""
        for blob in blobs:
            gltf.bufferViews.append(pygltflib.BufferView(buffer=0, byteOffset=len(whole), byteLength=len(blob)))
            whole += blob + bytes(-len(blob) % 4)
        gltf.buffers = [pygltflib.Buffer(byteLength=len(whole))]
        gltf.set_binary_blob(whole)
        gltf.save(folder / "m.glb")
        return folder / "m.glb"

    return write


def by_pycollada(uv=None, colour=None):
    def write(folder):
        document = collada.Collada()
        document.assetInfo.upaxis = "Z_UP"
        sources = [collada.source.FloatSource("p", BALL.vertices.ravel(), ("X", "Y", "Z"))]
        inputs, index = collada.source.InputList(), BALL.faces.ravel()
        inputs.addInput(0, "VERTEX", "#p")
        diffuse, params = colour or (0.5, 0.5, 0.5, 1.0), []
        if uv is not None:
            Image.fromarray(GRADIENT).save(folder / "q.png")
            sources.append(collada.source.FloatSource("t", np.asarray(uv).ravel(), ("S", "T")))
            inputs.addInput(1, "TEXCOORD", "#t", set="0")
            index = np.repeat(index, 2)
            image = collada.material.CImage("i", "q.png")
            surface = collada.material.Surface("s", image)
            sampler = collada.material.Sampler2D("x", surface)
            document.images.append(image)
            diffuse, params = collada.material.Map(sampler, "UV"), [surface, sampler]
        effect = collada.material.Effect("e", params, "lambert", diffuse=diffuse)
        material = collada.material.Material("m", "m", effect)
        document.effects.append(effect)
        document.materials.append(material)
        geometry = collada.geometry.Geometry(document, "g", "g", sources)
        geometry.primitives.append(geometry.createTriangleSet(index, inputs, "m"))
        document.geometries.append(geometry)
        bound = [collada.scene.MaterialNode("m", material, inputs=[("UV", "TEXCOORD", "0")])]
        node = collada.scene.Node("n", children=[collada.scene.GeometryNode(geometry, bound)])
        document.scenes.append(collada.scene.Scene("w", [node]))
        document.scene = document.scenes[0]
        document.write(str(folder / "m.dae"))
        return folder / "m.dae"

    return write


PICTURE = Image.fromarray(GRADIENT)
TRIANGLES, BOXES = [("triangle", BALL.faces)], [("quad", QUADS)]
FILES = {
    **{
        f"trimesh {name}": (by_trimesh(BALL, name, **options), None)
        for name, options in {
            "m.glb": {},
            "m.gltf": {},
            "m.obj": {},
            "m.ply": {},
            "text.ply": {"encoding": "ascii"},
            "m.stl": {},
            "text.stl": {"file_type": "stl_ascii"},
            "m.off": {},
        }.items()
    },
    **{
        f"trimesh colours {name}": (by_trimesh(painted(), name, **options), "linear" if name == "m.glb" else "shades")
        for name, options in {"m.glb": {}, "m.ply": {}, "text.ply": {"encoding": "ascii"}, "m.obj": {}}.items()
    },
    **{
        f"trimesh texture {name}": (by_trimesh(mapped(PBRMaterial(baseColorTexture=PICTURE)), name), "picture")
        for name in ("m.glb", "m.gltf")
    },
    "trimesh texture m.obj": (
        by_trimesh(mapped(SimpleMaterial(PICTURE, diffuse=[255, 255, 255, 255])), "m.obj"),
        "picture",
    ),
    "pygltflib": (by_pygltflib(), None),
    "pygltflib colours": (by_pygltflib(SHADES / 255.0), "linear"),
    "pygltflib texture": (by_pygltflib(uv=np.column_stack([UV[:, 0], 1 - UV[:, 1]])), "picture"),
    **{
        f"meshio {name}": (by_meshio(name, TRIANGLES, **options), None)
        for name, options in {
            "m.ply": {},
            "text.ply": {"binary": False},
            "m.stl": {"binary": True},
            "m.obj": {},
            "m.off": {},
        }.items()
    },
    **{
        f"meshio quads {name}": (by_meshio(name, BOXES, BOX.vertices, **options), None)
        for name, options in {"m.ply": {}, "text.ply": {"binary": False}, "m.obj": {}}.items()
    },
    "trimesh m.dae": (by_trimesh(BALL, "m.dae"), "black"),
    "pycollada": (by_pycollada(), "grey"),
    "pycollada colour": (by_pycollada(colour=(0.2, 0.4, 0.6, 1.0)), "blue"),
    "pycollada texture": (by_pycollada(uv=UV), "picture"),
}


@pytest.mark.parametrize("name", FILES)
def test_area_extent_and_colours_are_those_that_others_read(tmp_path, name):
    write, colours = FILES[name]
    path = write(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if name == "trimesh m.dae":
            warnings.filterwarnings("ignore", ".*its materials make it black all over")
        mesh = load_mesh(path, up_axis="z")
    read = read_by_trimesh if "quads" in name else READERS[path.suffix]
    vertices, faces = read_stl_text(path) if path.name == "text.stl" else read(path)
    for points, triangles in (
        (vertices, faces),
        ((BOX if "quads" in name else BALL).vertices, (BOX if "quads" in name else BALL).faces),
    ):
        np.testing.assert_allclose(
            [mesh.vertices.min(0), mesh.vertices.max(0)], [points.min(0), points.max(0)], atol=1e-6
        )
        assert area(mesh.vertices, mesh.faces) == pytest.approx(area(points, triangles), rel=1e-6)
        assert volume(mesh.vertices, mesh.faces) == pytest.approx(volume(points, triangles), rel=1e-5)  # none is turned
    if colours is None:
        assert mesh.skin is None
        return
    for place, seen in at_corners(mesh, 20):
        np.testing.assert_allclose(seen, expected(colours, place), atol=0.02 if colours == "picture" else 2e-3)


def area(points, faces):
    a, b, c = np.moveaxis(np.asarray(points, float)[faces], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def volume(points, faces):
    a, b, c = np.moveaxis(np.asarray(points, float)[faces], 1, 0)
    return (a * np.cross(b, c)).sum() / 6.0


def at_corners(mesh, count):
    """Places of corners of faces, and the linear colours there."""
    for k in np.random.default_rng(3).integers(0, len(mesh.faces), count):
        values, skin = mesh.skin.corners[k, 1], mesh.skin
        if skin.pages:
            height, width, _ = skin.pages[0].texels.shape
            values = linear(skin.pages[0].texels)[int((1 - values[1]) * height), int(values[0] * width)]
        yield mesh.vertices[mesh.faces[k, 1]], values


def expected(colours, place):
    """Linear colour of BALL at one of its vertices."""
    vertex = np.argmin(np.linalg.norm(BALL.vertices - place, axis=1))
    if colours in ("grey", "blue", "black"):
        return {"grey": [0.5] * 3, "blue": [0.2, 0.4, 0.6], "black": [0.0] * 3}[colours]
    if colours == "picture":
        u, v = UV[vertex]
        return srgb_to_linear(GRADIENT[int((1 - v) * 64), int(u * 64)] / 255.0)
    return SHADES[vertex] / 255.0 if colours == "linear" else srgb_to_linear(SHADES[vertex] / 255.0)


# -------------------------------------------------------------------------------------------------------- other readers


def read_gltf(path):
    """By pygltflib, and accessors unpacked with struct."""
    gltf = pygltflib.GLTF2().load(str(path))
    primitive = gltf.meshes[0].primitives[0]

    def values(index, letter, width):
        accessor = gltf.accessors[index]
        view = gltf.bufferViews[accessor.bufferView]
        data = (
            gltf.get_data_from_buffer_uri(gltf.buffers[view.buffer].uri)
            if gltf.buffers[view.buffer].uri
            else gltf.binary_blob()
        )
        return np.array(struct.unpack_from(f"<{width * accessor.count}{letter}", data, view.byteOffset or 0))

    code = gltf.accessors[primitive.indices].componentType
    return values(primitive.attributes.POSITION, "f", 3).reshape(-1, 3), values(
        primitive.indices, {5123: "H", 5125: "I"}[code], 1
    ).reshape(-1, 3)


def read_by_mitsuba(path):
    mitsuba.set_variant("scalar_rgb")
    params = mitsuba.traverse(mitsuba.load_dict({"type": path.suffix[1:], "filename": str(path)}))
    return np.array(params["vertex_positions"]).reshape(-1, 3), np.array(params["faces"]).reshape(-1, 3)


def read_by_meshio(path):
    mesh = meshio.read(path)
    return mesh.points, mesh.cells_dict["triangle"]


def read_by_trimesh(path):
    mesh = trimesh.load_mesh(path, process=False)
    return mesh.vertices, mesh.faces


def read_stl_text(path):
    places = np.array([line.split()[1:] for line in path.read_text().splitlines() if "vertex" in line], float)
    return places, np.arange(len(places)).reshape(-1, 3)


def read_by_pycollada(path):
    (primitive,) = next(iter(collada.Collada(str(path)).scene.objects("geometry"))).primitives()
    return primitive.vertex, primitive.vertex_index


READERS = {
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".obj": read_by_mitsuba,
    ".ply": read_by_mitsuba,
    ".off": read_by_meshio,
    ".stl": read_by_meshio,
    ".dae": read_by_pycollada,
}
