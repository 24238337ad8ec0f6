"""Water current: a uniform drift plus a few seeded sinusoids, so that every derivative exists, and turbulence.

A free neutral sphere inherits the acceleration of the water; a rougher current would put white noise into the IMU.
So would an Ornstein-Uhlenbeck process itself. But a hull averages over eddies that are smaller than it: turbulence is
the process behind two first-order lags,

    dx = -x dt/T + sqrt(2/T) sigma_x dW,    dy/dt = (x - y)/S,    dv/dt = (y - v)/S

whose acceleration has a derivative. It is drawn at the ticks from its exact transition; the cubic that has velocity
and acceleration of both ends joins them, so that within a tick the integrator keeps its order.
"""

from functools import cache

import numpy as np
from scipy.linalg import expm, solve_continuous_lyapunov

from varos_warp.errors import InputError
from varos_warp.scene.description import vehicle as description
from varos_warp.sim.clock import TICK_S
from varos_warp.sim.quaternion import Vector

WAVES = 8
SHORTEST_PERIOD_S = 0.1
"""20 ticks, 10 for the fastest wave, of which the integrator then misses 1e-4; and what readers of the IMU can follow.
"""
BLOCK_TICKS = 1000
HARDLY_EVER = 6.0
"""Standard deviations that turbulence does not exceed: once in 500 million correlation times."""


class Turbulence:
    """An Ornstein-Uhlenbeck process behind two lags, for each axis, by knots a step apart; a seed draws the same."""

    def __init__(self, turbulence: description.Turbulence, seed: int, step_s: float = TICK_S):
        self._lag, self._step, self.rms = turbulence.smoothing_s, step_s, np.asarray(turbulence.rms, float)
        self._E, self._noise, stationary = _transition(turbulence.correlation_time_s, self._lag, step_s)
        self._rng = np.random.default_rng([seed, turbulence.seed, 0x6F75])
        self._knots = np.einsum("ij,jk->ik", stationary, self._rng.standard_normal((3, 3)))[None]

    def knots(self, count: int) -> np.ndarray:
        """The first ``count`` states (x, y, v) in units of the RMS, [count, 3, 3]: by state and axis."""
        more = count - len(self._knots)
        if more > 0:
            more = max(more, BLOCK_TICKS)
            push = np.einsum("ij,njk->nik", self._noise, self._rng.standard_normal((more, 3, 3)))
            states: list[np.ndarray] = []
            for i, first in enumerate(self._knots[-1]):  # each is driven by those before it
                driven = push[:, i] + sum(self._E[i, j] * before[:-1] for j, before in enumerate(states))
                states.append(np.concatenate([first[None], _decay(self._E[i, i], driven, first)]))
            self._knots = np.concatenate([self._knots, np.stack(states, axis=1)[1:]])
        return self._knots[:count]

    def motion(self, t) -> tuple[np.ndarray, np.ndarray]:
        """Velocity [n, 3] [m/s] and acceleration [n, 3] [m/s^2] of the water at the times ``t`` [n] [s]."""
        n = np.floor(np.asarray(t) / self._step + 1e-9).astype(int)
        s, knots = (np.asarray(t) / self._step - n)[:, None], self.knots(int(n.max()) + 2)
        v, slope = knots[:, 2], (knots[:, 1] - knots[:, 2]) * (self._step / self._lag)
        moved = v[n + 1] - v[n]
        c2, c3 = 3.0 * moved - 2.0 * slope[n] - slope[n + 1], slope[n] + slope[n + 1] - 2.0 * moved
        return (
            self.rms * (v[n] + s * (slope[n] + s * (c2 + s * c3))),
            self.rms * (slope[n] + s * (2.0 * c2 + s * 3.0 * c3)) / self._step,
        )

    def way(self, t: float) -> np.ndarray:
        """How far the water has moved from time 0 to ``t`` [s], [3] [m], by the trapezoidal rule over the knots."""
        whole = int(np.floor(t / self._step + 1e-9))
        v, rest = self.knots(whole + 2)[:, 2], t / self._step - whole
        sums = v[:whole].sum(0) + 0.5 * (v[whole] - v[0]) + rest * (v[whole] + 0.5 * rest * (v[whole + 1] - v[whole]))
        return self.rms * self._step * sums


