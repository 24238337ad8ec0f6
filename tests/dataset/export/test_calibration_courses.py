"""The course to calibrate cameras with: its corners reach the image's corners, and OpenCV finds K by them."""

import csv

import cv2
import numpy as np
import pytest
from scipy.stats import chi2

from varos_warp.dataset.export import export
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import DATA, load_scene

NOISE_PX, SEEDS = 0.1, 40
NO_DISTORTION = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


@pytest.fixture(scope="module")
def course(tmp_path_factory):
    """The dataset, without images, places on the board and image points of its views [10, 54, 2], and the states."""
    root = tmp_path_factory.mktemp("camera")
    produce(load_scene(DATA / "templates/calibration_camera.yaml"), root / "data", images=False, quiet=True)
    export(root / "data", "corners", root / "out")
    rows = list(csv.DictReader((root / "out/camM0.csv").read_text().splitlines()))
    places, points = (
        np.array([[row[key] for key in keys] for row in rows], float).reshape(-1, 54, 2)
        for keys in (("board_x [m]", "board_z [m]"), ("u [px]", "v [px]"))
    )
    return Dataset(root / "data"), places, points, {row["state"] for row in rows}


def calibrated(places, points):
    """fx, fy, cx, cy and their standard errors, by OpenCV."""
    flat = np.concatenate([places, np.zeros((*places.shape[:2], 1))], -1).astype(np.float32)
    _, K, _, _, _, error, *_ = cv2.calibrateCameraExtended(
        list(flat), list(points.astype(np.float32)), (320, 240), None, None, flags=NO_DISTORTION
    )
    return K[[0, 1, 0, 1], [0, 1, 2, 2]], error.ravel()[:4]


def test_all_corners_are_seen_and_come_near_to_all_corners_of_the_image(course):
    """Within 30 pixels of a diagonal of 400: a square and a half, for detectors need the margin about the pattern."""
    _, _, points, states = course
    assert states == {"visible"}
    for corner in np.array([[0, 0], [319, 0], [0, 239], [319, 239]]):
        assert np.linalg.norm(points - corner, axis=-1).min() < 30


def test_opencv_finds_k_by_the_true_corners(course):
    """To the single precision that it takes them with: 1e-5 pixels, five times in what a focal length follows from."""
    data, places, points, _ = course
    got, _ = calibrated(places, points)
    np.testing.assert_allclose(got, data.intrinsics("M0", "opencv")[[0, 1, 0, 1], [0, 1, 2, 2]], atol=2e-4)


def test_with_noise_k_errs_by_its_standard_errors(course):
    """The squares of four numbers' errors over their standard errors, of each number over all seeds: chi-squared."""
    data, places, points, _ = course
    true = data.intrinsics("M0", "opencv")[[0, 1, 0, 1], [0, 1, 2, 2]]
    found = [
        calibrated(places, points + np.random.default_rng(seed).normal(0.0, NOISE_PX, points.shape))
        for seed in range(SEEDS)
    ]
    errors = np.array([(got - true) / error for got, error in found])
    low, high = chi2.ppf([5e-4, 1.0 - 5e-4], SEEDS)
    squares = (errors**2).sum(axis=0)
    assert ((squares > low) & (squares < high)).all(), squares
