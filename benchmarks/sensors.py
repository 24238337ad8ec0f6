"""Poses and IMU readings: error against the integration step, and against the rate of the samples.

In one course the thrusters' commands are held over 80 ms, so that every step up to that length integrates the same
problem. Within a step the thrusters are exact and the rest is smooth, so RK4 and RKMK4 converge with the fourth power
of the step (Hairer, Norsett and Wanner 1993, II.2; Munthe-Kaas 1999). The trapezoidal rule on IMU samples, as in an
estimator, converges with the second power of their interval.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.machine import Stopwatch
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.clock import TICK_S
from varos_warp.sim.guidance import Guidance, plan
from varos_warp.sim.quaternion import rotate, rotate_back
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.body import sphere
from varos_warp.sim.vehicle.control import Regulator
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import Dynamics, State, substeps

HELD_S, SECONDS = 0.08, 16.0
STEPS_MS = (20.0, 10.0, 5.0, 2.5, 1.25)
"""5 ms is the simulator's. Longer ones than 20 ms would be cut, for this vehicle's drag: ``substep_ms`` would tell."""
TRUTH_MS = 0.3125
RATES_HZ = (10, 20, 25, 40, 50, 100, 200)
STEP_ORDER, RATE_ORDER = 4, 2
"""Powers of the step and of the interval that the errors must fall with."""
REPEATS = 3


@dataclass(frozen=True)
class Flight:
    """Motion at every end of a held command: what every step length has in common."""

    position: np.ndarray
    """[n, 3] [m]"""
    attitude: Rotation
    specific_force: np.ndarray
    """[n, 3] [m/s^2], vehicle axes: what an IMU at the vehicle's origin feels."""
    angular_velocity: np.ndarray
    """[n, 3] [rad/s], vehicle axes."""
    substeps: int
    """That each step was cut into."""
    cpu_seconds: float


def course(actuator_frame: str = "world") -> Scene:
    """A vehicle that turns, climbs and brakes in a current that comes and goes."""
    waypoints = [
        {"position": (0, 0, 0), "look_at": (0, 5, -1)},
        {"position": (0, 4, 0), "rotation_euler_deg": (-10, 0, 40)},
        {"position": (3, 6, 0.5), "rotation_euler_deg": (15, 10, -60)},
        {"position": (0, 9, 1)},
    ]
    return scene_from_dict(
        {
            "trajectory": {"waypoints": waypoints, "speed": 1.0, "max_acceleration": 1.0, "max_angular_speed_deg": 60},
            "current": {"velocity": (0.1, 0.05, 0.0), "fluctuation": 0.1, "period_s": 5.0},
            "vehicle": {"actuator_frame": actuator_frame, "metacentric_height": 0.01},
        }
    )


def commands(scene: Scene) -> list[tuple]:
    """Force and moment that the regulator asks for every `HELD_S`, for a vehicle that follows the scene's course.

    The force is in the axes that its thrusters lag in.
    """
    body = sphere(scene.vehicle, scene.gravity)
    guidance = Guidance(plan(scene.trajectory), HELD_S)
    regulator = Regulator(body, scene.vehicle.controller, HELD_S)
    dynamics = _dynamics(scene, HELD_S)
    state, held = State(q=guidance.start), []
    for tick in range(round(SECONDS / HELD_S)):
        reference = guidance.reference(tick, state.p, state.q)
        force, torque = regulator.command(reference, state, dynamics.thrust(state))
        held.append((rotate_back(state.q, force) if dynamics.in_body_axes else force, torque))
        state = dynamics.advance(state, force, torque, tick)
    return held


def _dynamics(scene: Scene, h: float) -> Dynamics:
    body, current = sphere(scene.vehicle, scene.gravity), Current(scene.current, scene.seed)
    return Dynamics(body, current, actuator_frame=scene.vehicle.actuator_frame, h=h)


