"""What a further water costs is told beside what its A costs alone, and nothing of either is left behind."""

import json
import os

from benchmarks import sweep_cost


def test_costs_of_sweeps_are_told_beside_those_of_a(tmp_path, monkeypatch, capsys):
    """Times of all parts are those of work that was done: each has a clock and cores, and more waters take more."""
    made, kept = [], tmp_path / "cost.json"
    monkeypatch.setenv("VAROS_WARP_CACHE", "elsewhere")
    monkeypatch.setattr(sweep_cost, "produce_sharing", seen(sweep_cost.produce_sharing, made))
    few = ["--template", "calibration_camera", "--resolution", "16x9", "--frames", "2", "--spp", "1", "--repeats", "1"]
    sweep_cost.main([*few, "--integrator", "path", "--waters", "IB,II,1C", "-o", str(kept)])
    result = json.loads(kept.read_text())
    assert [letters for letters, _ in made] == [["C", "D", "S"], ["A", "C", "D", "S"]] * 3
    assert [rendered for _, rendered in made] == [6, 2] * 3  # A alone, where the rest is
    (row,) = result["repeats"]
    for count in ("2_waters", "3_waters"):
        assert all(value > 0.0 for value in row[count]["a_alone_s"])
        assert row[count]["over_a"] == result[f"over_a_{count}"]
    assert row["3_waters"]["a_alone_s"][0] > row["2_waters"]["a_alone_s"][0]
    assert os.environ["VAROS_WARP_CACHE"] == "elsewhere"
    capsys.readouterr()


def seen(produce, made: list):
    """As ``produce``; notes what was asked for and how many images were rendered."""

    def noted(scene, *args, **how):
        summary = produce(scene, *args, **how)
        made.append((scene.render.outputs, summary.rendered))
        return summary

    return noted
