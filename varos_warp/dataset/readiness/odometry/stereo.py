"""Stereo odometry: points triangulated by a pair of cameras at a keyframe, and the poses that see them afterwards."""

import numpy as np

from varos_warp.dataset.readiness.odometry.tracking import (
    REPROJECTION_PX,
    View,
    carried_on,
    corners,
    follow,
    pose_of,
    triangulated,
)

RENEWED = 0.6
"""Share of a keyframe's points below which the next frame becomes one."""


class StereoOdometry:
    """One run over a dataset: the course of the left camera; T_r_l [4, 4] leads to the axes of the right one."""

    def __init__(self, left: View, right: View, T_r_l: np.ndarray, seed: int):
        self.left, self.right, self.T_r_l, self.rng = left, right, T_r_l, np.random.default_rng([seed, 1])
        self.limit = REPROJECTION_PX * left.pixel
        self.poses, self.lost = [np.eye(4)], [False]
        self._keyframe(0, left.gray(0))

    def run(self) -> tuple[np.ndarray, np.ndarray]:
        """T_c_w [N, 4, 4] of all frames, the first at the origin, and which were lost [N]: they go on as before."""
        for index in range(1, len(self.left.data)):
            gray = self.left.gray(index)
            there, found = follow(self.gray, gray, self.pixels)
            self.points, self.pixels, self.gray = self.points[found], there[found], gray
            solved = pose_of(self.points, self.left.normalised(self.pixels), self.limit, self.rng)
            self.poses.append(carried_on(self.poses) if solved is None else solved[0])
            self.lost.append(solved is None)
            if solved is not None:
                self.points, self.pixels = self.points[solved[1]], self.pixels[solved[1]]
            if solved is None or len(self.points) < RENEWED * self.count:
                self._keyframe(index, gray)
        return np.array(self.poses), np.array(self.lost)

    def _keyframe(self, index: int, gray: np.ndarray) -> None:
        """Triangulate corners of the pair anew."""
        pixels = corners(gray, np.zeros((0, 2)))
        there, found = follow(gray, self.right.gray(index), pixels)
        pixels, there, T = pixels[found], there[found], self.poses[-1]
        points = triangulated(T, self.T_r_l @ T, self.left.normalised(pixels), self.right.normalised(there), self.limit)
        good = np.isfinite(points).all(1)
        self.points, self.pixels, self.gray, self.count = points[good], pixels[good], gray, int(good.sum())
