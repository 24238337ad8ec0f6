"""What files and options ask for as versions, and what is refused before anything is made, by file and key."""

import math
import re
from pathlib import Path

import pytest

from varos_warp.dataset.sweep.draws import Distribution
from varos_warp.dataset.sweep.versions import MOST, read_versions
from varos_warp.errors import InputError
from varos_warp.scene.file.load import load_scene

ROOT = Path(__file__).parents[3]


@pytest.fixture
def of(tmp_path):
    """Versions that a file of this text asks for."""

    def read(text):
        path = tmp_path / "waters.yaml"
        path.write_text(text)
        return read_versions([str(path)])

    return read


def overrides(versions):
    return {version.name: version.overrides for version in versions}


def test_versions_have_keys_with_dots_or_blocks_alike(of):
    found = of(
        "versions:\n"
        "  IB: {water.jerlov.type: IB}\n"
        "  '3C':\n    water: {jerlov: {type: 3C}}\n    vehicle: {lights: {0: {intensity: [1, 2, 3]}}}\n"
        "  none: {water: none, particles: []}\n"
        "  as_it_is:\n"
    )
    assert overrides(found) == {
        "IB": {"water.jerlov.type": "IB"},
        "3C": {"water.jerlov.type": "3C", "vehicle.lights.0.intensity": [1, 2, 3]},
        "none": {"water": "none", "particles": []},
        "as_it_is": {},
    }
    assert [change.where.rpartition(":")[2] for version in found for change in version.changes] == list("24566")


def test_options_give_every_combination_and_name_them_by_values():
    found = read_versions(["water.jerlov.type=IB,3C", "render.spp=1,2.5,-0.5"])
    assert [version.name for version in found] == ["IB-1", "IB-2.5", "IB-minus0.5", "3C-1", "3C-2.5", "3C-minus0.5"]
    assert found[4].overrides == {"water.jerlov.type": "3C", "render.spp": 2.5}


def test_blocks_and_lists_are_values_too_and_are_named_by_their_number():
    found = read_versions(["water={jerlov: {type: IB}},none,{coefficients: {sigma_s: [0, 0, 0], sigma_a: [1, 2, 3]}}"])
    assert overrides(found) == {
        "0": {"water.jerlov.type": "IB"},
        "none": {"water": "none"},
        "2": {"water.coefficients.sigma_s": [0, 0, 0], "water.coefficients.sigma_a": [1, 2, 3]},
    }


def test_values_may_be_longer_than_a_name_of_a_file():
    value = f"name={'a' * 30},{'b' * 300}"
    with pytest.raises(InputError, match="no name of a folder"):
        read_versions([value])
    lights = ", ".join(f"[{{kind: point, position: [{i}, 0, 0]}}]" for i in range(50))
    assert len(read_versions([f"vehicle.lights={lights}"])) == 50


def test_lists_in_a_file_are_as_options(of):
    found = of("over:\n  water.jerlov.type: [IB, II]\n  seed: [1, 2]\n")
    assert overrides(found) == overrides(read_versions(["water.jerlov.type=IB,II", "seed=1,2"]))


DRAWN = (
    "seed: {seed}\ncount: {count}\nover:\n  water.jerlov.type: {{choice: [IB, II, 3C]}}\n"
    "  render.spp: {{integer: [1, 4]}}\n  vehicle.mass_kg: {{normal: [40, 2]}}\n"
    "  vehicle.lights.0.blend: {{uniform: [0.2, 0.4]}}\n  particles.0.share: {{log_uniform: [1e-5, 1e-3]}}\n"
)


def test_draws_follow_from_the_seed_and_more_of_them_begin_with_the_same(of):
    few, many, others = (
        overrides(of(DRAWN.format(seed=seed, count=count))) for seed, count in ((1, 3), (1, 40), (2, 3))
    )
    assert [*many][:3] == ["0000", "0001", "0002"]
    assert {name: many[name] for name in few} == few
    assert not any(few[name] == others[name] for name in few)


