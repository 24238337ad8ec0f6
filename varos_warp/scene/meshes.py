"""Mesh files and parametric objects become parts of the world: float64 vertices, z up, metres, placed."""

import json
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene import assets, procedural, terrain
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse, MeshObject, Object, ProceduralTerrain
from varos_warp.scene.frames import euler_to_matrix
from varos_warp.scene.geometry import Instances, Part
from varos_warp.scene.scatter import Ground, scatter
from varos_warp.scene.skins import join_skins

SMALLEST_M, LARGEST_M = 1e-9, 1e9
"""Sizes of parts: the products of smaller lengths leave single precision, longer rays hit nothing."""
FORMATS = (".dae", ".obj", ".ply", ".stl", ".glb", ".gltf", ".off")

TO_Z_UP = {
    "x": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotations from COLLADA's X_UP, Y_UP and Z_UP (right, up, in: -y x z; x y z; x z -y) to z up."""


def load_mesh(path: str | Path, key: str = "file", up_axis: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Vertices float64 [V, 3] [m, z up] and faces int32 [F, 3] of a mesh file, its scene graph flattened.

    DAE's ``<up_axis>`` and ``<unit>`` are obeyed, glTF is y up (but for files that trimesh wrote, which does not
    rotate); OBJ, PLY, STL and OFF do not say and are taken as they are, in metres. Equal vertices are merged.

    Args:
        path: The file.
        key: The scene file's key that names it, for messages.
        up_axis: Overrides which axis of the file points up: x, y or z.

    Raises:
        InputError: The file is missing, empty, unreadable, without triangles, or holds vertices that are not finite.
    """
    return load_skinned_mesh(path, key, up_axis, with_skin=False)[:2]


def load_skinned_mesh(path: str | Path, key: str = "file", up_axis: str | None = None, *, with_skin: bool = True):
    """``load_mesh`` and the colours that the file brings along: vertices, faces and a Skin or None.

    Base colour maps are read from GLB, glTF and OBJ files, colours of vertices or faces from PLY, GLB and OFF files.
    """
    path = Path(path)
    vertices, faces, skin = _read(path, key, up_axis, with_skin)
    _check_finite(vertices, path, key)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices()
    kept = mesh.area_faces > 0.0
    mesh.update_faces(kept)
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise InputError("all triangles of the mesh have zero area", file=path, key=key, remedy="Export it anew.")
    skin = skin and replace(skin, corners=skin.corners[kept])
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), skin


def read_mesh(path: str | Path, key: str = "file", up_axis: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The same as it stands in the file: nothing merged or dropped, and vertices may be NaN or infinite.

    Raises:
        InputError: The file is missing, empty, unreadable or without triangles.
    """
    return _read(Path(path), key, up_axis, False)[:2]


def _read(path, key, up_axis, with_skin):
    """Vertices, faces and, if asked for, the Skin of a mesh file, as it stands there."""
    _check_file(path, key)
    try:
        with np.errstate(invalid="ignore"):  # vertices that are not finite are the caller's
            read = _read_dae(path) if path.suffix.lower() == ".dae" else _read_with_trimesh(path, with_skin)
            vertices, faces, axis, skin = read
    except Exception as error:  # every format's reader raises its own kinds
        problem = f"cannot be read as a mesh: {str(error).strip() or type(error).__name__}"
        raise InputError(problem, file=path, key=key, remedy="Export it anew from the program that made it.") from error
    _check_faces(vertices, faces, path, key)
    up = TO_Z_UP[up_axis or axis]
    with np.errstate(invalid="ignore"):
        return vertices if (up == np.eye(3)).all() else vertices @ up.T, np.asarray(faces, np.int32), skin


def build_parts(scene: Scene) -> list[Part | Instances]:
    """Everything solid in the scene (float64): the terrain, the objects in file order, then the blocks of scatter."""
    parts = build_single_parts(scene)
    return parts + build_instances(scene, parts)


def build_single_parts(scene: Scene) -> list[Part]:
    """What stands in one place only: the terrain, then the objects in file order."""
    parts = [] if scene.terrain is None else [_part(scene, scene.terrain, "terrain", *_terrain_mesh(scene))]
    return parts + [object_part(scene, block, f"objects.{i}") for i, block in enumerate(scene.objects)]


def build_instances(scene: Scene, parts: list[Part]) -> list[Instances]:
    """One mesh with many poses for every block of ``scatter``; ``parts`` are those that stand in one place."""
    if not scene.scatter:
        return []
    ground = Ground(parts[0], parts[1:])  # nothing is scattered without a terrain, and it comes first
    return [scatter(block, f"scatter.{i}", object_part(scene, block.object, f"scatter.{i}.object"), ground, scene.seed)
            for i, block in enumerate(scene.scatter)]


def object_part(scene: Scene, block: Object, key: str) -> Part:
    """An object of the scene file where its block places it; ``key`` names it, also in messages."""
    if isinstance(block, MeshObject):
        path = scene.resolve(block.file)
        mesh = load_skinned_mesh(path, f"{key}.file", block.up_axis, with_skin=block.material is None)
    else:
        mesh = assets.make_asset(block, key)
    return _part(scene, block, key, *mesh)


def _terrain_mesh(scene):
    block = scene.terrain
    if isinstance(block, ProceduralTerrain):
        return procedural.generate_terrain(block.size_m, block.resolution, block.relief_m, block.feature_m,
                                           block.rockiness, block.seed)
    files = [block.file] if isinstance(block.file, str) else block.file
    alone = len(files) == 1 and block.preprocess is None and block.material is None
    loaded = [load_skinned_mesh(scene.resolve(file), "terrain.file", block.up_axis, with_skin=alone) for file in files]
    vertices, faces = terrain.join((vertices, faces) for vertices, faces, _ in loaded)
    if block.preprocess is not None:
        options = block.preprocess.model_dump()
        vertices, faces = terrain.preprocess(vertices, faces, **options, key="terrain.preprocess")
    if block.detail is not None:
        vertices = procedural.add_detail(vertices, **block.detail.model_dump())
    return vertices, faces, loaded[0][2]


def _part(scene, block, key, vertices, faces, skin=None):
    """A mesh where its block places it: scaled, turned, moved."""
    with np.errstate(over="ignore", invalid="ignore"):
        turned = (vertices * block.scale) @ euler_to_matrix(block.rotation_euler_deg).T
    _check_size(turned, block, key)
    placed = turned + np.asarray(block.position)
    return Part(name=key, vertices=placed, faces=np.asarray(faces, np.int32),
                material=scene.materials[block.material] if block.material is not None else Diffuse(),
                origin=block.position, smooth_angle=float(np.radians(block.smooth_angle_deg)),
                smooth_shading=block.shading == "smooth", skin=skin)


# -------------------------------------------------------------------------------------------------------------- checks


def _check_file(path, key):
    """A file of a known format that is there and not empty."""
    if not path.is_file():
        problem = "there is no such mesh file" if not path.exists() else "is a folder, not a mesh file"
        raise InputError(problem, file=path, key=key, remedy="Paths are relative to the scene file; correct the path.")
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"unknown mesh format '{path.suffix}'", file=path, key=key,
                         remedy=f"Use one of {', '.join(FORMATS)}.")
    if path.stat().st_size == 0:
        raise InputError("the mesh file is empty (0 bytes)", file=path, key=key,
                         remedy="Copy or export it again; the transfer may have broken off.")


