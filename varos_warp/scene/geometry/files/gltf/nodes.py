"""Meshes of glTF where its nodes place them: the reader of the format."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from varos_warp.scene.geometry.files.gltf.accessors import (
    TYPES,
    DracoPrimitive,
    as_numbers,
    read_accessor,
    read_numbers,
)
from varos_warp.scene.geometry.files.gltf.document import Document
from varos_warp.scene.geometry.files.gltf.materials import Materials
from varos_warp.scene.geometry.files.pieces import MeshFile, Piece, damaged, in_words
from varos_warp.scene.geometry.files.polygons import strip

TRIANGLES, STRIP, FAN = 4, 5, 6
DEEPEST = 1000
"""Most nodes under each other."""
ROUNDING = 1e-5
"""Share of an accessor's extent by which its values may leave its min and max: exporters round those."""


def read_gltf(path: Path, with_colours: bool) -> MeshFile:
    """Read a .gltf or .glb file."""
    document = Document(path)
    return _Reader(document, with_colours).read()


class _Reader:
    def __init__(self, document: Document, with_colours: bool):
        self.document, self.with_colours = document, with_colours
        self.file = MeshFile(document.path, up_axis="y", colours_multiply=True)
        self.materials = Materials(document)
        self.pieces: dict[tuple, list[Piece]] = {}
        self.matrices: dict[int, np.ndarray] = {}
        """Matrices [4, 4] from the nodes of the scene, by their numbers, to its root."""

    def read(self) -> MeshFile:
        if "trimesh" in str(self.document.json["asset"].get("generator", "")):
            self.file.up_axis = None  # it writes whatever it holds, unrotated
        placed = list(self._placed(self._roots(), np.eye(4), ()))
        for node, matrix, key in placed:
            if node.get("mesh") is not None:
                self._place(node, matrix, key)
        for words in [*self.document.notes(), *(self.materials.notes() if self.with_colours else [])]:
            self.file.note(words)
        return self.file

    def _roots(self) -> list:
        """Nodes of the scene that is shown; where the file has no scenes, those that no other node has."""
        document = self.document
        if document.all("scenes"):
            return document.get("scenes", document.json.get("scene", 0)).get("nodes", [])
        children = {child for node in document.all("nodes") for child in node.get("children", ())}
        return [index for index in range(len(document.all("nodes"))) if index not in children]

    def _placed(self, nodes, matrix, above) -> Iterator[tuple[dict, np.ndarray, str]]:
        """Nodes with their matrices to the scene and their keys, depth first."""
        for index in nodes:
            if index in above or len(above) > DEEPEST:
                raise damaged("is below itself", f"nodes.{index}")
            node = self.document.get("nodes", index)
            if (self.document.extension(node, "KHR_node_visibility") or {}).get("visible", True) is False:
                continue
            self.file.count_copy()
            there = matrix @ self._matrix(node, f"nodes.{index}")
            self.matrices[index] = there
            yield node, there, f"nodes.{index}"
            yield from self._placed(node.get("children", ()), there, (*above, index))

    def _matrix(self, node, key) -> np.ndarray:
        if node.get("matrix") is not None:
            matrix = np.asarray(node["matrix"], float).reshape(4, 4).T
        else:
            rotation = np.asarray(node.get("rotation", (0, 0, 0, 1)), float)
            if rotation.shape != (4,) or not np.linalg.norm(rotation) > 0.0:
                raise damaged("is no rotation", f"{key}.rotation", node["rotation"])
            matrix = pose(
                np.asarray(node.get("translation", (0, 0, 0)), float),
                rotation,
                np.asarray(node.get("scale", (1, 1, 1)), float),
            )
        if not np.isfinite(matrix).all():
            raise damaged("has a matrix that is not finite", key)
        return matrix

    # ----------------------------------------------------------------------------------------------------- places

    def _place(self, node, matrix, key) -> None:
        """Add a node's mesh where it stands: once, or at each of its instances."""
        pieces = self._mesh(node)
        if node.get("skin") is not None:
            matrix = np.eye(4)  # its joints place it (section 3.7.3.3)
        instances = self.document.extension(node, "EXT_mesh_gpu_instancing")
        places = (
            [np.eye(4)]
            if instances is None
            else self._instances(instances.get("attributes") or {}, f"{key}.extensions.EXT_mesh_gpu_instancing")
        )
        for place in places:
            self.file.count_copy()
            for piece in pieces:
                self.file.add(piece.moved(matrix @ place))

    def _instances(self, attributes, key) -> Iterator[np.ndarray]:
        """Matrices of the instances of a mesh."""
        names = ("TRANSLATION", "ROTATION", "SCALE")
        given = {name: read_numbers(self.document, attributes[name]) for name in names if name in attributes}
        counts = {self.document.get("accessors", index).get("count") for index in attributes.values()}
        if len(counts) != 1:
            raise damaged(f"has {'attributes of different counts' if counts else 'no attributes'}", key)
        if others := [name for name in attributes if name not in names]:
            self.file.note(
                f"{in_words(others)} of EXT_mesh_gpu_instancing {'is' if len(others) == 1 else 'are'} not "
                "read: copies differ by place, turn and scale alone"
            )
        if "ROTATION" in given and not (np.linalg.norm(given["ROTATION"], axis=1) > 0.0).all():
            raise damaged("has a rotation 0 0 0 0", key)
        for i in range(counts.pop()):
            yield pose(
                *(
                    given[name][i] if name in given else default
                    for name, default in zip(
                        names, (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]), np.ones(3)), strict=True
                    )
                )
            )

    # ----------------------------------------------------------------------------------------------------- meshes

    def _mesh(self, node) -> list[Piece]:
        """The primitives of a node's mesh, in its axes, or those of the scene if it has a skin."""
        key = (node["mesh"], node.get("skin"), str(node.get("weights")))
        if key not in self.pieces:
            mesh = self.document.get("meshes", node["mesh"])
            weights = node.get("weights") or mesh.get("weights") or ()
            made = [
                self._primitive(primitive, weights, node.get("skin"), f"meshes.{node['mesh']}.primitives.{i}")
                for i, primitive in enumerate(mesh.get("primitives", ()))
            ]
            self.pieces[key] = [piece for piece in made if piece is not None]
        return self.pieces[key]

    def _primitive(self, block, weights, skin, key) -> Piece | None:
        mode = block.get("mode", TRIANGLES)
        if mode not in (TRIANGLES, STRIP, FAN):
            self.file.note("its points and lines are left out: only surfaces are rendered")
            return None
        draco = self.document.extension(block, "KHR_draco_mesh_compression")
        compressed = None if draco is None else DracoPrimitive(self.document, draco)
        stored = _Attributes(self.document, block, compressed)
        vertices = stored.numbers("POSITION")
        if vertices is None:
            self.file.note(f"{key} has no positions and is left out")
            return None
        self._check_extent(block["attributes"]["POSITION"], vertices)
        for weight, target in zip(weights, block.get("targets", ()), strict=False):
            if weight and "POSITION" in target:
                vertices = vertices + float(weight) * read_numbers(self.document, target["POSITION"])
        if skin is not None:
            vertices = self._skinned(stored, vertices, skin)
        corners = stored.indices(len(vertices))
        self.file.check(corners, len(vertices), "vertex")
        faces = triangles_of(corners, TRIANGLES if compressed else mode)  # Draco gives strips as triangles
        if not self.with_colours:
            return Piece(vertices, faces)
        return self._coloured(stored, vertices, faces, block.get("material"))

    def _coloured(self, stored, vertices, faces, material) -> Piece:
        colours, look = self._colours(stored), None if material is None else self.materials.look(material)
        if colours is not None:
            colours = np.clip(colours, 0.0, 1.0).astype(np.float32)[faces]
        uv = None
        if look is not None and look.material.texture is not None:
            uv = stored.numbers(f"TEXCOORD_{look.coordinates}")
            if uv is None:
                self.file.note(
                    f"materials.{material} has a texture, but a mesh of it has no TEXCOORD_"
                    f"{look.coordinates}: its texel at 0, 0 is used"
                )
                uv = np.zeros((len(vertices), 2))
            uv = look.uv(uv)[faces]
        return Piece(vertices, faces, None if look is None else look.material, uv, colours)

    def _colours(self, stored) -> np.ndarray | None:
        """COLOR_0 as real numbers; integers are unsigned, and stand for 0..1 (section 3.7.2.1)."""
        values = stored.stored("COLOR_0")
        if values is None or values.dtype.kind == "f":
            return values if values is None else values.astype(np.float64)
        index = stored.block["attributes"]["COLOR_0"]
        if values.dtype.kind != "u" or values.dtype.itemsize > 2:
            raise damaged("is COLOR_0 of a type that glTF does not have there", f"accessors.{index}")
        if not self.document.get("accessors", index).get("normalized", False):
            self.file.note(
                "COLOR_0 holds integers that are not normalized, which glTF does not have: they are taken as normalized"
            )
        return as_numbers(values, True)

    def _skinned(self, stored, vertices, index) -> np.ndarray:
        """Vertices where their joints have them (section 3.7.3.3), in the axes of the scene."""
        skin = self.document.get("skins", index)
        if outside := [joint for joint in skin["joints"] if joint not in self.matrices]:
            raise damaged(
                f"names joint {outside[0]}, which is not a node of the scene that is shown", f"skins.{index}.joints"
            )
        joints = np.array([self.matrices[joint] for joint in skin["joints"]])
        if skin.get("inverseBindMatrices") is not None:
            bind = read_accessor(self.document, skin["inverseBindMatrices"])[: len(joints)]
            joints = joints @ bind.reshape(-1, 4, 4).swapaxes(1, 2).astype(float)
        total, moved, ones = np.zeros(len(vertices)), np.zeros_like(vertices), np.ones((len(vertices), 1))
        for number in range(8):
            which, share = stored.stored(f"JOINTS_{number}"), stored.numbers(f"WEIGHTS_{number}")
            if which is None or share is None:
                break
            for k in range(which.shape[1]):
                at = np.einsum("vij,vj->vi", joints[which[:, k]], np.hstack([vertices, ones]))[:, :3]
                moved += share[:, k, None] * at
                total += share[:, k]
        return moved / np.where(total > 0.0, total, 1.0)[:, None]

    def _check_extent(self, index, vertices) -> None:
        """What was read lies where the accessor says that it lies."""
        block = self.document.get("accessors", index)
        if block.get("min") is None or block.get("max") is None or not len(vertices):
            return
        stated = np.array([block["min"], block["max"]], TYPES[block["componentType"]])
        stated = as_numbers(stated, block.get("normalized", False))
        found = np.array([vertices.min(axis=0), vertices.max(axis=0)])
        slack = ROUNDING * max(float(np.abs(stated).max()), 1e-30)
        if not (np.abs(found - stated) <= slack).all():
            low, high = (", ".join(f"{x:.4g}" for x in row) for row in found)
            self.file.note(
                f"the positions of accessors.{index} reach from ({low}) to ({high}), which is not what its "
                "min and max say: the file is damaged, or was changed by hand"
            )


