"""Oracles for a regulator's gains: what they tend to for short steps and fast actuators, and in 200 digits."""

from decimal import Decimal, localcontext
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


# ------------------------------------------------------------------------------------- the Riccati equation in decimals

DIGITS = 200


def exact_gain(A, B, Q, R: float, h: float) -> np.ndarray:
    """Gain K [1, n] of u = -K x that minimises the sampled cost, right to the last digit of a float.

    Of a plant x' = A x + B u and the cost x'Q x + u'R u, the input held over a step h. Transition and cost over the
    step are Taylor sums, the equation is solved by doubling (Anderson 1978), which converges quadratically from any
    start.
    """
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = DIGITS, -(10**9), 10**9
        A_d, B_d, Q_d, R_d, N_d = _sampled(*(_decimal(M) for M in (A, B, Q, [[R]])), Decimal(float(h)))
        # without the cross term: u = v - N'x / R
        A_0, Q_0 = A_d - B_d @ N_d.T / R_d[0, 0], Q_d - N_d @ N_d.T / R_d[0, 0]
        P = _doubled(A_0, B_d @ B_d.T / R_d[0, 0], Q_0, Decimal(10) ** (-DIGITS // 3))
        return ((B_d.T @ P @ A_d + N_d.T) / (R_d + B_d.T @ P @ B_d)[0, 0]).astype(float)


def _halvings(M) -> int:
    """How often a matrix is halved before the series converges quickly."""
    return max(0, int(np.ceil(np.log2(max(1e-9, float(np.abs(M).sum()))))) + 8)


def _decimal(M) -> np.ndarray:
    return np.vectorize(lambda x: x if isinstance(x, Decimal) else Decimal(float(x)), otypes=[object])(np.atleast_2d(M))


def _eye(n: int) -> np.ndarray:
    return _decimal(np.eye(n))


def _sampled(A, B, Q, R, h):
    """A_d, B_d, Q_d, R_d, N_d of a step ``h``: halved until the series converges quickly, then doubled."""
    n, m = B.shape
    F = np.block([[A, B], [_decimal(np.zeros((m, n + m)))]])
    weight = np.block([[Q, _decimal(np.zeros((n, m)))], [_decimal(np.zeros((m, n))), R]])
    halvings = _halvings(F * h)
    short = h / 2**halvings
    blocks = _expm(np.block([[-F.T, weight], [_decimal(np.zeros((n + m, n + m))), F]]) * short)
    transition = blocks[n + m :, n + m :]
    cost = transition.T @ blocks[: n + m, n + m :]
    for _ in range(halvings):
        cost, transition = cost + transition.T @ cost @ transition, transition @ transition
    return transition[:n, :n], transition[:n, n:], cost[:n, :n], cost[n:, n:], cost[:n, n:]


def _expm(M) -> np.ndarray:
    total = term = _eye(len(M))
    for k in range(1, 100):  # M is smaller than 1 / 200
        term = term @ M / k
        total = total + term
    return total


def _doubled(A, G, H, tolerance):
    """P of P = A'P (1 + G P)^-1 A + H."""
    for _ in range(300):
        inverse = _inverse(_eye(len(A)) + G @ H)
        change = A.T @ H @ inverse @ A
        A, G, H = A @ inverse @ A, G + A @ inverse @ G @ A.T, H + change
        if np.abs(change).max() <= tolerance * np.abs(H).max():
            return H
    raise ArithmeticError("the doubling of a Riccati equation does not converge")


def _inverse(M) -> np.ndarray:
    """Gauss-Jordan with pivots."""
    n = len(M)
    rows = np.hstack([M, _eye(n)])
    for i in range(n):
        pivot = i + int(np.argmax(np.abs(rows[i:, i])))
        rows[[i, pivot]] = rows[[pivot, i]]
        rows[i] = rows[i] / rows[i, i]
        for j in range(n):
            if j != i:
                rows[j] = rows[j] - rows[j, i] * rows[i]
    return rows[:, n:]
