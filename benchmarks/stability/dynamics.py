"""Sweeps of the moving vehicle: steps, drag, righting moments, mass, water, sensors."""

from functools import cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.stability import dynamics_body, dynamics_control
from benchmarks.stability.entry import Sweeps
from varos_warp.products.sensors.imu import ImuNoise
from varos_warp.products.sensors.noise import noise
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.vehicle.body import Sphere, sphere
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State, step_rotation, step_translation

H = 0.005


def ball(**keys) -> Sphere:
    """The default vehicle but for some keys."""
    return sphere(description.Vehicle(**keys))


def states(body: Sphere, state: State, ticks: int, h: float = H, current: Current | None = None):
    """States after every tick; the thrusters keep delivering what they deliver at the start."""
    dynamics = Dynamics(body, current or Current(description.Current(), 0), h=h)
    for tick in range(ticks):
        state = dynamics.advance(state, state.force, state.torque, tick)
        yield state


def fly(*arguments, **options) -> State:
    """The last of the states."""
    return [*states(*arguments, **options)][-1]


def turned(body: Sphere, q, omega, torque, ticks: int, h: float = H):
    """Attitude and rates after ticks of one step each, however stiff the body."""
    for _ in range(ticks):
        q, omega, _ = step_rotation(body, q, omega, [torque] * 3, h)
    return q, omega


def below(limit: float, error: float) -> float:
    """The error; nan where it grows beyond all use."""
    return float(error) if error < limit else float("nan")


# --------------------------------------------------------------------------------------------------------------- steps

PUSH, PUSHED = 120.0, ball(linear_drag=0.0, linear_rotational_drag=0.0, quadratic_rotational_drag=0.0)


def pushed_from_rest(h: float, substeps: bool) -> float:
    """Worst relative error of speeds up to the terminal one, against tanh."""
    ticks, v, speeds, calm = round(12.0 / h), ZERO, [], [(ZERO, ZERO)] * 3
    if substeps:
        speeds = [state.v[0] for state in states(PUSHED, State(force=(PUSH, 0.0, 0.0)), ticks, h)]
    for _ in range(0 if substeps else ticks):
        _, v = step_translation(PUSHED, ZERO, v, [(PUSH, 0.0, 0.0)] * 3, calm, h)
        speeds.append(v[0])
    rate = np.sqrt(PUSH * PUSHED.quadratic_drag) / PUSHED.virtual_mass
    truth = np.sqrt(PUSH / PUSHED.quadratic_drag) * np.tanh(np.arange(1, ticks + 1) * h * rate)
    return below(1e3, np.abs(speeds / truth - 1.0).max())


TUMBLING = State(omega=(1.5, -1.0, 0.7), torque=(0.5, 2.0, -1.5))
TUMBLER, SECONDS = ball(quadratic_rotational_drag=0.3, metacentric_height=0.02), 3.0


@cache
def tumbled() -> Rotation:
    """Attitude after `SECONDS` by DOP853."""

    def rates(_, y):
        q, omega = tuple(y[:4] / np.linalg.norm(y[:4])), tuple(y[4:])
        turn = TUMBLER.angular_acceleration(omega, np.add(TUMBLING.torque, TUMBLER.righting_moment(q)))
        return np.concatenate([0.5 * np.array(quaternion.multiply(tuple(y[:4]), (0.0, *omega))), turn])

    y0 = [*TUMBLING.q, *TUMBLING.omega]
    y = solve_ivp(rates, (0.0, SECONDS), y0, method="DOP853", rtol=1e-13, atol=1e-14).y[:4, -1]
    return Rotation.from_quat(y, scalar_first=True)


def tumbling_error(h: float, substeps: bool) -> float:
    """Angle [rad] to the truth of a tumbling vehicle with a righting moment."""
    start, ticks = TUMBLING, round(SECONDS / h)
    one_step = (TUMBLER, start.q, start.omega, start.torque, ticks, h)
    q = fly(TUMBLER, start, ticks, h).q if substeps else turned(*one_step)[0]
    return float((tumbled().inv() * Rotation.from_quat(q, scalar_first=True)).magnitude())


# ---------------------------------------------------------------------------------------------------- drag and righting


def decay_error(z: float, growth: float | None = None) -> float:
    """Of a speed that linear drag takes, lambda h = z: against exp(-t) by us, or by a method that grows so a tick."""
    ticks, base = 20, ball(quadratic_drag=0.0)
    if growth is None:
        body = ball(quadratic_drag=0.0, linear_drag=z / H * base.virtual_mass)
        left = fly(body, State(v=(1.0, 0.0, 0.0)), ticks).v[0]
    else:
        left = growth**ticks if abs(growth) < 1.0 else np.nan
    return abs(left - np.exp(-z * ticks))


