"""The command line of the benchmarks."""

import pytest

from benchmarks import bench


@pytest.mark.parametrize(
    "arguments", [["nowhere"], ["--methods", "magic"], ["--seconds", "-1"], ["--device", "cuda:99"]]
)
def test_an_unknown_name_or_a_bad_value_is_one_message(tmp_path, capsys, arguments):
    assert bench.main([*arguments, "-o", str(tmp_path)]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1
    assert said[0].startswith("benchmarks.bench: ")
    assert not list(tmp_path.iterdir())


def test_the_options_reach_the_benchmark(monkeypatch, tmp_path, capsys):
    (tmp_path / "bench.json").touch()
    seen = []
    monkeypatch.setattr(bench, "run", lambda *arguments: seen.append(arguments))
    words = "ref1 demo --device cpu --quick --seconds 7 --methods".split()
    assert bench.main([*words, "path, field", "-o", str(tmp_path)]) == 0
    assert seen == [(["ref1", "demo"], ["path", "field"], "cpu", True, 7.0, tmp_path)]
    assert capsys.readouterr().out == f"{tmp_path}: bench.json\n"
