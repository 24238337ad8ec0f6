"""What holds scenes by wavelength against three channels, and tells their cost, runs and tells what it should."""

import json

from benchmarks import spectral_cost, spectral_scenes


def test_passes_are_triples_by_hand(tmp_path, monkeypatch, capsys):
    """And a lamp of the wrong power would be seen."""
    monkeypatch.setattr(spectral_scenes, "RESOLUTION", (24, 16))
    kept = tmp_path / "scenes.json"
    common = ["--scenes", "open", "--seeds", "8", "--spp", "4", "--json", str(kept)]
    spectral_scenes.main([*common, "--most", "9"])
    (row,) = json.loads(kept.read_text())["rows"]
    assert abs(row["weaving"]["block_z"]) < 5.0
    assert 0.3 < row["bars"]["z_pooled"] < 3.0
    off, stated = (row["reduction"][key] for key in ("mean_percent", "stated_worst"))
    assert all(abs(a) < b + 1.0 for a, b in zip(off, stated, strict=True))
    shining = spectral_scenes._shining

    def brighter(light, nm):
        made = shining(light, nm)
        return made | {"intensity": [1.2 * value for value in made["intensity"]]}

    monkeypatch.setattr(spectral_scenes, "_shining", brighter)
    spectral_scenes.main([*common, "--most", "0"])
    (row,) = json.loads(kept.read_text())["rows"]
    assert abs(row["weaving"]["block_z"]) > 5.0
    capsys.readouterr()


def test_costs_are_told_as_ratios(tmp_path, capsys):
    kept = tmp_path / "cost.json"
    spectral_cost.main(
        [
            "--templates",
            "static_observer",
            "--resolution",
            "16x9",
            "--repeats",
            "1",
            "--spp",
            "1",
            "--integrator",
            "path",
            "--outputs",
            "A",
            "--bands",
            "4",
            "-o",
            str(kept),
        ]
    )
    (row,) = json.loads(kept.read_text())["rows"]
    assert row["4_bands"]["passes"] == 2
    assert row["4_bands"]["over_rgb"] > 0.0
    capsys.readouterr()
