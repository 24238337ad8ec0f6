"""Frames of a planned sequence are judged and written."""

import json
import sys

from benchmarks import by_frame


def test_frames_of_a_short_sequence_are_judged_and_charted(tmp_path, monkeypatch):
    scene = tmp_path / "scene.yaml"
    scene.write_text("""
objects: [{kind: boulder, diameter: 2.0, seed: 1, position: [0, 2, 0]}]
vehicle: {lights: [{kind: spot, position: [0.2, 0, 0], cone_deg: 65}], cameras: [{resolution: [32, 18]}]}
trajectory: {poses: [{position: [0, -1, 1]}, {position: [0, -1, 1.1], time_s: 0.3}]}
render: {tolerance: 0.1}
""")
    monkeypatch.setattr(sys, "argv", ["by_frame", "--scene", str(scene), "--device", "cpu", "--frames", "2", "-o",
                                      str(tmp_path / "out")])
    by_frame.main()
    result = json.loads((tmp_path / "out.json").read_text())
    assert len(result["checked"]) == 2
    assert all(0.02 < row["error"] < 0.2 for row in result["checked"])  # 0.1 is asked; so few pixels vary
    assert (tmp_path / "out.png").stat().st_size > 0
