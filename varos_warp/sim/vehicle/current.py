"""Water current: a uniform drift plus a few seeded sinusoids, so that every derivative exists.

A free neutral sphere inherits the acceleration of the water; a rougher current would put white noise into the IMU.
"""

import numpy as np

from varos_warp.errors import InputError
from varos_warp.scene.description import vehicle as description
from varos_warp.sim.quaternion import Vector

WAVES = 8
SHORTEST_PERIOD_S = 0.1
"""20 ticks, 10 for the fastest wave, of which the integrator then misses 1e-4; and what readers of the IMU can follow.
"""
BLOCK_TICKS = 1000


class Current:
    """Velocity of the water, the same everywhere, as a function of time.

    Raises:
        InputError: It would change faster than the simulator's clock can follow.
    """

    def __init__(self, current: description.Current, seed: int):
        if current.fluctuation > 0.0 and current.period_s < SHORTEST_PERIOD_S:
            raise InputError("is too short for ticks of 5 ms", key="current.period_s", value=current.period_s,
                             remedy=f"Give at least {SHORTEST_PERIOD_S:g} s")
        rng = np.random.default_rng([seed, 0x63757272])
        direction = rng.normal(size=(WAVES, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        self.drift = np.asarray(current.velocity, float)
        """Mean velocity [3] [m/s]."""
        self.amplitude = current.fluctuation * np.sqrt(2.0 / WAVES) * direction
        """Of each sinusoid [WAVES, 3] [m/s]; their sum has the asked RMS speed."""
        self.frequency = 2.0 * np.pi / max(current.period_s, SHORTEST_PERIOD_S) * 2.0 ** rng.uniform(-1.0, 1.0, WAVES)
        """[WAVES] [rad/s], within an octave of the asked period on either side."""
        self.phase = rng.uniform(0.0, 2.0 * np.pi, WAVES)

    def velocity(self, t) -> np.ndarray:
        """Velocity [n, 3] [m/s] at the times ``t`` [n] [s]."""
        return self.drift + np.sin(np.multiply.outer(t, self.frequency) + self.phase) @ self.amplitude

    def acceleration(self, t) -> np.ndarray:
        """Its time derivative [n, 3] [m/s^2]."""
        return (np.cos(np.multiply.outer(t, self.frequency) + self.phase) * self.frequency) @ self.amplitude

    @property
    def max_speed(self) -> float:
        """A bound on the speed at any time [m/s]."""
        return float(np.linalg.norm(self.drift) + np.linalg.norm(self.amplitude, axis=1).sum())


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
        return self._rows[start:start + self._per_tick + 1]
