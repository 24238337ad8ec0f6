"""Mesh files of every format: vertices in float64, z up, in metres, with the colours that they bring; and writing."""

import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh

from varos_warp.errors import InputError, warn
from varos_warp.files import require_file
from varos_warp.scene.geometry.files.dae import read_dae
from varos_warp.scene.geometry.files.gltf.nodes import read_gltf
from varos_warp.scene.geometry.files.obj import read_obj
from varos_warp.scene.geometry.files.off import read_off
from varos_warp.scene.geometry.files.pieces import MeshFile
from varos_warp.scene.geometry.files.ply import read_ply
from varos_warp.scene.geometry.files.skins import Skins, check_finite, shares_outside
from varos_warp.scene.geometry.files.stl import read_stl
from varos_warp.scene.geometry.foreign import remedy_for
from varos_warp.scene.geometry.parts import MeshFacts, Skin
from varos_warp.scene.geometry.topology import FARTHEST

READERS: dict[str, Callable[[Path, bool], MeshFile]] = {
    ".dae": read_dae,
    ".obj": read_obj,
    ".ply": read_ply,
    ".stl": read_stl,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".off": read_off,
}
FORMATS = tuple(READERS)
OTHERS = (
    (b"version https://git-lfs", "is a pointer of Git LFS, not the file itself", "Run `git lfs pull`."),
    (
        (b"<!doctype html", b"<html"),
        "is a web page, not a mesh",
        "Download the file itself: open the page in a browser, and follow its link.",
    ),
)
"""Beginnings of what is no mesh under a mesh's name, and what to do."""
LEAST_LOSS = 1e-6
"""Share of a mesh's area whose loss is told: rounding is a hundredth of it."""

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # what it logs of damaged files: not to stderr

TO_Z_UP = {
    "x": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotations from COLLADA's X_UP, Y_UP and Z_UP (right, up, in: -y x z; x y z; x z -y) to z up."""


class LoadedMesh(NamedTuple):
    """A mesh file as a part takes it."""

    vertices: np.ndarray
    """float64 [V, 3] [m], z up."""
    faces: np.ndarray
    """int32 [F, 3], counter-clockwise seen from outside."""
    skin: Skin | None
    facts: MeshFacts


def load_mesh(path: str | Path, key: str = "file", up_axis: str | None = None, *, with_skin: bool = True) -> LoadedMesh:
    """A mesh file with its scene graph flattened; docs/meshes.md says what is read of each format.

    DAE says which way is up and its unit, and glTF is y up in metres; OBJ, PLY, STL, OFF, and glTF files that trimesh
    wrote do not say, and are taken as z up, in metres. Equal vertices are merged. What may be meant and is not read is
    warned of.

    Args:
        up_axis: Overrides which axis of the file points up: x, y or z.

    Raises:
        InputError: The file is missing, empty, unreadable, requires what is not read, has no triangles, or holds
            vertices that are not finite.
    """
    path = Path(path)
    file = _read(path, key, with_skin)
    skins = Skins(file, key)
    check_finite(file.pieces, file, key)
    pieces, skin = _guarded(skins.made, path, key) if with_skin else (file.pieces, None)
    vertices, faces = _in_metres(file, pieces, up_axis, key)
    _tell(file, key, up_axis)
    mesh, kept, area, built = _built(vertices, faces, path, key)
    facts = MeshFacts(
        path,
        up_axis or file.up_axis or "z",
        file.up_axis is None and up_axis is None,
        file.unit_m,
        file.triangles,
        int(np.count_nonzero(~kept)),
        area,
        1.0 - built / area,
        {texture.name: share for texture, share in shares_outside(pieces)},
        skins.constant,
    )
    if facts.area_lost > LEAST_LOSS:
        warn(
            f"{key}: {path.name}: {facts.area_lost:.2%} of its area is lost, for vertices nearer to each other than "
            "1e-8 m are merged: scale it up in the file, and give `scale`"
        )
    skin = skin if skin is None or kept.all() else skin.of_faces(kept)
    return LoadedMesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int32), skin, facts)


def _built(vertices, faces, path, key):
    """The mesh with equal vertices merged, which of its faces have an area, and the area before and after [m2]."""
    bad = ~(np.abs(vertices) < FARTHEST).all(axis=1)
    if bad.any():
        raise InputError(
            f"{bad.sum()} of {len(vertices)} vertices are NaN or infinite, or too far away (the first is "
            f"number {np.argmax(bad)})",
            file=path,
            key=key,
            remedy="Remove them in a mesh editor, or with `varos-warp preprocess`.",
        )
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    area = float(mesh.area_faces.sum())
    mesh.merge_vertices()
    areas = mesh.area_faces
    mesh.update_faces(areas > 0.0)
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise InputError("all triangles of the mesh have zero area", file=path, key=key, remedy="Export it anew.")
    return mesh, areas > 0.0, area, float(areas.sum())


