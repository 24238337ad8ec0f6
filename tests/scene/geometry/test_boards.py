"""Calibration boards: what detectors count on."""

import cv2
import numpy as np
import pytest
import trimesh

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description.world import CalibrationBoard
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import pose_matrix
from varos_warp.scene.geometry.assets import boards
from varos_warp.scene.geometry.assets.boards import BLACK, WHITE


@pytest.fixture(scope="module")
def board():
    """6 x 9 inner corners, squares of 5 cm, 5 mm thick."""
    vertices, faces, skin = boards.board(CalibrationBoard(kind="calibration_board", square_m=0.05))
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


def seen(block, eye, width):
    """Image of B [H, W] uint8 of a board at (0, 1, 0), and image points of points of it."""
    scene = scene_from_dict(
        {
            "objects": [{"kind": "calibration_board", "position": [0, 1.0, 0], **block}],
            "vehicle": {"cameras": [{"resolution": [width, width * 9 // 16]}]},
            "trajectory": {"poses": [{"position": eye, "look_at": [0, 1.0, 0]}]},
        }
    )
    T_w_v, renderer = pose_matrix(scene.trajectory.poses[0]), FrameRenderer(scene, "cpu")
    image = renderer.render(T_w_v, outputs="B", spp_b=16, denoise_b="none").B.radiance.mean(axis=-1)
    return (
        np.rint(255.0 * image / image.max()).astype(np.uint8),
        lambda x, z: renderer.project(np.stack([x, np.full(len(x), 1.0), z], axis=-1), T_w_v),
    )


def test_opencv_finds_the_inner_corners_where_the_scene_has_them():
    """Each is nearest to another true corner, and their mean offset is noise: nothing is shifted by half a pixel."""
    grey, project = seen({"square_m": 0.05}, [0.1, 0.1, 0.1], 320)
    there, corners = cv2.findChessboardCorners(grey, (9, 6))
    assert there
    found = cv2.cornerSubPix(grey, corners, (4, 4), (-1, -1), (3, 100, 1e-5)).reshape(-1, 2) + 0.5
    x, z = np.meshgrid((np.arange(9) - 4.0) * 0.05, (np.arange(6) - 2.5) * 0.05)
    true = project(x.ravel(), z.ravel())
    nearest = np.linalg.norm(found[:, None] - true, axis=-1).argmin(axis=1)
    assert sorted(nearest) == list(range(54))
    offset = found - true[nearest]
    assert (np.abs(offset.mean(axis=0)) < 3.0 * offset.std(axis=0) / np.sqrt(54)).all()


def test_opencv_reads_the_tags_of_an_aprilgrid_where_kalibr_has_them():
    """Tag i lies in row i // columns from below. OpenCV draws tags turned by half: its first corner is the lower right.

    Corners between a tag and the black squares beside it are saddles, which are found as those of a checkerboard are.
    """
    columns, rows, tag, spacing = 4, 3, 0.08, 0.25
    grey, project = seen(
        {"pattern": "aprilgrid", "columns": columns, "rows": rows, "tag_m": tag, "spacing": spacing},
        [0.1, 0.4, 0.1],
        480,
    )
    how = cv2.aruco.DetectorParameters()
    how.markerBorderBits = 2
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    corners, ids, _ = cv2.aruco.ArucoDetector(family, how).detectMarkers(grey)
    assert sorted(ids.ravel()) == list(range(columns * rows))
    found = cv2.cornerSubPix(grey, np.concatenate(corners).reshape(-1, 1, 2), (4, 4), (-1, -1), (3, 100, 1e-5)) + 0.5
    step, ids = (1.0 + spacing) * tag, ids.reshape(-1, 1)
    left = (ids % columns) * step - 0.5 * (columns * step - spacing * tag)
    low = (ids // columns) * step - 0.5 * (rows * step - spacing * tag)
    true = project((left + [tag, 0, 0, tag]).ravel(), (low + [0, 0, tag, tag]).ravel())
    offset = found.reshape(-1, 2) - true
    assert np.abs(offset).max() < 0.5
    assert (np.abs(offset.mean(axis=0)) < 3.0 * offset.std(axis=0) / np.sqrt(len(offset))).all()


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({}, "square_m: is missing"),
        ({"pattern": "aprilgrid"}, "tag_m: is missing"),
        ({"square_m": 0.1, "tag_m": 0.1}, "tag_m: is not a key"),
        ({"pattern": "aprilgrid", "tag_m": 0.1, "rows": 60, "columns": 10}, "600 is more than the 587 tags"),
    ],
)
def test_a_board_has_the_keys_of_its_pattern(keys, message):
    with pytest.raises(ValueError, match=message):
        CalibrationBoard(kind="calibration_board", **keys)
