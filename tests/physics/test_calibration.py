"""Cameras calibrated from their images of a checkerboard, as outsiders would: OpenCV in air, a fit behind a port.

An image is the mean over blocks of pixels of S, the square that each ray hits, which leaves less noise in its edges
than random samples. OpenCV finds corners to 0.03 px where edges are as sharp as pixels, and to 0.01 px with a blur.
"""

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from varos_warp.render.renderer import FrameRenderer
from varos_warp.scene.description import Scene
from varos_warp.scene.description.world import Diffuse
from varos_warp.scene.geometry.parts import Part

pytestmark = pytest.mark.subject("camera")

SIZE = (480, 360)
K = np.array([[240.0, 0.0, 240.0], [0.0, 240.0, 180.0], [0.0, 0.0, 1.0]])
BLUR_PX, WINDOW = 2.0, 10
SQUARES, SIDE_M = (9, 7), 0.015
POSES = [(0.124, 12, 26, 12), (0.134, 16, -5, 24), (0.116, 7, -33, 70), (0.132, 11, -23, 105), (0.11, -36, 1, 12)]
"""Distance [m] of the board, and angles [degrees] about x, z, y of the vehicle."""
BARREL = [-0.15, 0.03, 0.001, -0.002, 0.0]
DISTANCE_M, THICKNESS_M, N_GLASS, N_WATER, NORMAL = 0.02, 0.008, 1.49, 1.342, np.array([0.05, -0.03, 1.0])

INNER = np.stack(np.meshgrid(*((np.arange(1, n) - n / 2) * SIDE_M for n in SQUARES)), -1).reshape(-1, 2)
CORNERS = np.column_stack([INNER, np.zeros(len(INNER))]).astype(np.float32)
"""In the plane of the board [m]."""


def board():
    """The dark and the light squares in the plane y = 0, with a light margin, as two parts."""
    x, z = ((np.arange(-1, n + 2) - n / 2) * SIDE_M for n in SQUARES)
    vertices = np.stack([*np.meshgrid(x, [0.0], z, indexing="ij")], -1).reshape(-1, 3)
    i, j = (k.ravel() for k in np.indices((len(x) - 1, len(z) - 1)))
    a = i * len(z) + j
    faces = np.stack([a, a + 1, a + len(z) + 1, a, a + len(z) + 1, a + len(z)], -1).reshape(-1, 2, 3).astype(np.int32)
    dark = (np.minimum(i, j) >= 1) & (i <= SQUARES[0]) & (j <= SQUARES[1]) & ((i + j) % 2 == 0)
    return [
        Part(name, vertices, faces[which].reshape(-1, 3), Diffuse())
        for name, which in (("dark", dark), ("light", ~dark))
    ]


def corners(sub, away=1.0, **camera):
    """Image points [5, 48, 2] of the board's corners, in OpenCV's pixels, whose first has its centre at (0, 0).

    ``sub`` squared rays make a pixel; all distances are multiplied by ``away``.
    """
    view = {"resolution": [sub * n for n in SIZE], "sensor_mm": [4.8, 3.6], "focal_mm": 2.4} | camera
    scene = Scene(vehicle={"cameras": [view]}, trajectory={"poses": [{"position": [0, 0, 0]}]})
    renderer, found = FrameRenderer(scene, "cpu", parts=board()), []
    for distance, *angles in POSES:
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("xzy", angles, degrees=True).as_matrix()
        T[:3, 3] = -away * distance * T[:3, 1]
        light = renderer.render(T, outputs="S").S.instance != 1
        found.append(corners_of(255.0 * light.reshape(SIZE[1], sub, SIZE[0], sub).mean((1, 3))))
    return np.array(found, np.float32)


def corners_of(image):
    there, points = cv2.findChessboardCorners(image.astype(np.uint8), [n - 1 for n in SQUARES])
    assert there
    for blur, window in ((1.0, 5), (BLUR_PX, WINDOW)):
        smooth = cv2.GaussianBlur(image, (0, 0), blur).astype(np.float32)
        points = cv2.cornerSubPix(smooth, points, (window, window), (-1, -1), (3, 200, 1e-6))
    return points.reshape(-1, 2)


def calibrated(points, flags):
    """fx, fy, cx, cy, k1, k2, p1, p2 by OpenCV, and their standard errors; principal point with pixels at 0.5."""
    _, K, k, _, _, error, *_ = cv2.calibrateCameraExtended(
        [CORNERS] * len(points), list(points), SIZE, None, None, flags=flags | cv2.CALIB_FIX_K3
    )
    return np.array([K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, *k.ravel()[:4]]), error.ravel()[:8]


