"""One tick of the vehicle: exact thrusters, fourth-order Runge-Kutta for the body, attitude through the rotation group.

RKMK4 (Munthe-Kaas): classical RK4 on position, velocity, angular velocity and the rotation vector phi of the step,
dphi/dt = omega + phi x omega / 2 + phi x (phi x omega) / 12, then q <- q exp(phi). No attitude is singular and the
quaternion keeps its length. The rotation of a sphere does not depend on the translation and is advanced first; a rigid
body's two are advanced together.
"""

from math import ceil
from typing import NamedTuple

from varos_warp.errors import InputError
from varos_warp.sim import quaternion
from varos_warp.sim.clock import TICK_S
from varos_warp.sim.quaternion import Quaternion, Vector, cross
from varos_warp.sim.vehicle.actuator import Actuator
from varos_warp.sim.vehicle.body import Sphere
from varos_warp.sim.vehicle.current import Current, SampledCurrent
from varos_warp.sim.vehicle.rigid_body import RigidBody

ZERO: Vector = (0.0, 0.0, 0.0)
SUBSTEP_ABOVE, REFUSE_ABOVE = 0.5, 2.0
"""Bounds on lambda h, rate of the fastest decay or swing times step; RK4 itself diverges beyond 2.785."""


class State(NamedTuple):
    """State of the vehicle; thrust in world axes unless ``actuator_frame`` is body or the vehicle a `RigidBody`."""

    p: Vector = ZERO
    """Position [m], world axes."""
    v: Vector = ZERO
    """Velocity [m/s], world axes."""
    q: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Attitude, vehicle to world."""
    omega: Vector = ZERO
    """Angular velocity [rad/s], vehicle axes."""
    force: Vector = ZERO
    """Thrust [N] and its rate [N/s]."""
    force_rate: Vector = ZERO
    torque: Vector = ZERO
    """Moment [N m] and its rate [N m/s], vehicle axes."""
    torque_rate: Vector = ZERO


def add(a: Vector, scale: float, b: Vector) -> Vector:
    """Sum of a and scale times b."""
    return (a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2])


def rk4_sum(k1: Vector, k2: Vector, k3: Vector, k4: Vector) -> Vector:
    """k1 + 2 k2 + 2 k3 + k4."""
    return (
        k1[0] + 2.0 * (k2[0] + k3[0]) + k4[0],
        k1[1] + 2.0 * (k2[1] + k3[1]) + k4[1],
        k1[2] + 2.0 * (k2[2] + k3[2]) + k4[2],
    )


def rotvec_rate(phi: Vector, omega: Vector) -> Vector:
    """Rate of the rotation vector of a step, exact to the order that RK4 sees."""
    turn = cross(phi, omega)
    twice = cross(phi, turn)
    return (
        omega[0] + 0.5 * turn[0] + twice[0] / 12.0,
        omega[1] + 0.5 * turn[1] + twice[1] / 12.0,
        omega[2] + 0.5 * turn[2] + twice[2] / 12.0,
    )


def step_translation(body: Sphere, p: Vector, v: Vector, forces, currents, h: float) -> tuple[Vector, Vector]:
    """Position and velocity ``h`` later by RK4; ``forces`` and ``currents`` at 0, h/2 and h, world axes."""
    a1 = body.acceleration(v, forces[0], *currents[0])
    a2 = body.acceleration(add(v, 0.5 * h, a1), forces[1], *currents[1])
    a3 = body.acceleration(add(v, 0.5 * h, a2), forces[1], *currents[1])
    a4 = body.acceleration(add(v, h, a3), forces[2], *currents[2])
    # dp/dt = v, so the RK4 sum of the velocities reduces to this
    p = (
        p[0] + h * v[0] + h * h / 6.0 * (a1[0] + a2[0] + a3[0]),
        p[1] + h * v[1] + h * h / 6.0 * (a1[1] + a2[1] + a3[1]),
        p[2] + h * v[2] + h * h / 6.0 * (a1[2] + a2[2] + a3[2]),
    )
    return p, add(v, h / 6.0, rk4_sum(a1, a2, a3, a4))


def step_rotation(body: Sphere, q: Quaternion, omega: Vector, torques, h: float) -> tuple[Quaternion, Vector, tuple]:
    """Attitude and angular velocity ``h`` later by RKMK4, and its four stage rates for `rotvec_halfway`."""

    def moment(torque: Vector, phi: Vector) -> Vector:
        if body.metacentric_height == 0.0:
            return torque
        return add(torque, 1.0, body.righting_moment(quaternion.multiply(q, quaternion.exp(phi))))

    k1, a1 = omega, body.angular_acceleration(omega, moment(torques[0], ZERO))
    phi2, omega2 = add(ZERO, 0.5 * h, k1), add(omega, 0.5 * h, a1)
    k2, a2 = rotvec_rate(phi2, omega2), body.angular_acceleration(omega2, moment(torques[1], phi2))
    phi3, omega3 = add(ZERO, 0.5 * h, k2), add(omega, 0.5 * h, a2)
    k3, a3 = rotvec_rate(phi3, omega3), body.angular_acceleration(omega3, moment(torques[1], phi3))
    phi4, omega4 = add(ZERO, h, k3), add(omega, h, a3)
    k4, a4 = rotvec_rate(phi4, omega4), body.angular_acceleration(omega4, moment(torques[2], phi4))
    phi = add(ZERO, h / 6.0, rk4_sum(k1, k2, k3, k4))
    q = quaternion.normalize(quaternion.multiply(q, quaternion.exp(phi)))
    return q, add(omega, h / 6.0, rk4_sum(a1, a2, a3, a4)), (k1, k2, k3, k4)


def step_together(
    body: RigidBody, p: Vector, v: Vector, q: Quaternion, omega: Vector, forces, torques, currents, h: float
) -> tuple[Vector, Vector, Quaternion, Vector]:
    """All four ``h`` later by RKMK4; thrust, in vehicle axes, and currents at 0, h/2 and h."""

    def rates(y, i: int):
        _, v, phi, omega = y
        a, alpha = body.accelerations(
            quaternion.multiply(q, quaternion.exp(phi)), v, omega, (forces[i], torques[i]), *currents[i]
        )
        return v, a, rotvec_rate(phi, omega), alpha

    def later(step: float, k):
        return tuple(add(x, step, slope) for x, slope in zip(y, k, strict=True))

    y = (p, v, ZERO, omega)
    k1 = rates(y, 0)
    k2 = rates(later(0.5 * h, k1), 1)
    k3 = rates(later(0.5 * h, k2), 1)
    k4 = rates(later(h, k3), 2)
    p, v, phi, omega = (add(x, h / 6.0, rk4_sum(*k)) for x, *k in zip(y, k1, k2, k3, k4, strict=True))
    return p, v, quaternion.normalize(quaternion.multiply(q, quaternion.exp(phi))), omega


def rotvec_halfway(rates, h: float) -> Vector:
    """Rotation vector of the first half of a step: the third-order dense output of RK4."""
    k1, k2, k3, k4 = rates
    return tuple(h / 24.0 * (5.0 * k1[i] + 4.0 * (k2[i] + k3[i]) - k4[i]) for i in range(3))


def substeps(body: Sphere, current_speed: float, h: float) -> int:
    """Steps that a tick is cut into so that RK4 stays accurate with stiff drag or righting moment; refuses stiffer."""
    stiffness = body.stiffness(current_speed) * h
    if stiffness > REFUSE_ABOVE:
        raise InputError(
            f"the motion is too stiff for ticks of {1e3 * h:g} ms: lambda h = {stiffness:.3g}, "
            f"at most {REFUSE_ABOVE:g} can be simulated",
            key="vehicle",
            remedy="Lower linear_drag, quadratic_drag (or the rotational ones), max_force, max_torque, "
            "metacentric_height or the current, or raise mass_kg, inertia or actuator_damping",
        )
    return max(1, ceil(stiffness / SUBSTEP_ABOVE))


class Dynamics:
    """The vehicle in its current, advanced by whole ticks of ``h``."""

    def __init__(self, body: Sphere, current: Current, *, actuator_frame: str = "world", h: float = TICK_S):
        self.body, self.in_body_axes = body, actuator_frame == "body" or isinstance(body, RigidBody)
        self._count = substeps(body, current.max_speed, h)
        self._h = h / self._count
        self._actuator = Actuator(body.actuator_frequency, body.actuator_damping, 0.5 * self._h)
        self._current = SampledCurrent(current, h, 2 * self._count)

    def thrust(self, state: State) -> tuple[Vector, Vector]:
        """Thrust [N] and its rate [N/s] in world axes."""
        if not self.in_body_axes:
            return state.force, state.force_rate
        rate = add(state.force_rate, 1.0, cross(state.omega, state.force))
        return quaternion.rotate(state.q, state.force), quaternion.rotate(state.q, rate)

    def accelerations(self, state: State, tick: int) -> tuple[Vector, Vector]:
        """Acceleration [m/s^2] in world and angular acceleration [rad/s^2] in vehicle axes, from the balances."""
        if isinstance(self.body, RigidBody):
            return self.body.accelerations(
                state.q, state.v, state.omega, (state.force, state.torque), *self._current.stages(tick)[0]
            )
        torque = state.torque
        if self.body.metacentric_height != 0.0:
            torque = add(torque, 1.0, self.body.righting_moment(state.q))
        current, current_rate = self._current.stages(tick)[0]
        return (
            self.body.acceleration(state.v, self.thrust(state)[0], current, current_rate),
            self.body.angular_acceleration(state.omega, torque),
        )

    def advance(self, state: State, force: Vector, torque: Vector, tick: int) -> State:
        """State at the next tick, a thrust [N], world axes, and a moment [N m], vehicle axes, held over this one."""
        if self.in_body_axes:
            force = quaternion.rotate_back(state.q, force)
        currents, actuate, h = self._current.stages(tick), self._actuator.advance, self._h
        p, v, q, omega, f0, f_rate, t0, t_rate = state
        for i in range(self._count):
            f1, f_rate = actuate(f0, f_rate, force)
            f2, f_rate = actuate(f1, f_rate, force)
            t1, t_rate = actuate(t0, t_rate, torque)
            t2, t_rate = actuate(t1, t_rate, torque)
            if isinstance(self.body, RigidBody):
                p, v, q, omega = step_together(
                    self.body, p, v, q, omega, (f0, f1, f2), (t0, t1, t2), currents[2 * i : 2 * i + 3], h
                )
                f0, t0 = f2, t2
                continue
            q_end, omega, rates = step_rotation(self.body, q, omega, (t0, t1, t2), h)
            forces = (f0, f1, f2)
            if self.in_body_axes:
                q_mid = quaternion.multiply(q, quaternion.exp(rotvec_halfway(rates, h)))
                forces = tuple(quaternion.rotate(a, f) for a, f in zip((q, q_mid, q_end), forces, strict=True))
            p, v = step_translation(self.body, p, v, forces, currents[2 * i : 2 * i + 3], h)
            q, f0, t0 = q_end, f2, t2
        return State(p, v, q, omega, f0, f_rate, t0, t_rate)
