"""Corners followed from image to image, and what they tell of poses: the tools of a small visual odometry.

Image points are as OpenCV counts them; normalised ones are x/z, y/z of the rays in the water. Behind a port, where rays
do not meet in a point, the odometry takes them to, as most SLAM systems do.
"""

from dataclasses import dataclass

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.readiness.opencv import opencv
from varos_warp.scene.description.image_types import WATER

MOST_CORNERS, QUALITY = 500, 0.01
WINDOW, LEVELS, RETURN_PX = 21, 3, 0.5
"""Window and levels of the tracker by Lucas and Kanade; how near to its start a corner must come back."""
REPROJECTION_PX = 1.5
LEAST = 12
"""Points that a pose must agree with, else the frame is lost."""


@dataclass(frozen=True)
class View:
    """What one camera of a dataset sees."""

    data: Dataset
    camera: str

    def gray(self, index: int) -> np.ndarray:
        """A of a frame by its place, uint8 [H, W]."""
        return opencv().cvtColor(self.data.pixels(WATER, self.data.frames[index], self.camera), opencv().COLOR_RGB2GRAY)

    def normalised(self, points: np.ndarray) -> np.ndarray:
        """Return normalised coordinates of image points [N, 2]; NaN if there is no ray."""
        d = self.data.camera_model(self.camera).rays(points.astype(float) + 0.5).direction
        return d[:, :2] / d[:, 2:]

    @property
    def pixel(self) -> float:
        """Size of a pixel in normalised coordinates at the middle of the image."""
        about = self.data.camera(self.camera)
        middle = np.array([about["width"], about["height"]]) / 2
        pair = self.normalised(np.array([middle, middle + [1.0, 0.0]]))
        return float(np.linalg.norm(pair[1] - pair[0]))


def corners(gray: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """New corners float32 [N, 2] apart from those that are ``kept`` [M, 2], as many as bring them to `MOST_CORNERS`."""
    cv2, apart = opencv(), max(5, gray.shape[1] // 64)
    if len(kept) >= MOST_CORNERS:
        return np.zeros((0, 2), np.float32)
    mask = np.full(gray.shape, 255, np.uint8)
    for x, y in np.rint(kept).astype(int).tolist():
        cv2.circle(mask, (x, y), apart, 0, -1)
    found = cv2.goodFeaturesToTrack(gray, MOST_CORNERS - len(kept), QUALITY, apart, mask=mask)
    return np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2)


def follow(before: np.ndarray, after: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Follow corners [N, 2] into another image; return places, and which were found [N]: those that come back."""
    if not len(points):
        return points, np.zeros(0, bool)
    cv2, size = opencv(), (WINDOW, WINDOW)
    start = points.astype(np.float32).reshape(-1, 1, 2)
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, None, winSize=size, maxLevel=LEVELS)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, winSize=size, maxLevel=LEVELS)
    there, off = there.reshape(-1, 2), np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    inside = ((there >= 0) & (there <= np.array(after.shape[::-1]) - 1)).all(1)
    return there, (found.ravel() == 1) & (returned.ravel() == 1) & (off <= RETURN_PX) & inside


def seen_from(T_c_w: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normalised points [N, 2] and depths [N] of points [N, 3]."""
    p = points @ T_c_w[:3, :3].T + T_c_w[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        return p[:, :2] / p[:, 2:], p[:, 2]


def pose_of(
    points: np.ndarray, seen: np.ndarray, limit: float, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray] | None:
    """T_c_w [4, 4] from points [N, 3] and their normalised image points [N, 2], and which agree with it [N].

    RANSAC over P3P, then least squares over those that agree. OpenCV draws the same numbers each time, so the order of
    the points is drawn here. None where fewer than `LEAST` agree.
    """
    cv2, order = opencv(), rng.permutation(len(points))
    if len(points) < LEAST:
        return None
    found, r, t, _ = cv2.solvePnPRansac(
        points[order],
        seen[order],
        np.eye(3),
        None,
        iterationsCount=300,
        reprojectionError=limit,
        confidence=0.999,
        flags=cv2.SOLVEPNP_AP3P,
    )
    if not found:
        return None
    for _ in range(3):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = cv2.Rodrigues(r)[0], t.ravel()
        again, depth = seen_from(T, points)
        agree = (np.linalg.norm(again - seen, axis=1) < limit) & (depth > 0)
        if agree.sum() < LEAST:
            return None
        r, t = cv2.solvePnPRefineLM(points[agree], seen[agree], np.eye(3), None, r, t)
    return T, agree


def triangulated(T_a_w: np.ndarray, T_b_w: np.ndarray, a: np.ndarray, b: np.ndarray, limit: float) -> np.ndarray:
    """Points [N, 3] that two cameras see at normalised points [N, 2]; NaN where they do not agree, or it is behind."""
    if not len(a):
        return np.zeros((0, 3))
    homogeneous = opencv().triangulatePoints(T_a_w[:3], T_b_w[:3], a.T.astype(float), b.T.astype(float))
    with np.errstate(divide="ignore", invalid="ignore"):
        points = (homogeneous[:3] / homogeneous[3]).T
    for T, seen in ((T_a_w, a), (T_b_w, b)):
        again, depth = seen_from(T, points)
        points = np.where(((depth > 0) & (np.linalg.norm(again - seen, axis=1) < limit))[:, None], points, np.nan)
    return points


def parallax(T_a_w: np.ndarray, T_b_w: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Angle [rad] [N] at points [N, 3] between the directions to two cameras."""
    rays = [points + T[:3, :3].T @ T[:3, 3] for T in (T_a_w, T_b_w)]
    a, b = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays)
    return np.arccos((a * b).sum(1).clip(-1, 1))


def carried_on(poses: list[np.ndarray]) -> np.ndarray:
    """The next T_c_w by the last step again; the last where there is one only."""
    return poses[-1] @ np.linalg.inv(poses[-2]) @ poses[-1] if len(poses) > 1 else poses[-1].copy()