def test_draws_of_a_key_do_not_depend_on_other_keys(of):
    alone = of("seed: 1\ncount: 3\nover:\n  vehicle.mass_kg: {normal: [40, 2]}\n")
    both = overrides(of(DRAWN.format(seed=1, count=3)))
    assert all(both[version.name]["vehicle.mass_kg"] == version.overrides["vehicle.mass_kg"] for version in alone)


@pytest.mark.parametrize(
    ("given", "mean", "variance"),
    [
        ({"uniform": [2.0, 5.0]}, 3.5, 9.0 / 12.0),
        ({"normal": [40.0, 2.0]}, 40.0, 4.0),
        ({"integer": [1, 6]}, 3.5, 35.0 / 12.0),
        ({"choice": [0.0, 1.0]}, 0.5, 0.25),
        ({"log_uniform": [0.01, 1.0]}, None, None),
    ],
)
def test_draws_have_mean_and_variance_of_what_they_are_drawn_from(given, mean, variance):
    """Within five standard errors of 4000 draws; of a logarithm it is the uniform one's."""
    drawn = [Distribution(**given).draw(7, "a.key", i) for i in range(4000)]
    if mean is None:
        drawn, mean, variance = [math.log10(x) for x in drawn], -1.0, 4.0 / 12.0
    found = sum(drawn) / len(drawn)
    assert abs(found - mean) < 5.0 * math.sqrt(variance / len(drawn))
    fourth = 3.0 * variance**2  # of a normal one, the largest of these
    squares = sum((x - found) ** 2 for x in drawn) / len(drawn)
    assert abs(squares - variance) < 5.0 * math.sqrt(fourth / len(drawn))


