"""Lenses whose view may exceed 180 degrees: Kannala-Brandt's and the double sphere, and their inverses."""

from abc import ABC, abstractmethod
from functools import cached_property

import numpy as np

from varos_warp.scene.optics.polynomials import first_fold, odd_polynomial
from varos_warp.scene.optics.roots import solve_increasing, solve_shortly


class Fisheye(ABC):
    """A lens that is measured by the angle to the axis, and whose image rises up to where it ends."""

    @property
    @abstractmethod
    def limit(self) -> float:
        """Half angle of the cone that the lens sees [rad]."""

    @property
    def radial_end(self) -> float:
        """Angle [rad] up to which the distance from the centre rises."""
        return self.limit

    @property
    def half_angle(self) -> float:
        """Half angle of the cone that the lens sees [rad]."""
        return self.limit

    def measure(self, angle: float) -> float:
        """The angle [rad], in which `limit` is."""
        return angle


class KannalaBrandt(Fisheye):
    """OpenCV's fisheye with k1, k2, k3, k4.

    A direction at an angle a to the axis is seen at a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8) from the centre.
    """

    def __init__(self, k: tuple[float, ...]):
        self.k = k

    @cached_property
    def limit(self) -> float:
        """Half angle of the cone that the lens sees [rad]: where the polynomial ceases to rise, or pi."""
        return first_fold(self.k, np.pi)

    def image_plane(self, d: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the image plane at which directions [..., 3] of any length are seen; NaN if nowhere."""
        beside = np.hypot(d[..., 0], d[..., 1])
        angle = np.arctan2(beside, d[..., 2])
        scale = np.where(angle <= self.limit, odd_polynomial(self.k, angle)[0], np.nan)
        return d[..., :2] * (scale / np.where(beside > 0.0, beside, 1.0))[..., None]

    def directions(self, xy: np.ndarray) -> np.ndarray:
        """Unit directions [..., 3] that are seen at points [..., 2] of the image plane; NaN where there is none."""
        r = np.hypot(xy[..., 0], xy[..., 1])
        angle = solve_increasing(lambda a: odd_polynomial(self.k, a), r, 0.0, self.limit)
        angle = np.where(r <= odd_polynomial(self.k, np.array(self.limit))[0], angle, np.nan)
        beside = xy * (np.sin(angle) / np.where(r > 0.0, r, 1.0))[..., None]
        return np.concatenate([beside, np.cos(angle)[..., None]], -1)

    def short_directions(self, xy: np.ndarray, reach: float, halvings: int, steps: int) -> np.ndarray:
        """Directions [N, 3] that kernels find in float32 for points [N, 2], at angles up to ``reach`` [rad]."""
        r = np.hypot(xy[..., 0], xy[..., 1])
        angle = solve_shortly(lambda a: odd_polynomial(self.k, a), r, reach, halvings, steps)
        beside = xy * (np.sin(angle) / np.where(r > 0.0, r, 1.0))[:, None]
        return np.concatenate([beside, np.cos(angle)[:, None]], -1)


class DoubleSphere(Fisheye):
    """The double sphere of Usenko, Demmel and Cremers (2018), https://arxiv.org/abs/1807.08957, with xi and alpha.

    A unit vector (x, y, z) is seen at (x, y) / (alpha d + (1 - alpha)(xi + z)), d = |(x, y, xi + z)|: in the middle at
    1 / (1 + xi) of its tangent. From the centre of the second sphere it is at an angle b to the axis, and the distance
    from the centre of the image rises while cos b > -w, w = alpha / (1 - alpha) or its reciprocal, whichever is below
    1, and b with the angle of (x, y, z) while 1 + xi z > 0. The paper's condition on z is a little narrower than that,
    by terms of xi^2, and than what its own inverse gives.
    """

    def __init__(self, k: tuple[float, ...]):
        self.xi, self.alpha = k

    @cached_property
    def limit(self) -> float:
        """Half angle of the cone that the lens sees [rad]."""
        xi, cosine = self.xi, -self._w
        if xi > 1.0:
            return float(np.arccos(-1.0 / xi))
        d = xi * cosine + np.sqrt(1.0 - xi * xi * (1.0 - cosine * cosine))
        return float(np.arccos(np.clip(d * cosine - xi, -1.0, 1.0)))

    @property
    def _w(self) -> float:
        low, high = sorted((self.alpha, 1.0 - self.alpha))
        return low / high

    def image_plane(self, d: np.ndarray) -> np.ndarray:
        """Points [..., 2] of the image plane at which directions [..., 3] of any length are seen; NaN if nowhere."""
        d = d / np.linalg.norm(d, axis=-1, keepdims=True)
        z = self.xi + d[..., 2]
        far = np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2 + z * z)
        seen = (z > -self._w * far) & (1.0 + self.xi * d[..., 2] > 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(seen, 1.0 / (self.alpha * far + (1.0 - self.alpha) * z), np.nan)
        return d[..., :2] * scale[..., None]

    def directions(self, xy: np.ndarray) -> np.ndarray:
        """Unit directions [..., 3] that are seen at points [..., 2] of the image plane; NaN where there is none."""
        xi, alpha = self.xi, self.alpha
        q = (xy**2).sum(-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            # from the centre of the second sphere, then where that line meets the first
            z = (1.0 - alpha**2 * q) / (alpha * np.sqrt(1.0 - (2.0 * alpha - 1.0) * q) + 1.0 - alpha)
            scale = (z * xi + np.sqrt(z * z + (1.0 - xi * xi) * q)) / (z * z + q)
        return np.concatenate([scale[..., None] * xy, (scale * z - xi)[..., None]], -1)