def test_opencv_recovers_the_intrinsics_of_a_pinhole(truth):
    """From five images without noise; what is left is how well corners are found."""
    flags = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_ZERO_TANGENT_DIST
    got, error = calibrated(corners(6), flags)
    assert error[:4].max() < 0.02, "too noisy to tell"
    truth(
        "fx, fy, cx, cy [px] by cv2.calibrateCamera from five checkerboards",
        source="K of the scene",
        expected=K[[0, 1, 0, 1], [0, 1, 2, 2]],
        got=got[:4],
        tolerance=0.02,
        reason="corners by cv2.cornerSubPix to 0.01 px",
    )


def test_opencv_recovers_the_distortion_of_a_lens(truth):
    got, error = calibrated(corners(3, distortion={"model": "brown_conrady", "k": BARREL}), 0)
    assert (error[4:] < [1e-3, 2e-3, 1e-4, 1e-4]).all(), "too noisy to tell"
    truth(
        "k1, k2, p1, p2 by cv2.calibrateCamera from five checkerboards",
        source="distortion of the scene",
        expected=np.array(BARREL[:4]),
        got=got[4:],
        stderr=error[4:],
    )
    truth(
        "fx, fy, cx, cy [px] of a distorting lens by cv2.calibrateCamera",
        source="K of the scene",
        expected=K[[0, 1, 0, 1], [0, 1, 2, 2]],
        got=got[:4],
        stderr=error[:4],
    )


def refracted(d, n, ratio):
    """Snell's law in vectors [..., 3]; ``ratio`` of the index before to that behind."""
    c = (d @ n)[..., None]
    return ratio * d + (np.sqrt(1.0 - ratio**2 * (1.0 - c**2)) - ratio * c) * n


def off_board(x, rays):
    """Pixels, nearly, by which rays [5, 48, 3] in air miss the corners; ``x``: tilts, distance, boards' poses."""
    n = np.array([x[0], x[1], 1.0]) / np.hypot(1.0, np.hypot(x[0], x[1]))
    glass = refracted(rays, n, 1.0 / N_GLASS)
    water = refracted(glass, n, N_GLASS / N_WATER)
    start = x[2] * rays / (rays @ n)[..., None] + THICKNESS_M * glass / (glass @ n)[..., None]
    off = []
    for o, d, pose in zip(start, water, x[3:].reshape(-1, 6), strict=True):
        R = Rotation.from_rotvec(pose[:3]).as_matrix()
        o, d = (o - pose[3:]) @ R, d @ R
        off.append((o - d * (o[:, 2:] / d[:, 2:]) - CORNERS)[:, :2] * N_WATER * K[0, 0] / pose[5])
    return np.concatenate(off).ravel()


def test_a_fit_recovers_distance_and_tilt_of_a_flat_port(truth):
    """Nothing of the package but its images: K, glass and water are known, port and boards are fitted."""
    port = {
        "kind": "flat",
        "distance_m": DISTANCE_M,
        "thickness_m": THICKNESS_M,
        "n_glass": N_GLASS,
        "normal": NORMAL.tolist(),
    }
    points = corners(6, away=1.4, port=port, n_water=N_WATER)
    rays = np.concatenate([(points + 0.5 - K[:2, 2]) / K[0, 0], np.ones((*points.shape[:2], 1))], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    in_water = K @ np.diag([N_WATER, N_WATER, 1.0]) - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]]
    start = [np.ravel(cv2.solvePnP(CORNERS, p, in_water, None)[1:3]) for p in points]
    fit = least_squares(off_board, [0.0, 0.0, 0.05, *np.concatenate(start)], x_scale="jac", args=(rays,))
    noise = np.sqrt(2.0 * fit.cost / (fit.fun.size - fit.x.size))
    error = noise * np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))[:3]
    assert error[2] < 4.5e-5, "too noisy to tell"
    got = np.degrees(np.arctan(fit.x[:2]))
    truth(
        "tilts [degrees] of a flat port, fitted to five checkerboards",
        source="port of the scene",
        expected=np.degrees(np.arctan(NORMAL[:2])),
        got=got,
        tolerance=0.05,
        reason="4 standard errors",
    )
    truth(
        "distance [m] of a flat port, fitted to five checkerboards",
        source="port of the scene",
        expected=DISTANCE_M,
        got=fit.x[2],
        tolerance=1e-4,
        reason="2.5 standard errors",
    )
