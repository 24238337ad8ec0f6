"""Pose of a camera on an IMU, and the offset of their clocks, from corners of a board: numpy, scipy and OpenCV only.

    varos-warp init --template calibration_imu
    varos-warp simulate scene.yaml -o data
    varos-warp export data --to corners -o corners
    python camera_imu.py data corners/camM0.csv --noise 0.1 --offset-ms 7

Known are K and the size of the board; fitted are T_cam_imu, the time that is to be added to the camera's stamps to have
the IMU's, both biases, which way is down in the board's axes, and the IMU's pose and velocity at the start of each
part of the course. Its readings carry these through it. In place of the true corners with noise of known size, put
those that you detect, and leave out --offset-ms, by which the script makes the camera's stamps early.
"""

import csv
import sys
from itertools import accumulate

import cv2
import numpy as np
from corner_tables import arguments, camera_of, frames_of
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

MARGIN_S = 0.03
"""Readings before the first image and after the last one of a part: as far as the offset of the clocks may be."""
LEAST_CORNERS = 12
"""Of an image that is used."""
SHARED = 15
"""Numbers before those of the parts: rotation and translation, offset, biases, two angles of gravity."""


def exp(vector):
    """Rotation matrices [..., 3, 3] of rotation vectors [..., 3]."""
    return Rotation.from_rotvec(vector.reshape(-1, 3)).as_matrix().reshape(*vector.shape, 3)


class Readings:
    """An IMU's readings: ``time_s`` [M] at one rate, ``gyro`` [M, 3] [rad/s] and ``force`` [M, 3] [m/s^2]."""

    def __init__(self, time_s, gyro, force):
        self.time_s, self.gyro, self.force = time_s, gyro, force
        self.step_s = (time_s[-1] - time_s[0]) / (len(time_s) - 1)

    def between(self, start_s, end_s):
        """Those of a time, with the ones before and behind it."""
        first, last = max(np.searchsorted(self.time_s, start_s, "right") - 1, 0), np.searchsorted(self.time_s, end_s)
        rows = slice(first, last + 1)
        return Readings(self.time_s[rows], self.gyro[rows], self.force[rows])

    def course(self, start, biases, gravity, time_s):
        """Attitude [F, 3, 3] and place [F, 3] at times, from those and the velocity at the first reading.

        Both kinds of readings are taken for straight lines between samples.
        """
        (R, p, v), h = start, self.step_s
        w, (k, s) = self.gyro - biases[:3], self._place(time_s)
        attitudes = np.array(list(accumulate(exp(_turn(w[:-1], w[1:], h, h)), np.matmul, initial=R)))
        a = np.einsum("kij,kj->ki", attitudes, self.force - biases[3:]) + gravity
        speeds = v + h / 2 * np.cumsum(np.concatenate([0 * a[:1], a[:-1] + a[1:]]), axis=0)
        places = p + np.cumsum(np.concatenate([0 * a[:1], h * speeds[:-1] + h * h / 6 * (2 * a[:-1] + a[1:])]), axis=0)
        return (
            attitudes[k] @ exp(_turn(w[k], w[k + 1], s, h)),
            places[k] + s * speeds[k] + s**2 / 2 * a[k] + s**3 / (6 * h) * (a[k + 1] - a[k]),
        )

    def _place(self, time_s):
        """Sample before each time [F], and how far behind it that is [F, 1] [s]."""
        k = np.clip(((time_s - self.time_s[0]) / self.step_s).astype(int), 0, len(self.time_s) - 2)
        return k, (time_s - self.time_s[k])[:, None]


def _turn(w, following, s, h):
    """Rotation vector after s of a step h in which the angular velocity goes from ``w`` to ``following``."""
    return s * w + s**2 / (2 * h) * (following - w) + s**3 / (12 * h) * np.cross(w, following)


