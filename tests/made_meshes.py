"""Mesh files made by hand, byte by byte, as their specifications say."""

import base64
import io
import json
import struct

import numpy as np
from PIL import Image

from varos_warp.scene.images import linear

BOARD = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
"""A square of 4 m^2 in the plane of x and y, seen from +z."""
TWO = np.array([[0, 1, 2], [0, 2, 3]])
QUARTERS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
"""Rows from the top: red, green; blue, white."""
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
"""Of BOARD, v up: the picture fills it, upright."""
L_SHAPE = np.array([[0.0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
"""3 m^2; its corner 3 is reentrant."""
TYPES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
WIDTHS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def picture(pixels=QUARTERS, kind="PNG", side=16, **options) -> bytes:
    """An image file of blocks of one colour."""
    file = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8).repeat(side, 0).repeat(side, 1)).save(file, kind, **options)
    return file.getvalue()


class Gltf:
    """A glTF document that grows; `save` writes it as GLB."""

    def __init__(self, **document):
        self.chunk, self.document = (
            b"",
            {
                "asset": {"version": "2.0", "generator": "hand"},
                "accessors": [],
                "bufferViews": [],
                "meshes": [],
                "nodes": [],
                **document,
            },
        )

    def view(self, data: bytes, **more) -> int:
        """A buffer view of bytes."""
        self.chunk += bytes(-len(self.chunk) % 4)
        self.document["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.chunk), "byteLength": len(data), **more}
        )
        self.chunk += data
        return len(self.document["bufferViews"]) - 1

    def accessor(self, values, kind="f4", **more) -> int:
        """An accessor of an array [count] or [count, width]."""
        values = np.asarray(values).astype("<" + kind)
        width = 1 if values.ndim == 1 else values.shape[1]
        more.setdefault("bufferView", self.view(values.tobytes()))
        self.document["accessors"].append(
            {
                "componentType": TYPES[kind],
                "count": len(values),
                "type": WIDTHS[width],
                **{key: value for key, value in more.items() if value is not None},
            }
        )
        return len(self.document["accessors"]) - 1

    def mesh(self, places=BOARD, faces=TWO, material=None, attributes=None, node=True, **more) -> int:
        """A mesh of one primitive, and a node for it."""
        given = {"POSITION": places if isinstance(places, int) else self.accessor(places), **(attributes or {})}
        block = {"attributes": given, **more}
        if faces is not None:
            block["indices"] = faces if isinstance(faces, int) else self.accessor(np.ravel(faces), "u2")
        if material is not None:
            block["material"] = material
        self.document["meshes"].append({"primitives": [block]})
        if node:
            self.node(mesh=len(self.document["meshes"]) - 1)
        return len(self.document["meshes"]) - 1

    def node(self, **block) -> int:
        """A node."""
        self.document["nodes"].append(block)
        return len(self.document["nodes"]) - 1

    def add(self, kind: str, block: dict) -> int:
        """An object of any kind."""
        self.document.setdefault(kind, []).append(block)
        return len(self.document[kind]) - 1

    def textured(self, data=None, info=None, sampler=None, mime="image/png", **material) -> int:
        """A material with a picture as its base colour."""
        image = self.add("images", {"bufferView": self.view(picture() if data is None else data), "mimeType": mime})
        texture = {"source": image} | ({} if sampler is None else {"sampler": self.add("samplers", sampler)})
        metallic = {"baseColorTexture": {"index": self.add("textures", texture), **(info or {})}}
        metallic |= material.pop("pbrMetallicRoughness", {})
        return self.add("materials", {"pbrMetallicRoughness": metallic, **material})

    def uv(self, uv=UV, kind="f4", **more) -> int:
        """Texture coordinates, given v up, stored v down."""
        return self.accessor(np.column_stack([np.asarray(uv)[:, 0], 1.0 - np.asarray(uv)[:, 1]]), kind, **more)

    def uses(self, name, required=True):
        """Declare an extension."""
        self.document.setdefault("extensionsUsed", []).append(name)
        if required:
            self.document.setdefault("extensionsRequired", []).append(name)
        return self

    def save(self, path):
        """Write it as GLB."""
        path.write_bytes(self.packed())
        return path

    def text(self) -> str:
        """It as text, with its bytes inside."""
        data = "data:application/octet-stream;base64," + base64.b64encode(self.chunk).decode()
        return json.dumps({**self.document, "buffers": [{"byteLength": len(self.chunk), "uri": data}]})

    def packed(self) -> bytes:
        """It as GLB."""
        self.document["buffers"] = [{"byteLength": len(self.chunk)}]
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        chunk = self.chunk + bytes(-len(self.chunk) % 4)
        data = struct.pack("<4sIII4s", b"glTF", 2, 28 + len(text) + len(chunk), len(text), b"JSON") + text
        data += struct.pack("<I4s", len(chunk), b"BIN\0") + chunk
        return data


def dae(
    geometry: str, *, node="", scene=None, before="", asset='<unit meter="1"/><up_axis>Z_UP</up_axis>', materials=""
) -> str:
    """A COLLADA document around the insides of one mesh."""
    shown = scene or f'<node id="n">{node}<instance_geometry url="#g">{materials}</instance_geometry></node>'
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset>{asset}</asset>{before}
<library_geometries><geometry id="g"><mesh>{geometry}</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s">{shown}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def dae_source(name: str, values, params="XYZ", stride=None, offset=0) -> str:
    """A source with its accessor."""
    values = np.asarray(values, float)
    text, count = " ".join(map(repr, values.ravel().tolist())), len(values)
    stride = stride or values.shape[1]
    named = "".join(f'<param name="{p}" type="float"/>' if p != "-" else '<param type="float"/>' for p in params)
    return (
        f'<source id="{name}"><float_array id="{name}a" count="{values.size}">{text}</float_array><technique_common>'
        f'<accessor source="#{name}a" count="{count}" stride="{stride}" offset="{offset}">{named}</accessor>'
        "</technique_common></source>"
    )


def dae_places(places=BOARD) -> str:
    """Positions, as sources and vertices."""
    return dae_source("p", places) + '<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'


VERTEX = '<input semantic="VERTEX" source="#v" offset="0"/>'


def dae_effect(diffuse: str, params="", extra="") -> str:
    """An effect, its material, and an image of q.png."""
    return (
        f'<library_images><image id="i"><init_from>q.png</init_from></image></library_images><library_effects>'
        f'<effect id="e"><profile_COMMON>{params}<technique sid="t"><lambert><diffuse>{diffuse}</diffuse>{extra}'
        "</lambert></technique></profile_COMMON></effect></library_effects><library_materials>"
        '<material id="m"><instance_effect url="#e"/></material></library_materials>'
    )


SAMPLER = (
    '<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam><newparam sid="a">'
    "<sampler2D><source>f</source>{}</sampler2D></newparam>"
)
BOUND = (
    '<bind_material><technique_common><instance_material symbol="x" target="#m">{}</instance_material>'
    "</technique_common></bind_material>"
)


def ply(vertex: str, vertices: str, face: str, faces: str, *, more="", comments="") -> str:
    """A PLY in text: properties and rows of vertices and faces."""
    count, faces_count = vertices.strip().count("\n") + 1, faces.strip().count("\n") + 1
    head = "".join(f"property {p}\n" for p in vertex.split(","))
    tail = "".join(f"property {p}\n" for p in face.split(","))
    return (
        f"ply\nformat ascii 1.0\n{comments}element vertex {count}\n{head}element face {faces_count}\n{tail}{more}"
        f"end_header\n{vertices.strip()}\n{faces.strip()}\n"
    )


def rows(values) -> str:
    """Rows of numbers as text."""
    return "\n".join(
        " ".join(repr(float(x)) if isinstance(x, float | np.floating) else str(x) for x in row)
        for row in np.asarray(values, object)
    )


def colour_at(mesh, x, y):
    """Linear colour of a loaded mesh over (x, y), computed here: nearest texel, factor, tint."""
    mesh_xy, faces, skin = mesh.vertices[:, :2], mesh.faces, mesh.skin
    for k, face in enumerate(faces):
        a, b, c = mesh_xy[face]
        w = np.linalg.solve(np.array([[*a, 1], [*b, 1], [*c, 1]]).T, [x, y, 1.0])
        if (w >= -1e-9).all():
            values = w @ skin.corners[k]
            page = (0 if skin.pages else -1) if skin.page is None else skin.page[k]
            if page < 0:
                return values[:3]
            tint = 1.0 if skin.tints is None else (w @ skin.tints[k])[:3]
            return texel(skin.pages[page], values[:2]) * skin.pages[page].factor * tint
    raise AssertionError("nothing there")


def texel(page, uv):
    height, width, _ = page.texels.shape
    u, v = (wrapped(x, how) for x, how in zip(uv, page.wrap, strict=True))
    return linear(page.texels)[min(int((1.0 - v) * height), height - 1), min(int(u * width), width - 1)]


def wrapped(x, how):
    if how == "clamp":
        return min(max(x, 0.0), 1.0)
    return 1.0 - abs(x % 2.0 - 1.0) if how == "mirror" else x % 1.0
