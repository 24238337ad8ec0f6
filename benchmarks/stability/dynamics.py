"""Sweeps of the moving vehicle: steps, drag, righting moments, mass, water, sensors."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.stability import dynamics_body, dynamics_control
from benchmarks.stability.entry import Measured, Sweeps
from varos_warp.errors import InputError
from varos_warp.products.sensors.noise import noise
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.vehicle.body import Sphere, sphere
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State, step_rotation, step_translation

H = 0.005
WITHOUT_DRAG = dict.fromkeys(
    ("linear_drag", "quadratic_drag", "linear_rotational_drag", "quadratic_rotational_drag"), 0.0
)


def still() -> Current:
    return Current(description.Current(), 0)


def or_nan(function, *arguments) -> float:
    """What a function returns; nan where it refuses its arguments or fails for want of numbers."""
    try:
        return function(*arguments)
    except (InputError, OverflowError, ZeroDivisionError):
        return float("nan")


def fly(body: Sphere, state: State, ticks: int, h: float = H, current: Current | None = None) -> State:
    """The thrusters keep delivering what they deliver at the start."""
    dynamics = Dynamics(body, current or still(), h=h)
    for tick in range(ticks):
        state = dynamics.advance(state, state.force, state.torque, tick)
    return state


# --------------------------------------------------------------------------------------------------------------- steps


def integration_step() -> Measured:
    """Measure speeds from rest to terminal speed against tanh, by ticks from 0.1 ms to seconds."""
    body = sphere(description.Vehicle(linear_drag=0.0, linear_rotational_drag=0.0, quadratic_rotational_drag=0.0))
    force, seconds = 120.0, 12.0
    tau = body.virtual_mass / np.sqrt(force * body.quadratic_drag)
    steps = [1e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2, 1.5, 2.0]

    def truth(t):
        return np.sqrt(force / body.quadratic_drag) * np.tanh(t / tau)

    def ours(h):
        states, worst, dynamics = State(force=(force, 0.0, 0.0)), 0.0, Dynamics(body, still(), h=h)
        for tick in range(round(seconds / h)):
            states = dynamics.advance(states, states.force, ZERO, tick)
            worst = max(worst, abs(states.v[0] / truth((tick + 1) * h) - 1.0))
        return worst

    def bare(h):
        v, worst, calm = ZERO, 0.0, [(ZERO, ZERO)] * 3
        for tick in range(round(seconds / h)):
            _, v = step_translation(body, ZERO, v, [(force, 0.0, 0.0)] * 3, calm, h)
            worst = max(worst, abs(v[0] / truth((tick + 1) * h) - 1.0))
        return worst if worst < 1e3 else float("nan")

    return steps, {
        "with substeps": [or_nan(ours, h) for h in steps],
        "one step a tick": [or_nan(bare, h) for h in steps],
    }


def attitude_step() -> Measured:
    """A tumbling vehicle with a righting moment against DOP853, by ticks."""
    body = sphere(description.Vehicle(quadratic_rotational_drag=0.3, metacentric_height=0.02))
    start, seconds = State(omega=(1.5, -1.0, 0.7), torque=(0.5, 2.0, -1.5)), 3.0

    def rates(_, y):
        q, omega = tuple(y[:4] / np.linalg.norm(y[:4])), tuple(y[4:])
        torque = np.add(start.torque, body.righting_moment(q))
        return np.concatenate(
            [0.5 * np.array(quaternion.multiply(tuple(y[:4]), (0.0, *omega))), body.angular_acceleration(omega, torque)]
        )

    y = solve_ivp(rates, (0.0, seconds), [*start.q, *start.omega], method="DOP853", rtol=1e-13, atol=1e-14).y[:4, -1]
    truth = Rotation.from_quat(y, scalar_first=True)
    steps = [seconds / n for n in (3000, 600, 300, 100, 50, 30, 20, 15, 12, 10, 8, 6, 4, 3)]

    def error(q):
        return float((truth.inv() * Rotation.from_quat(q, scalar_first=True)).magnitude())

    def bare(h):
        q, omega = start.q, start.omega
        for _ in range(round(seconds / h)):
            q, omega, _ = step_rotation(body, q, omega, [start.torque] * 3, h)
        return error(q)

    return steps, {
        "with substeps": [or_nan(lambda h: error(fly(body, start, round(seconds / h), h).q), h) for h in steps],
        "one step a tick": [or_nan(bare, h) for h in steps],
    }


# ---------------------------------------------------------------------------------------------------- drag and righting


def drag_stiffness() -> Measured:
    """Decay by linear drag against exp(-t), by lambda h."""
    base, ticks = sphere(description.Vehicle(quadratic_drag=0.0)), 20
    numbers = [1e-6, 1e-4, 1e-2, 0.1, 0.3, 0.5, 0.51, 0.8, 1.0, 1.01, 1.5, 1.99, 2.01, 2.5, 2.7, 2.8, 3.0, 5.0]

    def decay(z, growth):
        return abs(growth**ticks - np.exp(-z * ticks)) if abs(growth) < 1.0 else float("nan")

    def ours(z):
        body = sphere(description.Vehicle(quadratic_drag=0.0, linear_drag=z / H * base.virtual_mass))
        return max(abs(fly(body, State(v=(1.0, 0.0, 0.0)), ticks).v[0] - np.exp(-z * ticks)), 1e-17)

    rk4 = [decay(z, 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24) for z in numbers]
    return numbers, {
        "ours": [or_nan(ours, z) for z in numbers],
        "RK4, one step a tick": [max(e, 1e-17) for e in rk4],
        "Euler": [max(decay(z, 1 - z), 1e-17) for z in numbers],
    }


def righting_stiffness() -> Measured:
    """Swing of a tilted vehicle without drag, by omega h."""
    J, weight, tilt, ticks = sphere(description.Vehicle()).inertia, 40.0 * 9.81, 1e-4, 200
    numbers = [1e-3, 1e-2, 0.1, 0.3, 0.5, 0.51, 1.0, 1.5, 1.99, 2.01, 2.5, 2.8, 2.9, 4.0]

    def body(z):
        return sphere(description.Vehicle(metacentric_height=(z / H) ** 2 * J / weight, **WITHOUT_DRAG))

    def off(z, q, omega):
        angle, rate = quaternion.log(q)[0] / tilt, omega[0] / tilt * H / z
        return float(np.hypot(angle - np.cos(z * ticks), rate + np.sin(z * ticks)))

    def ours(z):
        end = fly(body(z), State(q=quaternion.exp((tilt, 0.0, 0.0))), ticks)
        return off(z, end.q, end.omega)

    def bare(z):
        q, omega = quaternion.exp((tilt, 0.0, 0.0)), ZERO
        for _ in range(ticks):
            q, omega, _ = step_rotation(body(z), q, omega, [ZERO] * 3, H)
        error = off(z, q, omega)
        return error if error < 10.0 else float("nan")

    return numbers, {"ours": [or_nan(ours, z) for z in numbers], "one step a tick": [or_nan(bare, z) for z in numbers]}


def mass() -> Measured:
    """Vehicles from a gram to a million tonnes, what is absent following from the mass."""
    masses = [1e-3, 0.01, 0.03, 0.04, 0.0453, 0.1, 1.0, 12.0, 40.0, 100.0, 1e3, 1e4, 1e6, 1e9, 1e12]

    def error(mass_kg):
        body = sphere(description.Vehicle(mass_kg=mass_kg))
        root = np.sqrt(body.linear_drag**2 + 4.0 * body.quadratic_drag * body.max_force)
        terminal, other = body.max_speed, -(body.linear_drag + root) / (2.0 * body.quadratic_drag)
        E = np.exp(-200 * H * root / body.virtual_mass)
        truth = terminal * -np.expm1(-200 * H * root / body.virtual_mass) / (1.0 - terminal / other * E)
        return max(abs(fly(body, State(force=(body.max_force, 0.0, 0.0)), 200).v[0] / truth - 1.0), 1e-17)

    return masses, {"speed after 1 s": [or_nan(error, m) for m in masses]}


def net_buoyancy() -> Measured:
    """Rise and fall with the thrusters off."""
    values = [-391.0, -300.0, -120.0, -10.0, -1e-3, 1e-3, 10.0, 120.0, 1e3, 1e5, 1e7]

    def error(buoyancy):
        body = sphere(description.Vehicle(net_buoyancy=buoyancy))
        seconds, drive = 20.0, abs(buoyancy)
        root = np.sqrt(body.linear_drag**2 + 4.0 * body.quadratic_drag * drive)
        terminal = 2.0 * drive / (body.linear_drag + root)
        other = -(body.linear_drag + root) / (2.0 * body.quadratic_drag)
        decay = seconds * root / body.virtual_mass
        truth = terminal * -np.expm1(-decay) / (1.0 - terminal / other * np.exp(-decay))
        return max(abs(abs(fly(body, State(), round(seconds / H)).v[2]) / truth - 1.0), 1e-17)

    return values, {"speed after 20 s": [or_nan(error, b) for b in values]}


# --------------------------------------------------------------------------------------------------------------- water


def current_period() -> Measured:
    """A free vehicle in a current that changes ever faster."""
    periods = [1e-3, 3e-3, 0.01, 0.02, 0.05, 0.099, 0.1, 0.2, 0.5, 1.0, 5.0, 20.0, 1e3, 1e6, 1e9]
    body = sphere(description.Vehicle(linear_drag=0.0, quadratic_drag=0.0))

    def error(period, taken):
        if not taken:
            current = Current(description.Current(fluctuation=0.1, period_s=period), 5)
        else:
            current = Current(description.Current(fluctuation=0.1, period_s=1.0), 5)
            current.frequency = current.frequency / period
        worst, state = 0.0, State(v=tuple(current.velocity([0.0])[0]))
        dynamics = Dynamics(body, current)
        for tick in range(400):
            state = dynamics.advance(state, ZERO, ZERO, tick)
            worst = max(worst, float(np.linalg.norm(state.v - current.velocity([(tick + 1) * H])[0])))
        return worst / 0.1

    return periods, {
        "ours": [or_nan(error, p, False) for p in periods],
        "if it were taken": [or_nan(error, p, True) for p in periods],
    }


def current_speed() -> Measured:
    """A vehicle at rest that a current takes along."""
    speeds = [1e-6, 1e-3, 0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 200.0, 239.0, 241.0, 300.0, 1e3, 1e6]
    body = sphere(description.Vehicle())

    def error(speed):
        current, ticks = Current(description.Current(velocity=(speed, 0.0, 0.0)), 0), 400
        c, k, t = body.linear_drag / body.virtual_mass, body.quadratic_drag / body.virtual_mass, ticks * H
        left = speed * np.exp(-c * t) / (1.0 + k * speed * -np.expm1(-c * t) / c)
        v = fly(body, State(), ticks, current=current).v[0]
        return max(abs((v - (speed - left)) / speed), 1e-17)

    return speeds, {"speed after 2 s": [or_nan(error, s) for s in speeds]}


# ------------------------------------------------------------------------------------------------- attitude and sensors


def imu_noise() -> Measured:
    """Densities from nothing to where readings end."""
    densities = [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12]
    count, rate = 100_000, 200.0

    def error(density, walk):
        try:
            description.ImuNoise(accelerometer_noise_density=density)
        except ValueError:
            return float("nan")
        made = noise(count, rate, density, density, np.random.default_rng(7))
        if walk:
            steps = np.diff(made.bias, axis=0) / (density / np.sqrt(rate))
            return abs(float(steps.std()) - 1.0)
        return abs(float((made.white / (density * np.sqrt(rate))).std()) - 1.0)

    return densities, {
        "white noise": [error(d, False) for d in densities],
        "random walk": [error(d, True) for d in densities],
    }


SWEEPS: Sweeps = (
    integration_step,
    attitude_step,
    drag_stiffness,
    righting_stiffness,
    mass,
    net_buoyancy,
    current_period,
    current_speed,
    imu_noise,
    *dynamics_body.SWEEPS,
    *dynamics_control.SWEEPS,
)
