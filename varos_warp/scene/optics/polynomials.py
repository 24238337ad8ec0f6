"""Polynomials of lenses: their values by radius or angle, and where they first vanish."""

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import Polynomial


def odd_polynomial(coefficients: Sequence[float], x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Value [...] and slope [...] of x + c1 x^3 + c2 x^5 + ... at x [...]."""
    value, slope, power = np.ones_like(x), np.ones_like(x), np.ones_like(x)
    for i, c in enumerate(coefficients):
        power = power * x * x
        value, slope = value + c * power, slope + (2 * i + 3) * c * power
    return x * value, slope


def first_fold(coefficients: Sequence[float], end: float) -> float:
    """Least x above 0 at which x + c1 x^3 + c2 x^5 + ... ceases to rise, or ``end`` if that is nearer."""
    c = np.array(coefficients)
    odd = np.arange(3, 3 + 2 * len(c), 2)
    roots = np.roots([*(odd * c)[::-1], 1.0])
    folds = np.sqrt(roots[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)].real)
    return float(min([end, *folds]))


def positive_roots(polynomial: Polynomial) -> np.ndarray:
    """Real roots above 0, ascending; a double root, where the sign stays, may be missing."""
    roots = np.atleast_1d(polynomial.trim().roots())
    return np.sort(roots[(np.abs(roots.imag) < 1e-12 * np.abs(roots)) & (roots.real > 0)].real)


def even(coefficients: Sequence[float]) -> Polynomial:
    """The polynomial 1 + c1 x^2 + c2 x^4 + ..."""
    return Polynomial([1.0, *(number for c in coefficients for number in (0.0, c))])
