"""What is wrong with a scene file, in plain words: the errors of validation as messages that name a remedy."""

import re
import typing
from typing import Any

from pydantic import BaseModel, ValidationError

from varos_warp.errors import InputError, counted, did_you_mean, same_name
from varos_warp.scene.block import FILE_KEYS
from varos_warp.scene.description import LAMPS
from varos_warp.scene.description.image_types import AMBIENT, WATER
from varos_warp.scene.file.schema import (
    KIND_KEYS,
    Entry,
    blocks_in,
    facts,
    find_key,
    homes,
    in_words,
    json_schema,
    plain,
)
from varos_warp.scene.file.source import Source
from varos_warp.scene.headers import LENGTHS

ELSEWHERE = {
    "sigma_a": ("a", "absorption", "absorption_coefficient", "absorption_coefficients", "mu_a"),
    "sigma_s": ("b", "scattering", "scattering_coefficient", "scattering_coefficients", "mu_s"),
    "resolution": ("size", "image_size", "width", "height", "image_width", "image_height"),
    "focal_mm": ("f", "focal_length", "focal_length_mm"),
    "f_stop": ("aperture", "f_number", "fnumber"),
    "distortion": ("dist", "dist_coeffs", "distortion_coefficients", "distortion_coeffs", "distortion_model"),
    "position": ("translation", "xyz", "origin", "location", "t"),
    "quaternion": ("q", "quat", "q_wxyz", "rotation_quaternion"),
    "rotation_euler_deg": ("rotation", "rpy", "orientation", "euler", "quaternion"),
    "intensity": ("power", "power_w", "watts", "energy", "lumens", "brightness"),
    "cone_deg": ("angle", "beam_angle", "spot_size", "fov"),
    "reflectance": ("albedo", "color", "colour", "base_color", "kd"),
    "file": ("mesh", "path", "filename", "uri", "model"),
    "lights": ("lamps",),
    "positive": ("depth", "positive_down", "z_down", "sign"),
    "pixel_m": ("cell_size", "cellsize", "cell_m", "spacing_m", "pixel_size", "gsd"),
    "resolution_m": ("step", "every", "thin", "decimate"),
    "height_offset_m": ("offset", "z_offset", "vertical_offset", "height_offset", "datum"),
    "nodata": ("no_data", "nodata_value", "fill_value", "missing_value"),
    "spp": ("samples", "samples_per_pixel"),
    "frame_rate_hz": ("fps", "frame_rate", "rate_hz"),
}
"""Names that other tools have for our keys."""
HEIGHTS = "heightmap heightfield height_map height_field heights depths dem dtm bathymetry grid geotiff raster".split()
"""Names of heights on a grid; ours is a kind."""
AS_FILE = "Heights on a grid are given as kind: heights and file; docs/terrain.md tells of their keys."
INTRINSICS = "k fx fy cx cy camera_matrix principal_point camera_info fov fov_deg hfov horizontal_fov".split()
"""What other tools say of a camera."""
MEASURED = (
    "Measured ones are intrinsics: {fx, fy, cx, cy} in pixels, or calibration: a file of Kalibr, OpenCV or "
    "ROS; else give sensor_mm and focal_mm, by which fx = focal_mm / sensor_mm[0] x width."
)
MEANT = {
    **{
        (key, f"-{axis}"): f"Give {axis} and turn it upside down: rotation_euler_deg: [180, 0, 0]."
        for key in ("up", "up_axis")
        for axis in "xyz"
    },
    **{(key, "percentile"): "Give {meter: percentile}." for key in (WATER, AMBIENT)},
    ("frame", "nwu"): "Give enu, which leaves the axes as they are: x of the scene is then north, and y west.",
}
"""What to give for values of a key that are none of its choices, but have a meaning."""
SHORT = 3
"""Words of so many letters at most are like too many others for a guess at what was meant."""
TYPES = frozenset(
    "float_type float_parsing int_type int_parsing int_from_float bool_type bool_parsing string_type "
    "string_pattern_mismatch tuple_type list_type dict_type model_type model_attributes_type".split()
)
"""Errors of validation that mean: something else belongs there."""


