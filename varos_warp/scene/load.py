"""Scene files: read YAML into a ``Scene``, say plainly what is wrong with it, and write a scene back."""

import difflib
import re
import typing
import warnings
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

from varos_warp.errors import InputError
from varos_warp.scene import plain_yaml
from varos_warp.scene.description import Scene
from varos_warp.scene.description.block import keys_without_effect
from varos_warp.scene.files import read_text

DATA = resources.files("varos_warp") / "data"
"""Files that come with the package."""


def load_scene(path: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read a scene file.

    Args:
        path: YAML file; the files that it names are relative to its folder.
        overrides: ``key.path=value``, the value in YAML, list items by number: ``objects.0.scale=2``.

    Raises:
        InputError: The file cannot be read, is not YAML, repeats a key, or is not what a scene file may be.
    """
    path = Path(path)
    source = _parse(path, "scene file", "Give the path of a scene file; `varos-warp init` writes one to begin with.")
    for override in overrides:
        _apply_override(source, override)
    scene = _validate(source, path.parent)
    for key, instead in keys_without_effect(scene).items():
        warnings.warn(f"{key} has no effect any more: {instead}", stacklevel=2)
    return scene


def scene_from_dict(data: dict[str, Any], base_dir: str | Path = ".") -> Scene:
    """Scene from the data of a scene file, such as ``scene_to_dict`` gives; files are relative to ``base_dir``."""
    return _validate(_Source(data=data), Path(base_dir))


def load_block(path: str | Path, model: type[BaseModel], what: str, remedy: str) -> Any:
    """Read a file that holds one block other than a scene, such as a noise profile.

    Args:
        path: YAML file.
        model: The block.
        what: Its name in messages.
        remedy: What to do where there is no such file.

    Raises:
        InputError: As for `load_scene`.
    """
    source = _parse(Path(path), what, remedy)
    source.model = model
    return _validated(source)


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """The whole scene with every default filled in, as plain JSON types; ``scene_from_dict`` gives it back."""
    return scene.model_dump(mode="json")


def demo_scene_path() -> Path:
    """The scene of ``varos-warp demo``."""
    return Path(str(DATA / "demo.yaml"))


# --------------------------------------------------------------------------------------------------------------- YAML


@dataclass
class _Source:
    """What a scene file says, and where."""

    data: Any
    file: Path | None = None
    lines: dict[tuple, int] = field(default_factory=dict)
    """Line of every key, by its path."""
    overridden: dict[tuple, str] = field(default_factory=dict)
    """The override that set a key, by its path."""
    model: type[BaseModel] = Scene
    """What the data are to be."""

    def where(self, path: tuple) -> dict[str, Any]:
        """File, line and key for a message about ``path``, or about the nearest block around it that has a line."""
        key = ".".join(str(part) for part in path) or None
        for end in range(len(path), -1, -1):
            if path[:end] in self.overridden:
                return {"file": f"--set {self.overridden[path[:end]]}", "key": key}
            if path[:end] in self.lines:
                return {"file": self.file, "line": self.lines[path[:end]], "key": key}
        return {"file": self.file, "key": key}


def _parse(path: Path, what: str, remedy: str) -> _Source:
    """Data and line numbers of a YAML file."""
    text = read_text(path, what, remedy)
    try:
        node = plain_yaml.compose(text)
        lines: dict[tuple, int] = {}
        if node is not None:
            _collect_lines(node, (), lines, path, set())
        data = plain_yaml.construct(node)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
        raise InputError(f"is not valid YAML: {problem}", file=path, line=mark.line + 1 if mark else None,
                         remedy="Check indentation, colons and brackets there.") from None
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # such as a date that does not exist
        raise InputError(f"is not valid YAML: {error}", file=path, remedy="Quote the value if it is text.") from None
    if data is None:
        raise InputError(f"the {what} is empty", file=path, remedy=remedy)
    if not isinstance(data, dict):
        raise InputError(f"a {what} is a mapping of keys to values, this is a {type(data).__name__}", file=path,
                         remedy=remedy)
    return _Source(data, path, lines)


def _collect_lines(node, path, lines, file, seen):
    """Note the line of every key under a YAML node; a key given twice is an error, for the first would be lost."""
    if id(node) in seen:  # an alias
        return
    seen.add(id(node))
    if isinstance(node, yaml.SequenceNode):
        for i, item in enumerate(node.value):
            lines[*path, i] = item.start_mark.line + 1
            _collect_lines(item, (*path, i), lines, file, seen)
    elif isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            inner, line = (*path, key.value), key.start_mark.line + 1
            if inner in lines and key.value != "<<":
                raise InputError("is given twice", file=file, line=line, key=".".join(map(str, inner)),
                                 remedy=f"Keep one; the first is in line {lines[inner]}.")
            lines[inner] = line
            _collect_lines(value, inner, lines, file, seen)


# ---------------------------------------------------------------------------------------------------------- overrides


def _apply_override(source: _Source, override: str) -> None:
    """Set one key of the data, making the blocks on the way to it."""
    key, equals, text = override.partition("=")
    path = tuple(int(part) if part.isdigit() else part for part in key.strip().split("."))
    where = f"--set {override}"
    if not equals or "" in path:
        raise InputError("is not of the form key.path=value", file=where, remedy="For example render.spp=64.")
    try:
        value = plain_yaml.parse(text)
    except yaml.YAMLError as error:
        problem = getattr(error, "problem", None) or "cannot be parsed"
        raise InputError(f"the value is not valid YAML: {problem}", file=where, key=key, value=text,
                         remedy="Quote it if it is text; lists are written [1, 2, 3].") from None
    block = source.data
    for depth, part in enumerate(path[:-1]):
        if isinstance(block, dict) and block.get(part) is None:
            source.overridden[path[:depth + 1]] = override
        block = _child(block, part, path[:depth], where)
    _child(block, path[-1], path[:-1], where)
    block[path[-1]] = value
    source.overridden[path] = override
    for inner in [known for known in source.lines if known[:len(path)] == path]:
        del source.lines[inner]  # what stood there is gone


def _child(block, part, path, where):
    """Item ``part`` of a list, or block ``part`` of a mapping, made where it is missing."""
    here = ".".join(map(str, path)) or "the scene"
    if isinstance(block, list):
        if not isinstance(part, int) or part >= len(block):
            raise InputError(f"is a list of {len(block)}", file=where, key=here,
                             remedy=f"Name an item by its number, 0 to {len(block) - 1}, not '{part}'.")
        return block[part]
    if not isinstance(block, dict):
        raise InputError("is no block that holds keys", file=where, key=here, value=block,
                         remedy="Set the whole value instead.")
    if block.get(part) is None:
        block[part] = {}
    return block[part]


# --------------------------------------------------------------------------------------------------------- validation


def _validate(source: _Source, base_dir: Path) -> Scene:
    scene = _validated(source)
    scene._base_dir = Path(base_dir).resolve()
    return scene


def _validated(source: _Source):
    """The block that a file describes."""
    try:
        return source.model.model_validate(source.data)
    except ValidationError as error:
        raise _input_error(error, source) from None


def _input_error(error: ValidationError, source: _Source) -> InputError:
    """The first problem of a scene, and how many more there are."""
    problems = _most_specific([(_key_path(e["loc"], source.data, e["type"] == "missing"), e) for e in error.errors()])
    # A misspelt key is most likely what makes another one missing.
    problems.sort(key=lambda p: p[1]["type"] != "extra_forbidden")
    path, first = problems[0]
    problem, remedy = _explain(path, first, source)
    named = re.match(r"([\w.]+): ", problem)
    if not path and named:  # a check of the whole scene that names a key itself
        path = tuple(int(part) if part.isdigit() else part for part in named[1].split("."))
        problem = problem[named.end():]
    if len(problems) > 1:
        also = ", ".join(dict.fromkeys(".".join(map(str, p)) for p, _ in problems[1:4]))
        count = len(problems) - 1
        remedy += f" ({count} more problem{'s' * (count > 1)}: {also}{', ...' * (count > 3)})"
    value = first["input"] if first["type"] not in ("missing", "extra_forbidden", "union_tag_not_found") else None
    if (isinstance(value, dict | list) and len(str(value)) > 60) or isinstance(value, BaseModel) or not path:
        value = None
    where = source.where(path)
    changes = dict.fromkeys(text for inner, text in source.overridden.items() if inner[:len(path)] == path != inner)
    if "line" in where and path and changes:  # which may have made the block wrong
        problem += f" (with --set {' and '.join(changes)})"
        remedy = remedy or f"To replace the whole block, set it: --set '{'.'.join(map(str, path))}={{...}}'."
    return InputError(problem, value=value, remedy=remedy or None, **where)


def _key_path(loc: tuple, data: Any, missing: bool) -> tuple:
    """The path of keys in the file: pydantic's, without the names of types and of kinds that it puts between.

    ``missing``: the last key is not in the file.
    """
    path: list = []
    for i, part in enumerate(loc):
        exists = (isinstance(data, dict) and part in data) or (isinstance(data, list) and isinstance(part, int)
                                                               and part < len(data))
        if exists and not _is_tag(part, loc[i + 1:], data):
            path.append(part)
            data = data[part]
        elif isinstance(part, int) or (missing and i == len(loc) - 1):
            path.append(part)
            data = None
    return tuple(path)


def _is_tag(part, rest, data):
    """Whether a part of pydantic's path is the kind of the block, though the block has such a key, too.

    A block without ``kind`` may be of the kind ``file``: then the next part is a key beside this one.
    """
    if not isinstance(data, dict) or not rest or isinstance(data[part], dict):
        return False
    return data["kind"] == part if "kind" in data else rest[0] in data


def _most_specific(problems):
    """Without what pydantic says about the other branches of a union, of which the user meant only one."""
    paths = [path for path, _ in problems]
    kept: dict[tuple, Any] = {}
    for path, e in problems:
        deeper = any(len(other) > len(path) and other[:len(path)] == path for other in paths)
        if not deeper or e["type"] == "extra_forbidden":
            kept.setdefault(path, e)
    return list(kept.items())


_REMEDIES = {
    "missing": "Add it.",
    **dict.fromkeys(("float_type", "float_parsing"), "Give a number, without a unit."),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "Give a whole number, without a unit."),
    **dict.fromkeys(("tuple_type", "list_type"), "Give a list: in brackets, or one item a line, each after a dash."),
    **dict.fromkeys(("model_type", "dict_type", "model_attributes_type"), "Give a block of keys, indented under it."),
    "string_type": "Put quotes around it if it is text.",
    "finite_number": "Give a finite number.",
    "too_long": "Give as many items as are asked for.",
}


_PLAIN = {"number": "a number", "integer": "a whole number", "tuple": "a list", "list": "a list", "string": "a text",
          "boolean": "true or false"}
"""Words for the types of pydantic's messages."""


def _explain(path: tuple, e: dict, source: _Source) -> tuple[str, str]:
    """Problem and remedy in plain words."""
    kind, context = e["type"], e.get("ctx", {})
    if kind == "extra_forbidden":
        return "unknown key", _suggest(str(path[-1]), _known_keys(path[:-1], source.data, source.model))
    if kind == "missing":
        return "is missing", _REMEDIES["missing"]
    if kind == "union_tag_invalid":
        known = [tag.strip(" '") for tag in context["expected_tags"].split(",")]
        return f"unknown kind '{context['tag']}'", _suggest(str(context["tag"]), known)
    if kind == "literal_error":
        known = [tag.strip(" '") for tag in context["expected"].replace(" or ", ",").split(",")]
        return "is not one of the choices", _suggest(str(e["input"]), known)
    if kind == "too_short":
        return "has too few items", f"Give at least {context['min_length']}."
    message = e["msg"].removeprefix("Value error, ").removeprefix("Input ")
    message = re.sub(r"valid dictionary.*", "block of keys", message)
    message = re.sub(r"an? valid (\w+)(, unable.*)?", lambda found: _PLAIN.get(found[1], found[0]), message)
    if kind == "string_pattern_mismatch":
        key = ".".join(str(part) for part in path if not isinstance(part, int))
        return f"should have the form {context['pattern']}", f"`varos-warp schema {key}` says what it means."
    bounds = {"greater_than": ("gt", "above"), "greater_than_equal": ("ge", "at least"),
              "less_than": ("lt", "below"), "less_than_equal": ("le", "at most")}
    if kind in bounds:
        name, word = bounds[kind]
        return message, f"Give a number that is {word} {context[name]:g}."
    return message, _REMEDIES.get(kind, "")


def _suggest(word: str, known: list[str]) -> str:
    near = difflib.get_close_matches(word, known, 1)
    listing = f"known here: {', '.join(known)}" if known else "nothing can be set here"
    return f"Did you mean '{near[0]}'?" if near else f"{listing[0].upper()}{listing[1:]}."


def _known_keys(path: tuple, data: Any, model: type[BaseModel]) -> list[str]:
    """Keys that a block at ``path`` may have."""
    models: list = [model]
    for part in path:
        data = data[part] if isinstance(data, dict | list) else None
        annotations = [m.model_fields[part].annotation for m in models if part in getattr(m, "model_fields", {})]
        if annotations:
            models = [model for annotation in annotations for model in _models_in(annotation)]
        if isinstance(data, dict) and "kind" in data:
            models = [m for m in models if data["kind"] in _kinds(m)] or models
    return list(dict.fromkeys(name for model in models for name in model.model_fields))


def _kinds(model) -> tuple:
    return typing.get_args(model.model_fields["kind"].annotation) if "kind" in model.model_fields else ()


def _models_in(annotation) -> list[type[BaseModel]]:
    """All models that a type annotation mentions."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in typing.get_args(annotation) for model in _models_in(inner)]