@cache
def _transition(T: float, S: float, h: float) -> tuple[np.ndarray, ...]:
    """Linear system of (x, y, v), v with variance 1: the matrix of a step [3, 3], square roots of two covariances.

    The roots [3, 3] are those of the covariance of what is added in a step, and of that of the state.
    """
    A = np.array([[-1.0 / T, 0.0, 0.0], [1.0 / S, -1.0 / S, 0.0], [0.0, 1.0 / S, -1.0 / S]])
    stationary = solve_continuous_lyapunov(A, -np.diag([1.0, 0.0, 0.0]))
    at, weights = np.polynomial.legendre.leggauss(20)  # a difference of covariances would lose the small ones' digits
    push = np.array([expm(A * (0.5 * h * (1.0 + x)))[:, 0] for x in at]) * np.sqrt(0.5 * h * weights)[:, None]
    roots = (np.linalg.cholesky(C / stationary[2, 2]) for C in (push.T @ push, stationary))
    return expm(A * h), *roots


def _decay(factor: float, push: np.ndarray, before: np.ndarray) -> np.ndarray:
    """y_n = factor y_(n-1) + push_n [n, 3], from the row before the first."""
    from scipy.signal import lfilter  # takes a third of a second to load, and hardly any scene has turbulence

    return lfilter([1.0], [1.0, -factor], push, axis=0, zi=factor * before[None])[0]


class Current:
    """Velocity of the water, the same everywhere, over time; refused if it changes too fast for the clock's ticks."""

    def __init__(self, current: description.Current, seed: int):
        if current.fluctuation > 0.0 and current.period_s < SHORTEST_PERIOD_S:
            raise InputError(
                "is too short for ticks of 5 ms",
                key="current.period_s",
                value=current.period_s,
                remedy=f"Give at least {SHORTEST_PERIOD_S:g} s",
            )
        rng = np.random.default_rng([seed, 0x63757272])
        direction = rng.normal(size=(WAVES, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        self.drift = np.asarray(current.velocity, float)
        """Mean velocity [3] [m/s]."""
        self.amplitude = current.fluctuation * np.sqrt(2.0 / WAVES) * direction
        """Amplitude of each sinusoid [WAVES, 3] [m/s]; their sum has the asked RMS speed."""
        self.frequency = 2.0 * np.pi / max(current.period_s, SHORTEST_PERIOD_S) * 2.0 ** rng.uniform(-1.0, 1.0, WAVES)
        """Angular frequency of each [WAVES] [rad/s], within an octave of the asked period on either side."""
        self.phase = rng.uniform(0.0, 2.0 * np.pi, WAVES)
        self.turbulence = Turbulence(current.turbulence, seed) if current.turbulence else None

    def velocity(self, t) -> np.ndarray:
        """Velocity [n, 3] [m/s] at the times ``t`` [n] [s]."""
        even = self.drift + np.sin(np.multiply.outer(t, self.frequency) + self.phase) @ self.amplitude
        return even if self.turbulence is None else even + self.turbulence.motion(t)[0]

    def way(self, t: float) -> np.ndarray:
        """How far the water has moved from time 0 to ``t`` [s], [3] [m]."""
        turned = np.cos(self.phase) - np.cos(self.frequency * t + self.phase)
        even = t * self.drift + (turned / self.frequency) @ self.amplitude
        return even if self.turbulence is None else even + self.turbulence.way(t)

    def acceleration(self, t) -> np.ndarray:
        """Acceleration of the water [n, 3] [m/s^2], the time derivative of its velocity."""
        even = (np.cos(np.multiply.outer(t, self.frequency) + self.phase) * self.frequency) @ self.amplitude
        return even if self.turbulence is None else even + self.turbulence.motion(t)[1]

    @property
    def max_speed(self) -> float:
        """A bound on the speed at any time [m/s]; turbulence hardly ever exceeds it."""
        even = float(np.linalg.norm(self.drift) + np.linalg.norm(self.amplitude, axis=1).sum())
        return even if self.turbulence is None else even + HARDLY_EVER * float(np.linalg.norm(self.turbulence.rms))


class SampledCurrent:
    """The current at the stages of the integrator, tabulated in blocks because single NumPy calls are slow."""

    def __init__(self, current: Current, tick_s: float, per_tick: int):
        self._current, self._dt, self._per_tick = current, tick_s / per_tick, per_tick
        self._first, self._rows = -BLOCK_TICKS, []

    def stages(self, tick: int) -> list[tuple[Vector, Vector]]:
        """(velocity, acceleration) at ``per_tick + 1`` evenly spaced times, from this tick to the next."""
        if not 0 <= tick - self._first < BLOCK_TICKS:
            self._first = tick
            t = (tick * self._per_tick + np.arange(BLOCK_TICKS * self._per_tick + 1)) * self._dt
            both = self._current.velocity(t).tolist(), self._current.acceleration(t).tolist()
            self._rows = [(tuple(v), tuple(a)) for v, a in zip(*both, strict=True)]
        start = (tick - self._first) * self._per_tick
        return self._rows[start : start + self._per_tick + 1]
