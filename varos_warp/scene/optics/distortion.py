"""Lens distortion by Brown-Conrady and Kannala-Brandt, with OpenCV's parameters in OpenCV's order, and its inverse.

A point of the image plane is ((u - cx) / fx, (v - cy) / fy). With x = X/Z, y = Y/Z and r^2 = x^2 + y^2 a direction
(X, Y, Z) is seen

    brown_conrady (k1, k2, p1, p2, k3)   at (x, y) (1 + k1 r^2 + k2 r^4 + k3 r^6), plus 2 p1 xy + p2 (r^2 + 2 x^2) in x
                                         and p1 (r^2 + 2 y^2) + 2 p2 xy in y (OpenCV's calib3d);
    kannala_brandt (k1, k2, k3, k4)      at a distance a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) from the centre, a the
                                         angle to the axis (OpenCV's fisheye), which may exceed 90 degrees.

A lens sees each direction once. Where a polynomial falls again, the model says otherwise: it folds.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from varos_warp.scene.optics.roots import solve_increasing

BROWN_CONRADY, KANNALA_BRANDT = "brown_conrady", "kannala_brandt"
MOST_TAN = 1e4
"""Tangent of the largest angle to the axis that Brown-Conrady is used for."""
STEPS = 30
"""Most of Newton's steps in two dimensions; tangential distortion is small, and 3 are enough."""


@dataclass(frozen=True)
class Lens:
    """Between directions in air, camera axes, and points of the image plane."""

    model: str = "none"
    """none, brown_conrady or kannala_brandt."""
    k: tuple[float, ...] = ()
    """Coefficients in OpenCV's order."""

    def __post_init__(self) -> None:
        if self.model not in ("none", BROWN_CONRADY, KANNALA_BRANDT):
            raise ValueError(f"there is no lens {self.model!r} here")

    @property
    def _radial(self) -> np.ndarray:
        """Coefficients of r^3, r^5, r^7 ..."""
        return np.array(self.k)[[0, 1, 4]] if self.model == BROWN_CONRADY else np.array(self.k)

    @cached_property
    def limit(self) -> float:
        """Where the radial polynomial folds or its use ends: tangent (brown_conrady) or angle [rad] of the axis."""
        odd = np.arange(3, 3 + 2 * len(self._radial), 2)
        roots = np.roots([*(odd * self._radial)[::-1], 1.0])
        folds = np.sqrt(roots[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)].real)
        return float(min([MOST_TAN if self.model == BROWN_CONRADY else np.pi, *folds]))

    def reach(self, corners: np.ndarray) -> float:
        """Tangent or angle of the axis that no point of an image exceeds; at most `limit`.

        Args:
            corners: Its first and last point [2, 2] in the image plane.
        """
        border = np.linspace(*corners, 65)
        x, y = np.meshgrid(border[:, 0], border[:, 1])
        d = self.directions(np.stack([x, y], -1))
        angle = np.arctan2(np.hypot(d[..., 0], d[..., 1]), d[..., 2]).max()
        # between the places tried, a little more
        return min(1.1 * float(np.tan(angle) if self.model == BROWN_CONRADY else angle), self.limit)

    def _along_radius(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance from the centre, and its slope, by tangent or angle."""
        value, slope, power = np.ones_like(r), np.ones_like(r), np.ones_like(r)
        for i, k in enumerate(self._radial):
            power = power * r * r
            value, slope = value + k * power, slope + (2 * i + 3) * k * power
        return r * value, slope

    def image_plane(self, d: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the image plane at which directions [..., 3] of any length are seen; NaN if nowhere."""
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = np.where(d[..., 2:] > 0.0, d[..., :2] / d[..., 2:], np.nan)
        if self.model == BROWN_CONRADY:
            seen = np.hypot(xy[..., 0], xy[..., 1]) <= self.limit
            return np.where(seen[..., None], self._brown_conrady(xy)[0], np.nan)
        if self.model == KANNALA_BRANDT:
            beside = np.hypot(d[..., 0], d[..., 1])
            angle = np.arctan2(beside, d[..., 2])
            scale = np.where(angle <= self.limit, self._along_radius(angle)[0], np.nan)
            return d[..., :2] * (scale / np.where(beside > 0.0, beside, 1.0))[..., None]
        return xy

    def directions(self, xy: np.ndarray) -> np.ndarray:
        """Unit directions [..., 3] that are seen at points [..., 2] of the image plane; NaN where there is none."""
        if self.model == KANNALA_BRANDT:
            r = np.hypot(xy[..., 0], xy[..., 1])
            angle = self._undone(r)
            beside = xy * (np.sin(angle) / np.where(r > 0.0, r, 1.0))[..., None]
            return np.concatenate([beside, np.cos(angle)[..., None]], -1)
        if self.model == BROWN_CONRADY:
            xy = self._undistorted(xy)
        d = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], -1)
        return d / np.linalg.norm(d, axis=-1, keepdims=True)

    def _undone(self, r: np.ndarray) -> np.ndarray:
        """Tangent or angle at which the radial polynomial is r; NaN where it folds before."""
        x = solve_increasing(self._along_radius, r, 0.0, self.limit)
        return np.where(r <= self._along_radius(np.array(self.limit))[0], x, np.nan)

    def _brown_conrady(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distorted points [..., 2] of undistorted ones, and the Jacobian [..., 2, 2]."""
        k1, k2, p1, p2, k3 = self.k
        x, y = xy[..., 0], xy[..., 1]
        q = x * x + y * y
        scale, slope = 1.0 + q * (k1 + q * (k2 + q * k3)), k1 + q * (2.0 * k2 + q * 3.0 * k3)
        there = np.stack([x * scale + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
                          y * scale + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y], -1)
        across = 2.0 * x * y * slope + 2.0 * (p1 * x + p2 * y)
        rows = [np.stack([scale + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, across], -1),
                np.stack([across, scale + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x], -1)]
        return there, np.stack(rows, -2)

    def _undistorted(self, target: np.ndarray) -> np.ndarray:
        """The inverse of Brown-Conrady: the radial part alone, then Newton's steps for both."""
        r = np.hypot(target[..., 0], target[..., 1])
        start = solve_increasing(self._along_radius, r, 0.0, self.limit)
        xy = target * (start / np.where(r > 0.0, r, 1.0))[..., None]
        with np.errstate(all="ignore"):  # where there is no inverse, steps lead anywhere
            for _ in range(STEPS):
                there, J = self._brown_conrady(xy)
                off = there - target
                determinant = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] ** 2
                step = np.stack([J[..., 1, 1] * off[..., 0] - J[..., 0, 1] * off[..., 1],
                                 J[..., 0, 0] * off[..., 1] - J[..., 0, 1] * off[..., 0]], -1) / determinant[..., None]
                xy = xy - step
                if not (np.abs(step) > 1e-15 * (1.0 + np.abs(xy))).any():
                    break
            good = (np.abs(off).max(-1) < 1e-12 * (1.0 + r)) & (determinant > 0.0)
            good &= np.hypot(xy[..., 0], xy[..., 1]) <= self.limit
        return np.where(good[..., None], xy, np.nan)