def read_mesh(path: str | Path, key: str = "file", up_axis: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces as they stand in the file: nothing merged or dropped, and vertices may be NaN or infinite.

    Raises:
        InputError: The file is missing, empty, unreadable or without triangles.
    """
    file = _read(Path(path), key, False)
    _tell(file, key, up_axis)
    return _in_metres(file, file.pieces, up_axis, key)


def _read(path, key, with_colours) -> MeshFile:
    """What a file holds, by the reader of its format."""
    _check_file(path, key)
    with np.errstate(invalid="ignore", over="ignore"):  # vertices that are not finite are the caller's
        return _guarded(lambda: READERS[path.suffix.lower()](path, with_colours), path, key)


def _guarded(read, path, key):
    """What a reader returns; whatever it raises names file and key."""
    try:
        return read()
    except InputError as error:
        inner = error.key if error.key is None or error.key.startswith(key) else f"{key}: {error.key}"
        raise error.but(file=error.file or path, key=inner or key) from error
    except RecursionError as error:
        raise InputError(
            "is nested too deeply", file=path, key=key, remedy="Export it anew, with fewer nodes."
        ) from error
    except Exception as error:  # a damaged file can be wrong in any way
        problem = f"cannot be read as a mesh: {str(error).strip() or type(error).__name__}"
        raise InputError(problem, file=path, key=key, remedy="Export it anew from the program that made it.") from error


def _in_metres(file, pieces, up_axis, key):
    """Vertices float64 [V, 3], z up, and faces int32 [F, 3] of some pieces."""
    vertices, faces = _joined(pieces)
    if len(faces) == 0:
        problem, remedy = "the mesh has no triangles", "Point clouds and lines cannot be rendered; export a surface."
        bad = int((~np.isfinite(vertices)).any(axis=1).sum())
        if bad:
            problem, remedy = f"{problem}: {bad} of its vertices are NaN or infinite", "Remove them in a mesh editor."
        elif file.why_empty:
            problem, remedy = f"{problem}: {file.why_empty}", "Export it anew, with what it shows."
        if file.triangles:
            problem, remedy = "masks leave nothing of the mesh", "Give it a material, or another alphaCutoff."
        raise InputError(problem, file=file.path, key=key, remedy=remedy)
    up = TO_Z_UP[up_axis or file.up_axis or "z"]
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = vertices * file.unit_m
        return vertices if (up == np.eye(3)).all() else vertices @ up.T, faces


def _joined(pieces):
    """Vertices and faces of all pieces; those that share their vertices, as of several materials, keep one copy."""
    places, shared, count = [], {}, 0
    for piece in pieces:
        if id(piece.vertices) not in shared:
            shared[id(piece.vertices)] = count
            places.append(piece.vertices)
            count += len(piece.vertices)
    faces = [piece.faces + np.int64(shared[id(piece.vertices)]) for piece in pieces]
    return (
        np.concatenate([np.zeros((0, 3)), *places]),
        np.concatenate([np.zeros((0, 3), np.int64), *faces]).astype(np.int32),
    )


def _tell(file, key, up_axis):
    """Warn of what may be meant and is not read."""
    if file.up_axis is None and up_axis is None and file.path.suffix.lower() in (".glb", ".gltf"):
        file.note("trimesh wrote it, which keeps whatever axis was up: z is taken; say `up: y` or `up: z`")
    for words in file.notes:
        warn(f"{key}: {file.path.name}: {words}")


def write_ply(path: str | Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write a binary PLY in double precision, aside first and then renamed (trimesh writes single precision)."""
    path = Path(path)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(faces), [("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    aside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        aside.write_bytes(header.encode() + np.asarray(vertices, "<f8").tobytes() + rows.tobytes())
        aside.replace(path)
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise InputError(
            f"cannot be written: {error.strerror}",
            file=path,
            remedy="Choose a folder that exists, is writable and has space.",
        ) from error


def _check_file(path, key):
    """The file exists, has a known format and is not empty."""
    require_file(path, "mesh file", "Paths are relative to the scene file; correct the path.", key)
    if path.suffix.lower() not in FORMATS:
        raise InputError(
            f"unknown mesh format '{path.suffix}'", file=path, key=key, remedy=remedy_for(path.suffix, FORMATS)
        )
    if path.stat().st_size == 0:
        raise InputError(
            "the mesh file is empty (0 bytes)",
            file=path,
            key=key,
            remedy="Copy or export it again; the transfer may have broken off.",
        )
    with path.open("rb") as file:
        beginning = file.read(256).removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    for words, problem, remedy in OTHERS:
        if beginning.startswith(words):
            raise InputError(problem, file=path, key=key, remedy=remedy)
