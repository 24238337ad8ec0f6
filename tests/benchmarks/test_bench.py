"""The verb `varos-warp bench`."""

import sys

from typer.testing import CliRunner

from benchmarks import bench
from varos_warp.cli import app


def run(*arguments):
    return CliRunner().invoke(app, ["bench", *arguments])


def test_outside_of_a_checkout_it_says_where_to_run_it(monkeypatch):
    for name in [name for name in sys.modules if name.split(".")[0] == "benchmarks"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "benchmarks", None)
    result = run("ref1")
    assert result.exit_code == 2
    assert "checkout" in result.output


def test_bad_names_are_one_message(tmp_path):
    for arguments in (["nowhere"], ["--methods", "magic"], ["--outputs", "B"], ["--seconds", "-1"]):
        result = run(*arguments, "-o", str(tmp_path))
        assert result.exit_code == 2, result.output
        assert "varos-warp: " in result.output
        assert not list(tmp_path.iterdir())


def test_the_options_reach_the_benchmark(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(bench, "run", lambda *arguments: seen.append(arguments) or {"machine": {}})
    result = run("ref1", "demo", "--methods", "path, field", "--outputs", "A,sensors", "--device", "cpu", "--quick",
                 "--seconds", "7", "-o", str(tmp_path), "--json", "--quiet")
    assert result.exit_code == 0, result.output
    assert seen == [(["ref1", "demo"], ["path", "field"], ["A", "sensors"], "cpu", True, 7.0, tmp_path, True)]
