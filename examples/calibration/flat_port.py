"""Distance and normal of a flat port from corners of a board, by least squares: numpy, scipy and OpenCV only.

    varos-warp init --template calibration
    varos-warp simulate scene.yaml -o data
    varos-warp export data --to corners -o corners
    python flat_port.py data corners/camL0.csv --noise 0.05

Known are K, the glass and the water; fitted are the port and the pose of the board in every frame. In place of the true
corners with noise of known size, put those that you detect.
"""

import sys

import cv2
import numpy as np
from corner_tables import arguments, camera_of, frames_of
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

STEP_PX = 1e-2
"""For derivatives by image points."""


def refracted(d, n, ratio):
    """Snell's law for unit vectors [..., 3] and a normal [3]; ``ratio`` of the index before to that behind."""
    c = (d @ n)[..., None]
    return ratio * d + (np.sqrt(1.0 - ratio**2 * (1.0 - c**2)) - ratio * c) * n


class FlatPort:
    """A camera behind a flat port, whose normal and distance are looked for.

    Args:
        camera: Its entry in dataset.json.
        board: Places of corners on the board [frames, N, 2] [m].
        points: Where the camera sees them, OpenCV's pixels [frames, N, 2].
    """

    def __init__(self, camera, board, points):
        self.K, self.port, self.n_water = np.array(camera["K_opencv"]), camera["port"], camera["n_water"][1]
        self.corners, self.points = np.concatenate([board, np.zeros((*board.shape[:2], 1))], -1), points

    def rays(self, points, x):
        """Origins and directions in the water of image points, for a port of normal (x0, x1, 1) at distance x2 [m]."""
        n = np.array([x[0], x[1], 1.0]) / np.sqrt(1.0 + x[0] ** 2 + x[1] ** 2)
        air = np.concatenate([points, np.ones((*points.shape[:-1], 1))], -1) @ np.linalg.inv(self.K).T
        air /= np.linalg.norm(air, axis=-1, keepdims=True)
        glass = refracted(air, n, 1.0 / self.port["n_glass"])
        start = x[2] * air / (air @ n)[..., None] + self.port["thickness_m"] * glass / (glass @ n)[..., None]
        return start, refracted(glass, n, self.port["n_glass"] / self.n_water)

    def missed(self, points, x, there):
        """By how much rays pass corners, in the plane of each across the camera's axis [..., 2] [m]."""
        start, d = self.rays(points, x)
        return (start + d * ((there - start)[..., 2:] / d[..., 2:]) - there)[..., :2]

    def residuals(self, x):
        """Pixels between image points and where port and boards have them: what is missed, over its derivative."""
        poses = x[3:].reshape(-1, 6)
        R = Rotation.from_rotvec(poses[:, :3]).as_matrix()
        there = np.einsum("fij,fnj->fni", R, self.corners) + poses[:, None, 3:]
        J = np.stack(
            [
                (self.missed(self.points + step, x, there) - self.missed(self.points - step, x, there))
                / (2.0 * STEP_PX)
                for step in STEP_PX * np.eye(2)
            ],
            -1,
        )
        return np.linalg.solve(J, self.missed(self.points, x, there)[..., None]).ravel()

    def fit(self, noise_px):
        """Normal (x0, x1, 1) and distance [m], 3 numbers, and their covariance [3, 3], for noise of ``noise_px``."""
        in_water = self.K * [[self.n_water, 1, 1], [1, self.n_water, 1], [1, 1, 1]]
        start = [
            np.ravel(cv2.solvePnP(corners, points, in_water, None)[1:3])
            for corners, points in zip(self.corners, self.points, strict=True)
        ]
        found = least_squares(self.residuals, [0.0, 0.0, 0.04, *np.concatenate(start)], x_scale="jac", xtol=1e-12)
        return found.x[:3], noise_px**2 * np.linalg.inv(found.jac.T @ found.jac)[:3, :3]


def views(path):
    """Places on the board and image points [frames, N, 2] of the frames in which all corners are visible.

    Raises:
        ValueError: If there are none, or the table is none of corners.
    """
    board, points = ("board_x [m]", "board_z [m]"), ("u [px]", "v [px]")
    whole = [rows for rows in frames_of(path, *board, *points) if all(row["state"] == "visible" for row in rows)]
    if not whole:
        raise ValueError(f"{path}: no frame shows all corners")
    return tuple(np.array([[[row[key] for key in keys] for row in rows] for rows in whole]) for keys in (board, points))


def main(argv=None):
    """Fit and print."""
    parser = arguments(__doc__.splitlines()[0], 0.05)
    given = parser.parse_args(argv)
    _, camera = camera_of(parser, given)
    if (camera.get("port") or {}).get("kind") != "flat":
        parser.error(f"{given.corners} is of a camera without a flat port")
    try:
        board, points = views(given.corners)
    except ValueError as error:
        parser.error(str(error))
    points = points + np.random.default_rng(given.seed).normal(0.0, given.noise, points.shape)
    got, covariance = FlatPort(camera, board, points).fit(given.noise)
    normal = np.array(camera["port"]["normal"])
    true = [*normal[:2] / normal[2], camera["port"]["distance_m"]]
    for name, value, error, truth in zip(
        ("normal x/z", "normal y/z", "distance [m]"), got, np.sqrt(np.diag(covariance)), true, strict=True
    ):
        print(f"{name}: {value:.5f} +- {error:.5f}, true {truth:.5f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
