"""The controller: a linear quadratic regulator per axis, designed with the actuator in the plant (paper 3.3.3).

State of an axis in acceleration units: x = (e, de/dt, a, da/dt), with e the error of position (or angle) and a what the
actuator delivers. The gain comes from the discrete Riccati equation with the exactly sampled cost, so it stays right
when the actuator or the weights are fast compared with the tick.
"""

from math import ceil, log2, sqrt
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, expm, solve_discrete_are

from varos_warp.errors import InputError
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.clock import TICK_S
from varos_warp.sim.guidance import Reference
from varos_warp.sim.quaternion import Vector
from varos_warp.sim.vehicle.actuator import limit
from varos_warp.sim.vehicle.body import Sphere
from varos_warp.sim.vehicle.dynamics import ZERO, State, add
from varos_warp.sim.vehicle.rigid_body import RigidBody

# ------------------------------------------------------------------------------------------------------------ design


def plant(c: float, frequency: float, damping: float, integral: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """A [n, n] and B [n, 1] of one axis about hover, ``c`` [1/s] its linear drag; first the integral of e if asked."""
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [0.0, -c, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [0.0, 0.0, -(frequency**2), -2.0 * damping * frequency],
        ]
    )
    B = np.array([[0.0], [0.0], [0.0], [frequency**2]])
    if not integral:
        return A, B
    augmented = np.zeros((5, 5))
    augmented[1:, 1:], augmented[0, 1] = A, 1.0
    return augmented, np.vstack([[[0.0]], B])


def sampled(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, h: float):
    """Exact transition and cost over a step ``h`` with the input held (Van Loan 1978).

    Returns:
        A_d [n, n], B_d [n, m], Q_d [n, n], R_d [m, m], N_d [n, m]: the integral of x'Qx + u'Ru over the step is
        x'Q_d x + 2 x'N_d u + u'R_d u.
    """
    n, m = B.shape
    F = np.block([[A, B], [np.zeros((m, n + m))]])
    weight = np.block([[Q, np.zeros((n, m))], [np.zeros((m, n)), R]])
    # the exponential of -F' h loses all digits when a mode decays within the step: start short and double
    doublings = max(0, ceil(log2(max(1e-300, np.abs(np.linalg.eigvals(A)).max() * h))))
    short = h / 2**doublings
    blocks = expm(np.block([[-F.T, weight], [np.zeros_like(F), F]]) * short)
    transition = blocks[n + m :, n + m :]
    cost = transition.T @ blocks[: n + m, n + m :]
    for _ in range(doublings):
        cost = cost + transition.T @ cost @ transition
        transition = transition @ transition
    cost = 0.5 * (cost + cost.T)
    return transition[:n, :n], transition[:n, n:], cost[:n, :n], cost[n:, n:], cost[:n, n:]


