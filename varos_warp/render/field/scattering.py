"""Scattering as a matrix from directions to directions, for any phase function.

What leaves in a direction w is the mean of the radiance u that arrives, over the phase function p around w. Both are
peaked: p around w, and u around the direction to the light, gamma = 0, where light scattered once goes like the
integral of p beyond gamma, over sin(gamma). A partition of unity takes the peaks apart: with s = sin^2(psi/2) of the
angle psi to w, and c = sin^2(gamma/2), the share s^2/(s^2 + c^2) has no peak around w and is summed over the quadrature
of directions; the rest has none around the light and is summed over rings around w, between the directions by
interpolation of u over its known shape.
"""

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from varos_warp.render.field.directions import Directions
from varos_warp.scene.water.phase.phase_function import PhaseFunction

NEAREST_S = 1e-10
"""What is scattered by less than 2 asin(sqrt(s)) of this, 0.02 mrad, goes straight on."""
RING_PANEL, RING_NODES, AROUND = np.log(16.0), 6, 64
"""Rings: Gauss-Legendre in log s, panels of a factor of 4 in the angle; directions on each."""
BETWEEN = 2
"""Directions to a step of the directions that light leaves in: values between them are kept, not those at the nodes."""


def scattering_matrix(phase: PhaseFunction, arriving: Directions, leaving: Directions) -> np.ndarray:
    """Matrix [leaving, arriving]: the mean of radiance over the phase function, for linear interpolation between."""
    between, fit = leaving.fit(BETWEEN)
    s, weights = _rings(phase)
    shape = _shape(phase)
    spline = make_interp_spline(arriving.s, np.eye(len(arriving.s)), k=3)  # its coefficients, of values there
    series = np.cos(np.outer(np.arange(len(arriving.phi)), arriving.phi))
    series[1:] *= 2.0
    far = _far(phase, between, arriving)
    # rings are the same at every phi: what they make of cos(m phi) is in proportion to it
    near = np.array([_near(gamma, s, weights, shape, arriving, spline.t) for gamma in between.gamma])
    waves = np.cos(np.outer(between.phi, np.arange(len(series))))
    near = np.einsum("gbm,pm,bi,mk->gpik", near, waves, spline.c, series / len(arriving.phi), optimize=True)
    near /= shape(arriving.gamma)[:, None]
    return fit @ (far + near.reshape(far.shape))


def _rings(phase: PhaseFunction) -> tuple[np.ndarray, np.ndarray]:
    """Values of s, and shares of the light scattered there; the first is straight on."""
    panels = int(np.ceil(-np.log(NEAREST_S) / RING_PANEL))
    x, w = np.polynomial.legendre.leggauss(RING_NODES)
    width = -np.log(NEAREST_S) / panels
    log_s = (np.log(NEAREST_S) + width * (np.arange(panels)[:, None] + (1.0 + x) / 2.0)).ravel()
    s = np.exp(log_s)
    weights = np.tile(w, panels) * width / 2.0 * 4.0 * np.pi * s * phase.eval_s(s)
    return np.append(0.0, s), np.append(1.0 - weights.sum(), weights)


def _shape(phase: PhaseFunction):
    """Approximate fall-off of light scattered once with gamma: the integral of p beyond gamma, over sin(gamma / 2)."""
    theta = np.geomspace(1e-8, np.pi, 4000)
    p = phase.eval_s(np.sin(theta / 2.0) ** 2)
    steps = np.diff(theta) * (p[1:] + p[:-1]) / 2.0
    beyond = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
    values = (beyond + 1e-2 * beyond[0]) / np.sin(theta / 2.0)
    return lambda gamma: np.exp(np.interp(np.log(np.maximum(gamma, 1e-8)), np.log(theta), np.log(values)))


def shape_of_twice(phase: PhaseFunction, matrix: np.ndarray, arriving: Directions, leaving: Directions):
    """Approximate fall-off of light scattered twice with gamma: as what scattering makes of light scattered once.

    A tenth of its median is added, for light scattered often has no peak.
    """
    once = np.repeat(_shape(phase)(arriving.gamma), len(arriving.phi))
    values = (matrix @ once).reshape(len(leaving.gamma), -1)[:, 0]
    values = np.log(values / np.median(values) + 0.1)
    return lambda gamma: np.exp(np.interp(np.sqrt(gamma), np.sqrt(leaving.gamma), values))


def _share_far(s: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Share of the part that is summed over the quadrature of directions."""
    return s * s / np.maximum(s * s + c * c, 1e-300)


def _far(phase: PhaseFunction, leaving: Directions, arriving: Directions) -> np.ndarray:
    """Matrix [leaving, arriving] of what is summed over the quadrature of directions."""
    c = np.sin(arriving.pairs[:, 0] / 2.0) ** 2
    x, y, z = arriving.vectors.T.copy()
    far = np.empty((len(leaving.vectors), len(c)))
    for row, (to_x, to_y, to_z) in zip(far, leaving.vectors, strict=True):
        across, along, total = (x - to_x) ** 2, (z - to_z) ** 2, 0.0
        for side in (-y, y):
            s = (across + (side - to_y) ** 2 + along) / 4.0
            total = total + _share_far(s, c) * phase.eval_s(np.maximum(s, 1e-30))
        row[:] = 0.5 * total * arriving.weights
    return far


def _near(gamma, s, weights, shape, arriving: Directions, knots) -> np.ndarray:
    """Coefficients [splines, cosines] of what comes from rings around the direction (gamma, phi = 0)."""
    chi = 2.0 * np.pi * (np.arange(AROUND) + 0.5) / AROUND
    w = np.array([np.sin(gamma), 0.0, np.cos(gamma)])
    a, b = np.array([np.cos(gamma), 0.0, -np.sin(gamma)]), np.array([0.0, 1.0, 0.0])
    sin_psi = 2.0 * np.sqrt(s * (1.0 - s))
    around = np.outer(np.cos(chi), a) + np.outer(np.sin(chi), b)
    v = w + (-2.0 * s)[:, None, None] * w + sin_psi[:, None, None] * around
    v = v.reshape(-1, 3)
    c = (v[:, 0] ** 2 + v[:, 1] ** 2 + (1.0 - v[:, 2]) ** 2) / 4.0
    gamma = 2.0 * np.arcsin(np.sqrt(np.minimum(c, 1.0)))
    share = 1.0 - _share_far(np.repeat(s, AROUND), c)
    amount = np.repeat(weights / AROUND, AROUND) * share * shape(gamma)
    at = np.clip((gamma / np.pi) ** (1.0 / arriving.power), 0.0, 1.0)
    basis = BSpline.design_matrix(at, knots, 3, extrapolate=True)
    cos_phi = v[:, 0] / np.maximum(np.hypot(v[:, 0], v[:, 1]), 1e-300)
    waves = np.empty((len(at), len(arriving.phi)))
    waves[:, 0], waves[:, 1] = 1.0, cos_phi
    for m in range(2, waves.shape[1]):
        waves[:, m] = 2.0 * cos_phi * waves[:, m - 1] - waves[:, m - 2]
    return basis.T @ (amount[:, None] * waves)
