"""Scenes for tests of benchmarks."""

import pytest


@pytest.fixture
def boulder(tmp_path):
    """Scene file of a few frames of 32 x 18 pixels, with one boulder and one lamp."""
    path = tmp_path / "scene.yaml"
    path.write_text("""
objects: [{kind: boulder, diameter: 2.0, seed: 1, position: [0, 2, 0]}]
vehicle: {lights: [{kind: spot, position: [0.2, 0, 0], cone_deg: 65}], cameras: [{resolution: [32, 18]}]}
trajectory: {poses: [{position: [0, -1, 1]}, {position: [0, -1, 1.1], time_s: 0.3}]}
""")
    return path
