"""A phase function as the kernels have it (kernels/world/phase.py), in float64: a power of s between nodes in log s.

s = (1 - cos theta)/2 = sin^2(theta/2), so that solid angle is 4 pi ds.
"""

import numpy as np

S_CUT = float(np.sin(np.radians(0.5e-4)) ** 2)
"""s at 1e-4 degrees, the second node. Below the first one the density is constant: no camera, and no direction in
float32, tells such angles apart."""
NODES = 8192
"""Number of nodes: the error of smooth phase functions is below 1e-5 (docs/phase_functions.md). They take
64 kB in all on a device."""
LOG_STEP = -np.log(S_CUT) / (NODES - 2)
LOG_S = np.linspace(np.log(S_CUT) - LOG_STEP, 0.0, NODES)
"""Nodes in log s, [NODES]."""


class PowerTable:
    """Density [1/sr] at the nodes LOG_S, constant below the first, normalised to 1 exactly.

    Args:
        log_p: Logarithm of the density at the nodes, normalised to about 1.
    """

    def __init__(self, log_p: np.ndarray):
        light = np.exp(log_p + LOG_S) * 4.0 * np.pi
        slope = np.diff(log_p) + LOG_STEP
        share = np.concatenate([light[:1], light[:-1] * LOG_STEP * _expm1_over(slope)])
        self.integral = float(share.sum())
        """Integral of the density as it was given, before it was normalised."""
        self.log_p = log_p - np.log(self.integral)
        self.cdf = np.cumsum(share) / self.integral
        self.cdf[-1] = 1.0
        self._slope, self._share = slope, share[1:] / self.integral

    def eval(self, s) -> np.ndarray:
        """Density [1/sr]."""
        return np.exp(np.interp(np.log(np.maximum(s, 1e-300)), LOG_S, self.log_p))

    def cdf_at(self, s) -> np.ndarray:
        """Share of the light that is scattered to at most ``s``."""
        s = np.asarray(s, float)
        at = np.clip((np.log(np.maximum(s, 1e-300)) - LOG_S[0]) / LOG_STEP, 0.0, NODES - 1)
        i = np.minimum(at.astype(int), NODES - 2)
        m, x = self._slope[i], at - i
        inside = self.cdf[i] + self._share[i] * x * _expm1_over(m * x) / _expm1_over(m)
        return np.where(at > 0.0, inside, self.cdf[0] * s * np.exp(-LOG_S[0]))

    def sample(self, u) -> np.ndarray:
        """The s that a share ``u`` of the light stays below."""
        u = np.asarray(u, float)
        i = np.clip(np.searchsorted(self.cdf, u) - 1, 0, NODES - 2)
        share, m = np.clip((u - self.cdf[i]) / np.maximum(self._share[i], 1e-300), 0.0, 1.0), self._slope[i]
        flat = np.abs(m) < 1e-9
        x = np.where(flat, share, np.log1p(share * np.expm1(m)) / np.where(flat, 1.0, m))
        return np.where(u <= self.cdf[0], np.exp(LOG_S[0]) * u / self.cdf[0], np.exp(LOG_S[i] + x * LOG_STEP))


def _expm1_over(m):
    """(exp(m) - 1)/m, 1 at 0."""
    m = np.where(np.abs(m) < 1e-12, 1e-12, m)
    return np.expm1(m) / m