class _Attributes:
    """The attributes of a primitive, of Draco or of accessors."""

    def __init__(self, document, block, compressed):
        self.document, self.block, self.compressed = document, block, compressed

    def stored(self, name: str) -> np.ndarray | None:
        """Values [count, width] as they are stored; None if there are none."""
        index = self.block.get("attributes", {}).get(name)
        if index is None:
            return None
        found = None if self.compressed is None else self.compressed.attribute(name)
        return read_accessor(self.document, index) if found is None else found

    def numbers(self, name: str) -> np.ndarray | None:
        """Values [count, width] as real numbers; None if there are none."""
        values = self.stored(name)
        if values is None:
            return None
        block = self.document.get("accessors", self.block["attributes"][name])
        return as_numbers(values, block.get("normalized", False))

    def indices(self, count: int) -> np.ndarray:
        """Vertices of the corners int64 [C]; without any, all in order."""
        if self.compressed is not None:
            return self.compressed.indices
        if self.block.get("indices") is None:
            return np.arange(count)
        return read_accessor(self.document, self.block["indices"]).astype(np.int64)


def pose(translation: Any, rotation: Any, scale: Any) -> np.ndarray:
    """Matrix [4, 4] of a translation, a quaternion x, y, z, w and a scale."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(rotation).as_matrix() * scale
    matrix[:3, 3] = translation
    return matrix


def triangles_of(corners: np.ndarray, mode: int) -> np.ndarray:
    """Faces int64 [F, 3] of a list of corners: triangles, a strip or a fan (section 3.7.2.1)."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode == STRIP:
        return strip(corners)
    i = np.arange(max(len(corners) - 2, 0))
    return corners[np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)]
