"""Phase functions in scene files: every kind, the defaults, and what is refused before any file is opened."""

import json

import numpy as np
import pytest
from pydantic import TypeAdapter

import varos_warp as vw
from varos_warp.errors import InputError
from varos_warp.scene.description import water as description
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.registry import PHASE_FUNCTIONS

SCENE = """\
water: {form}
trajectory: {{poses: [{{position: [0, 0, 0]}}]}}
"""
COEFFICIENTS = "{{coefficients: {{sigma_s: [0.2, 0.2, 0.2], sigma_a: [0.1, 0.1, 0.1], phase: {phase}}}}}"
TABLE = "angle_deg,p\n0.1,5\n10,1\n180,0.1\n"

EVERY_KIND = [
    "{g: 0.8}",
    "{}",
    "{kind: henyey_greenstein, g: 0.8}",
    "{kind: fournier_forand, n: 1.10, mu: 3.5835}",
    "{kind: fournier_forand, backscatter_fraction: 0.0183}",
    "{kind: petzold}",
    "{kind: rayleigh}",
    "{kind: tabulated, file: vsf.csv}",
    "{kind: mixture, of: [{weight: 0.98, kind: fournier_forand, backscatter_fraction: 0.01}, "
    "{weight: 0.02, kind: rayleigh}, {weight: 0.5, g: 0.9}, {weight: 1, kind: tabulated, file: vsf.csv}]}",
]


def load(tmp_path, phase=None, form=None):
    (tmp_path / "vsf.csv").write_text(TABLE)
    (tmp_path / "scene.yaml").write_text(SCENE.format(form=form or COEFFICIENTS.format(phase=phase)))
    return vw.load_scene(tmp_path / "scene.yaml")


def test_the_registry_has_the_kinds_of_the_scene_file():
    schema = TypeAdapter(description.Phase).json_schema()
    assert set(schema["discriminator"]["mapping"]) == set(PHASE_FUNCTIONS)


@pytest.mark.parametrize("text", EVERY_KIND)
def test_every_kind_is_made_normalised_and_keyed(tmp_path, text):
    scene = load(tmp_path, text)
    phase = vw.phase_function(scene)
    assert phase.moments(0)[0] == pytest.approx(1.0)
    assert phase.mean_cosine == pytest.approx(phase.moments(1)[1])
    assert hash(phase.key) == hash(vw.phase_function(scene).key)
    assert json.loads(json.dumps([phase.key, phase.describe()]))
    assert phase.eval(np.array([1.0, -1.0])).shape == (2,)
    assert np.isfinite(phase.eval(1.0))
    assert phase.sample(np.array([0.0, 1.0])) == pytest.approx([-1.0, 1.0])


def test_a_block_without_a_kind_is_henyey_and_greenstein(tmp_path):
    assert vw.phase_function(load(tmp_path, "{g: 0.8}")).key == ("henyey_greenstein", 0.8)
    assert vw.phase_function(load(tmp_path, form="none")).key == ("henyey_greenstein", 0.0)


def test_a_jerlov_type_scatters_as_fournier_and_forand_unless_told(tmp_path):
    phase = vw.phase_function(load(tmp_path, form="{jerlov: {type: 1C}}"))
    assert phase.kind == "fournier_forand"
    assert phase.backscatter_fraction == pytest.approx(0.0183)
    told = vw.phase_function(load(tmp_path, form="{jerlov: {type: 1C, phase: {g: 0.924}}}"))
    assert isinstance(told, HenyeyGreenstein)
    mixed = "{jerlov: {type: IC, phase: {kind: mixture, of: [{weight: 1, kind: petzold}]}}}"
    assert isinstance(vw.phase_function(load(tmp_path, form=mixed)), Mixture)


PHASE = "water.coefficients.phase"


@pytest.mark.parametrize(
    ("text", "key", "says"),
    [
        ("{g: 1.0}", f"{PHASE}.g", "at most 0.999"),
        ("{g: -1}", f"{PHASE}.g", "at least -0.99"),
        ("{kind: petzolt}", PHASE, "Did you mean 'petzold'?"),
        ("{kind: rayleigh, g: 0.1}", f"{PHASE}.g", "unknown key"),
        ("{kind: fournier_forand}", PHASE, "give either n and mu"),
        ("{kind: fournier_forand, n: 1.1}", PHASE, "give either n and mu"),
        ("{kind: fournier_forand, n: 1.1, mu: 3.5, backscatter_fraction: 0.1}", PHASE, "give either n and mu"),
        ("{kind: fournier_forand, n: 1.1, mu: 2.9}", f"{PHASE}.mu", "above 3"),
        ("{kind: fournier_forand, n: 1.1, mu: 5.1}", f"{PHASE}.mu", "at most 5"),
        ("{kind: fournier_forand, n: 1.0, mu: 3.5}", f"{PHASE}.n", "above 1"),
        ("{kind: fournier_forand, n: 1.6, mu: 3.5}", f"{PHASE}.n", "at most 1.5"),
        ("{kind: fournier_forand, backscatter_fraction: 0.16}", f"{PHASE}.backscatter_fraction", "at most 0.15"),
        ("{kind: fournier_forand, backscatter_fraction: 0.00009}", f"{PHASE}.backscatter_fraction", "at least 0.0001"),
        ("{kind: tabulated}", f"{PHASE}.file", "is missing"),
        ("{kind: mixture}", f"{PHASE}.of", "is missing"),
        ("{kind: mixture, of: []}", f"{PHASE}.of", "at least 1"),
        ("{kind: mixture, of: [{weight: 0, kind: petzold}]}", PHASE, "sum to 0"),
        ("{kind: mixture, of: [{weight: -1, kind: petzold}]}", f"{PHASE}.of.0.weight", "at least 0"),
        ("{kind: mixture, of: [{kind: petzold}]}", f"{PHASE}.of.0.weight", "is missing"),
        ("{kind: mixture, of: [{weight: 1, kind: mixture}]}", f"{PHASE}.of.0", "unknown kind 'mixture'"),
        ("{kind: mixture, of: [{weight: 1, g: -0.7}]}", f"{PHASE}.of.0.g", "at least -0.6"),
    ],
)
def test_bad_input_is_named_with_file_line_key_and_remedy(tmp_path, text, key, says):
    with pytest.raises(InputError) as caught:
        load(tmp_path, text)
    error = caught.value
    assert (error.file.name, error.line, error.key) == ("scene.yaml", 1, key)
    assert says in error.message
    assert "\n" not in error.message


def test_a_missing_table_within_a_mixture_is_named_by_its_place(tmp_path):
    parts = "[{weight: 1, kind: petzold}, {weight: 1, kind: tabulated, file: x.csv}]"
    scene = load(tmp_path, f"{{kind: mixture, of: {parts}}}")
    with pytest.raises(InputError, match=r"x\.csv: water\.coefficients\.phase\.of\.1\.file: there is no such table"):
        vw.phase_function(scene)
