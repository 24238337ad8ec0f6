"""Odometry of one camera: two views by the essential matrix, then poses from points that grow along the way."""

import numpy as np

from varos_warp.dataset.readiness.odometry.tracking import (
    LEAST,
    REPROJECTION_PX,
    View,
    carried_on,
    corners,
    follow,
    parallax,
    pose_of,
    triangulated,
)
from varos_warp.dataset.readiness.opencv import opencv

START_ANGLE = np.radians(2.0)
"""Median parallax with which the first two views begin, and that of a new point."""
START_LIMIT = 0.5
"""Limit of the first two views over that of others: all that follows rests on them."""
WIDER = 1.25
"""Factor by which the parallax of a point must grow before it is triangulated again."""


class MonoOdometry:
    """One run over a dataset by a seed of RANSAC; its unit of length is the way between the first two views."""

    def __init__(self, view: View, seed: int):
        self.view, self.rng, self.limit = view, np.random.default_rng([seed, 0]), REPROJECTION_PX * view.pixel
        self.poses, self.lost, self.speed = [np.eye(4)], [False], None
        self._begin(0, view.gray(0))

    def run(self) -> tuple[np.ndarray, np.ndarray]:
        """T_c_w [N, 4, 4] of all frames and which were lost [N]: these go on as before, and others begin from them."""
        for index in range(1, len(self.view.data)):
            gray = self.view.gray(index)
            there, found = follow(self.gray, gray, self.pixels)
            self._keep(found)
            self.pixels, self.gray = there[found], gray
            self.poses.append(carried_on(self.poses))
            self.lost.append(True)
            self._solve(index)
            self._replenish(index)
        return np.array(self.poses), np.array(self.lost)

    def _begin(self, index: int, gray: np.ndarray) -> None:
        """Forget all points; the next two views begin with this frame."""
        self.start, self.started, self.gray, self.history = index, False, gray, {}
        self.pixels = corners(gray, np.zeros((0, 2)))
        self.first = self.view.normalised(self.pixels)
        """Normalised place of each corner at the frame in which it was first seen, which `anchor` numbers."""
        self.anchor, self.angle = np.full(len(self.pixels), index), np.zeros(len(self.pixels))
        self.points = np.full((len(self.pixels), 3), np.nan)

    def _keep(self, kept: np.ndarray) -> None:
        for name in ("pixels", "first", "anchor", "angle", "points"):
            setattr(self, name, getattr(self, name)[kept])
        self.history = {index: seen[kept] for index, seen in self.history.items()}

    def _solve(self, index: int) -> None:
        seen = self.view.normalised(self.pixels)
        if not self.started:
            self._start(index, seen)
            return
        there = np.flatnonzero(np.isfinite(self.points).all(1))
        solved = pose_of(self.points[there], seen[there], self.limit, self.rng)
        if solved is None:
            self._begin(index, self.gray)
            return
        self.poses[-1], self.lost[-1] = solved[0], False
        self._remember_speed()
        kept = np.ones(len(seen), bool)
        kept[there[~solved[1]]] = False
        self._keep(kept)
        self._grow(seen[kept])

    def _remember_speed(self) -> None:
        if not self.lost[-2]:
            step = self.poses[-1] @ np.linalg.inv(self.poses[-2])
            self.speed = float(np.linalg.norm(step[:3, 3]))

    def _start(self, index: int, seen: np.ndarray) -> None:
        """The first two views, once they are far enough apart; what lies between follows from their points."""
        if len(seen) < 2 * LEAST:
            self._begin(index, self.gray)
            return
        T = self._two_views(seen)
        if T is not None:
            T_first = self.poses[self.start]
            T[:3, 3] *= 1.0 if self.speed is None else max(self.speed, 1e-9) * (index - self.start)
            T = T @ T_first
            points = triangulated(T_first, T, self.first, seen, self.limit)
            good = np.isfinite(points).all(1)
            angle = parallax(T_first, T, points)
            if good.sum() >= 2 * LEAST and np.median(angle[good]) >= START_ANGLE:
                self._take_start(T, points, np.where(good, angle, 0.0))
                return
        self.history[index] = seen

    def _two_views(self, seen: np.ndarray) -> np.ndarray | None:
        """Find the motion from the first view to this one [4, 4], a step of length 1."""
        cv2, order = opencv(), self.rng.permutation(len(seen))
        a, b = self.first[order], seen[order]
        E, mask = cv2.findEssentialMat(
            a, b, np.eye(3), method=cv2.USAC_ACCURATE, prob=0.999, threshold=START_LIMIT * self.limit
        )
        if E is None or E.shape != (3, 3):
            return None
        count, R, t, _ = cv2.recoverPose(E, a, b, np.eye(3), mask=mask)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, t.ravel()
        return T if count >= 2 * LEAST else None

    def _take_start(self, T: np.ndarray, points: np.ndarray, angle: np.ndarray) -> None:
        self.started, self.points, self.angle = True, points, angle
        self.poses[-1], self.lost[-1] = T, False
        good = np.isfinite(points).all(1)
        for index, seen in self.history.items():
            solved = pose_of(points[good], seen[good], self.limit, self.rng)
            if solved is not None:
                self.poses[index], self.lost[index] = solved[0], False
        self.history = {}
        self._remember_speed()
        if self.speed is None:
            self.speed = 1.0 / (len(self.poses) - 1 - self.start)
        self._keep(good)

    def _grow(self, seen: np.ndarray) -> None:
        """Triangulate corners from the frame that first saw them and this one: new ones, and those seen wider now."""
        for anchor in np.unique(self.anchor):
            rows, T_first = np.flatnonzero(self.anchor == anchor), self.poses[anchor]
            points = triangulated(T_first, self.poses[-1], self.first[rows], seen[rows], self.limit)
            angle = parallax(T_first, self.poses[-1], points)
            with np.errstate(invalid="ignore"):
                wider = angle >= np.maximum(START_ANGLE, WIDER * self.angle[rows])
            self.points[rows[wider]], self.angle[rows[wider]] = points[wider], angle[wider]

    def _replenish(self, index: int) -> None:
        """New corners where a pose is known and many are gone."""
        if not self.started or self.lost[-1]:
            return
        more = corners(self.gray, self.pixels)
        if len(more):
            self.pixels = np.concatenate([self.pixels, more])
            self.first = np.concatenate([self.first, self.view.normalised(more)])
            self.anchor = np.concatenate([self.anchor, np.full(len(more), index)])
            self.angle = np.concatenate([self.angle, np.zeros(len(more))])
            self.points = np.concatenate([self.points, np.full((len(more), 3), np.nan)])