def dare_gain(A, B, Q, R, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Gain K [m, n] of u = -K x held over ``h`` that minimises the sampled cost, and the cost matrix P [n, n]."""
    Ad, Bd, Qd, Rd, Nd = sampled(A, B, Q, R, h)
    P = solve_discrete_are(Ad, Bd, Qd, Rd, s=Nd)
    return np.linalg.solve(Rd + Bd.T @ P @ Bd, Bd.T @ P @ Ad + Nd.T), P


FARTHEST = 1e12
"""Largest ratio of a weight to r, and of r to the weight of a position: gains keep six digits up to there, and lose
them all some 8 orders of magnitude beyond."""


def design(
    c: float,
    frequency: float,
    damping: float,
    q: tuple[float, float],
    r: float,
    *,
    integral: float = 0.0,
    h: float = TICK_S,
    key: str = "vehicle.controller",
) -> tuple[float, ...]:
    """Gains (k_integral, k1, k2, k3, k4) of one axis; k_integral is 0 unless ``integral`` weighs it.

    Raises:
        InputError: The weights leave an axis without a stabilising gain, or are too far apart for one to be found.
    """
    if not (r / FARTHEST <= q[0] <= r * FARTHEST and max(q[1], integral) <= r * FARTHEST):
        raise InputError(
            "the weights are too far from r to find a gain" if q[0] else "a position without a weight",
            key=key,
            value=list(q),
            remedy=f"The first must lie between 1e-12 and 1e12 times "
            f"vehicle.controller.r = {r:g}, the second and integral at most there",
        )
    A, B = plant(c, frequency, damping, integral > 0.0)
    weights = np.array(([integral] if integral > 0.0 else []) + [q[0], q[1], 0.0, 0.0]) / r  # only ratios count
    try:
        with np.errstate(all="ignore"):  # what overflows is found unstable
            K, _ = dare_gain(A, B, np.diag(weights), np.eye(1), h)
            step = expm(np.block([[A, B], [np.zeros((1, len(A) + 1))]]) * h)
        stable = np.abs(np.linalg.eigvals(step[:-1, :-1] - step[:-1, -1:] @ K)).max() < 1.0
    except (LinAlgError, ValueError):
        stable = False
    if not stable:
        raise InputError(
            "the weights leave the vehicle without a stabilising gain",
            key=key,
            value=list(q),
            remedy="Bring them (with r and integral) nearer to each other",
        )
    values = tuple(K[0].tolist())
    return values if integral > 0.0 else (0.0, *values)


def is_slow(frequency: float, k1: float) -> bool:
    """Return whether an actuator is too slow for a gain that ignores it, which overshoots below five times sqrt(k1)."""
    return frequency < 5.0 * sqrt(k1)


# --------------------------------------------------------------------------------------------------------- operation


class Gains(NamedTuple):
    """(k_integral, k1, k2, k3, k4) of translation and of rotation."""

    translation: tuple[float, ...]
    rotation: tuple[float, ...]


def gains(body: Sphere, controller: description.Controller) -> Gains:
    """Design both regulators for a vehicle."""
    frequency, damping, r = body.actuator_frequency, body.actuator_damping, controller.r
    return Gains(
        design(
            body.linear_drag / body.virtual_mass,
            frequency,
            damping,
            controller.translation_q,
            r,
            integral=controller.integral,
            key="vehicle.controller.translation_q",
        ),
        design(
            body.linear_rotational_drag / body.inertia,
            frequency,
            damping,
            controller.rotation_q,
            r,
            key="vehicle.controller.rotation_q",
        ),
    )


class Regulator:
    """u = a_ff - k_i integral(e) - k1 e - k2 (v - v_ref) - k3 (a - a_ff) - k4 da/dt, for translation and rotation.

    The error of attitude is the rotation vector from the reference, the short way round: no attitude is singular and
    a quaternion and its negative are the same. ``feed_forward: none`` is the paper's controller, which knows the
    reference pose only; ``velocity`` adds its rates; ``full`` also its accelerations and the known forces.

    A `RigidBody` is controlled alike in its own axes, with the inertia of each; its thrusters share what is asked.
    """

    def __init__(self, body: Sphere, controller: description.Controller, h: float = TICK_S):
        self.gains = gains(body, controller)
        self.saturated_ticks = 0
        self._body, self._h = body, h
        self._rates, self._forces = controller.feed_forward != "none", controller.feed_forward == "full"
        self._integral: Vector = ZERO

    def command(self, reference: Reference, state: State, thrust: tuple[Vector, Vector]) -> tuple[Vector, Vector]:
        """Thrust [N] (world axes) and moment [N m] (vehicle axes) to command, within what the thrusters can do."""
        error = add(state.p, -1.0, reference.position)
        if isinstance(self._body, RigidBody):
            force, torque = self._along_axes(self._body, error, reference, state)
        else:
            force, torque = self._force(error, reference, state, thrust), self._torque(reference, state)
        force, torque, force_limited, torque_limited = saturated(self._body, force, torque)
        if isinstance(self._body, RigidBody):
            force = quaternion.rotate(state.q, force)
        if force_limited or torque_limited:
            self.saturated_ticks += 1
        if not force_limited:  # or the integral would wind up
            self._integral = add(self._integral, self._h, error)
        return force, torque

    def _force(self, error: Vector, reference: Reference, state: State, thrust) -> Vector:
        body = self._body
        velocity = reference.velocity if self._rates else ZERO
        ahead = ZERO
        if self._forces:
            drag = body.linear_drag + body.quadratic_drag * _norm(velocity)
            ahead = add(reference.acceleration, drag / body.virtual_mass, velocity)
            ahead = add(ahead, -body.net_buoyancy / body.virtual_mass, (0.0, 0.0, 1.0))
        return _law(
            self.gains.translation,
            3 * (body.virtual_mass,),
            self._integral,
            error,
            add(state.v, -1.0, velocity),
            ahead,
            *thrust,
        )

    def _torque(self, reference: Reference, state: State) -> Vector:
        body = self._body
        turned = quaternion.multiply(quaternion.conjugate(reference.attitude), state.q)
        rate = quaternion.rotate_back(turned, reference.omega) if self._rates else ZERO
        ahead = ZERO
        if self._forces:
            drag = body.linear_rotational_drag + body.quadratic_rotational_drag * _norm(rate)
            ahead = add(quaternion.rotate_back(turned, reference.alpha), drag / body.inertia, rate)
            if body.metacentric_height != 0.0:
                ahead = add(ahead, -1.0 / body.inertia, body.righting_moment(reference.attitude))
        return _law(
            self.gains.rotation,
            3 * (body.inertia,),
            ZERO,
            quaternion.log(turned),
            add(state.omega, -1.0, rate),
            ahead,
            state.torque,
            state.torque_rate,
        )

    def _along_axes(self, body: RigidBody, error: Vector, reference: Reference, state: State) -> tuple[Vector, Vector]:
        """Force [N] and moment [N m] in vehicle axes, in which all of it is meant."""
        turned = quaternion.multiply(quaternion.conjugate(reference.attitude), state.q)
        velocity, rate = (reference.velocity, reference.omega) if self._rates else (ZERO, ZERO)
        rate, alpha = (quaternion.rotate_back(turned, x) for x in (rate, reference.alpha))
        force, torque = ZERO, ZERO
        if self._forces:
            force, torque = body.needed(reference.attitude, velocity, rate, reference.acceleration, alpha)
            if body.free:  # a tilt that nobody controls lasts, and turns the drag
                force, _ = body.needed(state.q, velocity, rate, reference.acceleration, alpha)
        drift, integral = (quaternion.rotate_back(state.q, x) for x in (add(state.v, -1.0, velocity), self._integral))
        masses, inertias = body.masses, body.inertias
        return (
            _law(
                self.gains.translation,
                masses,
                integral,
                quaternion.rotate_back(state.q, error),
                drift,
                _over(force, masses),
                state.force,
                state.force_rate,
            ),
            _law(
                self.gains.rotation,
                inertias,
                ZERO,
                quaternion.log(turned),
                add(state.omega, -1.0, rate),
                _over(torque, inertias),
                state.torque,
                state.torque_rate,
            ),
        )


def saturated(body: Sphere, force: Vector, torque: Vector) -> tuple[Vector, Vector, bool, bool]:
    """What the vehicle can do of a force [N] and a moment [N m] that it is told, and whether it can do less of either.

    Its thrusters share the command, all in vehicle axes; without any, force, in any axes, and moment are limited in
    length.
    """
    if isinstance(body, RigidBody) and body.thrusters:
        force, torque, limited = body.thrusters.deliver(force, torque)
        return force, torque, limited, limited
    force, force_limited = limit(force, body.max_force)
    torque, torque_limited = limit(torque, body.max_torque)
    return force, torque, force_limited, torque_limited


def _over(a: Vector, b: Vector) -> Vector:
    return (a[0] / b[0], a[1] / b[1], a[2] / b[2])


def _law(k, inertia: Vector, integral, error, rate, ahead, output, output_rate) -> Vector:
    ki, k1, k2, k3, k4 = k
    return tuple(
        inertia[i] * ((1.0 + k3) * ahead[i] - ki * integral[i] - k1 * error[i] - k2 * rate[i])
        - k3 * output[i]
        - k4 * output_rate[i]
        for i in range(3)
    )


def _norm(v: Vector) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def steady_offset(body: Sphere, k, force: float) -> float:
    """Distance [m] that a regulator without integral stays off its target under a steady ``force`` [N]."""
    return force / body.virtual_mass * (1.0 + k[3]) / k[1]
