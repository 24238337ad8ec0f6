"""What may be asked of a frame: unknown names and numbers too low are refused, the scene says what is absent."""

import ast
from pathlib import Path

import pytest

import varos_warp
from varos_warp.errors import InputError
from varos_warp.render.options import LAYERS, RenderOptions, options_of
from varos_warp.scene.description import Scene

SCENE = Scene(trajectory={"poses": [{"position": [0, 0, 0]}]}, render={"spp": 12, "spp_b": 5, "integrator": "path"})


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("layers", ()),
        ("layers", ("direct", "glow")),
        ("layers", "direct"),
        ("integrator", "bidirectional"),
        ("denoise", "blur"),
        ("denoise_b", "blur"),
        ("spp", 0),
        ("spp_b", -3),
        ("max_scatterings", -1),
        ("max_bounces", -1),
    ],
)
def test_unknown_names_and_numbers_too_low_are_bad_input_that_names_the_option(key, value):
    with pytest.raises(InputError, match=f"^{key} = "):
        RenderOptions(**{key: value})


def test_an_unknown_option_is_refused_and_those_that_are_there_are_named():
    with pytest.raises(TypeError, match=r"samples; there are: spp, spp_b,.* copied"):
        options_of(SCENE, {"spp": 3, "samples": 3})


def test_the_scene_says_what_is_absent():
    assert options_of(SCENE, {}) == RenderOptions(spp=12, spp_b=5, integrator="path", layers=list(LAYERS))
    given = {"spp": 3, "spp_b": 2, "integrator": "tables", "layers": LAYERS[:1], "max_bounces": 0}
    assert options_of(SCENE, given) == RenderOptions(**given)
    planned = SCENE.model_copy(update={"render": SCENE.render.model_copy(update={"spp": None})})
    assert options_of(planned, {}).spp == 64


def test_bounds_and_layers_of_the_scene_hold_unless_others_are_given():
    asked = {"max_scatterings": 0, "max_bounces": 2, "layers": ["direct"]}
    scene = SCENE.model_copy(update={"render": SCENE.render.model_copy(update=asked)})
    assert options_of(scene, {}) == RenderOptions(spp=12, spp_b=5, integrator="path", **asked)
    given = {"max_scatterings": 3, "max_bounces": 0, "layers": ("single",)}
    assert options_of(scene, given) == RenderOptions(spp=12, spp_b=5, integrator="path", **given)


def test_functions_of_the_renderer_have_at_most_ten_arguments():
    paths = (Path(varos_warp.__file__).parent / "render").rglob("*.py")
    nodes = [node for path in paths for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
    counts = [
        (len([*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]), node.name)
        for node in nodes
        if isinstance(node, ast.FunctionDef)
    ]
    assert max(counts) <= (10, "z"), max(counts)