def test_whole_numbers_and_choices_are_all_drawn():
    assert {Distribution(integer=(1, 3)).draw(1, "k", i) for i in range(60)} == {1, 2, 3}
    assert {Distribution(choice=["a", "b"]).draw(1, "k", i) for i in range(60)} == {"a", "b"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("versions: {}", "versions: is empty"),
        ("over: {}", "over: is empty"),
        ("versions:\n  IB: {seed: 1}\n  IB: {seed: 2}\n", ":3: versions.IB: is given twice"),
        ("versions:\n  IB: {seed: 1}\n  ib: {seed: 2}\n", "upper and lower case"),
        ("versions:\n  a/b: {seed: 1}\n", "no name of a folder"),
        ("versions:\n  ..: {seed: 1}\n", "no name of a folder"),
        ("versions:\n  .hidden: {seed: 1}\n", "no name of a folder"),
        ("versions:\n  NUL: {seed: 1}\n", "no name of a folder"),
        ("versions:\n  sweep.json: {seed: 1}\n", "no name of a folder"),
        ("versions:\n  a.: {seed: 1}\n", "no name of a folder"),
        (f"versions:\n  {81 * 'a'}: {{}}\n", "no name of a folder"),
        ("versions:\n  12: {seed: 1}\n", ":2: versions.12: is read as a number"),
        ("versions:\n  a: [1]\n", "versions.a"),
        ("versions: [a]\n", "versions"),
        ("versions:\n  a: {seed: 1, 'seed': 2}\n", "is given twice"),
        (
            "versions:\n  a: {water: {jerlov: {type: I}}, water.jerlov.type: II}\n",
            "versions.a.water.jerlov.type: is given",
        ),
        (
            "versions:\n  a: {water: none, water.jerlov.type: IB}\n",
            "versions.a.water = 'none': has no effect beside water.jerlov.type, which takes its place",
        ),
        (
            "versions:\n  a: {water: {jerlov: {type: IB}, principled: {density: 1}}}\n",
            "versions.a.water.jerlov.type = 'IB': has no effect beside water.principled.density",
        ),
        ("versions:\n  a: {seed: 1}\nover: {seed: [1]}\n", "either versions or over"),
        ("seed: 1\n", "either versions or over"),
        ("waters:\n  a: {seed: 1}\n", "waters: unknown key"),
        ("over: {seed: []}\n", "over.seed: is empty"),
        ("over: {seed: [1, 2, 1]}\n", "seed = 1: is given twice"),
        ("over: {seed: 1}\n", "over.seed"),
        ("over: {render.spp: {gaussian: [1, 2]}}\n", "over.render.spp"),
        ("over: {a: {uniform: [1, 2]}}\ncount: 3\n", "seed is missing"),
        ("over: {a: {uniform: [1, 2]}}\nseed: 3\n", "count is missing"),
        ("over: {a: {uniform: [1, 2]}, b: [1]}\nseed: 3\ncount: 1\n", "lists and distributions"),
        ("over: {seed: [1]}\nseed: 3\n", "seed: is of distributions"),
        ("over: {a: {uniform: [2, 1]}}\nseed: 3\ncount: 1\n", "must be less"),
        ("over: {a: {log_uniform: [0, 1]}}\nseed: 3\ncount: 1\n", "log_uniform"),
        ("over: {a: {choice: []}}\nseed: 3\ncount: 1\n", "choice"),
        ("over: {a: {}}\nseed: 3\ncount: 1\n", "exactly one of"),
        ("over: {a: {uniform: [1, 2], normal: [0, 1]}}\nseed: 3\ncount: 1\n", "exactly one of"),
        (f"over: {{a: {[*range(101)]}, b: {[*range(101)]}}}\n", f"10201 versions, and {MOST}"),
        ("over: {a: {uniform: [1, 2]}}\nseed: 3\ncount: 0\n", "count"),
        ("versions: {a: {seed: 1\n", "not valid YAML"),
    ],
)
def test_a_file_that_does_not_say_what_a_sweep_is_is_refused(of, text, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        of(text)
    assert "waters.yaml" in caught.value.message


@pytest.mark.parametrize(
    ("over", "words"),
    [
        ([], "is missing"),
        (["no_such_file.yaml"], "no such"),
        (["seed="], "is not of the form"),
        (["=1,2"], "is not of the form"),
        (["seed=1,2", "seed=3"], "--over seed: is given twice"),
        (["seed=1,1"], "--over seed = 1: is given twice"),
        (["vehicle.mass_kg={normal: [40, 1]}"], "--over vehicle.mass_kg = {'normal': [40, 1]}: is a distribution"),
        (["seed={integer: [1, 9]},3"], "in a file, with a seed and a count"),
        (["water=none", "water.jerlov.type=IB"], "--over water = 'none': has no effect beside water.jerlov.type"),
        (["water.jerlov.type=IB", "water=none"], "--over water.jerlov.type = 'IB': has no effect beside water,"),
        (["water={jerlov: {type: IB}},none"] * 2, "is given twice"),
        (["vehicle.lights.0.blend=0.1,0.2", "vehicle.lights=[]"], "has no effect beside vehicle.lights"),
        (["seed=[1"], "is not of the form"),
        (["name=a b,a_b"], "name of two versions"),
        (["seed=1", "no_such_file.yaml"], "nothing else"),
    ],
)
def test_options_that_do_not_say_what_a_sweep_is_are_refused(over, words):
    with pytest.raises(InputError, match=re.escape(words)):
        read_versions(over)


def test_a_key_of_what_another_key_sets_may_be_set_beside_it_and_changes_no_other_version():
    lights = "vehicle.lights=[{kind: point, position: [0, 0, 0]}]"
    versions = read_versions([lights, "vehicle.lights.0.intensity=[1, 1, 1],[2, 2, 2]"])
    before = [str(version.overrides) for version in versions]
    starter = ROOT / "varos_warp/data/starter.yaml"
    scenes = [load_scene(starter, version.changes) for version in versions]
    assert [scene.vehicle.lights[0].intensity for scene in scenes] == [(1, 1, 1), (2, 2, 2)]
    assert [str(version.overrides) for version in versions] == before


def test_a_block_that_has_a_key_of_a_distribution_is_none():
    assert len(read_versions(["vehicle.cameras.0.port={normal: [0, 0, 1]}", "seed=1,2"])) == 2


@pytest.mark.parametrize("name", ["waters", "drawn"])
def test_examples_are_versions_of_the_starter(name):
    versions = read_versions([str(ROOT / f"examples/sweeps/{name}.yaml")])
    scenes = [load_scene(ROOT / "varos_warp/data/starter.yaml", version.changes) for version in versions]
    assert len({scene.model_dump_json() for scene in scenes}) == len(versions) == {"waters": 5, "drawn": 50}[name]
