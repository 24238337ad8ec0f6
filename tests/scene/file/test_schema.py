"""The JSON Schema tells of every key what it means, in which unit, and within which bounds; one key in plain words."""

import json
import re
from itertools import chain

import pytest

from varos_warp.errors import InputError
from varos_warp.scene import plain_yaml
from varos_warp.scene.file.schema import FORMS, UNITS, explain, find_key, json_schema, keys_like, unit_of
from varos_warp.scene.file.templates import TEMPLATES, template_text

SCHEMA = json_schema()
BLOCKS = {"Scene": SCHEMA, **SCHEMA["$defs"]}
KEYS = [
    (f"{name}.{key}", entry, key in block.get("required", ()))
    for name, block in BLOCKS.items()
    for key, entry in block.get("properties", {}).items()
]
SUFFIXES = {
    "_m": "m",
    "_mm": "mm",
    "_s": "s",
    "_hz": "Hz",
    "_kg": "kg",
    "_deg": "degrees",
    "_C": "degrees Celsius",
    "_T": "T",
}
"""Of names of keys; ``sigma_s`` is a symbol."""


def test_every_block_and_key_is_described():
    assert {"terrain", "objects", "materials", "water", "vehicle", "trajectory", "render"} <= set(SCHEMA["properties"])
    assert [name for name, block in BLOCKS.items() if len(block.get("description", "")) < 10] == []
    assert [key for key, entry, _ in KEYS if len(entry.get("description", "")) < 10] == []


def test_what_stands_in_brackets_is_a_unit_that_the_schema_knows():
    """[a, b] names the parts of a list."""
    for key, entry, _ in KEYS:
        brackets = [text for text in re.findall(r"\[([^\]]+)\]", entry["description"]) if ", " not in text]
        assert set(brackets) <= UNITS, key
        assert entry.get("x-unit") == unit_of(entry["description"]), key


def test_a_key_whose_name_ends_in_a_unit_has_it():
    for key, entry, _ in KEYS:
        for suffix, unit in SUFFIXES.items():
            if key.endswith(suffix) and not key.endswith(("sigma_s", "_per_s", "_per_m", "_m_s")):
                assert entry.get("x-unit", "none").split("/")[0] == unit, key


def is_block(entry) -> bool:
    return "$defs" in json.dumps(entry)


def test_what_has_no_default_value_has_an_example():
    """Blocks and choices aside: the keys of a block, and the choices, say what to write."""
    without = [
        key
        for key, entry, required in KEYS
        if (required or entry.get("default", 0) is None)
        and "examples" not in entry
        and not is_block(entry)
        and not re.search(r'"(const|enum|deprecated|boolean)"', json.dumps(entry))
    ]
    assert without == []


def test_examples_are_values_that_the_key_accepts():
    """By the bounds of the schema, as far as they go: types and ranges of numbers and lists."""
    for key, entry, _ in KEYS:
        for example in entry.get("examples", ()):
            assert fits(example, entry), (key, example)


def test_keys_of_older_files_are_valid_but_not_offered():
    assert fits({"trajectory": {}, "render": {"level_of_detail": None}}, SCHEMA)
    assert "level_of_detail" not in explain("render")
    assert keys_like("render.lev") == []


def test_the_form_of_every_text_has_words():
    entries = [json.dumps(entry) for _, entry, _ in KEYS]
    assert {json.loads(text) for entry in entries for text in re.findall(r'"pattern": ("[^"]*")', entry)} == set(FORMS)
    assert "value:   two letters or digits" in explain("vehicle.cameras.id")


# ---------------------------------------------------------------------------------------- what an editor would mark


def fits(value, schema) -> bool:
    """Whether a value is valid by the part of JSON Schema that this schema uses."""
    if "$ref" in schema:
        return fits(value, SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]])
    if any(word in schema for word in ("anyOf", "oneOf")):
        count = sum(fits(value, part) for part in chain(schema.get("anyOf", ()), schema.get("oneOf", ())))
        return count == 1 if "oneOf" in schema else count >= 1
    if "const" in schema or "enum" in schema:
        return value in schema.get("enum", [schema.get("const")])
    types = {
        "number": (int, float),
        "integer": int,
        "string": str,
        "boolean": bool,
        "null": type(None),
        "array": list,
        "object": dict,
    }
    if not isinstance(value, types[schema["type"]]) if "type" in schema else False:
        return False
    if isinstance(value, dict):
        return object_fits(value, schema)
    if isinstance(value, list):
        items = schema.get("prefixItems") or [schema.get("items", {})] * len(value)
        sizes = schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value))
        return sizes and all(map(fits, value, items))
    if isinstance(value, str):
        return re.search(schema.get("pattern", ""), value) is not None
    return value is None or (
        schema.get("minimum", value) <= value <= schema.get("maximum", value)
        and not value <= schema.get("exclusiveMinimum", value - 1)
        and not value >= schema.get("exclusiveMaximum", value + 1)
    )


