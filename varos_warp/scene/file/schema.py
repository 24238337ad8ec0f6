"""The JSON Schema of scene files, for editors and the docs, and what it says of one key in plain words."""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from varos_warp.errors import InputError, did_you_mean
from varos_warp.scene.description import Scene

UNITS = frozenset(
    "m, mm, s, Hz, kg, kg m^2, N, N m, N m s, N s/m, N s^2/m^2, N m s^2, T, W/sr, 1/m, m/s, m/s^2, rad/s, "
    "m/s^2/sqrt(Hz), m/s^3/sqrt(Hz), rad/s/sqrt(Hz), rad/s^2/sqrt(Hz), degrees, degrees/s, degrees Celsius, per mille, "
    "pixels, e-, e-/s, e-/DN, e- per W/sr/m^2, W, lm, mg/m^3, g/m^3".split(", ")
)
"""What may stand in brackets in the description of a key: its unit."""
KIND_KEYS = ("kind", "model")
"""Keys that tell which of several blocks one is."""
FORMS = {
    r"^[0-9a-zA-Z]$": "a letter or digit",
    r"^[0-9a-zA-Z]{2}$": "two letters or digits",
    r"^(vehicle|imu|[0-9a-zA-Z]{2})$": "vehicle, imu or the id of a camera",
    r"^([xyz]{3}|[XYZ]{3})$": "three of x, y, z or of X, Y, Z",
    r"^\S(.*\S)?$": "a text without blanks at its ends",
    r"^M\d+(\.\d+)?$": "M and a number, such as M24",
    r"^(terrain|objects\.\d+)$": "terrain or objects.NUMBER",
}
"""What a text of each form is, in words."""


class _Generator(GenerateJsonSchema):
    """Pydantic's, without a title for each key, which only repeats the key."""

    def field_title_should_be_set(self, schema) -> bool:
        return False


@cache
def json_schema(model: type[BaseModel] = Scene) -> dict[str, Any]:
    """JSON Schema of the scene file, not to be changed; keys have a description, and ``x-unit`` if they have a unit.

    Or that of another file, of one ``model``.
    """
    schema = model.model_json_schema(schema_generator=_Generator)
    if model is Scene:
        schema["required"].remove("trajectory")  # or each of the vehicles has one
    for block in (schema, *schema["$defs"].values()):
        for key, entry in block.get("properties", {}).items():
            if key in KIND_KEYS and tags_of(entry):
                entry.setdefault("description", f"Tells what this is. {block['description']}")
            if unit := unit_of(entry.get("description", "")):
                entry["x-unit"] = unit
    return {"$schema": GenerateJsonSchema.schema_dialect, **schema, "title": "Scene file of varos-warp"}


def unit_of(description: str) -> str | None:
    """The unit that a description names in brackets."""
    return next((text for text in re.findall(r"\[([^\]]+)\]", description) if text in UNITS), None)


# ------------------------------------------------------------------------------------------------------------ one key


@dataclass(frozen=True)
class Entry:
    """What the schema says of a key in one kind of block, or alike in several."""

    key: str
    kinds: tuple[str, ...]
    """Kinds of block that have it so; none where there is but one."""
    schema: dict[str, Any]
    required: bool


def find_key(key: str, model: type[BaseModel] = Scene) -> list[Entry]:
    """What the schema says of a key such as ``vehicle.cameras.port``; more than one entry if kinds of block differ.

    Items of lists need no number and materials no name; a part may name a kind: ``objects.pipe.radius``.

    Raises:
        InputError: There is no such key.
    """
    root = json_schema(model)
    blocks, found, named = [root], [], False
    for part in key.split("."):
        if part.isdecimal():
            continue
        of_kind = [block for block in blocks if part in kinds_of(block)]
        holders = [block for block in blocks if part in block.get("properties", {})]
        if holders:
            found = entries(part, holders)
            blocks = [block for entry in found for block in blocks_in(entry.schema, root)]
        elif of_kind:
            blocks = of_kind
            found = [
                Entry(part, (), {"$ref": f"#/$defs/{block['title']}", "description": block["description"]}, False)
                for block in of_kind
            ]
        elif not named:
            raise _unknown(key, part, blocks)
        named = bool(holders) and any("additionalProperties" in entry.schema for entry in found)
    return found


