"""Lenses that distort the image of a pinhole, Brown-Conrady and OpenCV's rational model, and their inverse.

With x = X/Z, y = Y/Z and r^2 = x^2 + y^2 a direction (X, Y, Z) is seen at (x, y) s, plus 2 p1 xy + p2 (r^2 + 2 x^2) in
x and p1 (r^2 + 2 y^2) + 2 p2 xy in y. The map is the gradient of a potential, r^2 (p2 x + p1 y) plus the integral of
r s, so its Jacobian is symmetric. On the widest disk of (x, y) on which that is positive definite the potential is
strictly convex, so that the lens sees each direction once. There its cone ends: what lies outside is not seen.
"""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np
from numpy.polynomial import Polynomial

from varos_warp.scene.optics.polynomials import even, first_fold, odd_polynomial, positive_roots
from varos_warp.scene.optics.roots import solve_increasing, solve_shortly

MOST_TAN = 1e4
"""Tangent of the largest angle to the axis that these lenses are used for."""
STEPS, CAREFUL_STEPS = 30, 200
"""Most of Newton's steps in two dimensions: 3 are enough but close to a fold, where each halves the error; and of those
that follow where they fail."""
BEFORE_A_POLE = 1.0 - 1e-9
"""Share of the way to where a rational model is infinite."""