def object_fits(value, schema) -> bool:
    known, others = schema.get("properties", {}), schema.get("additionalProperties", False)
    return set(schema.get("required", ())) <= set(value) and all(
        fits(item, known[key]) if key in known else isinstance(others, dict) and fits(item, others)
        for key, item in value.items()
    )


@pytest.mark.parametrize("name", TEMPLATES)
def test_an_editor_finds_no_fault_in_a_template_and_some_in_a_wrong_one(name):
    data = plain_yaml.parse(template_text(name))  # as YAML 1.2, by which editors read: `on` is a name, not a truth
    assert fits(data, SCHEMA)
    assert not fits(data | {"nmae": "x"}, SCHEMA)
    assert not fits(data | {"render": {"spp": 0}}, SCHEMA)


# -------------------------------------------------------------------------------------------------------- one key


def test_a_key_is_explained_by_meaning_range_unit_default_and_example():
    text = explain("vehicle.cameras.focus_m")
    for words in ("plane of focus", "number from 0.001 to 1e+09", "unit:    m", "default: 3.0"):
        assert words in text
    assert "example: 0.06" in explain("vehicle.cameras.port.radius_m")


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("vehicle.cameras.position", "list of 3 numbers from -1e+09 to 1e+09"),
        ("scatter.circle", "list of 3: number, number, number above 0"),
        ("scatter.polygon", "list of lists of 2 numbers"),
        ("vehicle.lights", "list of blocks"),
        ("seed", "whole number at least 0 and below 2147483648"),
        ("terrain.file", "text or list of texts"),
    ],
)
def test_what_a_key_may_be_is_told_as_people_say_it(key, words):
    assert f"value:   {words}\n" in explain(key)


def test_a_block_is_explained_by_its_kinds_and_their_keys():
    text = explain("vehicle.cameras.0.port")
    for words in (
        "kind flat: A flat pane",
        "    distance_m     required        Distance from the lens",
        "    clear_radius_m absent          Radius",
        "kind dome:",
        "half_angle_deg",
    ):
        assert words in text
    assert text == explain("vehicle.cameras.port").replace("cameras.port", "cameras.0.port")


def test_kinds_that_differ_are_told_apart_and_may_be_named():
    assert [entry.kinds for entry in find_key("vehicle.lights.direction")] == [("spot", "profile"), ("sheet",)]
    assert len(find_key("vehicle.lights.sheet.direction")) == 1
    assert "Wall thickness" in explain("objects.pipe.wall")
    assert "bend_radius" in explain("objects.elbow")
    assert "bend_radius" not in explain("objects.pipe")


def test_names_of_materials_may_be_given_or_left_out():
    assert explain("materials.amount").count("default: 0.5") == 2
    assert explain("materials.my_paint.amount").count("default: 0.5") == 2


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("vehicle.camera.port", "Did you mean 'cameras'?"),
        ("vehicle.cameras.focus", "Did you mean 'focus_m'?"),
        ("seed.x", "nothing is under it"),
        ("vehicle.", "Known there: id"),
        ("", "Known there: name"),
        ("materials.a.b.c", "Known there: kind, reflectance"),
    ],
)
def test_an_unknown_key_is_refused_with_what_is_near(key, says):
    with pytest.raises(InputError, match=re.escape(says)):
        explain(key)


def test_every_key_can_be_explained():
    """By its path from the scene, through every kind of block."""

    def walk(prefix, block, seen):
        for key, entry in block.get("properties", {}).items():
            path = f"{prefix}{key}"
            assert " ".join(entry["description"].replace("``", "").split()) in explain(path)
            for name in set(re.findall(r"#/\$defs/(\w+)", json.dumps(entry))) - seen:
                walk(f"{path}.", SCHEMA["$defs"][name], seen | {name})

    for key in ("vehicle", "water", "render", "trajectory"):
        name = re.search(r"#/\$defs/(\w+)", json.dumps(SCHEMA["properties"][key]))[1]
        walk(f"{key}.", SCHEMA["$defs"][name], {name})


def test_the_choosing_key_of_a_block_says_what_the_block_is():
    spot = SCHEMA["$defs"]["SpotLight"]["properties"]["kind"]
    assert spot["description"].startswith("Tells what this is. A spot light")
    brown_conrady = SCHEMA["$defs"]["BrownConrady"]["properties"]["model"]
    assert brown_conrady["description"].startswith("Tells what this is. Distortion of a lens")


def test_bounds_are_those_of_json_schema():
    """Behind a validator they would be words that no editor knows, and no bounds."""

    def keys(node):
        if isinstance(node, dict):
            yield from node
            node = node.values()
        if isinstance(node, (list, type({}.values()))):
            for part in node:
                yield from keys(part)

    assert not {"ge", "le", "gt", "lt"} & {*keys(SCHEMA)}
