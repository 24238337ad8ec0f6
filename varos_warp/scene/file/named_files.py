"""The files that a scene names: whether all are there, before hours are spent."""

import os
from collections.abc import Iterator
from pathlib import Path

from varos_warp.errors import InputError
from varos_warp.files import is_file, like_it
from varos_warp.scene.description import Scene
from varos_warp.scene.description.survey import Heights
from varos_warp.scene.description.world import GROUND_TEXTURES, MeshObject, SlopeBlend, Terrain


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
    folder = ": this is a folder" if os.path.isdir(path) else ""
    raise InputError(
        f"there is no such {what} file{folder}",
        file=path,
        key=key,
        remedy=f"{like_it(path) or f'{known} relative to the scene file.'}{also}",
    )


def _named(scene: Scene) -> Iterator[tuple[str, Path, str]]:
    """Key, path and kind of every mesh, survey and image that the scene names."""
    if isinstance(scene.terrain, Heights):
        for file in scene.terrain.files:
            yield "terrain.file", scene.resolve(file), "survey"
    for key, path in named_meshes(scene):
        yield key, path, "mesh"
    for place, trajectory in scene.trajectories.items():
        if trajectory.file is not None:
            yield f"{place}.file", scene.resolve(trajectory.file), "course"
    for name, material in scene.materials.items():
        for part in ("flat", "steep") if isinstance(material, SlopeBlend) else ():
            texture = getattr(material, part).texture
            if texture not in GROUND_TEXTURES:
                yield f"materials.{name}.{part}.texture", scene.resolve(texture), "image"


def named_meshes(scene: Scene) -> Iterator[tuple[str, Path]]:
    """Key and path of every mesh file."""
    terrain = scene.terrain
    if isinstance(terrain, Terrain):
        files = [terrain.file] if isinstance(terrain.file, str) else terrain.file
        for file in files:
            yield "terrain.file", scene.resolve(file)
    blocks = [(f"objects.{i}", block) for i, block in enumerate(scene.objects)]
    blocks += [(f"scatter.{i}.object", block.object) for i, block in enumerate(scene.scatter)]
    blocks += [(f"vehicles.{i}.body", vehicle.body) for i, vehicle in enumerate(scene.vehicles or ())]
    for key, block in blocks:
        if isinstance(block, MeshObject):
            yield f"{key}.file", scene.resolve(block.file)
