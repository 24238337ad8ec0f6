"""True, false, yes and off of YAML where numbers belong."""

import pytest
from pydantic import ValidationError

from varos_warp.errors import InputError
from varos_warp.scene.block import Block, _types_in
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.file.schema import json_schema


def blocks(block=Block):
    return {block, *(inner for child in block.__subclasses__() for inner in blocks(child))}


def numbers():
    """Every block and key whose value may be a number, of scene files and noise profiles."""
    assert json_schema(Scene)  # all are imported
    for block in sorted(blocks(), key=lambda block: block.__qualname__):
        for name, field in block.model_fields.items():
            kinds = {*_types_in(field.annotation)}
            if kinds & {int, float} and block.__module__.startswith("varos_warp."):
                yield pytest.param(block, field.alias or name, id=f"{block.__name__}.{name}")


@pytest.mark.parametrize("value", [True, False])
@pytest.mark.parametrize(("block", "key"), list(numbers()))
def test_no_number_is_read_of_a_truth_value(block, key, value):
    with pytest.raises(ValidationError) as caught:
        block.model_validate({key: value})
    assert [key] in [[*error["loc"]] for error in caught.value.errors() if error["input"] is value]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (
            "vehicle: {cameras: [{exposure: {time_s: true}}]}",
            "vehicle.cameras.0.exposure.time_s = True: should be a num",
        ),
        ("gravity: on", "gravity = True: should be a number above 0 and at most 1000. Give a number."),
        ("render: {spp: no}", "render.spp = False: should be a number from 0.25 to 16777216. Give a number."),
        ("objects: [{kind: bolt, size: M24, position: [0, 0, yes]}]", "objects.0.position.2 = True: should be a num"),
        ("water: {coefficients: {sigma_s: [[true]], sigma_a: [0, 0, 0]}}", "sigma_s.0.0 = True"),
    ],
)
def test_the_message_names_file_line_key_and_remedy(line, words, tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(f"trajectory: {{poses: [{{position: [0, 0, 0]}}]}}\n{line}\n")
    with pytest.raises(InputError) as caught:
        load_scene(file)
    assert f"{file}:2: " in str(caught.value)
    assert words in str(caught.value)


def test_keys_that_are_true_or_false_take_both(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text("trajectory: {poses: [{position: [0, 0, 0]}]}\nrender: {linear_exr: yes, depth_exr: off}\n")
    render = load_scene(file).render
    assert (render.linear_exr, render.depth_exr) == (True, False)