def keys_like(typed: str) -> list[str]:
    """Keys that go on from what was typed so far: ``vehicle.cam`` may become ``vehicle.cameras``."""
    above, dot, _ = typed.rpartition(".")
    try:
        blocks = (
            [block for entry in find_key(above) for block in blocks_in(entry.schema, json_schema())]
            if dot
            else [json_schema()]
        )
    except InputError:
        return []
    names = dict.fromkeys(name for block in blocks for name in names_in(block))
    return [key for key in (above + dot + name for name in names) if key.startswith(typed)]


@cache
def homes(name: str, model: type[BaseModel] = Scene) -> tuple[str, ...]:
    """Keys of the blocks that have a key of this name, ``vehicles`` for ``body``; empty text for the file itself.

    A block that may stand in several places counts where it is first met.
    """
    root = json_schema(model)
    found, blocks, met = [], [("", root)], set()
    for path, block in blocks:  # which grows on the way
        if name in names_in(block):
            found.append(path)
        for key in names_in(block):
            for inner in blocks_in(block["properties"][key], root):
                if inner["title"] not in met:
                    met.add(inner["title"])
                    blocks.append((f"{path}.{key}".lstrip("."), inner))
    return tuple(dict.fromkeys(found))


def entries(key: str, holders: list[dict]) -> list[Entry]:
    """One entry for each way in which blocks that have a key describe it."""
    alike: dict[str, list] = {}
    for block in holders:
        required = key in block.get("required", ())
        alike.setdefault(json.dumps([block["properties"][key], required], sort_keys=True), []).append(block)
    several = len(alike) > 1
    return [
        Entry(
            key,
            tuple(filter(None, map(kind_of, blocks))) if several else (),
            blocks[0]["properties"][key],
            key in blocks[0].get("required", ()),
        )
        for blocks in alike.values()
    ]


def names_in(block: dict) -> list[str]:
    """The keys of a block, but for those that are only there for older files."""
    return [name for name, schema in block.get("properties", {}).items() if not schema.get("deprecated")]


def kind_of(block: dict) -> str | None:
    """What tells a block from others that may stand in its place, by the first of its names."""
    return next(iter(kinds_of(block)), None)


def kinds_of(block: dict) -> tuple[str, ...]:
    """All names by which a block may be told from others that may stand in its place."""
    tags = (tags_of(block.get("properties", {}).get(key, {})) for key in KIND_KEYS)
    return next(filter(None, tags), ())


def tags_of(entry: dict) -> tuple[str, ...]:
    """Values of a key that tells what a block is; nothing of others, such as choices with a default."""
    if "const" in entry:
        return (entry["const"],)
    return () if "default" in entry else tuple(entry.get("enum", ()))


def blocks_in(schema: dict, root: dict) -> Iterator[dict]:
    """The blocks that may stand where a schema says, also as items of a list or under any name."""
    if "$ref" in schema:
        yield root["$defs"][schema["$ref"].rpartition("/")[2]]
    inner = [
        *schema.get("anyOf", ()),
        *schema.get("oneOf", ()),
        schema.get("items"),
        schema.get("additionalProperties"),
    ]
    for part in inner:
        if isinstance(part, dict):
            yield from blocks_in(part, root)


def _unknown(key: str, part: str, blocks: list[dict]) -> InputError:
    known = list(dict.fromkeys(name for block in blocks for name in names_in(block)))
    listing = f"Known there: {', '.join(known)}." if known else "It is no block, nothing is under it."
    return InputError(f"no key '{part}'", key=key, remedy=did_you_mean(part, known) or listing)


