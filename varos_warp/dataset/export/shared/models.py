"""Meshes of what has labels, in its own axes: one model of all that are alike."""

import json
from dataclasses import dataclass

import numpy as np

from varos_warp.dataset.export.shared.labels import Labels
from varos_warp.products.images.segments import block_of
from varos_warp.scene.frames import attitude
from varos_warp.scene.geometry.parts import Instances, Moving, Part

PLACE = {"position", "rotation_euler_deg", "path", "material", "class_"}
"""Keys of an object that do not change its shape."""


@dataclass(frozen=True)
class Model:
    """A mesh, and the keys of all that have its shape, size and class."""

    number: int
    """Number of the model, from 1."""
    keys: list[str]
    category: str
    vertices: np.ndarray
    """float64 [V, 3] [m]."""
    faces: np.ndarray
    """int32 [F, 3]."""


def models_of(labels: Labels) -> list[Model]:
    """The models of all things, in the order of the first with each."""
    found: dict[str, tuple[list[str], str, np.ndarray, np.ndarray]] = {}
    numbers = {thing.key: thing for thing in labels.things.values()}
    meshes = {key: mesh for part in labels.parts for key, mesh in _meshes(labels, part) if key in numbers}
    for key, (shape, vertices, faces) in sorted(meshes.items(), key=lambda item: numbers[item[0]].number):
        category = numbers[key].category
        found.setdefault(f"{category}: {shape}", ([], category, vertices, faces))[0].append(key)
    return [Model(number, *entry) for number, entry in enumerate(found.values(), 1)]


def _meshes(labels: Labels, part: Part | Instances):
    """Key, a text that is the same for equal shapes, vertices in own axes and faces of each thing that a part is."""
    if isinstance(part, Instances):
        for key, scale in zip(part.names, part.scale.tolist(), strict=True):
            yield key, (f"{part.first_name} {scale!r}", part.vertices * scale, part.faces)
        return
    block = block_of(labels.scene, part.name)
    R_w_o = part.R_w_o if isinstance(part, Moving) else attitude(block)
    placed = isinstance(part, Moving) and not part.path  # a body has a place in its vehicle's axes
    formed = part.relief is not None  # by where it stands
    shape = part.name if placed or formed else json.dumps(block.model_dump(mode="json", exclude=PLACE))
    yield part.name, (shape, (part.vertices - part.origin) @ R_w_o, part.faces)


def ply(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    """A binary PLY of a mesh with normals of its vertices (each the mean of its faces' by their angles there)."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    normals = np.array(mesh.vertex_normals, np.float32)
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    corners = np.hstack([vertices.astype("<f4"), normals.astype("<f4")])
    rows = np.zeros(len(faces), [("count", "u1"), ("corners", "<i4", 3)])
    rows["count"], rows["corners"] = 3, faces
    return "\n".join([*head, ""]).encode() + corners.tobytes() + rows.tobytes()