def input_error(error: ValidationError, source: Source) -> InputError:
    """The first problem of a scene, and how many more there are."""
    problems = _most_specific([(_key_path(e["loc"], source.data, e["type"] == "missing"), e) for e in error.errors()])
    # A misspelt key is most likely what makes another one missing.
    problems.sort(key=lambda p: p[1]["type"] != "extra_forbidden")
    path, first = problems[0]
    problem, remedy = _explain(path, first, source)
    inner = _named_key(problem, path, source)
    if inner:
        path += inner
        problem = problem.partition(": ")[2]
    # the mesh that is missing is what the remedy speaks of
    remedy += _others(path, first, [p for p in problems[1:] if remedy != AS_FILE or p[1]["type"] != "missing"])
    value = None if first["type"] in ("missing", "extra_forbidden", "union_tag_not_found") or inner else first["input"]
    if (isinstance(value, dict | list) and len(str(value)) > 60) or isinstance(value, BaseModel) or not path:
        value = None
    where = source.where(path)
    changes = dict.fromkeys(text for inner, text in source.overridden.items() if inner[: len(path)] == path != inner)
    if "line" in where and path and changes:  # which may have made the block wrong
        problem += f" (with {' and '.join(changes)})"
        remedy = remedy or f"To replace the whole block, set it: --set '{'.'.join(map(str, path))}={{...}}'."
    return InputError(problem, value=value, remedy=remedy.strip() or None, **where)


def _named_key(problem: str, path: tuple, source: Source) -> tuple:
    """The key that the check of a whole block names itself, ``port.normal: ...``; none that is not of the block."""
    named = re.match(r"([\w.]+): ", problem)
    if named is None:
        return ()
    inner = tuple(int(part) if part.isdigit() else part for part in named[1].split("."))
    block = source.value(path)
    return inner if not path or (isinstance(block, dict) and inner[0] in block) else ()


def _others(path: tuple, first: dict, problems: list) -> str:
    """What else is wrong; keys that are missing by themselves, for what is given in their place is told first."""
    names = {True: [], False: []}
    for other, e in problems:
        missing = e["type"] == "missing"
        near = missing and other[:-1] == path[:-1]
        names[missing].append(".".join(map(str, other[-1:] if near else other)))
    missing, wrong = names[True], names[False]
    parts = []
    if wrong:
        parts.append(f"{counted(len(wrong), 'more problem')}: {_some(wrong)}")
    if missing:
        parts.append(f"missing{', too' * (first['type'] == 'missing')}: {_some(missing)}")
    return f" ({'; '.join(parts)})" if parts else ""


def _some(names: list[str]) -> str:
    return ", ".join(list(dict.fromkeys(names))[:3]) + ", ..." * (len(names) > 3)


def _key_path(loc: tuple, data: Any, missing: bool) -> tuple:
    """The path of keys in the file: pydantic's, without the names of types and of kinds that it puts between.

    ``missing``: the last key is not in the file.
    """
    path: list = []
    for i, part in enumerate(loc):
        exists = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        if exists and not _is_tag(part, loc[i + 1 :], data):
            path.append(part)
            data = data[part]
        elif isinstance(part, int) or (missing and i == len(loc) - 1):
            path.append(part)
            data = None
    return tuple(path)


def _is_tag(part, rest, data):
    """Return whether a part of pydantic's path is the kind of the block, though the block has such a key, too.

    A block without ``kind`` may be of the kind ``file``: then the next part is a key beside this one.
    """
    if not isinstance(data, dict) or not rest or isinstance(data[part], dict):
        return False
    return data["kind"] == part if "kind" in data else rest[0] in data


def _most_specific(problems):
    """Drop what pydantic says about the other branches of a union, of which the user meant only one."""
    paths = [path for path, _ in problems]
    kept: dict[tuple, Any] = {}
    for path, e in problems:
        deeper = any(len(other) > len(path) and other[: len(path)] == path for other in paths)
        if not deeper or e["type"] == "extra_forbidden":
            if _is_number(e["input"]) and kept.get(path, e)["type"] == "literal_error":
                kept[path] = e  # a number is out of the bounds of numbers, not a word that is mistyped
            kept.setdefault(path, e)
    return list(kept.items())


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _explain(path: tuple, e: dict, source: Source) -> tuple[str, str]:
    """Problem and remedy in plain words."""
    kind, context = e["type"], e.get("ctx", {})
    if kind == "extra_forbidden":
        return "unknown key", _instead(path, source)
    if kind == "missing":
        return "is missing", "Add it."
    if kind == "union_tag_invalid":
        return f"unknown kind '{context['tag']}'", _other_kind(str(context["tag"]), _listed(context["expected_tags"]))
    if kind == "literal_error":
        known = _listed(context["expected"].replace(" or ", ","))
        return "is not one of the choices", _other_choice(path, str(e["input"]), known)
    if kind == "too_short":
        return "has too few items", f"Give at least {context['min_length']}."
    if kind in TYPES and (known := _known(path, source)):
        return _should_be(path, e, known, _as_block(path, e["input"], source))
    message = e["msg"].removeprefix("Value error, ").removeprefix("Input ")
    message = re.sub(r"valid dictionary.*", "block of keys", message)
    bounds = {
        "greater_than": ("gt", "above"),
        "greater_than_equal": ("ge", "at least"),
        "less_than": ("lt", "below"),
        "less_than_equal": ("le", "at most"),
    }
    if kind in bounds:
        name, word = bounds[kind]
        return message, f"Give a number that is {word} {context[name]:g}."
    remedies = {"finite_number": "Give a finite number.", "too_long": "Give as many items as are asked for."}
    return message, remedies.get(kind, "")


