"""Flat and dome ports: rays from the lens through glass into the water, and back from a point to the lens.

Camera axes, origin at the lens (its entrance pupil), air around it. Light that is reflected within the glass is left
out: a ten-thousandth of the light on axis. From air into denser media there is no total reflection.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.scene.optics.roots import solve_increasing


class WaterRays(NamedTuple):
    """Rays behind a port, NaN and transmittance 0 where there is none."""

    origin: np.ndarray
    """Points on the outer surface [..., 3] [m]."""
    direction: np.ndarray
    """Unit vectors [..., 3]."""
    transmittance: np.ndarray
    """Share of the light, unpolarised, that passes both surfaces [...]."""


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1, keepdims=True)


def refract(d: np.ndarray, n: np.ndarray, before: float, after: float) -> tuple[np.ndarray, np.ndarray]:
    """Direction [..., 3] behind a surface (Snell), and the shares of s and p waves that pass it [..., 2] (Fresnel).

    ``before`` and ``after`` are the indices on its sides, ``n``: normals along the way of the rays, ``d * n > 0``.
    """
    cos_before, ratio = _dot(d, n), before / after
    cos_after = np.sqrt(1.0 - ratio * ratio * (1.0 - cos_before * cos_before))
    s = (before * cos_before - after * cos_after) / (before * cos_before + after * cos_after)
    p = (after * cos_before - before * cos_after) / (after * cos_before + before * cos_after)
    return ratio * d + (cos_after - ratio * cos_before) * n, 1.0 - np.concatenate([s * s, p * p], -1)


def snell(angle: ArrayLike, before: float, after: float) -> np.ndarray:
    """Angle to the normal [rad] behind a surface between two indices; pi/2 where all is reflected."""
    return np.arcsin(np.clip(before / after * np.sin(angle), -1.0, 1.0))


def transmitted(angle: ArrayLike, indices: Sequence[float]) -> np.ndarray:
    """Share of unpolarised power that passes parallel surfaces, without what is reflected back and forth.

    Args:
        angle: To the normal, in the first medium [rad], any shape.
        indices: Refractive indices of the media in order.
    """
    angle, n, T = np.asarray(angle, float)[..., None], np.array([0.0, 0.0, 1.0]), 1.0
    d = np.concatenate([np.sin(angle), 0.0 * angle, np.cos(angle)], -1)
    for before, after in pairwise(indices):
        d, passed = refract(d, n, before, after)
        T = T * passed
    return T.mean(-1)


def _rays(origin, direction, transmittance, there) -> WaterRays:
    return WaterRays(
        np.where(there, origin, np.nan),
        np.where(there, direction, np.nan),
        np.where(there, transmittance, 0.0).mean(-1),
    )


@dataclass(frozen=True)
class FlatPort:
    """A pane; ``normal`` is its unit normal towards the water."""

    normal: tuple[float, float, float]
    distance_m: float
    """Distance from the lens to the glass, along the normal [m]."""
    thickness_m: float
    n_glass: float
    clear_radius_m: float | None = None
    """Clear radius of the outer face, around the foot of the perpendicular from the lens [m]; None: there is no rim."""

    @property
    def has_rim(self) -> bool:
        """True if some rays miss the glass by its size."""
        return self.clear_radius_m is not None

    def leave(self, o: np.ndarray, d: np.ndarray, n_water: float) -> WaterRays:
        """Rays in the water of rays from ``o`` along unit vectors ``d``, both [..., 3], in air."""
        n = np.array(self.normal)
        with np.errstate(invalid="ignore", divide="ignore"):
            there = _dot(d, n) > 0.0
            inner = o + (self.distance_m - _dot(o, n)) / _dot(d, n) * d
            in_glass, T = refract(d, n, 1.0, self.n_glass)
            outer = inner + self.thickness_m / _dot(in_glass, n) * in_glass
            in_water, T_outer = refract(in_glass, n, self.n_glass, n_water)
        if self.has_rim:
            there &= np.linalg.norm(outer - _dot(outer, n) * n, axis=-1, keepdims=True) <= self.clear_radius_m
        return _rays(outer, in_water, T * T_outer, there)

    def arrive(self, points: np.ndarray, n_water: float) -> np.ndarray:
        """Directions [..., 3] in air, unit vectors, whose rays from the lens reach points [..., 3]; NaN if none.

        With x the tangent of the angle in air, the ray is off the axis by distance x behind the air and by
        thickness x / sqrt(n^2 + (n^2 - 1) x^2) behind a layer of index n.
        """
        n = np.array(self.normal)
        depth = _dot(points, n)
        beside = points - depth * n
        r = np.linalg.norm(beside, axis=-1)
        layers = (
            (self.distance_m, 1.0),
            (self.thickness_m, self.n_glass),
            (depth[..., 0] - self.distance_m - self.thickness_m, n_water),
        )

        def off_axis(x):
            roots = [np.sqrt(index**2 + (index**2 - 1.0) * x * x) for _, index in layers]
            return (
                sum(t * x / root for (t, _), root in zip(layers, roots, strict=True)),
                sum(t * index**2 / root**3 for (t, index), root in zip(layers, roots, strict=True)),
            )

        x = solve_increasing(off_axis, r, 0.0, r / self.distance_m)
        cosine = 1.0 / np.sqrt(1.0 + x * x)
        d = cosine[..., None] * (n + beside * (x / np.where(r > 0.0, r, 1.0))[..., None])
        return np.where(depth > self.distance_m + self.thickness_m, d, np.nan)


@dataclass(frozen=True)
class DomePort:
    """A spherical shell around the lens."""

    centre: tuple[float, float, float]
    radius_m: float
    """Radius of the outer surface [m]."""
    thickness_m: float
    n_glass: float
    half_angle_deg: float | None = None
    """Half angle of the shell, at its centre, to the camera's axis; None: there is no rim."""

    @property
    def has_rim(self) -> bool:
        """True if some rays miss the glass by its size."""
        return self.half_angle_deg is not None

    @property
    def rim_cosine(self) -> float:
        """Cosine of the half angle."""
        return float(np.cos(np.radians(self.half_angle_deg)))

    @property
    def _inner(self) -> float:
        return self.radius_m - self.thickness_m

    def leave(self, o: np.ndarray, d: np.ndarray, n_water: float) -> WaterRays:
        """Rays in the water of rays from ``o`` along unit vectors ``d``, both [..., 3], in air."""
        centre = np.array(self.centre)
        inner, n = _to_sphere(o - centre, d, self._inner)
        in_glass, T = refract(d, n, 1.0, self.n_glass)
        outer, n = _to_sphere(inner, in_glass, self.radius_m)
        in_water, T_outer = refract(in_glass, n, self.n_glass, n_water)
        there = np.isfinite(T[..., :1])
        if self.has_rim:
            there &= n[..., 2:] >= self.rim_cosine
        return _rays(outer + centre, in_water, T * T_outer, there)

    def arrive(self, points: np.ndarray, n_water: float) -> np.ndarray:
        """Directions [..., 3] in air, unit vectors, whose rays from the lens reach points [..., 3]; NaN if none.

        The ray stays in the plane of lens, centre and point. Index times distance from the centre, b, is the same in
        all media, so by angle a between the ray in air and the line from the centre through the lens, the ray turns
        around the centre by a - asin(b / r) at radius r in air, and by asin(b / (n r)) less behind.
        """
        start, there = -np.array(self.centre), points - np.array(self.centre)
        off, s = float(np.linalg.norm(start)), np.linalg.norm(there, axis=-1)
        axis = start / off if off > 0.0 else np.array([0.0, 0.0, 1.0])
        beside = there - _dot(there, axis) * axis
        r = np.linalg.norm(beside, axis=-1)
        shells = (
            (-1.0, 1.0, self._inner),
            (1.0, self.n_glass, self._inner),
            (-1.0, self.n_glass, self.radius_m),
            (1.0, n_water, self.radius_m),
            (-1.0, n_water, s),
        )

        def turned(a):
            b, slope = off * np.sin(a), off * np.cos(a)
            sines = [b / (n * radius) for _, n, radius in shells]
            return (
                a + sum(sign * np.arcsin(sine) for (sign, _, _), sine in zip(shells, sines, strict=True)),
                1.0
                + slope
                * sum(
                    sign / (n * radius * np.sqrt(1.0 - sine * sine))
                    for (sign, n, radius), sine in zip(shells, sines, strict=True)
                ),
            )

        outside = s > self.radius_m
        with np.errstate(invalid="ignore", divide="ignore"):
            a = solve_increasing(turned, np.arctan2(r, _dot(there, axis)[..., 0]), 0.0, np.pi)
        d = np.cos(a)[..., None] * axis + beside * (np.sin(a) / np.where(r > 0.0, r, 1.0))[..., None]
        return np.where(outside[..., None], d, np.nan)


def _to_sphere(o: np.ndarray, d: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Points where rays from within a sphere around the origin leave it, and its outward normals there."""
    along = _dot(o, d)
    p = o + (np.sqrt(along * along - _dot(o, o) + radius * radius) - along) * d
    return p, p / radius


Port = FlatPort | DomePort
