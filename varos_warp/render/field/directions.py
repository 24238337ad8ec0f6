"""Directions of light around a node of the field: it is even in phi, which runs over half a circle."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline


@dataclass(frozen=True, eq=False)
class Directions:
    """A grid of directions: gamma = pi s^power [rad] by phi [rad], ``s`` and ``phi`` increasing."""

    s: np.ndarray
    phi: np.ndarray
    power: int
    s_weights: np.ndarray | None = None

    @classmethod
    def quadrature(cls, gammas: int, phis: int, power: int) -> "Directions":
        """Directions for integrals: Gauss-Legendre in s, middles of steps in phi."""
        x, w = np.polynomial.legendre.leggauss(gammas)
        return cls((1.0 + x) / 2.0, np.pi * (np.arange(phis) + 0.5) / phis, power, w / 2.0)

    @classmethod
    def ends(cls, gammas: int, phis: int, power: int) -> "Directions":
        """Directions from end to end, for interpolation."""
        return cls(np.linspace(0.0, 1.0, gammas), np.linspace(0.0, np.pi, phis), power)

    @cached_property
    def gamma(self) -> np.ndarray:
        """Angles to the direction to the light [rad]."""
        return np.pi * self.s**self.power

    @cached_property
    def pairs(self) -> np.ndarray:
        """(gamma, phi) of each direction, [n, 2]."""
        return np.stack(np.meshgrid(self.gamma, self.phi, indexing="ij"), -1).reshape(-1, 2)

    @cached_property
    def weights(self) -> np.ndarray:
        """Solid angle [sr] of each direction of a quadrature and its mirror image, [n]."""
        return np.repeat(self._ring * 2.0 * np.pi / len(self.phi), len(self.phi))

    @property
    def _ring(self) -> np.ndarray:
        """Solid angle of each gamma of a quadrature, over 2 pi."""
        return np.sin(self.gamma) * np.pi * self.power * self.s ** (self.power - 1) * self.s_weights

    @cached_property
    def vectors(self) -> np.ndarray:
        """Unit vectors, z towards the light source and x towards its axis, [n, 3]."""
        gamma, phi = self.pairs.T
        return np.stack([np.sin(gamma) * np.cos(phi), np.sin(gamma) * np.sin(phi), np.cos(gamma)], 1)

    def fit(self, nodes: int) -> tuple["Directions", np.ndarray]:
        """Directions between these, ``nodes`` to a step of s, and the matrix from values there to values at these.

        Linear interpolation of the latter is nearest to the former, in the mean square over solid angle, so it keeps
        their integral. Values that are exact at the ends of the steps would be too large between them where they peak.
        """
        s, weights = _between(self.s, nodes)
        between = Directions(s, self.phi, self.power, weights)
        phi, weights = _between(self.phi, nodes)
        m = np.arange(len(self.phi))
        # values at these phi are a cosine series, which tells those between
        series = np.cos(np.outer(phi, m)) @ np.linalg.inv(np.cos(np.outer(self.phi, m)))
        return between, np.kron(_nearest(self.s, s, between._ring), _nearest(self.phi, phi, weights) @ series)

    def interpolation(self, others: "Directions", shape=np.ones_like) -> np.ndarray:
        """Matrix [others, n] from values at these of a quadrature: splines in gamma, a cosine series in phi.

        What is interpolated are the values over their ``shape``, a function of gamma.
        """
        s = (others.gamma / np.pi) ** (1.0 / self.power)
        along = make_interp_spline(self.s, np.eye(len(self.s)), k=3)(s)
        along *= shape(others.gamma)[:, None] / shape(self.gamma)
        m = np.arange(1, len(self.phi))
        series = 1.0 + 2.0 * np.cos(np.outer(others.phi, m)) @ np.cos(np.outer(m, self.phi))
        return np.kron(along, series / len(self.phi))


def _between(ends: np.ndarray, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of Gauss-Legendre in each step between ``ends``."""
    x, w = np.polynomial.legendre.leggauss(nodes)
    step = np.diff(ends)[:, None]
    return (ends[:-1, None] + step * (1.0 + x) / 2.0).ravel(), (step * w / 2.0).ravel()


def _nearest(ends: np.ndarray, at: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Matrix [ends, at]: values at ``ends`` between which linear interpolation is nearest to values ``at``."""
    hats = np.array([np.interp(at, ends, one) for one in np.eye(len(ends))])
    weighted = hats * weights
    return np.linalg.solve(weighted @ hats.T, weighted)


def irradiance_matrix(arriving: Directions, normals: Directions) -> np.ndarray:
    """Matrix [normals, arriving]: irradiance of planes, from radiance and its mirror image by a quadrature."""
    sides = (np.maximum(normals.vectors @ (arriving.vectors * [1, side, 1]).T, 0.0) for side in (-1, 1))
    return 0.5 * sum(sides) * arriving.weights
