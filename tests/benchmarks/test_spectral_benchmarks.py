"""What tells the cost of water by wavelength runs and tells ratios."""

import json

from benchmarks import spectral_cost


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
