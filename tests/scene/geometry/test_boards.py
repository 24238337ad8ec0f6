"""Calibration boards: what detectors count on."""

import cv2
import numpy as np
import pytest
import trimesh

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.world import CalibrationBoard
from varos_warp.scene.frames import pose_matrix
from varos_warp.scene.geometry.boards import BLACK, WHITE, checkerboard
from varos_warp.scene.load import scene_from_dict


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


def test_opencv_finds_the_inner_corners_where_the_scene_has_them():
    """Each is nearest to another true corner, and their mean offset is noise: nothing is shifted by half a pixel."""
    scene = scene_from_dict({
        "objects": [{"kind": "calibration_board", "square_m": 0.05, "position": [0, 1.0, 0]}],
        "vehicle": {"cameras": [{"resolution": [320, 180]}]},
        "trajectory": {"poses": [{"position": [0.1, 0.1, 0.1], "look_at": [0, 1.0, 0]}]}})
    T_w_v, renderer = pose_matrix(scene.trajectory.poses[0]), FrameRenderer(scene, "cpu")
    image = renderer.render(T_w_v, outputs="B", spp_b=16, denoise_b="none").B.radiance.mean(axis=-1)
    grey = np.rint(255.0 * image / image.max()).astype(np.uint8)
    there, corners = cv2.findChessboardCorners(grey, (9, 6))
    assert there
    found = cv2.cornerSubPix(grey, corners, (4, 4), (-1, -1), (3, 100, 1e-5)).reshape(-1, 2) + 0.5
    x, z = np.meshgrid((np.arange(9) - 4.0) * 0.05, (np.arange(6) - 2.5) * 0.05)
    points = np.stack([x.ravel(), np.full(54, 1.0), z.ravel()], axis=-1)
    true = renderer.project(points, T_w_v)
    nearest = np.linalg.norm(found[:, None] - true, axis=-1).argmin(axis=1)
    assert sorted(nearest) == list(range(54))
    offset = found - true[nearest]
    assert (np.abs(offset.mean(axis=0)) < 3.0 * offset.std(axis=0) / np.sqrt(54)).all()
