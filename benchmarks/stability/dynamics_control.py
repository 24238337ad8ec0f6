"""Sweeps of thrusters and control: filters, weights, sample rates, saturation, large angles."""

from decimal import Decimal, localcontext

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_lyapunov

from benchmarks.stability.entry import Measured, Sweeps
from benchmarks.stability.riccati import exact_gain
from varos_warp.errors import InputError
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.actuator import propagator
from varos_warp.sim.vehicle.body import sphere
from varos_warp.sim.vehicle.control import design, plant, sampled
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import Dynamics

H, DRAG = 0.005, 1.0 / 6.0
FLOOR = 1e-17
"""Errors below are drawn there."""

# ----------------------------------------------------------------------------------------------------------- thrusters


def exact_filter(frequency: float, damping: float, dt: float) -> np.ndarray:
    """exp(A dt) of the filter by its Taylor series in 400 digits."""
    with localcontext() as context:
        context.prec, context.Emin, context.Emax = 400, -(10**9), 10**9
        wn, zeta = Decimal(frequency), Decimal(damping)
        A = np.array([[Decimal(0), Decimal(1)], [-wn * wn, -2 * zeta * wn]])
        halvings = max(0, int(np.log2(max(1e-9, frequency * dt * (1.0 + 2.0 * damping) + frequency**2 * dt)))) + 9
        M, total = A * (Decimal(dt) / 2**halvings), np.array([[Decimal(1), Decimal(0)], [Decimal(0), Decimal(1)]])
        term = total
        for k in range(1, 120):
            term = term @ M / k
            total = total + term
        for _ in range(halvings):
            total = total @ total
        return total.astype(float)


def filter_error(frequency: float, damping: float) -> float:
    scale = np.array([[1.0, 1.0 / frequency], [frequency, 1.0]])
    difference = np.abs(propagator(frequency, damping, H) - exact_filter(frequency, damping, H)) / scale
    return max(float(difference.max()), FLOOR)


def series_error(frequency: float, damping: float, order: int) -> float:
    """Return the error of Euler's step (order 1) or RK4's (4) instead of the exact one; nan where it grows."""
    A = np.array([[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]]) * H
    step = term = np.eye(2)
    for k in range(1, order + 1):
        term = term @ A / k
        step = step + term
    if np.abs(np.linalg.eigvals(step)).max() > 1.0:
        return float("nan")
    scale = np.array([[1.0, 1.0 / frequency], [frequency, 1.0]])
    return max(float((np.abs(step - exact_filter(frequency, damping, H)) / scale).max()), FLOOR)


def actuator_frequency() -> Measured:
    """A tick of the thruster against its matrix exponential."""
    values = [1e-6, 1e-3, 0.1, 1.0, 10.0, 100.0, 300.0, 500.0, 1e3, 1e4, 1e6, 1e9]
    return values, {
        "ours": [filter_error(wn, 1.0) for wn in values],
        "RK4": [series_error(wn, 1.0, 4) for wn in values],
        "Euler": [series_error(wn, 1.0, 1) for wn in values],
    }


def actuator_damping() -> Measured:
    """Measure the error by damping, through the critical one."""
    values = [1e-6, 1e-3, 0.1, 0.9, 1.0 - 1e-9, 1.0, 1.0 + 1e-9, 1.1, 10.0, 1e3, 1e6]

    def accepted(zeta):
        try:
            Dynamics(sphere(description.Vehicle(actuator_damping=zeta)), Current(description.Current(), 0))
        except (InputError, ValueError):
            return False
        return True

    return values, {
        "the filter": [filter_error(15.0, zeta) for zeta in values],
        "the filter, where the vehicle takes it": [
            filter_error(15.0, z) if accepted(z) else float("nan") for z in values
        ],
    }


# -------------------------------------------------------------------------------------------------------------- weights


