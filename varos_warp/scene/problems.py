"""What is wrong with a scene file, in plain words: the errors of validation as messages that name a remedy."""

import re
import typing
from typing import Any

from pydantic import BaseModel, ValidationError

from varos_warp.errors import InputError, did_you_mean
from varos_warp.scene.source import Source


def input_error(error: ValidationError, source: Source) -> InputError:
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
    changes = [text for inner, text in source.overridden.items() if inner[:len(path)] == path != inner]
    if "line" in where and changes:  # which may have made the block wrong
        problem += f" (with --set {' and '.join(changes)})"
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
    **dict.fromkeys(("float_type", "float_parsing"), "Give a number."),
    **dict.fromkeys(("int_type", "int_parsing", "int_from_float"), "Give a whole number."),
    **dict.fromkeys(("tuple_type", "list_type"), "Give a list, such as [1, 2, 3]."),
    **dict.fromkeys(("model_type", "dict_type", "model_attributes_type"), "Give a block of keys, indented under it."),
    "string_type": "Put quotes around it if it is text.",
    "finite_number": "Give a finite number.",
    "too_long": "Give as many items as are asked for.",
}


def _explain(path: tuple, e: dict, source: Source) -> tuple[str, str]:
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
    bounds = {"greater_than": ("gt", "above"), "greater_than_equal": ("ge", "at least"),
              "less_than": ("lt", "below"), "less_than_equal": ("le", "at most")}
    if kind in bounds:
        name, word = bounds[kind]
        return message, f"Give a number that is {word} {context[name]:g}."
    return message, _REMEDIES.get(kind, "")


def _suggest(word: str, known: list[str]) -> str:
    listing = f"Known here: {', '.join(known)}." if known else "Nothing can be set here."
    return did_you_mean(word, known) or listing


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
