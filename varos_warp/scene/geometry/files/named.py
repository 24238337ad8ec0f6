"""The files that mesh files name, without reading their meshes."""

import contextlib
import json
import re
import struct
from pathlib import Path
from urllib.parse import unquote

from varos_warp.errors import InputError
from varos_warp.files import beside, is_file
from varos_warp.scene.description import Scene
from varos_warp.scene.description.survey import BESIDE, Heights
from varos_warp.scene.file.named_files import named_meshes
from varos_warp.scene.geometry.files.mtl import UDIM, files_of, read_mtl
from varos_warp.scene.geometry.files.obj import library_paths
from varos_warp.scene.geometry.files.pieces import MeshFile
from varos_warp.scene.geometry.files.ply import read_header
from varos_warp.scene.geometry.files.wavefront import name_of, text_of

MOST_BYTES = 1 << 24
"""Most bytes of a file that are searched for names."""


def mesh_textures(scene: Scene) -> list[Path]:
    """Files that the scene's mesh files name, such as textures, or that belong to its surveys, and that are there."""
    found = [path for _, mesh in named_meshes(scene) if is_file(mesh) for path in named_by(mesh)]
    surveys = map(scene.resolve, scene.terrain.files) if isinstance(scene.terrain, Heights) else ()
    found += [file for path in surveys for suffix in BESIDE if (file := beside(path, suffix))]
    return sorted({path for path in found if is_file(path)})


def named_by(path: Path) -> list[Path]:
    """Files that a mesh file names: textures, material libraries, buffers. Damaged files are refused elsewhere."""
    readers = {".obj": _of_obj, ".gltf": _of_gltf, ".glb": _of_gltf, ".ply": _of_ply, ".dae": _of_dae}
    reader = readers.get(path.suffix.lower())
    with contextlib.suppress(ValueError, struct.error, AttributeError, TypeError, OSError, InputError):
        return [] if reader is None else list(dict.fromkeys(reader(path)))
    return []


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MOST_BYTES)


def _of_obj(path: Path) -> list[Path]:
    """Material libraries, and the maps in them that are read; of UDIM textures, all tiles that are there."""
    lines = re.findall(rb"^[ \t]*mtllib[ \t]([^\n]*)", text_of(_beginning(path)), re.M)
    libraries = [library for line in lines for library in library_paths(path.parent, name_of(line))]
    found = [*libraries]
    for material in [m for library in libraries for m in read_mtl(library, MeshFile(path)).values()]:
        for source in (each.path for each in (material.colour, material.mask) if each is not None):
            found += files_of(source) if UDIM.search(source.name) else [source]
    return found


def _of_gltf(path: Path) -> list[Path]:
    """Images and buffers beside a glTF file; what is embedded needs none."""
    data = _beginning(path)
    if data[:4] == b"glTF":
        data = data[20 : 20 + struct.unpack_from("<I", data, 12)[0]]
    document = json.loads(data)
    uris = [block.get("uri") for kind in ("images", "buffers") for block in document.get(kind, ())]
    return [path.parent / unquote(uri) for uri in uris if uri and not uri.startswith("data:")]


def _of_ply(path: Path) -> list[Path]:
    return [path.parent / name for name in read_header(_beginning(path))[2]]


def _of_dae(path: Path) -> list[Path]:
    names = re.findall(rb"<init_from>(?:\s*<ref>)?([^<]+)<", _beginning(path))
    texts = [unquote(name.strip().decode("utf-8", "replace")).removeprefix("file://") for name in names]
    return [path.parent / text.replace("\\", "/") for text in texts]
