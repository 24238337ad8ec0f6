"""Sweeps of the rigid body with six coupled degrees of freedom, and of its thrusters."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.stability.entry import Sweeps
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.description.body import Thruster
from varos_warp.sim import quaternion
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State
from varos_warp.sim.vehicle.rigid_body import RigidBody, rigid_body
from varos_warp.sim.vehicle.thrusters import PITCH, ROLL, thrusters

ROV = {
    "inertia": (0.26, 0.23, 0.37),
    "added_mass": (7.1, 6.4, 18.7, 0.19, 0.12, 0.22),
    "linear_drag": (18.0, 14.0, 60.0, 1.1, 0.9, 1.2),
    "quadratic_drag": (60.0, 40.0, 90.0, 1.6, 1.3, 1.6),
}
START = State(v=(0.5, 0.8, -0.3), omega=(1.5, -1.0, 0.7))
SECONDS = 0.6


def rov() -> RigidBody:
    """An open-frame vehicle of 13.5 kg."""
    return rigid_body(description.Vehicle(mass_kg=13.5, metacentric_height=0.05, rigid_body=ROV))


def end_of(body: RigidBody, h: float) -> np.ndarray:
    """Velocity in the world and rates [6] after `SECONDS` without thrust."""
    dynamics, state = Dynamics(body, Current(description.Current(), 0), h=h), START
    for tick in range(round(SECONDS / h)):
        state = dynamics.advance(state, ZERO, ZERO, tick)
    return np.array([*state.v, *state.omega])


def truth_of(body: RigidBody, state: State = START, seconds: float = SECONDS) -> np.ndarray:
    """Velocity in the world and rates [6] by DOP853 on Kirchhoff's equations in vehicle axes, still water."""
    M, J = np.array(body.masses), np.array(body.inertias)
    d, k = np.array(body.linear).reshape(2, 3), np.array(body.quadratic).reshape(2, 3)
    lift = body.displaced * body.gravity * body.metacentric_height

    def rates(_, y):
        q, v, omega = y[:4], y[4:7], y[7:]
        up = Rotation.from_quat(q, scalar_first=True).inv().apply([0.0, 0.0, 1.0])
        force = -(d[0] + k[0] * np.linalg.norm(v)) * v - np.cross(omega, M * v) + state.force
        moment = (
            np.cross([0.0, 0.0, lift], up)
            - (d[1] + k[1] * np.linalg.norm(omega)) * omega
            - np.cross(omega, J * omega)
            - np.cross(v, M * v)
            + state.torque
        )
        return np.concatenate([0.5 * np.array(quaternion.multiply(tuple(q), (0.0, *omega))), force / M, moment / J])

    y0 = [*state.q, *quaternion.rotate_back(state.q, state.v), *state.omega]
    y = solve_ivp(rates, (0.0, seconds), y0, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return np.concatenate([Rotation.from_quat(y[:4], scalar_first=True).apply(y[4:7]), y[7:]])


def vectored(angle: float) -> list[Thruster]:
    """Four thrusters at the corners that are turned by ``angle`` [rad] from straight ahead, and two upwards."""
    flat = [
        Thruster(
            position=(0.2 * x, 0.2 * y, 0.0), direction=(-x * y * np.sin(angle), np.cos(angle), 0.0), max_force=40.0
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return [*flat, *(Thruster(position=(x, 0.0, 0.0), direction=(0.0, 0.0, 1.0), max_force=40.0) for x in (-0.1, 0.1))]


def misallocated(angle: float) -> float:
    """Return how far the thrusters together are off what is asked of them, as a share."""
    blocks = vectored(angle)
    made = thrusters(blocks, 0.15, righted=True)
    controlled, worst = [i for i in range(6) if i not in (PITCH, ROLL)], 0.0
    for asked in np.eye(6)[controlled]:
        given = np.zeros(6)
        for block, share in zip(blocks, made.allocation @ asked, strict=True):
            force = share * block.max_force * np.divide(block.direction, np.linalg.norm(block.direction))
            given += [*force, *np.cross(block.position, force)]
        worst = max(worst, float(np.abs(given - asked)[controlled].max()))
    return max(worst, 1e-17)


@cache
def _rov_and_truth() -> tuple[RigidBody, np.ndarray]:
    return rov(), truth_of(rov())


def step_error(h: float) -> float:
    """All six degrees of freedom against DOP853, as a share of the rates at the start."""
    body, truth = _rov_and_truth()
    return float(np.linalg.norm(end_of(body, h) - truth) / np.linalg.norm([*START.v, *START.omega]))


SWEEPS: Sweeps = {
    "rigid_body_step": {"with substeps": step_error},
    "thruster_allocation": {"what is given": lambda degrees: misallocated(np.radians(degrees))},
}
