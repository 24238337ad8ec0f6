"""Mesh files: reading vertices in float64, z up, in metres, and the colours that they bring along; and writing."""

import json
import logging
import os
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.visual.material import PBRMaterial, pack

from varos_warp.errors import InputError
from varos_warp.files import require_file
from varos_warp.limits import check_limit
from varos_warp.scene.geometry.foreign import remedy_for
from varos_warp.scene.geometry.joining import join
from varos_warp.scene.geometry.parts import Skin
from varos_warp.scene.geometry.topology import FARTHEST
from varos_warp.scene.images import decode_image, srgb_to_linear

FORMATS = (".dae", ".obj", ".ply", ".stl", ".glb", ".gltf", ".off")

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # what it logs of damaged files: not to stderr

TO_Z_UP = {
    "x": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotations from COLLADA's X_UP, Y_UP and Z_UP (right, up, in: -y x z; x y z; x z -y) to z up."""


def load_mesh(path: str | Path, key: str = "file", up_axis: str | None = None, *, with_skin: bool = True):
    """Vertices float64 [V, 3] [m, z up], faces int32 [F, 3] and Skin or None of a mesh file, its scene graph flattened.

    DAE's ``<up_axis>`` and ``<unit>`` are obeyed, glTF is y up (but for files that trimesh wrote, which does not
    rotate); OBJ, PLY, STL and OFF do not say and are taken as they are, in metres. Equal vertices are merged. Base
    colour maps are read from GLB, glTF and OBJ files, colours of vertices or faces from PLY, GLB and OFF files.

    Args:
        path: The file.
        key: The scene file's key that names it, for messages.
        up_axis: Overrides which axis of the file points up: x, y or z.
        with_skin: Whether to read the colours that the file brings along.

    Raises:
        InputError: The file is missing, empty, unreadable, without triangles, or holds vertices that are not finite.
    """
    path = Path(path)
    vertices, faces, skin = read_mesh(path, key, up_axis, with_skin=with_skin)
    bad = ~(np.abs(vertices) < FARTHEST).all(axis=1)
    if bad.any():
        raise InputError(f"{bad.sum()} of {len(vertices)} vertices are NaN or infinite, or too far away (the first is "
                         f"number {np.argmax(bad)})", file=path, key=key,
                         remedy="Remove them in a mesh editor, or with `varos-warp preprocess`.")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    kept = mesh.area_faces > 0.0
    mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise InputError("all triangles of the mesh have zero area", file=path, key=key, remedy="Export it anew.")
    skin = skin and replace(skin, corners=skin.corners[kept])
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), skin


def read_mesh(path: str | Path, key: str = "file", up_axis: str | None = None, *, with_skin: bool = False):
    """The same as it stands in the file: nothing merged or dropped, and vertices may be NaN or infinite.

    Raises:
        InputError: The file is missing, empty, unreadable or without triangles.
    """
    path = Path(path)
    _check_file(path, key)
    try:
        with np.errstate(invalid="ignore"):  # vertices that are not finite are the caller's
            read = _read_dae(path) if path.suffix.lower() == ".dae" else _read_with_trimesh(path, with_skin)
    except InputError:
        raise
    except Exception as error:  # every format's reader raises its own kinds
        problem = f"cannot be read as a mesh: {str(error).strip() or type(error).__name__}"
        raise InputError(problem, file=path, key=key, remedy="Export it anew from the program that made it.") from error
    vertices, faces, axis, skin = read
    if len(faces) == 0:
        raise InputError("the mesh has no triangles", file=path, key=key,
                         remedy="Point clouds and lines cannot be rendered; export a surface.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"a face names vertex {faces.max()} of {len(vertices)}", file=path, key=key,
                         remedy="The file is damaged; export it again.")
    up = TO_Z_UP[up_axis or axis]
    with np.errstate(invalid="ignore"):
        return vertices if (up == np.eye(3)).all() else vertices @ up.T, np.asarray(faces, np.int32), skin


