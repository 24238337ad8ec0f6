"""The scaling benchmark counts what it says."""

import json

from standins import make_scene

from benchmarks import scaling


def test_efficiency_is_the_gain_over_one_worker_and_differing_bytes_are_told(tmp_path, monkeypatch):
    rates, calls = {0: 12.0, 1: 10.0, 2: 18.0, 4: 30.0}, []

    def measure(scene, frames, workers, device, out, step=1):
        calls.append((frames, workers))
        return {
            "workers": workers,
            "frames_per_s": rates[workers],
            "until_first_image_s": 8.0,
            "expose_and_checksums_s": 2.0,
            "stages": {},
            "checksums": f"{workers == 4}  A/000.png\nb  B/000.png\n",
        }

    monkeypatch.setattr(scaling, "measure", measure)
    kept = []
    result = scaling.scaling(make_scene(), 50, [0, 1, 2, 4], "cpu", tmp_path, 1, kept.append)
    assert calls == [(4, 4), (50, 0), (50, 1), (50, 2), (50, 4)]
    assert [row["efficiency"] for row in result["runs"]] == [None, 1.0, 0.9, 0.75]
    assert result["differ"] == ["A/000.png"]
    assert kept[-1] == result


def test_a_run_is_measured_by_its_log(tmp_path):
    from benchmarks.soak import small_scene

    scene = small_scene(6, (16, 9), integrator="path", max_scatterings=1, denoise="none", denoise_b="none")
    row = scaling.measure(scene, 6, 0, "cpu", tmp_path / "out")
    assert row["images"] == 24
    (log,) = (json.loads(path.read_text()) for path in (tmp_path / "out" / "log").glob("*.json"))
    assert 0 < row["frames_per_s"] <= 1.01 * 5 / sum(entry["seconds"] for entry in log["frames"][1:])
    assert row["spp"] > 0
    assert 0 <= row["until_first_image_s"] < row["seconds"] - 5 / row["frames_per_s"]
    assert len(row["checksums"].splitlines()) > 24