class CameraImu:
    """Images of a board and readings of an IMU.

    Args:
        K: Of the camera, OpenCV's pixels.
        board: Places of corners in the board's axes [N, 3] [m].
        stamps_s: Of images, by the camera's clock [F].
        points: Image points [F, N, 2], nan where a corner is not seen.
        readings: Of the IMU, by its own clock.
        gravity: Its size [m/s^2].
        part_s: Length of the parts of the course [s].
    """

    def __init__(self, K, board, stamps_s, points, readings, gravity, part_s):
        self.K, self.board, self.gravity = K, board, gravity
        there = (
            (np.isfinite(points[..., 0]).sum(axis=1) >= LEAST_CORNERS)
            & (stamps_s > readings.time_s[0] + MARGIN_S)
            & (stamps_s < readings.time_s[-1] - MARGIN_S)
        )
        self.stamps_s, self.points = stamps_s[there], points[there]
        number = ((self.stamps_s - self.stamps_s[0]) / part_s + 1e-9).astype(int)
        self.parts = [np.flatnonzero(number == k) for k in np.unique(number)]
        ends = [self.stamps_s[rows[[0, -1]]] + [-MARGIN_S, MARGIN_S] for rows in self.parts]
        self.readings = [readings.between(*end) for end in ends]
        self._begin(readings)

    def _begin(self, readings):
        """A first guess: poses of the camera from each image, and how their turning agrees with the gyroscope's."""
        seen = np.isfinite(self.points[..., 0])
        poses = [
            cv2.solvePnP(self.board[each], points[each], self.K, None)[1:]
            for points, each in zip(self.points, seen, strict=True)
        ]
        R_b_c = exp(-np.array([turn.ravel() for turn, _ in poses]))
        p = -np.einsum("fij,fj->fi", R_b_c, np.array([place.ravel() for _, place in poses]))
        spacing = np.diff(self.stamps_s)
        turning = Rotation.from_matrix(R_b_c[:-1].transpose(0, 2, 1) @ R_b_c[1:]).as_rotvec() / spacing[:, None]
        middles = (self.stamps_s[:-1] + self.stamps_s[1:]) / 2
        gyro = np.stack([np.interp(middles, readings.time_s, column) for column in readings.gyro.T], -1)
        self.R_c_i = Rotation.align_vectors(turning - turning.mean(axis=0), gyro - gyro.mean(axis=0))[0].as_matrix()
        R_b_i, v = R_b_c @ self.R_c_i, np.gradient(p, self.stamps_s, axis=0)
        force = np.stack([np.interp(self.stamps_s, readings.time_s, column) for column in readings.force.T], -1)
        up = np.einsum("fij,fj->fi", R_b_i, force).mean(axis=0)
        self.down = -up / np.linalg.norm(up)
        self.starts = [(R_b_i[rows[0]], p[rows[0]] - MARGIN_S * v[rows[0]], v[rows[0]]) for rows in self.parts]

    def rotation(self, x):
        """R_cam_imu."""
        return exp(x[:3]) @ self.R_c_i

    def fall(self, x):
        """Acceleration by gravity in the board's axes, two angles from the first guess."""
        across = np.linalg.svd(self.down[None])[2][1:]
        return self.gravity * exp(x[13:15] @ across) @ self.down

    def residuals(self, x):
        """Pixels between where the board should be seen and where it is."""
        R_c_i, gravity, missed = self.rotation(x), self.fall(x), []
        for rows, readings, (R, p, v), own in zip(
            self.parts, self.readings, self.starts, x[SHARED:].reshape(-1, 9), strict=True
        ):
            start = exp(own[:3]) @ R, p + own[3:6], v + own[6:]
            R_b_i, place = readings.course(start, x[7:13], gravity, self.stamps_s[rows] + x[6])
            there = np.einsum("fji,fnj->fni", R_b_i, self.board - place[:, None]) @ R_c_i.T + x[3:6]
            uv = there @ self.K.T
            missed.append((uv[..., :2] / uv[..., 2:] - self.points[rows]).ravel())
        missed = np.concatenate(missed)
        return missed[np.isfinite(missed)]

    def fit(self, noise_px):
        """R_cam_imu [3, 3], what else `SHARED` holds [12], and the covariance of all [15, 15], for noise of corners.

        The covariance of the rotation is that of the vector by which it is turned in the camera's axes. It holds for
        exact readings: those with noise err by more.
        """
        found = least_squares(self.residuals, np.zeros(SHARED + 9 * len(self.parts)), x_scale="jac", method="lm")
        # again from what was found, whose derivatives the covariance is of
        found = least_squares(self.residuals, self._again(found.x), x_scale="jac", method="lm")
        covariance = noise_px**2 * np.linalg.inv(found.jac.T @ found.jac)
        return self.rotation(found.x), found.x[3:SHARED], covariance[:SHARED, :SHARED]

    def _again(self, x):
        """The same solution as the guess to begin with, and its numbers."""
        self.R_c_i = self.rotation(x)
        self.starts = [
            (exp(own[:3]) @ R, p + own[3:6], v + own[6:])
            for (R, p, v), own in zip(self.starts, x[SHARED:].reshape(-1, 9), strict=True)
        ]
        self.down = self.fall(x) / self.gravity
        return np.concatenate([np.zeros(3), x[3:13], np.zeros(2 + 9 * len(self.parts))])


