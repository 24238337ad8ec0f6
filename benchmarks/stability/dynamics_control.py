"""Sweeps of thrusters and control: filters, weights, sample rates, saturation, large angles."""

from decimal import Decimal, localcontext

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_lyapunov

from benchmarks.stability.entry import Sweeps
from benchmarks.stability.riccati import exact_gain, exact_transition
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.actuator import propagator
from varos_warp.sim.vehicle.body import sphere
from varos_warp.sim.vehicle.control import design, plant, sampled
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import Dynamics

H, DRAG = 0.005, 1.0 / 6.0


def exact_filter(frequency: float, damping: float, dt: float) -> np.ndarray:
    """exp(A dt) of the filter in 400 digits."""
    with localcontext(prec=400):
        wn, zeta = Decimal(frequency), Decimal(damping)
        A = [[Decimal(0), Decimal(1)], [-wn * wn, -2 * zeta * wn]]
    return exact_transition(A, dt, 400)


def filter_error(frequency: float, damping: float) -> float:
    scale = np.array([[1.0, 1.0 / frequency], [frequency, 1.0]])
    difference = np.abs(propagator(frequency, damping, H) - exact_filter(frequency, damping, H)) / scale
    return float(difference.max())


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
    return float((np.abs(step - exact_filter(frequency, damping, H)) / scale).max())


def gain_error(q, r=1.0, *, wn=15.0, zeta=1.0, integral=0.0, h=H) -> float:
    """Largest error of a gain as a share of the largest one."""
    A, B = plant(DRAG, wn, zeta, integral > 0.0)
    weights = ([integral] if integral > 0.0 else []) + [*q, 0.0, 0.0]
    made = np.array(design(DRAG, wn, zeta, q, r, integral=integral, h=h))[0 if integral > 0.0 else 1 :]
    exact = exact_gain(A, B, np.diag(weights), r, h)[0]
    return float(np.abs(made - exact).max() / np.abs(exact).max())


MINI_ROV = (5.0 / 18.0, 20.0, 1.0)
A, B = plant(*MINI_ROV)
Q, R = np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1)
IDEAL = solve_continuous_are(A, B, Q, R)


def excess_cost(K: np.ndarray, h: float) -> float:
    """Cost from an error of 1 m when the command is held for ``h``, over that of one who decides at any time."""
    Ad, Bd, Qd, Rd, Nd = sampled(A, B, Q, R, h)
    loop = Ad - Bd @ K
    if np.abs(np.linalg.eigvals(loop)).max() >= 1.0:
        return float("nan")
    P = solve_discrete_lyapunov(loop.T, Qd + K.T @ Rd @ K - Nd @ K - K.T @ Nd.T)
    return float(P[0, 0] / IDEAL[0, 0] - 1.0)


def lags(force: float) -> tuple[float, float]:
    """Largest lag [m], and how far from the goal it ends, on a leg that takes 19.5 N with a limit of the force."""
    way = {"waypoints": [{"position": (0, 0, 0)}, {"position": (0, 3, 0)}], "handover_timeout_s": 5.0}
    made = simulate(scene_from_dict({"vehicle": {"max_force": force}, "trajectory": way}))
    lag = np.linalg.norm(made.reference_position - made.trajectory.position, axis=1).max()
    return float(lag), float(np.linalg.norm(made.frames.position[-1] - [0.0, 3.0, 0.0]))


def accepted_filter_error(damping: float) -> float:
    """The filter's error where a vehicle takes its damping."""
    Dynamics(sphere(description.Vehicle(actuator_damping=damping)), Current(description.Current(), 0))
    return filter_error(15.0, damping)


SWEEPS: Sweeps = {
    "actuator_frequency": {
        "ours": lambda wn: filter_error(wn, 1.0),
        "RK4": lambda wn: series_error(wn, 1.0, 4),
        "Euler": lambda wn: series_error(wn, 1.0, 1),
    },
    "actuator_damping": {
        "the filter": lambda zeta: filter_error(15.0, zeta),
        "the filter, where the vehicle takes it": accepted_filter_error,
    },
    "lqr_weights": {
        "position and speed": lambda v: gain_error((v, 0.5 * v)),
        "position alone": lambda v: gain_error((v, 0.5)),
        "r (inverse)": lambda v: gain_error((1.0, 0.5), 1.0 / v),
        "integral": lambda v: gain_error((1.0, 0.5), integral=v),
    },
    "lqr_actuator": {"gains": lambda wn: gain_error((1.0, 0.5), wn=wn)},
    "sample_rate": {
        "designed for the step": lambda h: excess_cost(np.array([design(*MINI_ROV, (1.0, 0.5), 1.0, h=h)[1:]]), h),
        "continuous gain, held": lambda h: excess_cost(B.T @ IDEAL, h),
    },
    "saturation": {("largest lag [m]", "from the goal at the end [m]"): lags},
}
