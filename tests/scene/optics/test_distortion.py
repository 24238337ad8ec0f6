"""Distorted lenses: OpenCV's image points, and exact inverses."""

import cv2
import numpy as np
import pytest

from varos_warp.scene.optics.distortion import Lens

BARREL = Lens("brown_conrady", (-0.3, 0.1, 0.001, -0.002, -0.01))
PINCUSHION = Lens("brown_conrady", (0.4, 0.2, -0.003, 0.001, 0.05))
FISHEYE = Lens("kannala_brandt", (-0.02, 0.003, -0.001, 0.0002))
EQUIDISTANT = Lens("kannala_brandt", (0.0, 0.0, 0.0, 0.0))


def opencv(lens, d):
    """Points of the image plane of directions [N, 3] by OpenCV."""
    no_turn, k = np.zeros(3), np.array(lens.k)
    if lens.model == "brown_conrady":
        return cv2.projectPoints(d, no_turn, no_turn, np.eye(3), k)[0][:, 0]
    return cv2.fisheye.projectPoints(d[:, None], no_turn, no_turn, np.eye(3), k)[0][:, 0]


@pytest.mark.parametrize("lens", [BARREL, PINCUSHION, FISHEYE, EQUIDISTANT])
def test_directions_are_seen_where_opencv_sees_them(lens):
    xy = np.random.default_rng(1).uniform(-0.8, 0.8, (1000, 2))
    d = np.column_stack([xy, np.ones(1000)])
    np.testing.assert_allclose(lens.image_plane(d), opencv(lens, d), atol=1e-14, rtol=0)
    np.testing.assert_allclose(lens.image_plane(7.0 * d), lens.image_plane(d), atol=1e-14, rtol=0)


@pytest.mark.parametrize("lens", [Lens(), BARREL, PINCUSHION, FISHEYE, EQUIDISTANT])
def test_the_inverse_is_exact(lens):
    """Within 1e-9 px of a focal length of 1000 px: on grids of the image plane, with its centre."""
    xy = np.stack(np.meshgrid(np.linspace(-0.7, 0.7, 41), np.linspace(-0.5, 0.5, 41)), -1)
    d = lens.directions(xy)
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1.0, atol=1e-14)
    np.testing.assert_allclose(lens.image_plane(d), xy, atol=1e-12, rtol=0)


def test_a_fisheye_sees_behind_itself():
    d = EQUIDISTANT.directions(np.array([[np.radians(100.0), 0.0]]))
    np.testing.assert_allclose(d, [[np.sin(np.radians(100.0)), 0.0, np.cos(np.radians(100.0))]], atol=1e-14)
    np.testing.assert_allclose(EQUIDISTANT.image_plane(d), [[np.radians(100.0), 0.0]], atol=1e-14)


def test_a_lens_sees_no_further_than_it_folds():
    """X (1 - 0.4 x^2) rises to x = sqrt(1 / 1.2), and takes the values below its largest again beyond."""
    lens, fold = Lens("brown_conrady", (-0.4, 0.0, 0.0, 0.0, 0.0)), np.sqrt(1.0 / 1.2)
    assert lens.limit == pytest.approx(fold, rel=1e-12)
    assert np.isfinite(lens.image_plane(np.array([0.99 * fold, 0.0, 1.0]))).all()
    assert np.isnan(lens.image_plane(np.array([1.01 * fold, 0.0, 1.0]))).all()
    highest = fold * (1.0 - 0.4 * fold**2)
    np.testing.assert_allclose(lens.directions(np.array([0.5 * highest, 0.0]))[1], 0.0, atol=0)
    assert np.isnan(lens.directions(np.array([1.01 * highest, 0.0]))).all()


@pytest.mark.parametrize("lens", [Lens(), BARREL])
def test_nothing_is_seen_behind_a_flat_image(lens):
    assert np.isnan(lens.image_plane(np.array([[0.1, 0.1, -1.0], [1.0, 0.0, 0.0]]))).all()
