"""Scene files: read YAML into a ``Scene``, say plainly what is wrong with it, and write a scene back."""

import warnings
from collections.abc import Iterable
from copy import copy
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from pydantic import ValidationError

from varos_warp.errors import InputError
from varos_warp.scene import plain_yaml
from varos_warp.scene.block import keys_without_effect
from varos_warp.scene.description import Scene
from varos_warp.scene.description.water import Water
from varos_warp.scene.file.camera_noise import with_camera_noise
from varos_warp.scene.file.imu_files import with_noise_files
from varos_warp.scene.file.problems import input_error
from varos_warp.scene.file.source import Source
from varos_warp.scene.file.yaml_files import parse_file

DATA = resources.files("varos_warp") / "data"
"""Files that come with the package."""


class Change(NamedTuple):
    """A key of a scene that another file sets."""

    key: str
    """Path of the key, with dots."""
    value: Any
    """Its new value, in the types that YAML gives."""
    where: str
    """Name in messages of what sets it, such as that file and the line."""


def load_scene(path: str | Path, overrides: Iterable[str | tuple[str, str] | Change] = ()) -> Scene:
    """Read a scene file.

    Args:
        path: YAML file; the files that it names are relative to its folder.
        overrides: ``key.path=value``, the value in YAML, list items by number: ``objects.0.scale=2``; or a pair of that
            and what messages are to name instead, such as an option of the command line; or a `Change`, by which a key
            of one form of the water also takes the place of its other forms.

    Raises:
        InputError: The file cannot be read, is not YAML, repeats a key, or is not what a scene file may be.
    """
    path = Path(path)
    source = parse_file(
        path, "scene file", "Give the path of a scene file; `varos-warp init` writes one to begin with.", Scene
    )
    if "schema_version" in source.data:
        raise InputError(
            "describes a dataset, it is no scene file",
            file=path,
            remedy="Give the scene file that it was made of, or a file of what its key scene has.",
        )
    for override in overrides:
        if isinstance(override, Change):
            _choose_form(source.data, override.key)
            _set(source, *override)
            continue
        change, given = (override, f"--set {override}") if isinstance(override, str) else override
        _apply_override(source, change, given)
    scene = _validate(source, path.parent)
    for key, instead in keys_without_effect(scene).items():
        warnings.warn(f"{key} has no effect any more: {instead}", stacklevel=2)
    return scene


def scene_from_dict(data: dict[str, Any], base_dir: str | Path = ".") -> Scene:
    """Scene from the data of a scene file, such as ``scene_to_dict`` gives; files are relative to ``base_dir``."""
    return _validate(Source(data, model=Scene), Path(base_dir))


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """The whole scene with every default filled in, as plain JSON types; ``scene_from_dict`` gives it back."""
    return scene.model_dump(mode="json")


def demo_scene_path() -> Path:
    """The scene of ``varos-warp demo``."""
    return Path(str(DATA / "demo.yaml"))


# ---------------------------------------------------------------------------------------------------------- overrides


def _apply_override(source: Source, override: str, where: str) -> None:
    """Set the key that an option says; ``where``: what messages name."""
    key, equals, text = override.partition("=")
    if not equals or "" in path_of(key):
        raise InputError("is not of the form key.path=value", file=where, remedy="For example render.spp=64.")
    try:
        value = plain_yaml.parse(text)
    except yaml.YAMLError as error:
        problem = getattr(error, "problem", None) or "cannot be parsed"
        remedy = plain_yaml.escapes(problem) or "Quote it if it is text; lists are written [1, 2, 3]."
        raise InputError(
            f"the value is not valid YAML: {problem}", file=where, key=key, value=text, remedy=remedy
        ) from None
    _set(source, key, value, where)


def path_of(key: str) -> tuple[str | int, ...]:
    """The parts of a key with dots; items of lists are numbers."""
    return tuple(int(part) if part.isdecimal() else part for part in key.strip().split("."))


def takes_the_place(key: str, of: Change) -> bool:
    """Return whether a `Change` of ``key`` after another leaves nothing of what that set."""
    new, old = path_of(key), path_of(of.key)
    if old[: len(new)] == new:
        return True
    if new[0] != "water" or old[0] != "water" or new[1] not in Water.model_fields:
        return False
    return old[1] != new[1] if len(old) > 1 else bool(of.value) and not isinstance(of.value, dict)


def _choose_form(data: dict[str, Any], key: str) -> None:
    """Leave out the other forms of the water if a key of one form is to be set: only one may be given."""
    block, *inner = path_of(key)
    if block == "water" and inner and inner[0] in Water.model_fields:
        there = data.get("water")
        data["water"] = {inner[0]: there[inner[0]]} if isinstance(there, dict) and inner[0] in there else {}


def _set(source: Source, key: str, value: Any, where: str) -> None:
    """Set one key of the data, making the blocks on the way to it."""
    path, block = path_of(key), source.data
    for depth, part in enumerate(path[:-1]):
        if isinstance(block, dict) and block.get(part) is None:
            source.overridden[path[: depth + 1]] = where
        child = copy(_child(block, part, path[:depth], where))  # what an alias or another version has stays as it is
        block[part] = child
        block = child
    _child(block, path[-1], path[:-1], where)
    block[path[-1]] = value
    source.overridden[path] = where
    for inner in [known for known in source.lines if known[: len(path)] == path]:
        del source.lines[inner]  # what stood there is gone


def _child(block, part, path, where):
    """Item ``part`` of a list, or block ``part`` of a mapping, made where it is missing."""
    here = ".".join(map(str, path)) or "the scene"
    if isinstance(block, list):
        if not isinstance(part, int) or part >= len(block):
            raise InputError(
                f"is a list of {len(block)}",
                file=where,
                key=here,
                remedy=f"Name an item by its number, 0 to {len(block) - 1}, not '{part}'.",
            )
        return block[part]
    if not isinstance(block, dict):
        raise InputError(
            "is no block that holds keys", file=where, key=here, value=block, remedy="Set the whole value instead."
        )
    if block.get(part) is None:
        block[part] = {}
    return block[part]


# --------------------------------------------------------------------------------------------------------- validation


def _validate(source: Source, base_dir: Path) -> Scene:
    folder = Path(base_dir).resolve()
    scene = validated(with_camera_noise(with_noise_files(source, folder), folder), base_dir)
    scene._base_dir, scene._source = folder, source
    return scene


def validated(source: Source, base_dir: Path = Path(".")):
    """The block that a file describes; files that blocks are read from are relative to a folder."""
    try:
        return source.model.model_validate(source.data, context={"base_dir": Path(base_dir)})
    except ValidationError as error:
        raise input_error(error, source) from None
