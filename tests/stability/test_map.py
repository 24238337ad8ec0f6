"""The stability map: every entry names a test that there is, and the page says what was measured."""

import json
import math
import re
from pathlib import Path

import pytest

from benchmarks.stability.__main__ import GROUPS, sweeps
from benchmarks.stability.entry import record_of, sweep_of, words
from benchmarks.stability.page import write_page

ROOT = Path(__file__).parents[2]
RESULTS = json.loads((ROOT / "benchmarks" / "results" / "stability.json").read_text())
MEASURED = ([1.0, 2.0, 3.0], {"path": [1e-3, 2e-3, math.nan]})
SAID = {
    "title": "a sweep",
    "method": "path",
    "parameter": "x [m]",
    "measure": "Relative error.",
    "limit": "1 .. 2 m",
    "fails": "everything | all",
    "program": "refuses",
    "test": "tests/stability/test_map.py::test_x",
    "holds": (None, 2.0),
}


@pytest.mark.parametrize("key", RESULTS)
def test_every_entry_is_guarded_by_a_test_that_there_is(key):
    file, name = sweep_of(key, RESULTS[key], words()[key]).test.split("::")
    assert re.search(rf"^def {re.escape(name.partition('[')[0])}\(", (ROOT / file).read_text(), re.MULTILINE)


def test_the_map_speaks_of_every_sweep_and_of_nothing_that_was_not_measured():
    """Sweeps that are settled have no script any more; their records stay."""
    assert set(sweeps()) <= set(words()) == set(RESULTS)
    assert {key: said["values"] for key, said in words().items()} == {key: r["values"] for key, r in RESULTS.items()}
    assert {record["group"] for record in RESULTS.values()} == set(GROUPS)
    for key, (group, _) in sweeps().items():
        assert RESULTS[key]["group"] == group


def test_a_sweep_survives_its_record():
    record = json.loads(json.dumps(record_of(MEASURED) | {"group": "g"}))
    again = sweep_of("sweep", record, SAID)
    assert math.isnan(again.errors["path"].pop())
    assert again.errors == {"path": [1e-3, 2e-3]}
    assert again.holds == (None, 2.0)


@pytest.mark.parametrize(
    ("values", "changes", "message"),
    [([1.0], {}, "error for each"), (MEASURED[0], {"test": "a test"}, "node")],
)
def test_a_sweep_that_makes_no_sense_is_none(values, changes, message):
    with pytest.raises(ValueError, match=message):
        sweep_of("sweep", record_of((values, MEASURED[1])), SAID | changes)


def test_the_page_has_the_boundary_the_worst_error_within_and_a_figure(tmp_path):
    record = record_of(MEASURED) | {"group": "water", "commit": "abc", "machine": "a machine", "seconds": 3.0}
    results = {"sweep": record, "other": record | {"group": "gone"}}
    write_page(results, {"sweep": SAID}, {"water": "Water"}, tmp_path / "stability.md")
    page = (tmp_path / "stability.md").read_text()
    assert "| path | x [m] | 1 .. 2 m | everything \\| all | refuses |" in page
    assert "[x](../tests/stability/test_map.py)" in page
    assert "Largest within the boundary: path 2.0e-03." in page
    assert "gone" not in page
    assert (tmp_path / "images" / "stability_water.png").stat().st_size > 1000
