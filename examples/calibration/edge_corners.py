"""K from images of a checkerboard, by corners that are fitted to what pixels are: means over squares.

    varos-warp init --template calibration_camera
    varos-warp run scene.yaml -o data
    python edge_corners.py data --images A --rows 6 --columns 9

OpenCV finds the corners first. About each, two straight edges part dark from bright, both of which may change evenly
across the window; place and directions of the edges are fitted to the linear image. Detectors of blurred saddles err by
some hundredths of a pixel on edges as sharp as these.
"""

import argparse
import sys

import cv2
import numpy as np
from scipy.optimize import least_squares

import varos_warp as vw

HALF, PARTS = 4, 8
"""Half the window, without its middle [pixels], and samples along a side of a pixel."""
FIXED = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST


def bright_share(x):
    """Share of each pixel [81] of a window that is in one pair of sectors: corner (x0, x1), edges at angles x2, x3."""
    side = (np.arange(PARTS * (2 * HALF + 1)) + 0.5) / PARTS - HALF - 0.5
    u, v = side - x[0], side[:, None] - x[1]
    beyond = [np.clip(PARTS * (np.cos(angle) * v - np.sin(angle) * u), -1.0, 1.0) for angle in x[2:]]
    share = 0.5 + 0.5 * beyond[0] * beyond[1]
    return share.reshape(2 * HALF + 1, PARTS, 2 * HALF + 1, PARTS).mean(axis=(1, 3)).ravel()


def missed(x, window):
    """What is left of a window [81] after the levels of both pairs of sectors, each of them a plane."""
    v, u = np.indices((2 * HALF + 1, 2 * HALF + 1)).reshape(2, -1) - HALF
    plane, share = np.stack([np.ones_like(u), u, v], -1), bright_share(x)[:, None]
    levels = np.concatenate([share * plane, (1.0 - share) * plane], axis=1)
    return levels @ np.linalg.lstsq(levels, window, rcond=None)[0] - window


def refined(image, board, points):
    """Corners in a linear image [H, W], of those that a detector found.

    Args:
        image: Linear grey values [H, W].
        board: Places of corners on the board [N, 2].
        points: Image points [N, 2], good to half a pixel, in OpenCV's pixels; nan is returned near the image's edges.
    """
    H, _ = cv2.findHomography(board, points)
    step, found = 0.2 * np.linalg.norm(board[1] - board[0]), np.full(points.shape, np.nan)
    for k, middle in enumerate(np.rint(points).astype(int)):
        (u, v), ends = middle, board[k] + step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        if not (HALF <= u < image.shape[1] - HALF and HALF <= v < image.shape[0] - HALF):
            continue
        ends = cv2.perspectiveTransform(ends[None].astype(float), H)[0]
        along = ends[::2] - ends[1::2]
        start = [*(points[k] - middle), *np.arctan2(along[:, 1], along[:, 0])]
        window = image[v - HALF : v + HALF + 1, u - HALF : u + HALF + 1].ravel()
        fit = least_squares(
            missed, start, args=(window / window.max(),), diff_step=1e-4, x_scale=[0.1, 0.1, 0.05, 0.05]
        )
        found[k] = fit.x[:2] + middle
    return found


def corners_of(linear, rows, columns):
    """Places [N, 2] in squares and image points [N, 2] of one image [H, W, 3]; None where OpenCV finds no board."""
    grey = linear.mean(axis=-1)
    seen = np.rint(255.0 * np.clip(grey / np.percentile(grey, 99), 0.0, 1.0) ** (1 / 2.2)).astype(np.uint8)
    there, points = cv2.findChessboardCornersSB(seen, (columns, rows), None, cv2.CALIB_CB_ACCURACY)
    if not there:
        return None
    board = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), -1).reshape(-1, 2).astype(float)
    points = refined(grey, board, points.reshape(-1, 2).astype(float))
    kept = np.isfinite(points[:, 0])
    return board[kept], points[kept]


def calibrated(views, size):
    """fx, fy, cx, cy [pixels] and their standard errors, by OpenCV, of a camera without distortion."""
    flat = [np.pad(board, ((0, 0), (0, 1))).astype(np.float32) for board, _ in views]
    _, K, _, _, _, error, *_ = cv2.calibrateCameraExtended(
        flat, [points.astype(np.float32) for _, points in views], size, None, None, flags=FIXED
    )
    return K[[0, 1, 0, 1], [0, 1, 2, 2]], error.ravel()[:4]


def main(argv=None):
    """Calibrate, and print K beside the truth."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dataset")
    parser.add_argument("--camera", help="its id; absent: the first")
    parser.add_argument("--images", choices=("A", "B"), default="A")
    parser.add_argument("--rows", type=int, default=6, help="of inner corners")
    parser.add_argument("--columns", type=int, default=9, help="of inner corners")
    given = parser.parse_args(argv)
    if min(given.rows, given.columns) < 3:
        parser.error("--rows and --columns are at least 3")
    try:
        data = vw.Dataset(given.dataset)
        about = data.camera(given.camera)
        if about.get("port") or about.get("distortion", "none") != "none":
            parser.error(f"camera {about['id']} has a port or distortion: K is not all")
        found = [
            corners_of(data.image(given.images, frame, given.camera), given.rows, given.columns)
            for frame in data.frames
        ]
    except (vw.InputError, cv2.error) as error:
        parser.error(str(error))
    views = [view for view in found if view is not None]
    if len(views) < 3:
        parser.error(f"{len(views)} of {len(found)} images show the board: K needs three or more")
    got, error = calibrated(views, (about["width"], about["height"]))
    true = data.intrinsics(given.camera, "opencv")[[0, 1, 0, 1], [0, 1, 2, 2]]
    for name, value, off, truth in zip(("fx", "fy", "cx", "cy"), got, error, true, strict=True):
        print(f"{name} [px]: {value:.3f} +- {off:.3f}, true {truth:.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