class Perspective(ABC):
    """What both models share; ``k`` are OpenCV's coefficients k1, k2, p1, p2, k3 (, k4, k5, k6)."""

    def __init__(self, k: tuple[float, ...]):
        self.k = k

    @abstractmethod
    def _scale(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factor s [...] of the radius and its slope ds/dq at q = r^2 [...]."""

    @abstractmethod
    def _along_radius(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance r s [...] from the centre, without tangential distortion, and its slope by the tangent r [...]."""

    @property
    def radial_end(self) -> float:
        """Tangent at which r s ceases to rise, or the largest in use."""
        return self.limit

    @cached_property
    def limit(self) -> float:
        """Tangent of the half angle of the cone that the lens sees."""
        return self._first_fold()

    def _first_fold(self) -> float:
        """Tangent at which the Jacobian is first singular, in whichever direction.

        With p = |(p1, p2)|, f = r s and c the cosine of the azimuth against (p2, p1), its determinant is
        (f' + 6 p r c)(f/r + 2 p r c) - 4 p^2 r^2 (1 - c^2). That vanishes first at c = -1, in one factor or the other,
        or between if p is very large.
        """
        k1, k2, p1, p2, k3, *below = self.k
        r, top, bottom = Polynomial([0.0, 1.0]), even((k1, k2, k3)), even(below)
        slope, ratio = (r * top).deriv() * bottom - r * top * bottom.deriv(), top * bottom  # f' and f/r, times bottom^2
        tilt = float(np.hypot(p1, p2)) * r * bottom * bottom
        between = positive_roots((slope - ratio) * (9.0 * ratio - slope) - 64.0 * tilt * tilt)
        between = between[slope(between) + 3.0 * ratio(between) < 16.0 * tilt(between)]
        return float(
            min(
                [
                    MOST_TAN,
                    *between,
                    *positive_roots(slope - 6.0 * tilt),
                    *positive_roots(ratio - 2.0 * tilt),
                    *(BEFORE_A_POLE * positive_roots(bottom)),
                ]
            )
        )

    @property
    def half_angle(self) -> float:
        """Half angle of the cone that the lens sees [rad]."""
        return float(np.arctan(self.limit))

    def measure(self, angle: float) -> float:
        """Tangent, in which `limit` is, of an angle to the axis [rad]."""
        return float(np.tan(angle))

    def image_plane(self, d: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the image plane at which directions [..., 3] of any length are seen; NaN if nowhere."""
        xy = tangents(d)
        seen = np.hypot(xy[..., 0], xy[..., 1]) <= self.limit
        return np.where(seen[..., None], self._distorted(xy)[0], np.nan)

    def directions(self, xy: np.ndarray) -> np.ndarray:
        """Unit directions [..., 3] that are seen at points [..., 2] of the image plane; NaN where there is none."""
        return along(self._undistorted(xy))

    def short_directions(self, xy: np.ndarray, reach: float, halvings: int, steps: int) -> np.ndarray:
        """Directions [N, 3] of any length that kernels find in float32 for points [N, 2], of tangents up to ``reach``.

        Halvings and Newton's steps solve the radial part, as many steps then both.
        """
        r = np.hypot(xy[..., 0], xy[..., 1])
        found = xy * (solve_shortly(self._along_radius, r, reach, halvings, steps) / np.where(r > 0.0, r, 1.0))[:, None]
        for _ in range(steps):
            found = found - self._step(found, xy)[0]
        return np.concatenate([found, np.ones_like(found[:, :1])], -1)

    def _distorted(self, xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distorted points [..., 2] of undistorted ones, and the Jacobian [..., 2, 2]."""
        p1, p2 = self.k[2:4]
        x, y = xy[..., 0], xy[..., 1]
        q = x * x + y * y
        scale, slope = self._scale(q)
        there = np.stack(
            [
                x * scale + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
                y * scale + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
            ],
            -1,
        )
        across = 2.0 * x * y * slope + 2.0 * (p1 * x + p2 * y)
        rows = [
            np.stack([scale + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, across], -1),
            np.stack([across, scale + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x], -1),
        ]
        return there, np.stack(rows, -2)

    @cached_property
    def _outermost(self) -> float:
        """A distance from the centre of the image plane beyond which nothing is seen."""
        azimuth = np.linspace(0.0, 2.0 * np.pi, 721)
        with np.errstate(over="ignore"):
            edge = self._distorted(self.limit * np.stack([np.cos(azimuth), np.sin(azimuth)], -1))[0]
            return float((1.0 + 1e-4) * np.hypot(edge[:, 0], edge[:, 1]).max())

    def _undistorted(self, target: np.ndarray) -> np.ndarray:
        """Tangents [..., 2] seen at points [..., 2]: the radial part alone, then Newton's steps for both."""
        r = np.hypot(target[..., 0], target[..., 1])
        target = np.where((r <= self._outermost)[..., None], target, np.nan)
        start = np.minimum(solve_increasing(self._along_radius, r, 0.0, self.radial_end), self.limit)
        xy = target * (start / np.where(r > 0.0, r, 1.0))[..., None]
        with np.errstate(all="ignore"):  # where there is no inverse, steps lead anywhere
            for _ in range(STEPS):
                step = self._step(xy, target)[0]
                xy = xy - step
                if not (np.abs(step) > 1e-15 * (1.0 + np.abs(xy))).any():
                    break
            good = np.asarray(self._is_seen_at(xy, target))
            again = ~good & np.isfinite(target).all(-1)
            if again.any():
                xy[again] = self._with_care(target[again])
                good[again] = self._is_seen_at(xy[again], target[again])
        return np.where(good[..., None], xy, np.nan)

    def _step(self, xy: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Newton's step [..., 2] from tangents to those seen at points, how far off [..., 2], and the determinant."""
        there, J = self._distorted(xy)
        off = there - target
        determinant = J[..., 0, 0] * J[..., 1, 1] - J[..., 0, 1] ** 2
        step = (
            np.stack(
                [
                    J[..., 1, 1] * off[..., 0] - J[..., 0, 1] * off[..., 1],
                    J[..., 0, 0] * off[..., 1] - J[..., 0, 1] * off[..., 0],
                ],
                -1,
            )
            / determinant[..., None]
        )
        return step, off, determinant

    def _is_seen_at(self, xy: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Return whether tangents [..., 2] lie in the cone, and are seen at points [..., 2]."""
        _, off, determinant = self._step(xy, target)
        good = (np.abs(off).max(-1) < 1e-12 * (1.0 + np.hypot(target[..., 0], target[..., 1]))) & (determinant > 0.0)
        return good & (np.hypot(xy[..., 0], xy[..., 1]) <= self.limit)

    def _with_care(self, target: np.ndarray) -> np.ndarray:
        """Tangents [N, 2] seen at points [N, 2] by steps from the axis that stay in the cone and come nearer each time.

        Along Newton's direction the error falls in proportion, so that a short enough step always does.
        """
        xy, size = np.zeros_like(target), np.ones((len(target), 1))
        step, off, _ = self._step(xy, target)
        for _ in range(CAREFUL_STEPS):
            new = xy - size * step
            new_step, new_off, determinant = self._step(new, target)
            nearer = (np.square(new_off).sum(-1) < np.square(off).sum(-1)) & (determinant > 0.0)
            nearer = (nearer & (np.hypot(new[:, 0], new[:, 1]) <= self.limit))[:, None]
            xy, step, off = (np.where(nearer, *pair) for pair in ((new, xy), (new_step, step), (new_off, off)))
            size = np.where(nearer, np.minimum(2.0 * size, 1.0), 0.5 * size)
        return xy


class BrownConrady(Perspective):
    """OpenCV's calib3d with k1, k2, p1, p2, k3: s = 1 + k1 r^2 + k2 r^4 + k3 r^6."""

    @cached_property
    def radial_end(self) -> float:
        """Tangent at which r s ceases to rise, or the largest in use."""
        return first_fold(self._radial, MOST_TAN)

    @cached_property
    def limit(self) -> float:
        """Tangent of the half angle of the cone that the lens sees."""
        return min(self._first_fold(), self.radial_end) if any(self.k[2:4]) else self.radial_end

    @property
    def _radial(self) -> tuple[float, float, float]:
        return self.k[0], self.k[1], self.k[4]

    def _scale(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k1, k2, k3 = self._radial
        return 1.0 + q * (k1 + q * (k2 + q * k3)), k1 + q * (2.0 * k2 + q * 3.0 * k3)

    def _along_radius(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return odd_polynomial(self._radial, r)


class Rational(Perspective):
    """OpenCV's rational model with k1, k2, p1, p2, k3, k4, k5, k6.

    s = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6).
    """

    def _scale(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        k1, k2, _, _, k3, k4, k5, k6 = self.k
        bottom = 1.0 + q * (k4 + q * (k5 + q * k6))
        scale = (1.0 + q * (k1 + q * (k2 + q * k3))) / bottom
        return scale, (k1 + q * (2.0 * k2 + q * 3.0 * k3) - scale * (k4 + q * (2.0 * k5 + q * 3.0 * k6))) / bottom

    def _along_radius(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        scale, slope = self._scale(r * r)
        return r * scale, scale + 2.0 * r * r * slope


def tangents(d: np.ndarray) -> np.ndarray:
    """X/Z and Y/Z [..., 2] of directions [..., 3]; NaN of those that do not point forwards."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(d[..., 2:] > 0.0, d[..., :2] / d[..., 2:], np.nan)


def along(xy: np.ndarray) -> np.ndarray:
    """Unit directions [..., 3] of tangents [..., 2]."""
    d = np.concatenate([xy, np.ones((*xy.shape[:-1], 1))], -1)
    return d / np.linalg.norm(d, axis=-1, keepdims=True)
