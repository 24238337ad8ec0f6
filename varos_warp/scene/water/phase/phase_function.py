"""Phase functions on the host, in float64, and their records for the kernels.

Angles are given as s = (1 - cos theta)/2 = sin^2(theta/2), which loses no digits ahead. Solid angle is 4 pi ds.
"""

from abc import ABC, abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np
import warp as wp
from scipy.optimize import brentq

from varos_warp.kernels.world.phase import Phase
from varos_warp.scene.water.phase.power_table import LOG_S, LOG_STEP, S_CUT, PowerTable

SMALLEST_S = 1e-18
"""Lower end of densities that are infinite ahead: a cosine in float64 cannot tell smaller angles from 0."""

SMALLEST_ANGLE, BEAM_NODES = 1e-6, 256
ANGLE_LOG_STEP = np.log(np.pi / SMALLEST_ANGLE) / (BEAM_NODES - 2)
"""Smallest angle [rad], nodes, and step of its logarithm, of the table by which angles along a ray are sampled. It may
be coarse: samples are weighted by the density that it has."""


class PhaseFunction(ABC):
    """A phase function, normalised to 1 over the sphere."""

    kind: ClassVar[str]
    """Name in the scene file."""
    is_henyey_greenstein = False
    """True if kernels have its closed form; all others are tables there."""

    @property
    def key(self) -> tuple:
        """Kind and all that its values depend on, as numbers, strings and tuples: for caches in memory and on disk."""
        return (self.kind,)

    def __eq__(self, other) -> bool:
        return isinstance(other, PhaseFunction) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)

    @abstractmethod
    def density(self, s: np.ndarray) -> np.ndarray:
        """Density per solid angle, up to a factor, at s in (0, 1]."""

    @property
    def kinks(self) -> np.ndarray:
        """The s between which the density is smooth; quadrature has its panels end there."""
        return np.empty(0)

    def describe(self) -> dict:
        """Its facts in plain JSON types."""
        return {
            "kind": self.kind,
            "g": float(self.mean_cosine),
            "backscatter_fraction": float(self.backscatter_fraction),
        }

    def __repr__(self) -> str:
        return f"{type(self).__name__}{self.key[1:]}"

    # --------------------------------------------------------------------------------------------------------- values

    def eval(self, cos_theta) -> np.ndarray:
        """Density [1/sr] by the cosine of the scattering angle; 1 is straight on."""
        return self.eval_s(0.5 * (1.0 - np.asarray(cos_theta, float)))

    def eval_s(self, s) -> np.ndarray:
        """Density [1/sr] by s = sin^2(theta/2), as right ahead as anywhere."""
        return self.density(np.clip(np.asarray(s, float), SMALLEST_S, 1.0)) / self.integral

    def cdf(self, s) -> np.ndarray:
        """Share of the light that is scattered by at most the angle of ``s``."""
        return self.table.cdf_at(s)

    def sample(self, u) -> np.ndarray:
        """Cosines that shares ``u`` in [0, 1] of the light stay below: -1 at 0, 1 at 1."""
        return 1.0 - 2.0 * self.table.sample(1.0 - np.asarray(u, float))

    # --------------------------------------------------------------------------------------------------------- moments

    def moments(self, n: int) -> np.ndarray:
        """Legendre moments chi_0 .. chi_n: means of P_l(cos theta), float64 [n + 1]; for n up to several hundred."""
        s, weights = self._quadrature
        weights = weights * self.density(s) / self.integral
        cosine, ahead = 1.0 - 2.0 * s, self.light_ahead / self.integral
        chi, before, P = np.empty(n + 1), np.zeros_like(s), np.ones_like(s)
        for order in range(n + 1):
            chi[order] = ahead + weights @ P
            before, P = P, ((2 * order + 1) * cosine * P - order * before) / (order + 1)
        return chi

    @cached_property
    def mean_cosine(self) -> float:
        """Mean of cos theta, g."""
        return float(self.moments(1)[1])

    @cached_property
    def backscatter_fraction(self) -> float:
        """Share of the light that is scattered by more than 90 degrees, B = b_b/b."""
        s, weights = self._quadrature
        behind = s > 0.5  # 90 degrees is an end of panels
        return float(weights[behind] @ self.density(s[behind]) / self.integral)

    @cached_property
    def integral(self) -> float:
        """Integral of `density` over the sphere."""
        s, weights = self._quadrature
        return float(self.light_ahead + weights @ self.density(s))

    @cached_property
    def light_ahead(self) -> float:
        """Integral of `density` below S_CUT, where all of them are powers of s."""
        nearer, p = self.density(np.array([S_CUT / np.e, S_CUT]))
        slope = np.log(p / nearer) if p > 0.0 else 0.0
        return float(4.0 * np.pi * S_CUT * p / (1.0 + slope))

    @cached_property
    def _quadrature(self) -> tuple[np.ndarray, np.ndarray]:
        """Nodes s from S_CUT to 1, and their weights in solid angle [sr].

        Gauss and Legendre's rule in panels of log tan(theta/2), in which peaks ahead and behind are wide; narrow enough
        for several hundred oscillations of a Legendre polynomial.
        """
        nearest, farthest = 0.5 * np.log(S_CUT), 18.0
        kinks = np.clip(self.kinks, S_CUT, 1.0 - 1e-12)
        even = np.concatenate([np.linspace(nearest, 0.0, 281), np.linspace(0.0, farthest, 281)])
        edges = np.unique(np.concatenate([even, 0.5 * np.log(kinks / (1.0 - kinks))]))
        x, w = np.polynomial.legendre.leggauss(16)
        middle, half = 0.5 * (edges[1:] + edges[:-1])[:, None], 0.5 * np.diff(edges)[:, None]
        t = (middle + half * x).ravel()
        s, rest = 1.0 / (1.0 + np.exp(-2.0 * t)), 1.0 / (1.0 + np.exp(2.0 * t))
        return s, 8.0 * np.pi * (half * w).ravel() * s * rest

    # ------------------------------------------------------------------------------------------------------ the device

    @cached_property
    def table(self) -> PowerTable:
        """The table that kernels get, in float64.

        Light below S_CUT, which may grow without bound ahead, keeps its share: the first node, just below, is so high
        that the table has as much light up to S_CUT as there is.
        """
        p = self.eval_s(np.exp(LOG_S))
        p = np.maximum(p, 1e-30 * p.max())
        # light up to S_CUT over that of a constant density
        inner = self.light_ahead / self.integral / (4.0 * np.pi * S_CUT * p[1])

        def too_much(rise):
            """Excess of light up to S_CUT with the first node e^rise times as high as the second."""
            m = LOG_STEP - rise
            bin_share = np.expm1(m) / m if abs(m) > 1e-12 else 1.0
            return np.exp(rise - LOG_STEP) * (1.0 + LOG_STEP * bin_share) - inner

        log_p = np.log(p)
        log_p[0] = log_p[1] + brentq(too_much, -20.0, 20.0)
        return PowerTable(log_p)

    @cached_property
    def _on_devices(self) -> dict[str, list[wp.array]]:
        return {}

    @cached_property
    def _beam(self) -> tuple[np.ndarray, ...]:
        """Angles [rad], minus the integral of the density over the angles beyond each of them, and means between."""
        angle = np.append(0.0, np.geomspace(SMALLEST_ANGLE, np.pi, BEAM_NODES - 1))
        x, w = np.polynomial.legendre.leggauss(8)
        step = np.diff(angle)[:, None]
        theta = angle[:-1, None] + step * (1.0 + x) / 2.0
        density = self.eval_s(np.sin(theta / 2.0) ** 2) @ w / 2.0
        density = np.maximum(density, 1e-12 * density.max())  # any angle may be drawn
        return angle, -np.append(np.cumsum((density * step[:, 0])[::-1])[::-1], 0.0), density

    def device_record(self, device: str) -> Phase:
        """What kernels know of it. Its arrays live as long as this object does."""
        record = Phase()
        record.g = self.mean_cosine
        device = str(device)
        if device not in self._on_devices:
            density = () if self.is_henyey_greenstein else (self.table.log_p, self.table.cdf)
            self._on_devices[device] = [
                wp.array(values.astype(np.float32), dtype=float, device=device) for values in (*self._beam, *density)
            ]
        record.angle, record.angle_integral, record.angle_density, *density = self._on_devices[device]
        record.angle_log_step = float(ANGLE_LOG_STEP)
        if density:
            record.log_p, record.cdf = density
            record.log_first, record.log_step = float(LOG_S[0]), float(LOG_STEP)
        return record