def swing_error(z: float, substeps: bool) -> float:
    """Of a tilted vehicle without drag, omega h = z, in its angle and rate."""
    J, weight, tilt, ticks = ball().inertia, 40.0 * 9.81, 1e-4, 200
    drags = ("linear_drag", "quadratic_drag", "linear_rotational_drag", "quadratic_rotational_drag")
    body, q = ball(metacentric_height=(z / H) ** 2 * J / weight, **dict.fromkeys(drags, 0.0)), (tilt, 0.0, 0.0)
    if substeps:
        end = fly(body, State(q=quaternion.exp(q)), ticks)
        q, omega = end.q, end.omega
    else:
        q, omega = turned(body, quaternion.exp(q), ZERO, ZERO, ticks)
    angle, rate = quaternion.log(q)[0] / tilt, omega[0] / tilt * H / z
    return below(10.0, np.hypot(angle - np.cos(z * ticks), rate + np.sin(z * ticks)))


def speed_error(body: Sphere, drive: float, seconds: float, speed: float) -> float:
    """Relative error of the speed that a steady force [N] brings in so long, against its closed form."""
    root = np.sqrt(body.linear_drag**2 + 4.0 * body.quadratic_drag * drive)
    terminal, other = 2.0 * drive / (body.linear_drag + root), -(body.linear_drag + root) / (2.0 * body.quadratic_drag)
    decay = seconds * root / body.virtual_mass
    return abs(speed / (terminal * -np.expm1(-decay) / (1.0 - terminal / other * np.exp(-decay))) - 1.0)


def mass_error(mass_kg: float) -> float:
    """After a second at full force, what is absent following from the mass."""
    body = ball(mass_kg=mass_kg)
    return speed_error(body, body.max_force, 1.0, fly(body, State(force=(body.max_force, 0.0, 0.0)), 200).v[0])


def buoyancy_error(buoyancy: float) -> float:
    """After 20 s of rise or fall with the thrusters off."""
    body = ball(net_buoyancy=buoyancy)
    return speed_error(body, abs(buoyancy), 20.0, abs(fly(body, State(), round(20.0 / H)).v[2]))


# --------------------------------------------------------------------------------------------------------------- water


def taken_along(period: float, refuse: bool) -> float:
    """Worst lag of a free vehicle in a current that changes ever faster, over its changes."""
    current = Current(description.Current(fluctuation=0.1, period_s=period if refuse else 1.0), 5)
    if not refuse:
        current.frequency = current.frequency / period
    made = states(
        ball(linear_drag=0.0, quadratic_drag=0.0), State(v=tuple(current.velocity([0.0])[0])), 400, H, current
    )
    lags = [np.linalg.norm(state.v - current.velocity([tick * H])[0]) for tick, state in enumerate(made, 1)]
    return float(max(lags)) / 0.1


def drifting_error(speed: float) -> float:
    """Relative error of the speed after 2 s of a vehicle at rest that a current takes along."""
    body, current, ticks = ball(), Current(description.Current(velocity=(speed, 0.0, 0.0)), 0), 400
    c, k, t = body.linear_drag / body.virtual_mass, body.quadratic_drag / body.virtual_mass, ticks * H
    left = speed * np.exp(-c * t) / (1.0 + k * speed * -np.expm1(-c * t) / c)
    return abs((fly(body, State(), ticks, current=current).v[0] - (speed - left)) / speed)


def noise_error(density: float, walk: bool) -> float:
    """Relative error of the spread of white noise, or of the steps of a random walk."""
    ImuNoise(accelerometer_noise_density=density)
    made, root = noise(100_000, 200.0, density, density, np.random.default_rng(7)), np.sqrt(200.0)
    values, expected = (np.diff(made.bias, axis=0), density / root) if walk else (made.white, density * root)
    return abs(float((values / expected).std()) - 1.0)


SWEEPS: Sweeps = {
    "integration_step": {
        "with substeps": lambda h: pushed_from_rest(h, True),
        "one step a tick": lambda h: pushed_from_rest(h, False),
    },
    "attitude_step": {
        "with substeps": lambda h: tumbling_error(h, True),
        "one step a tick": lambda h: tumbling_error(h, False),
    },
    "drag_stiffness": {
        "ours": decay_error,
        "RK4, one step a tick": lambda z: decay_error(z, 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24),
        "Euler": lambda z: decay_error(z, 1 - z),
    },
    "righting_stiffness": {"ours": lambda z: swing_error(z, True), "one step a tick": lambda z: swing_error(z, False)},
    "mass": {"speed after 1 s": mass_error},
    "net_buoyancy": {"speed after 20 s": buoyancy_error},
    "current_period": {"ours": lambda p: taken_along(p, True), "if it were taken": lambda p: taken_along(p, False)},
    "current_speed": {"speed after 2 s": drifting_error},
    "imu_noise": {"white noise": lambda d: noise_error(d, False), "random walk": lambda d: noise_error(d, True)},
    **dynamics_body.SWEEPS,
    **dynamics_control.SWEEPS,
}
