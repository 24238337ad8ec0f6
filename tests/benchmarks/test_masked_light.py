"""What a mask cuts looks as the same surface made of triangles does."""

import json

import pytest

from benchmarks.light import masked_light


@pytest.mark.parametrize("name", ["open", "painted"])
def test_textures_light_as_triangles_do(name, tmp_path):
    """Boards and boxes cut into strips, still, copied and moving; a floor in colours of textures and of vertices.

    With the same random numbers paths part only where an edge lies within rounding, 4e-6 m of strips 4 cm wide, of one
    of the hundred rays of a pixel.
    """
    kept = tmp_path / "masked.json"
    masked_light.main(
        [
            "--scenes",
            name,
            "--integrators",
            "path",
            "--seeds",
            "4",
            "--spp",
            "2",
            "--resolution",
            "48x32",
            "--json",
            str(kept),
        ]
    )
    told = json.loads(kept.read_text())
    of_a, of_b, *of_geometry = told["rows"]
    for row in (of_a, of_b):
        assert abs(row["same_z"]) < told["bound"]
        assert abs(row["block_z"]) < told["bound"]
        assert row["alike_percent"] > 99.0
    for row in of_geometry:
        assert row["s_differs_inner"] == 0
        assert row["d_relative"] < 1e-6
        assert row["c"] < 1e-6
