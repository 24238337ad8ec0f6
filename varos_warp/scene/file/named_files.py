"""The files that a scene names, and those that its meshes name: whether all are there, before hours are spent."""

import contextlib
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from varos_warp.errors import InputError
from varos_warp.files import is_file, like_it
from varos_warp.scene.description import Scene
from varos_warp.scene.description.survey import BESIDE, Heights
from varos_warp.scene.description.world import GROUND_TEXTURES, MeshObject, SlopeBlend, Terrain

MOST_BYTES = 1 << 24
"""Of a file's text that is searched for names."""


def require_files(scene: Scene) -> None:
    """Refuse a scene that names a mesh or an image which is not there; all of them are told at once.

    Raises:
        InputError: Names the first, and counts the others.
    """
    missing = [(key, path, what) for key, path, what in _named(scene) if not is_file(path)]
    if not missing:
        return
    key, path, what = missing[0]
    others = [f"{key} ({path.name})" for key, path, _ in missing[1:]]
    also = f" Missing, too: {', '.join(others[:5])}{', ...' * (len(others) > 5)}." if others else ""
    known = f"Give {' or '.join(GROUND_TEXTURES)}, or the path" if what == "image" else "Paths are"
    raise InputError(f"there is no such {what} file", file=path, key=key,
                     remedy=f"{like_it(path) or f'{known} relative to the scene file.'}{also}")


def check_textures(scene: Scene) -> list[str]:
    """Warnings of textures of mesh files that are not there, or cannot be used."""
    return [f"{key}: {path.name} {problem}" for key, path, with_own_colours in _meshes(scene) if with_own_colours
            for problem in _problems(path)]


def mesh_textures(scene: Scene) -> list[Path]:
    """Files that the scene's mesh files name, such as textures, or that belong to its surveys, and that are there."""
    beside = [path.parent / name for _, path, _ in _meshes(scene) if is_file(path) for name in _named_by(path)]
    surveys = map(scene.resolve, scene.terrain.files) if isinstance(scene.terrain, Heights) else ()
    beside += [path.with_suffix(made) for path in surveys for suffix in BESIDE for made in (suffix, suffix.upper())]
    return sorted({path for path in beside if is_file(path)})


def _named(scene: Scene) -> Iterator[tuple[str, Path, str]]:
    """Key, path and kind of every mesh, survey and image that the scene names."""
    if isinstance(scene.terrain, Heights):
        for file in scene.terrain.files:
            yield "terrain.file", scene.resolve(file), "survey"
    for key, path, _ in _meshes(scene):
        yield key, path, "mesh"
    for name, material in scene.materials.items():
        for part in ("flat", "steep") if isinstance(material, SlopeBlend) else ():
            texture = getattr(material, part).texture
            if texture not in GROUND_TEXTURES:
                yield f"materials.{name}.{part}.texture", scene.resolve(texture), "image"


def _meshes(scene: Scene) -> Iterator[tuple[str, Path, bool]]:
    """Key and path of every mesh file, and whether its own colours are used."""
    terrain = scene.terrain
    if isinstance(terrain, Terrain):
        files = [terrain.file] if isinstance(terrain.file, str) else terrain.file
        for file in files:
            yield "terrain.file", scene.resolve(file), terrain.material is None and terrain.preprocess is None
    blocks = [(f"objects.{i}", block) for i, block in enumerate(scene.objects)]
    blocks += [(f"scatter.{i}.object", block.object) for i, block in enumerate(scene.scatter)]
    blocks += [(f"vehicles.{i}.body", vehicle.body) for i, vehicle in enumerate(scene.vehicles or ())]
    for key, block in blocks:
        if isinstance(block, MeshObject):
            yield f"{key}.file", scene.resolve(block.file), block.material is None


def _problems(path: Path) -> Iterator[str]:
    """What is wrong with the textures that a mesh file names."""
    kind = path.suffix.lower()
    if kind == ".dae" and b"<init_from" in _beginning(path):
        yield "names textures, but those of DAE files are not read: it is grey; give a material, or export it as GLB"
    for name in _named_by(path):
        if not is_file(path.parent / name):
            yield f"names {name}, which is not there: it is grey"


def _named_by(path: Path) -> list[str]:
    """Files that a mesh file names, relative to its folder, each once."""
    kind = path.suffix.lower()
    return list(dict.fromkeys(_of_obj(path) if kind == ".obj" else _of_gltf(path) if kind in (".gltf", ".glb") else []))


def _of_obj(path: Path) -> Iterator[str]:
    """Material libraries of an OBJ file, and the base colour maps in them."""
    for library in _values(path, "mtllib"):
        yield library
        for options in _values(path.parent / library, "map_Kd"):
            yield options.split()[-1] if options.startswith("-") else options


def _values(path: Path, keyword: str) -> list[str]:
    """What follows a keyword in the lines of a text file; nothing where there is no file."""
    if not is_file(path):
        return []
    lines = _beginning(path).decode("utf-8", "replace").splitlines()
    rows = [line.split(maxsplit=1) for line in lines if line.lstrip().startswith(keyword)]
    return [row[1].strip() for row in rows if len(row) == 2 and row[0] == keyword]


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MOST_BYTES)


def _of_gltf(path: Path) -> list[str]:
    """Images beside a glTF file; what is embedded needs none."""
    data = _beginning(path)
    with contextlib.suppress(ValueError, struct.error, AttributeError, TypeError):  # a damaged one is refused elsewhere
        if data[:4] == b"glTF":
            data = data[20:20 + struct.unpack_from("<I", data, 12)[0]]
        uris = [image.get("uri") for image in json.loads(data).get("images", ())]
        return [unquote(uri) for uri in uris if uri and not uri.startswith("data:")]
    return []
