"""What the sampled regulator tends to for short steps and fast actuators: an oracle for its gains."""

from math import sqrt

import numpy as np
from scipy.linalg import solve_continuous_are


def care_gain(A, B, Q, R) -> tuple[np.ndarray, np.ndarray]:
    """Gain K [m, n] of u = -K x that minimises the cost in continuous time, and the cost matrix P [n, n]."""
    P = solve_continuous_are(A, B, Q, R)
    return np.linalg.solve(R, B.T @ P), P


def ideal_gain(c: float, q: tuple[float, float], r: float) -> tuple[float, float]:
    """Closed form (k1, k2) for a double integrator with drag ``c`` and an actuator without delay."""
    k1 = sqrt(q[0] / r)
    return k1, -c + sqrt(c**2 + q[1] / r + 2.0 * k1)