def fly(scene: Scene, held: list[tuple], h: float) -> Flight:
    """Replay commands with steps of ``h`` [s], which divides `HELD_S`."""
    every = round(HELD_S / h)
    dynamics, state = _dynamics(scene, h), State(q=Guidance(plan(scene.trajectory)).start)
    watch, rows = Stopwatch(), []
    for k, (force, torque) in enumerate(held):
        for tick in range(k * every, (k + 1) * every):
            # `advance` takes world axes and turns them back with this very attitude
            command = rotate(state.q, force) if dynamics.in_body_axes else force
            state = dynamics.advance(state, command, torque, tick)
        rows.append((*state.p, *state.q, *dynamics.accelerations(state, (k + 1) * every)[0], *state.omega))
    cpu_seconds, table = watch.cpu_seconds, np.array(rows)
    attitude = Rotation.from_quat(table[:, 3:7], scalar_first=True)
    felt = attitude.inv().apply(table[:, 7:10] + [0.0, 0.0, scene.gravity])
    count = substeps(dynamics.body, Current(scene.current, scene.seed).max_speed, h)
    return Flight(table[:, :3], attitude, felt, table[:, 10:], count, cpu_seconds)


def step_rows(steps_ms=STEPS_MS) -> list[dict]:
    """RMS error of pose and readings against a run with steps of `TRUTH_MS`; CPU seconds per simulated second."""
    rows = []
    for frame in ("world", "body"):
        scene = course(frame)
        held = commands(scene)
        truth = fly(scene, held, 1e-3 * TRUTH_MS)
        for step_ms in steps_ms:
            flights = [fly(scene, held, 1e-3 * step_ms) for _ in range(REPEATS)]
            flight = flights[0]
            rows.append(
                {
                    "sweep": "step",
                    "actuator_frame": frame,
                    "step_ms": step_ms,
                    "substep_ms": step_ms / flight.substeps,
                    "position_m": rms(flight.position - truth.position),
                    "attitude_rad": rms((truth.attitude.inv() * flight.attitude).as_rotvec()),
                    "specific_force": rms(flight.specific_force - truth.specific_force),
                    "angular_velocity": rms(flight.angular_velocity - truth.angular_velocity),
                    "cpu_seconds_per_second": min(one.cpu_seconds for one in flights) / SECONDS,
                }
            )
    return rows


def rate_rows(rates_hz=RATES_HZ) -> list[dict]:
    """RMS error of the pose that trapezoids through the IMU's rows come to, by the rate of the rows."""
    scene = course()
    simulation = simulate(scene)
    watch, rows = Stopwatch(), []
    simulate(scene)
    cost = watch.cpu_seconds / (len(simulation.trajectory.time_ns) * TICK_S)
    for rate in rates_hz:
        position, attitude = dead_reckoning(simulation, round(1.0 / (TICK_S * rate)), scene.gravity)
        rows.append(
            {
                "sweep": "rate",
                "rate_hz": rate,
                "step_ms": 1e3 / rate,
                "position_m": position,
                "attitude_rad": attitude,
                "cpu_seconds_per_second": cost,
            }
        )
    return rows


def dead_reckoning(simulation, stride: int, gravity: float) -> tuple[float, float]:
    """RMS errors [m] and [rad] of integrating every ``stride``-th IMU row from the first true pose and velocity."""
    imu, trajectory, h = simulation.imu, simulation.trajectory, stride * TICK_S
    w, felt = imu.angular_velocity[::stride], imu.acceleration[::stride]
    turns = Rotation.from_rotvec(0.5 * h * (w[:-1] + w[1:]) + h * h / 12.0 * np.cross(w[:-1], w[1:]))
    attitudes = [trajectory.rotation()[0]]
    for k in range(len(turns)):
        attitudes.append(attitudes[-1] * turns[k])
    attitudes = Rotation.concatenate(attitudes)
    a = attitudes.apply(felt) - [0.0, 0.0, gravity]
    start = trajectory.velocity[0]
    v = start + np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * h * (a[:-1] + a[1:]), axis=0)])
    steps = h * v[:-1] + h * h / 6.0 * (2.0 * a[:-1] + a[1:])
    p = trajectory.position[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    turned = trajectory.rotation()[::stride].inv() * attitudes
    return rms(p - trajectory.position[::stride]), rms(turned.as_rotvec())


def rms(errors: np.ndarray) -> float:
    """Root of the mean squared length of the rows [n, 3]."""
    return float(np.sqrt((np.asarray(errors) ** 2).sum(axis=-1).mean()))
