"""Polygons of every shape become triangles, or are counted as those that cannot."""

import numpy as np
import pytest

from varos_warp.scene.geometry.files.polygons import area_vectors, fill, triangulate

BOW_TIE = np.array([[0.0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]])
"""Its two halves go around in opposite ways: its vector area is zero."""
AXES = {"level": [0, 1, 2], "upright": [0, 2, 1], "facing x": [2, 0, 1]}


@pytest.mark.parametrize("axes", AXES.values(), ids=AXES)
def test_a_bow_tie_is_not_lost_without_a_word(axes):
    triangles, _, crossed = triangulate(BOW_TIE[:, axes], np.array([0, 4]))
    assert crossed == 1
    assert len(triangles) > 0


@pytest.mark.parametrize("axes", AXES.values(), ids=AXES)
def test_a_spiral_is_filled_with_its_area_and_keeps_its_side(axes):
    """Earcut's triangles against Newell's area of the outline, which needs none."""
    turns = np.linspace(0, 3 * np.pi, 40)
    along = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    out, back = ((r + turns[:, None]) * along for r in (1.0, 0.5))
    ring = np.concatenate([out, back[::-1]])[:, axes]
    triangles, sound = fill(ring)
    assert sound
    np.testing.assert_allclose(area_vectors(ring[triangles]).sum(axis=0), area_vectors(ring), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "ring", [np.zeros((4, 3)), np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0]])], ids=["a point", "a line"]
)
def test_what_has_no_area_gives_no_triangles(ring):
    triangles, sound = fill(ring)
    assert sound
    assert len(triangles) == 0