def gain_error(q, r=1.0, *, wn=15.0, zeta=1.0, integral=0.0, h=H) -> float:
    """Largest error of a gain as a share of the largest one; nan where the design is refused."""
    A, B = plant(DRAG, wn, zeta, integral > 0.0)
    weights = ([integral] if integral > 0.0 else []) + [*q, 0.0, 0.0]
    try:
        made = np.array(design(DRAG, wn, zeta, q, r, integral=integral, h=h))[0 if integral > 0.0 else 1 :]
    except InputError:
        return float("nan")
    exact = exact_gain(A, B, np.diag(weights), r, h)[0]
    return max(float(np.abs(made - exact).max() / np.abs(exact).max()), FLOOR)


def lqr_weights() -> Measured:
    """Weights of position and speed over r, and of the integral."""
    values = [10.0**e for e in (-14, -13, -12, -10, -8, -6, -4, -2, 0, 2, 4, 6, 8, 10, 12, 13, 14)]
    return values, {
        "position and speed": [gain_error((v, 0.5 * v)) for v in values],
        "position alone": [gain_error((v, 0.5)) for v in values],
        "r (inverse)": [gain_error((1.0, 0.5), 1.0 / v) for v in values],
        "integral": [gain_error((1.0, 0.5), integral=v) for v in values],
    }


def lqr_actuator() -> Measured:
    """Gains for slow and fast thrusters."""
    values = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e6, 1e8, 1e9]
    return values, {"gains": [gain_error((1.0, 0.5), wn=v) for v in values]}


def sample_rate() -> Measured:
    """Cost of the closed loop when the command is held ever longer."""
    steps = [1e-4, 1e-3, 5e-3, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0, 1.3, 1.5, 1.7, 2.0, 5.0, 20.0]
    A, B = plant(5.0 / 18.0, 20.0, 1.0)  # the mini ROV
    Q, R = np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1)
    continuous = B.T @ solve_continuous_are(A, B, Q, R)

    def excess(K, h):
        """Cost from an error of 1 m over that of an ideal controller, which decides at any time."""
        Ad, Bd, Qd, Rd, Nd = sampled(A, B, Q, R, h)
        loop = Ad - Bd @ K
        if np.abs(np.linalg.eigvals(loop)).max() >= 1.0:
            return float("nan")
        P = solve_discrete_lyapunov(loop.T, Qd + K.T @ Rd @ K - Nd @ K - K.T @ Nd.T)
        return max(float(P[0, 0] / solve_continuous_are(A, B, Q, R)[0, 0] - 1.0), FLOOR)

    def ours(h):
        return excess(np.array([design(5.0 / 18.0, 20.0, 1.0, (1.0, 0.5), 1.0, h=h)[1:]]), h)

    return steps, {
        "designed for the step": [ours(h) for h in steps],
        "continuous gain, held": [excess(continuous, h) for h in steps],
    }


# ---------------------------------------------------------------------------------------------------------- saturation


def saturation() -> Measured:
    """The force limit towards zero, on a leg that takes 19.5 N."""
    forces = [1e-6, 1e-3, 0.1, 1.0, 3.0, 10.0, 15.0, 19.0, 20.0, 30.0, 120.0, 1e4, 2e6, 3e6]

    def lag(force):
        try:
            run = simulate(
                scene_from_dict(
                    {
                        "vehicle": {"max_force": force},
                        "trajectory": {
                            "waypoints": [{"position": (0, 0, 0)}, {"position": (0, 3, 0)}],
                            "handover_timeout_s": 5.0,
                        },
                    }
                )
            )
        except InputError:
            return float("nan"), float("nan")
        return (
            float(np.linalg.norm(run.reference_position - run.trajectory.position, axis=1).max()),
            float(np.linalg.norm(run.frames.position[-1] - [0.0, 3.0, 0.0])),
        )

    made = [lag(force) for force in forces]
    return forces, {"largest lag [m]": [a for a, _ in made], "from the goal at the end [m]": [b for _, b in made]}


SWEEPS: Sweeps = (actuator_frequency, actuator_damping, lqr_weights, lqr_actuator, sample_rate, saturation)