def _check_faces(vertices, faces, path, key):
    """Triangles, all between vertices that exist."""
    if len(faces) == 0:
        raise InputError("the mesh has no triangles", file=path, key=key,
                         remedy="Point clouds and lines cannot be rendered; export a surface.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"a face names vertex {faces.max()} of {len(vertices)}", file=path, key=key,
                         remedy="The file is damaged; export it again.")


def _check_finite(vertices, path, key):
    """No vertex is NaN, infinite or so far that it must be a fault."""
    bad = ~(np.abs(vertices) < terrain.repair.FARTHEST).all(axis=1)
    if bad.any():
        number = int(np.flatnonzero(bad)[0])
        raise InputError(f"{bad.sum()} of {len(vertices)} vertices are NaN or infinite, or too far away (the first is "
                         f"number {number})",
                         file=path, key=key, remedy="Remove them in a mesh editor, or with `varos-warp preprocess`.")


def _check_size(vertices, block, key):
    """A part, at its scale, is of a size that rays can hit."""
    reach, size = float(np.abs(vertices).max()), float(np.ptp(vertices, axis=0).max())
    if not (reach <= LARGEST_M and size >= SMALLEST_M):
        what = f"is {size:.3g} m across" if reach <= LARGEST_M else f"reaches {reach:.3g} m from its origin"
        raise InputError(f"{what}; parts are {SMALLEST_M:g} to {LARGEST_M:g} m large", key=key,
                         remedy=f"Check the units of its file or its measures, and its scale ({block.scale}).")


# ------------------------------------------------------------------------------------------------------------- readers


def _read_with_trimesh(path, with_skin):
    """Vertices, faces, up axis and Skin or None of a file that trimesh reads in double precision."""
    options = {"skip_materials": True} if path.suffix.lower() == ".obj" and not with_skin else {}
    loaded = trimesh.load_scene(path, process=False, **options)
    meshes, skinned = [], []
    for node in loaded.graph.nodes_geometry:
        matrix, name = loaded.graph[node]
        mesh = loaded.geometry[name]
        if isinstance(mesh, trimesh.Trimesh):
            meshes.append(_transformed(mesh.vertices, mesh.faces, matrix))
            skinned.append((mesh, bool(np.linalg.det(matrix[:3, :3]) < 0.0)))
    vertices, faces = terrain.join(meshes)
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
    meshes = []
    for node in document.scene.nodes if document.scene is not None else []:
        _walk_dae(node, np.eye(4), meshes)
    vertices, faces = terrain.join(meshes)
    unit = document.assetInfo.unitmeter
    return vertices * (1.0 if unit is None else unit), faces, (document.assetInfo.upaxis or "Y_UP")[0].lower(), None


def _walk_dae(node, matrix, meshes):
    """Append (vertices, faces) of every geometry under a COLLADA node, in the axes of the document."""
    import collada

    if isinstance(node, collada.scene.GeometryNode):
        for primitive in node.geometry.primitives:
            if hasattr(primitive, "triangleset"):
                primitive = primitive.triangleset()
            if isinstance(primitive, collada.triangleset.TriangleSet) and len(primitive.index):
                source = primitive.sources["VERTEX"][0][4].xmlnode
                positions = _numbers(next(e for e in source.iter() if str(e.tag).endswith("float_array")))
                meshes.append(_transformed(positions.reshape(-1, 3), primitive.vertex_index, matrix))
    elif isinstance(node, collada.scene.Node):
        inner = node.node if isinstance(node, collada.scene.NodeNode) else node
        for step in inner.transforms:
            matrix = matrix @ _dae_matrix(step)
        for child in inner.children:
            _walk_dae(child, matrix, meshes)


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
