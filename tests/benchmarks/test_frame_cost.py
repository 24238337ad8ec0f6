"""The cost of a frame is counted by kernel, and its errors are those of images."""

import json
import sys

from benchmarks import frame_cost


def test_kernels_have_the_names_of_their_functions():
    for timed, name in (
        ("forward kernel make_reflect_kernel__locals__reflect_light_8ec351db(...)", "reflect_light"),
        ("forward kernel develop_20e2adba", "develop"),
        ("memcpy DtoH", "memcpy DtoH"),
        ("forward kernel trace_rays", "trace_rays"),
    ):
        assert frame_cost.kernel_name(timed) == name


def test_costs_and_errors_are_written(boulder, tmp_path, monkeypatch):
    """On a CPU, which has no times of kernels; more samples leave less."""
    out = tmp_path / "cost.json"
    monkeypatch.setattr(
        sys,
        "argv",
        [
            "frame_cost",
            "--scene",
            str(boulder),
            "--device",
            "cpu",
            "--frames",
            "1",
            "--spp",
            "1,8",
            "--spp-b",
            "1,8",
            "--estimate-spp",
            "32",
            "-o",
            str(out),
        ],
    )
    frame_cost.main()
    result = json.loads(out.read_text())
    assert [row["outputs"] for row in result["cost"]] == ["A", "A", "B", "B", "CDS"]
    assert all(row["ms"] > 0.0 for row in result["cost"])
    for letter in "AB":
        few, many = (max(row["error"]) for row in result["errors"] if row["output"] == letter)
        assert many < few