def corners(path):
    """Places on the board [N, 3], stamps [F] [s] and image points [F, N, 2], nan where a corner is not visible.

    Raises:
        ValueError: If the table is none of corners.
    """
    stamp, image = "timestamp [ns]", ("u [px]", "v [px]")
    places = [f"board_{axis} [m]" for axis in "xyz"]
    frames = frames_of(path, stamp, *places, *image)
    board = np.array([[row[key] for key in places] for row in frames[0]])
    points = np.array(
        [[[row[key] if row["state"] == "visible" else np.nan for key in image] for row in rows] for rows in frames]
    )
    return board, 1e-9 * np.array([rows[0][stamp] for rows in frames]), points


def readings_of(dataset, vehicle):
    """What the IMU reads."""
    with open(f"{dataset}/vehicle{vehicle}/imu0/imu0_data.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    gyro, force = (
        np.array([[float(row[f"{name}_RS_S_{axis} [{unit}]"]) for axis in "xyz"] for row in rows])
        for name, unit in (("w", "rad s^-1"), ("a", "m s^-2"))
    )
    return Readings(1e-9 * np.array([int(row["# timestamp [ns]"]) for row in rows]), gyro, force)


def main(argv=None):
    """Fit and print."""
    parser = arguments(__doc__.splitlines()[0], 0.1)
    parser.add_argument("--offset-ms", type=float, default=0.0, help="by which the camera's stamps are made early")
    parser.add_argument("--part", type=float, default=2.0, help="length of the parts of the course [s]")
    given = parser.parse_args(argv)
    if not (0.1 <= given.part < np.inf and np.isfinite(given.offset_ms)):
        parser.error("--part is at least 0.1, and --offset-ms a number")
    about, camera = camera_of(parser, given)
    if camera["mount"] == "world" or camera.get("port"):
        parser.error(f"{given.corners} is of a camera with a port, or one that stands in the world: K is not all")
    try:
        board, stamps_s, points = corners(given.corners)
    except ValueError as error:
        parser.error(str(error))
    points = points + np.random.default_rng(given.seed).normal(0.0, given.noise, points.shape)
    fit = CameraImu(
        np.array(camera["K_opencv"]),
        board,
        stamps_s - 1e-3 * given.offset_ms,
        points,
        readings_of(given.dataset, about["vehicle"]),
        np.linalg.norm(about["gravity"]),
        given.part,
    )
    R, x, covariance = fit.fit(given.noise)
    error, true = (
        np.sqrt(np.diag(covariance)),
        np.linalg.inv(camera["T_v_c"]) @ np.array(about["sensors"]["imu0"]["T_v_s"]),
    )
    off = np.degrees(Rotation.from_matrix(R @ true[:3, :3].T).as_rotvec())
    for axis in range(3):
        print(f"rotation {'xyz'[axis]} [deg]: off by {off[axis]:.5f} +- {np.degrees(error[axis]):.5f}")
    for axis in range(3):
        print(
            f"translation {'xyz'[axis]} [mm]: {1e3 * x[axis]:.3f} +- {1e3 * error[3 + axis]:.3f}, "
            f"true {1e3 * true[axis, 3]:.3f}"
        )
    print(f"offset [ms]: {1e3 * x[3]:.4f} +- {1e3 * error[6]:.4f}, true {given.offset_ms:.4f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