def _listed(names: str) -> list[str]:
    return [name.strip(" '") for name in names.split(",")]


def _should_be(path: tuple, e: dict, known: list[Entry], as_block: str | None) -> tuple[str, str]:
    """What belongs at a key, by the schema, and an example, a unit, or what the value is ``as_block``."""
    schemas = [entry.schema for entry in known]
    if isinstance(path[-1], int):
        schemas = [item for schema in schemas if (item := _item(schema, path[-1]))] or schemas
    words = " or ".join(dict.fromkeys(filter(None, map(in_words, schemas))))
    if known[0].key != path[-1] and words == "blocks by name":
        words = "block"
    article = "a " if words.split()[0] in ("number", "whole", "list", "block") else ""
    about, value = facts(known[0]), e["input"]
    unit, example = about["unit"], about["example"] or about["default"]
    if words.startswith("list of blocks"):
        remedy = "Begin each block with a dash, also if there is but one."
    elif "block" in words:
        remedy = as_block or "Give a block of keys, indented under it."
    elif e["type"] == "string_type":
        remedy = "Put quotes around it if it is text."
    elif words.startswith(("number", "whole")):
        remedy = "Give a whole number." if words.startswith("whole") else "Give a number."
        if isinstance(value, str) and re.match(r"\s*[-+.]?\d", value):
            remedy = f"Give the number alone{f'; the unit is {unit}' * bool(unit)}."
    else:
        such = f"Such as {example}: " if example not in ("", "required", "absent", "none", "see its keys") else ""
        remedy = f"{such}{_first_sentence(known[0])}"
    return f"should be {article}{words}", remedy


def _as_block(path: tuple, value: Any, source: Source) -> str | None:
    """The block that a word was given for, if it is a choice of one of the block's keys or the block needs one."""
    needed = None
    for model in _models_at(path, source) if isinstance(value, str) else ():
        for name, field in model.model_fields.items():
            choices = [str(choice) for choice in typing.get_args(field.annotation)]
            if typing.get_origin(field.annotation) is not typing.Literal:
                continue
            if choice := same_name(value, choices):
                return f"Give {{{name}: {choice}}}."
            if field.is_required() and len(choices) > 1:
                needed = f"Give {{{name}: {choices[0]}}}, or one of {', '.join(choices[1:])}."
    return needed


def _item(schema: dict, number: int) -> dict | None:
    """The schema of an item of a list."""
    for part in (schema, *schema.get("anyOf", ())):
        if number < len(items := part.get("prefixItems", ())):
            return items[number]
        if isinstance(part.get("items"), dict):
            return part["items"]
    return None


def _known(path: tuple, source: Source) -> list[Entry]:
    """What the schema says of a key in its block, whose kind the data tell; nothing of what it does not know."""
    names, data = [], source.data
    for part in path:
        names += [str(data[key]) for key in KIND_KEYS if isinstance(data, dict) and isinstance(data.get(key), str)]
        names.append(str(part))
        try:
            data = data[part]
        except (LookupError, TypeError):
            data = None
    try:
        return find_key(".".join(names), source.model)
    except InputError:
        return []


def _first_sentence(entry: Entry) -> str:
    return re.split(r"(?<=\.)\s+(?=[A-Z])", plain(entry.schema.get("description", "")))[0]