def write_ply(path: str | Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write a binary PLY in double precision, aside first and then renamed (trimesh writes single precision)."""
    path = Path(path)
    header = (f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
              "property double x\nproperty double y\nproperty double z\n"
              f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n")
    rows = np.empty(len(faces), [("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_bytes(header.encode() + np.asarray(vertices, "<f8").tobytes() + rows.tobytes())
        aside.replace(path)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise InputError(f"cannot be written: {error.strerror}", file=path,
                         remedy="Choose a folder that exists, is writable and has space.") from error


def _check_file(path, key):
    """The file exists, has a known format and is not empty."""
    require_file(path, "mesh file", "Paths are relative to the scene file; correct the path.", key)
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"unknown mesh format '{path.suffix}'", file=path, key=key,
                         remedy=remedy_for(path.suffix, FORMATS))
    if path.stat().st_size == 0:
        raise InputError("the mesh file is empty (0 bytes)", file=path, key=key,
                         remedy="Copy or export it again; the transfer may have broken off.")


# ------------------------------------------------------------------------------------------------------------- readers


def _read_with_trimesh(path, with_skin):
    """Vertices, faces, up axis and Skin or None of a file that trimesh reads in double precision."""
    options = {"skip_materials": True} if path.suffix.lower() == ".obj" and not with_skin else {}
    loaded = trimesh.load_scene(path, process=False, **options)
    meshes, skinned, count = [], [], 0
    for node in loaded.graph.nodes_geometry:
        matrix, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh):
            count += len(mesh.faces)
            check_limit("TRIANGLES", count, file=path)
            meshes.append(_transformed(mesh.vertices, mesh.faces, matrix))
            skinned.append((mesh, bool(np.linalg.det(matrix[:3, :3]) < 0.0)))
    vertices, faces = join(meshes)
    return vertices, faces, "y" if _gltf_is_y_up(path) else "z", join_skins(skinned) if with_skin else None


def _transformed(vertices, faces, matrix):
    """A mesh moved by an affine [4, 4]; a mirroring one turns the faces, so that outside stays outside."""
    moved = np.asarray(vertices, float) @ matrix[:3, :3].T + matrix[:3, 3]
    return moved, np.asarray(faces)[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else np.asarray(faces)


def _gltf_is_y_up(path):
    """By section 3.4 of glTF 2.0, +y is up. trimesh writes whatever it holds, unrotated, and signs as the generator."""
    data = path.read_bytes() if path.suffix.lower() in (".glb", ".gltf") else b""
    if data[:4] == b"glTF":
        data = data[20:20 + struct.unpack_from("<I", data, 12)[0]]
    return bool(data) and "trimesh" not in json.loads(data).get("asset", {}).get("generator", "")


def _read_dae(path):
    """COLLADA through pycollada, but positions and node transforms from the text, in double precision.

    pycollada keeps float32, in which UTM coordinates move by half a metre, and it turns NaN into 0.
    """
    import collada

    ignored = [collada.common.DaeUnsupportedError, collada.common.DaeBrokenRefError]
    document = collada.Collada(str(path), ignore=ignored)
    meshes, copies, triangles = [], 0, 0
    for node in document.scene.nodes if document.scene is not None else []:
        for mesh in _walk_dae(node, np.eye(4)):
            copies += 1
            check_limit("COPIES", copies, file=path)
            if mesh is not None:
                triangles += len(mesh[1])
                check_limit("TRIANGLES", triangles, file=path)
                meshes.append(_transformed(*mesh))
    vertices, faces = join(meshes)
    unit = document.assetInfo.unitmeter
    return vertices * (1.0 if unit is None else unit), faces, (document.assetInfo.upaxis or "Y_UP")[0].lower(), None


def _walk_dae(node, matrix):
    """Each geometry under a COLLADA node, as (vertices, faces, matrix) in the axes of the document; None for a node.

    A node may stand in many places, each of which may hold others: whoever counts can stop in time.
    """
    import collada

    if isinstance(node, collada.scene.GeometryNode):
        for primitive in node.geometry.primitives:
            if hasattr(primitive, "triangleset"):
                primitive = primitive.triangleset()
            if isinstance(primitive, collada.triangleset.TriangleSet) and len(primitive.index):
                source = primitive.sources["VERTEX"][0][4].xmlnode
                positions = _numbers(next(e for e in source.iter() if str(e.tag).endswith("float_array")))
                yield positions.reshape(-1, 3), primitive.vertex_index, matrix
    elif isinstance(node, collada.scene.Node):
        yield None
        inner = node.node if isinstance(node, collada.scene.NodeNode) else node
        for step in inner.transforms:
            matrix = matrix @ _dae_matrix(step)
        for child in inner.children:
            yield from _walk_dae(child, matrix)


def _dae_matrix(step):
    """Matrix [4, 4] of one COLLADA transform element; only ``lookat`` keeps pycollada's single precision."""
    kind = str(step.xmlnode.tag).rpartition("}")[2]
    values = _numbers(step.xmlnode)
    T = np.eye(4)
    if kind == "matrix":
        return values.reshape(4, 4)
    if kind == "translate":
        T[:3, 3] = values
    elif kind == "scale":
        T[:3, :3] = np.diag(values)
    elif kind == "rotate":
        axis = values[:3] / np.linalg.norm(values[:3])
        T[:3, :3] = Rotation.from_rotvec(np.radians(values[3]) * axis).as_matrix()
    else:
        return np.asarray(step.matrix, float)
    return T


def _numbers(element):
    return np.array((element.text or "").split(), float)


# ----------------------------------------------------------------------------------------------------------- colours


def join_skins(meshes: list[tuple[trimesh.Trimesh, bool]]) -> Skin | None:
    """Skin of several meshes joined; None if none of them has colours.

    Beside meshes with maps, one without has its plain colour. Several maps are packed into one.

    Args:
        meshes: Each mesh, and whether its triangles were turned over.
    """
    if any(_has_map(mesh) for mesh, _ in meshes):
        return _mapped([mesh for mesh, _ in meshes], [turned for _, turned in meshes])
    colours = [_corner_colours(mesh, turned) for mesh, turned in meshes]
    if all(c is None for c in colours):
        return None
    plain = [np.full((len(mesh.faces), 3, 3), 0.5, np.float32) for mesh, _ in meshes]
    return Skin(np.concatenate([p if c is None else c for c, p in zip(colours, plain, strict=True)]))


def _image(mesh):
    """Base colour map of a mesh, or None."""
    material = getattr(mesh.visual, "material", None)
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _has_map(mesh):
    return _image(mesh) is not None and getattr(mesh.visual, "uv", None) is not None


def _factor(mesh):
    """Linear base colour [3] that multiplies the map of a glTF material."""
    factor = getattr(getattr(mesh.visual, "material", None), "baseColorFactor", None)
    return None if factor is None else np.asarray(factor, np.float32)[:3] / 255.0


def _mapped(meshes, turned):
    """One texture map for all meshes."""
    distinct = {id(_image(mesh)) for mesh in meshes if _has_map(mesh)}
    factors = {tuple(_factor(mesh)) for mesh in meshes if _factor(mesh) is not None}
    if len(distinct) == 1 and len(factors) <= 1 and all(map(_has_map, meshes)):
        uvs = [np.asarray(mesh.visual.uv) for mesh in meshes]
        image = decode_image(_image(meshes[0]))
        image = image * np.array(factors.pop(), np.float32) if factors else image
    else:
        materials = [mesh.visual.material if _has_map(mesh) else PBRMaterial(baseColorFactor=_plain(mesh))
                     for mesh in meshes]
        uvs = [mesh.visual.uv if _has_map(mesh) else np.full((len(mesh.vertices), 2), 0.5) for mesh in meshes]
        material, packed = pack(materials, uvs)
        image = decode_image(getattr(material, "image", None) or material.baseColorTexture)
        uvs = np.split(packed, np.cumsum([len(uv) for uv in uvs])[:-1])
    corners = [_turn(uv[mesh.faces], over) for uv, mesh, over in zip(uvs, meshes, turned, strict=True)]
    return Skin(np.concatenate(corners).astype(np.float32), image)


def _plain(mesh):
    """Colour of a mesh without a map, RGBA [4] of 8 bits."""
    factor = _factor(mesh)
    return [128, 128, 128, 255] if factor is None else [*np.rint(255 * factor).astype(int), 255]


def _corner_colours(mesh, turned):
    """Linear reflectances float32 [F, 3, 3] of a mesh's vertices, its faces or its material; None without any."""
    kind = getattr(mesh.visual, "kind", None)
    if kind == "vertex":
        return _turn(_decode(mesh.visual.vertex_colors)[mesh.faces], turned)
    if kind == "face":
        return np.repeat(_decode(mesh.visual.face_colors)[:, None], 3, axis=1)
    factor = _factor(mesh)
    return None if factor is None else np.broadcast_to(factor, (len(mesh.faces), 3, 3)).astype(np.float32)


def _decode(colours):
    """Linear reflectances float32 [N, 3] of colours as files store them: sRGB of 8 bits."""
    return srgb_to_linear(np.asarray(colours)[:, :3] / 255.0).astype(np.float32)


def _turn(corners, over):
    return corners[:, ::-1] if over else corners