# -------------------------------------------------------------------------------------------------------------- words


def explain(key: str) -> str:
    """A key in plain words: meaning, what it may be, unit, default, example; and the keys under it.

    Raises:
        InputError: There is no such key.
    """
    root = json_schema()
    return "\n\n".join("\n".join(_explained(key, entry, root)) for entry in find_key(key))


def _explained(path, entry, root) -> Iterator[str]:
    yield path + (f" (of {', '.join(entry.kinds)})" if entry.kinds else "")
    yield f"  {plain(entry.schema['description'])}"
    yield from (f"  {name + ':':9}{words}" for name, words in facts(entry).items() if words)
    for block in blocks_in(entry.schema, root):
        kind = " or ".join(kinds_of(block))
        yield ""
        yield f"  {f'kind {kind}' if kind else 'keys'}: {plain(block['description'].splitlines()[0])}"
        names = [name for name in names_in(block) if name not in KIND_KEYS or not kind]
        rows = [(name, _default(inner), inner) for name in names for inner in entries(name, [block])]
        wide, deep = (max((len(row[column]) for row in rows), default=0) for column in (0, 1))
        yield from (
            f"    {name:{wide}} {default:{deep}} {plain(inner.schema['description'])}" for name, default, inner in rows
        )


def facts(entry: Entry) -> dict[str, str]:
    """What a key may be, its unit, default and example, in words; empty where there is none."""
    return {
        "value": in_words(entry.schema),
        "unit": entry.schema.get("x-unit", ""),
        "default": _default(entry) if entry.required or "default" in entry.schema else "",
        "example": ", ".join(map(_value, entry.schema.get("examples", ()))),
    }


def plain(text: str) -> str:
    """A description as one line without markup."""
    return " ".join(text.replace("``", "").split())


def _default(entry: Entry) -> str:
    if entry.required:
        return "required"
    value = entry.schema.get("default")
    blocks = isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict) for item in value))
    return "absent" if value is None else "none" if value in ([], {}) else "see its keys" if blocks else _value(value)


def _value(value) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def in_words(schema: dict, several: bool = False) -> str:
    """What a value may be, or several, with its bounds."""
    choices = [*schema.get("anyOf", ()), *schema.get("oneOf", ())]
    if choices:
        return " or ".join(dict.fromkeys(filter(None, (in_words(choice, several) for choice in choices))))
    if "enum" in schema or "const" in schema:
        return " or ".join(map(str, schema.get("enum", [schema.get("const")])))
    lists = "lists" if several else "list"
    if "prefixItems" in schema:
        items = schema["prefixItems"]
        if len(set(map(in_words, items))) == 1:
            return f"{lists} of {len(items)} {in_words(items[0], several=True)}"
        return f"{lists} of {len(items)}: {', '.join(map(in_words, items))}"
    if schema.get("type") == "array":
        return f"{lists} of {in_words(schema['items'], several=True)}"
    if "pattern" in schema:
        return FORMS[schema["pattern"]]
    words = {
        "number": "number",
        "integer": "whole number",
        "string": "text",
        "boolean": "true or false",
        "null": "",
        "object": "blocks by name",
    }.get(schema.get("type", ""), "block")
    return words + "s" * (several and words in ("number", "whole number", "text", "block")) + _bounds(schema)


def _bounds(schema: dict) -> str:
    if {"minimum", "maximum"} <= schema.keys():
        return f" from {_bound(schema['minimum'])} to {_bound(schema['maximum'])}"
    names = {"minimum": "at least", "exclusiveMinimum": "above", "maximum": "at most", "exclusiveMaximum": "below"}
    found = [f"{word} {_bound(schema[name])}" for name, word in names.items() if name in schema]
    return f" {' and '.join(found)}" if found else ""


def _bound(value: float) -> str:
    """A number without rounding it."""
    return f"{value:g}" if float(f"{value:g}") == value else str(value)
