"""docs/benchmarks.md is the front page of all that can be run here."""

from pathlib import Path

import pytest

from benchmarks.__main__ import commands

PAGE = (Path(__file__).parents[2] / "docs" / "benchmarks.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", commands())
def test_every_benchmark_is_on_the_front_page_and_says_what_it_measures(name):
    rows = [line for line in PAGE.splitlines() if line.startswith("| `python -m benchmarks")]
    assert any(f"{name}`" in row.split("|")[1] for row in rows)
    assert commands()[name].endswith((".", "?", "`."))
