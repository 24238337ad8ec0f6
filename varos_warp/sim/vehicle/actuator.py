"""Thrusters as second-order filters y'' + 2 zeta wn y' + wn^2 y = wn^2 u, advanced exactly (paper 3.3.3)."""

import cmath

import numpy as np

from varos_warp.sim.quaternion import Vector


def propagator(frequency: float, damping: float, dt: float) -> np.ndarray:
    """exp(A dt) [2, 2] of the filter's state (y, y'), for any damping and any dt.

    The two roots are taken apart without cancellation, so the critically damped case is their limit, to rounding.
    """
    decay = damping * frequency
    root = frequency * cmath.sqrt(damping**2 - 1.0)
    slow = -(frequency**2) / (decay + root)  # = root - decay
    first, second = cmath.exp(slow * dt), cmath.exp(-(decay + root) * dt)
    sine = first * (dt if root == 0.0 else -np.expm1(-2.0 * root * dt) / (2.0 * root))
    cosine = 0.5 * (first + second)
    E = np.array([[cosine + decay * sine, sine], [-(frequency**2) * sine, cosine - decay * sine]])
    return E.real


class Actuator:
    """Three independent filters of the same kind, advanced by ``dt`` with the command held."""

    def __init__(self, frequency: float, damping: float, dt: float):
        (self._yy, self._yv), (self._vy, self._vv) = propagator(frequency, damping, dt).tolist()

    def advance(self, y: Vector, rate: Vector, u: Vector) -> tuple[Vector, Vector]:
        """Output and its rate ``dt`` later; exact while ``u`` is constant."""
        yy, yv, vy, vv = self._yy, self._yv, self._vy, self._vv
        x0, x1, x2 = y[0] - u[0], y[1] - u[1], y[2] - u[2]
        r0, r1, r2 = rate
        return (
            (u[0] + yy * x0 + yv * r0, u[1] + yy * x1 + yv * r1, u[2] + yy * x2 + yv * r2),
            (vy * x0 + vv * r0, vy * x1 + vv * r1, vy * x2 + vv * r2),
        )


def limit(u: Vector, largest: float) -> tuple[Vector, bool]:
    """Scale a whole vector down to length ``largest``, which keeps its direction; tells whether it had to."""
    square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
    if square <= largest * largest:
        return u, False
    scale = largest / square**0.5
    return (u[0] * scale, u[1] * scale, u[2] * scale), True
