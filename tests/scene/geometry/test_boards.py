"""Calibration boards: what detectors count on."""

import numpy as np
import pytest
import trimesh

from varos_warp.scene.description.world import CalibrationBoard
from varos_warp.scene.geometry.boards import BLACK, WHITE, checkerboard


@pytest.fixture(scope="module")
def board():
    """6 x 9 inner corners, squares of 5 cm, 5 mm thick."""
    vertices, faces, skin = checkerboard(CalibrationBoard(kind="calibration_board", square_m=0.05))
    return trimesh.Trimesh(vertices, faces, process=False), skin.corners[:, 0, 0]


def test_a_board_is_a_closed_box_with_a_margin_of_one_square(board):
    mesh, _ = board
    assert mesh.is_watertight
    np.testing.assert_allclose(mesh.bounds, [[-0.3, 0.0, -0.225], [0.3, 0.005, 0.225]], atol=1e-12)
    np.testing.assert_allclose(mesh.volume, 0.6 * 0.45 * 0.005, rtol=1e-9)


def test_colours_change_at_each_inner_corner_and_nowhere_else(board):
    """From square to square along both sides; what is black ends one square before the edge."""
    mesh, colours = board
    front = mesh.triangles_center[:, 1] == 0.0
    index = np.floor((mesh.triangles_center[front][:, [0, 2]] - [-0.25, -0.175]) / 0.05).astype(int)
    inside = ((index >= 0) & (index < [10, 7])).all(axis=1)
    black = inside & (index.sum(axis=1) % 2 == 0)
    np.testing.assert_array_equal(colours[front], np.where(black, np.float32(BLACK), np.float32(WHITE)))
    assert (colours[~front] == np.float32(WHITE)).all()
    assert black.sum() == 2 * 35
