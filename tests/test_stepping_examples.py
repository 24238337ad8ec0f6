"""The examples of docs/stepping.md run, and their own checks hold; an environment passes gymnasium's checker."""

import runpy
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples" / "stepping"


@pytest.mark.parametrize("by", ["dvl", "depth"])
def test_a_vehicle_keeps_its_distance_from_a_wall(by, capsys):
    main = runpy.run_path(str(EXAMPLES / "keep_distance.py"))["main"]
    assert main(["--by", by, "--seconds", "12"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 12
    assert lines[-1].split()[0] == "12.0"


def test_a_vehicle_that_has_not_come_near_yet_is_no_success():
    main = runpy.run_path(str(EXAMPLES / "keep_distance.py"))["main"]
    assert main(["--seconds", "1"]) == 1
    assert main(["--seconds", "0"]) == 1


def test_the_environment_passes_the_checker_and_holds_its_place(capsys):
    pytest.importorskip("gymnasium")
    assert runpy.run_path(str(EXAMPLES / "gym_env.py"))["main"]() == 0
    assert "100 steps" in capsys.readouterr().out


def test_without_gymnasium_the_environment_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(SystemExit, match="pip install gymnasium"):
        runpy.run_path(str(EXAMPLES / "gym_env.py"))


def test_the_environment_has_at_most_80_lines():
    assert len((EXAMPLES / "gym_env.py").read_text(encoding="utf-8").splitlines()) <= 80