def _instead(path: tuple, source: Source) -> str:
    """What to give instead of a key that is not known."""
    word, models = str(path[-1]), _models_at(path[:-1], source)
    block = source.value(path[:-1])
    known = _keys_of(models, block)
    if kinds := [kind for model in models if {word, "kind"} <= {*_keys(model)} for kind in _kinds(model)]:
        theirs = f"Blocks of kind {' or '.join(kinds)} have it"
        given = block.get("kind") if isinstance(block, dict) else None
        return (
            f"{theirs}, those of kind {given} do not. {_suggest(word, known)}" if given else f"{theirs}: give the kind."
        )
    if word.lower() in INTRINSICS and "focal_mm" in known:
        return MEASURED
    if word.lower() in ("unit", "units") and "scale" in known:
        return _scale(source.value(path))
    if word.lower() in HEIGHTS and path[0] == "terrain":
        return AS_FILE
    for ours, theirs in ELSEWHERE.items():
        if ours in known and word.lower() in theirs and (entries := _known((*path[:-1], ours), source)):
            return f"Here it is {ours}: {_first_sentence(entries[0])}"
    here = ".".join(str(part) for part in path[:-1] if not isinstance(part, int))
    places = [place for place in _where_it_fits(word, source.value(path), source.model) if place != here]
    if len(places) in (1, 2) and not did_you_mean(word, known):
        where = " and ".join(f"of {place}" if place else "at the top of the file" for place in places)
        return f"{word} is a key {where}. {_known_here(known)}"
    return _suggest(word, known)


def _scale(unit: Any) -> str:
    """What to give for a unit, or metres in it, where a mesh has a ``scale``."""
    word = str(unit).strip().lower()
    metres = LENGTHS.get(word, LENGTHS.get(word.removesuffix("s")))
    if metres is None:
        return "Give scale, metres in one unit of the file, such as 0.001 for mm."
    return f"Give scale: {metres:g}, the metres in one unit of the file."


def _where_it_fits(word: str, value: Any, model: type[BaseModel]) -> list[str]:
    """Keys of the blocks that have a key of this name; where it is given as a block, of those that take one for it."""
    places, root = list(homes(word, model)), json_schema(model)
    if not isinstance(value, dict) or len(places) < 2:
        return places
    return [
        place
        for place in places
        if any(True for entry in find_key(f"{place}.{word}".lstrip("."), model) for _ in blocks_in(entry.schema, root))
    ]


def _other_kind(tag: str, known: list[str]) -> str:
    if "profile" in known and (lamp := same_name(tag, LAMPS)):
        return f"{tag} is a file: give kind: profile and file: {lamp}."
    return _suggest(tag, known)


def _other_choice(path: tuple, word: str, known: list[str]) -> str:
    key = next((part for part in reversed(path) if isinstance(part, str)), "")
    if remedy := MEANT.get((key, word.lower())):
        return remedy
    return _suggest(word, known) if len(word) > SHORT or same_name(word, known) else _known_here(known)


def _suggest(word: str, known: list[str]) -> str:
    return did_you_mean(word, known) or _known_here(known)


def _known_here(known: list[str]) -> str:
    return f"Known here: {', '.join(known)}." if known else "Nothing can be set here."


def _models_at(path: tuple, source: Source) -> list[type[BaseModel]]:
    """Kinds of block that may stand at ``path``, whichever is there."""
    models, data = [source.model], source.data
    for part in path:
        models = _of_kind(models, data)
        data = data[part] if isinstance(data, dict | list) else None
        annotations = [m.model_fields[part].annotation for m in models if part in m.model_fields]
        if annotations:
            models = [model for annotation in annotations for model in _models_in(annotation)]
    return models


def _of_kind(models: list[type[BaseModel]], data: Any) -> list[type[BaseModel]]:
    """Return the models that a block says it is of; all if it says nothing of use."""
    named = [data[key] for key in KIND_KEYS if key in data] if isinstance(data, dict) else []
    return [model for model in models if named and named[0] in _kinds(model)] or models


def _keys_of(models: list[type[BaseModel]], data: Any) -> list[str]:
    """Keys that a block may have."""
    return list(dict.fromkeys(name for model in _of_kind(models, data) for name in _keys(model)))


def _keys(model: type[BaseModel]) -> list[str]:
    """Keys of a block."""
    return [FILE_KEYS.get(name, name) for name in model.model_fields]


def _kinds(model) -> tuple:
    tags = [model.model_fields[key].annotation for key in KIND_KEYS if key in model.model_fields]
    return typing.get_args(tags[0]) if tags else ()


def _models_in(annotation) -> list[type[BaseModel]]:
    """All models that a type annotation mentions."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for inner in typing.get_args(annotation) for model in _models_in(inner)]
