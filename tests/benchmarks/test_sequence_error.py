"""Frames of a planned sequence are measured and written."""

import json
import sys

from benchmarks import by_frame


def test_frames_of_a_short_sequence_are_measured_and_charted(boulder, tmp_path, monkeypatch):
    monkeypatch.setattr(
        sys,
        "argv",
        [
            "by_frame",
            "--scene",
            str(boulder),
            "--device",
            "cpu",
            "--frames",
            "2",
            "--set",
            "render.tolerance=0.1",
            "-o",
            str(tmp_path / "out"),
        ],
    )
    by_frame.main()
    result = json.loads((tmp_path / "out.json").read_text())
    assert len(result["checked"]) == 2
    assert all(0.02 < row["error"] < 0.2 for row in result["checked"])  # 0.1 is asked; so few pixels vary
    assert (tmp_path / "out.png").stat().st_size > 0
