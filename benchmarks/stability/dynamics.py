"""Sweeps of the moving vehicle: steps, drag, righting moments, mass, water, sensors."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from benchmarks.stability import dynamics_body, dynamics_control
from benchmarks.stability.entry import Sweep, Sweeps
from varos_warp.errors import InputError
from varos_warp.products.sensors.noise import noise
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.frames import euler_angles, look_at_matrix
from varos_warp.sim import quaternion
from varos_warp.sim.vehicle.body import Sphere, sphere
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State, step_rotation, step_translation

H = 0.005
TESTS = "tests/stability/test_vehicle_limits.py"
OLD_TESTS = "tests/stability/test_dynamics_limits.py"
STIFF = (
    "refuses a lambda h above 2 with one message that names what makes the motion stiff; cuts the tick into "
    "up to 4 substeps above 0.5"
)
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


def integration_step() -> Sweep:
    """From rest to terminal speed against tanh, by ticks from 0.1 ms to seconds."""
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

    limit = 2.0 / body.stiffness()
    return Sweep(
        "integration_step",
        "Step of the integration",
        "RK4 of the translation, with substeps",
        "tick h [s]",
        steps,
        {"with substeps": [or_nan(ours, h) for h in steps], "one step a tick": [or_nan(bare, h) for h in steps]},
        "Worst relative error of the speed on the way to terminal speed, thrust 120 N, quadratic drag, against tanh; "
        "it falls with the fourth power of h.",
        f"ticks of the simulator are 5 ms, where the error is {or_nan(ours, H):.1g}; lambda h = 2 is at {limit:.2f} s "
        "for this vehicle",
        "the RK4 step itself diverges from lambda h = 2.785 on",
        STIFF,
        f"{OLD_TESTS}::test_rk4_itself_would_diverge_where_the_simulator_refuses",
        holds=(None, limit),
    )


def attitude_step() -> Sweep:
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

    limit = 2.0 / body.stiffness()
    return Sweep(
        "attitude_step",
        "Step of the attitude",
        "RKMK4 of the rotation, with substeps",
        "tick h [s]",
        steps,
        {
            "with substeps": [or_nan(lambda h: error(fly(body, start, round(seconds / h), h).q), h) for h in steps],
            "one step a tick": [or_nan(bare, h) for h in steps],
        },
        "Error of the attitude [rad] after 3 s of tumbling with a righting moment, against DOP853 on the quaternion "
        "itself at 1e-13; fourth order.",
        f"ticks of the simulator are 5 ms; lambda h = 2 is at {limit:.2f} s for this vehicle",
        "the series of the rotation vector leaves its range: errors of a radian",
        STIFF,
        "tests/physics/test_dynamics.py::test_the_attitude_converges_with_the_fourth_power_of_the_step",
        holds=(None, limit),
    )


def quaternion_drift() -> Sweep:
    """Up to a million steps at a constant rate of turning."""
    body, omega = sphere(description.Vehicle(**WITHOUT_DRAG)), (1.1, -0.7, 0.4)
    counts = [1, 10, 100, 1000, 10_000, 100_000, 1_000_000]
    lengths, angles, state, dynamics, done = [], [], State(omega=omega), Dynamics(body, still()), 0
    rate = np.linalg.norm(omega)
    for count in counts:
        for tick in range(done, count):
            state = dynamics.advance(state, ZERO, ZERO, tick)
        done = count
        turned = Rotation.from_rotvec(np.array(omega) / rate * np.fmod(rate * count * H, 2.0 * np.pi))
        lengths.append(max(abs(np.linalg.norm(state.q) - 1.0), 1e-17))
        angles.append(float((turned.inv() * Rotation.from_quat(state.q, scalar_first=True)).magnitude()))
    return Sweep(
        "quaternion_drift",
        "Drift of the quaternion",
        "RKMK4, normalised at every step",
        "steps",
        counts,
        {"length": lengths, "attitude [rad]": angles},
        "Deviation of the quaternion's length from 1, and of the attitude from exp(omega t), at a constant 1.36 rad/s.",
        "no end found: after a million steps (83 minutes) the length is 1 to the last digit and the attitude right to "
        f"{angles[-1]:.1g} rad",
        "the rounding of the attitude adds up, slower than in proportion to the steps",
        "normalises each step",
        f"{TESTS}::test_the_quaternion_does_not_drift",
        holds=(None, None),
        bound=1e-9,
    )


# ---------------------------------------------------------------------------------------------------- drag and righting


def drag_stiffness() -> Sweep:
    """Decay by linear drag against exp(-t), by lambda h."""
    base, ticks = sphere(description.Vehicle(quadratic_drag=0.0)), 20
    numbers = [1e-6, 1e-4, 1e-2, 0.1, 0.3, 0.5, 0.51, 0.8, 1.0, 1.01, 1.5, 1.99, 2.01, 2.5, 2.7, 2.8, 3.0, 5.0]

    def decay(z, growth):
        return abs(growth**ticks - np.exp(-z * ticks)) if abs(growth) < 1.0 else float("nan")

    def ours(z):
        body = sphere(description.Vehicle(quadratic_drag=0.0, linear_drag=z / H * base.virtual_mass))
        return max(abs(fly(body, State(v=(1.0, 0.0, 0.0)), ticks).v[0] - np.exp(-z * ticks)), 1e-17)

    rk4 = [decay(z, 1 - z + z**2 / 2 - z**3 / 6 + z**4 / 24) for z in numbers]
    return Sweep(
        "drag_stiffness",
        "Stiff drag",
        "RK4 with substeps",
        "lambda h",
        numbers,
        {
            "ours": [or_nan(ours, z) for z in numbers],
            "RK4, one step a tick": [max(e, 1e-17) for e in rk4],
            "Euler": [max(decay(z, 1 - z), 1e-17) for z in numbers],
        },
        "Error of the speed after 20 ticks of coasting from 1 m/s with linear drag, against exp(-lambda t).",
        "lambda h = 2; for the vehicle of 40 kg a linear_drag of 24 000 N s/m or a quadratic_drag of 1.2e6 N s^2/m^2",
        "beyond lambda h = 2 Euler oscillates, beyond 2.785 RK4 grows",
        STIFF,
        f"{OLD_TESTS}::test_drag_too_stiff_for_the_clock_is_refused_with_its_number",
        holds=(None, 2.0),
    )


def righting_stiffness() -> Sweep:
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

    return Sweep(
        "righting_stiffness",
        "Stiff righting moment",
        "RKMK4 with substeps",
        "omega h",
        numbers,
        {"ours": [or_nan(ours, z) for z in numbers], "one step a tick": [or_nan(bare, z) for z in numbers]},
        "Error of the swing (angle and rate, as shares of the amplitude) after 200 ticks without drag, against cos.",
        "omega h = 2; for the vehicle of 40 kg without drag a metacentric_height of 289 m",
        "the phase is lost from omega h = 0.5 on, beyond 2.83 the swing grows",
        STIFF,
        f"{TESTS}::test_a_stiff_righting_moment_without_drag_is_cut_into_substeps_like_drag",
        holds=(None, 2.0),
    )


def mass() -> Sweep:
    """Vehicles from a gram to a million tonnes, what is absent following from the mass."""
    masses = [1e-3, 0.01, 0.03, 0.04, 0.0453, 0.1, 1.0, 12.0, 40.0, 100.0, 1e3, 1e4, 1e6, 1e9, 1e12]

    def error(mass_kg):
        body = sphere(description.Vehicle(mass_kg=mass_kg))
        root = np.sqrt(body.linear_drag**2 + 4.0 * body.quadratic_drag * body.max_force)
        terminal, other = body.max_speed, -(body.linear_drag + root) / (2.0 * body.quadratic_drag)
        E = np.exp(-200 * H * root / body.virtual_mass)
        truth = terminal * -np.expm1(-200 * H * root / body.virtual_mass) / (1.0 - terminal / other * E)
        return max(abs(fly(body, State(force=(body.max_force, 0.0, 0.0)), 200).v[0] / truth - 1.0), 1e-17)

    return Sweep(
        "mass",
        "Mass of the vehicle",
        "parameters from the mass, RK4",
        "vehicle.mass_kg [kg]",
        masses,
        {"speed after 1 s": [or_nan(error, m) for m in masses]},
        "Relative error of the speed after a second of full thrust from rest, against the closed form.",
        "from 0.045 kg; no end found above",
        "lighter spheres are so stiff that lambda h exceeds 2",
        STIFF,
        f"{TESTS}::test_a_vehicle_lighter_than_its_own_drag_allows_is_refused",
        holds=(0.0453, None),
        bound=1e-6,
    )


def net_buoyancy() -> Sweep:
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

    return Sweep(
        "net_buoyancy",
        "Buoyancy",
        "force balance",
        "vehicle.net_buoyancy [N]",
        values,
        {"speed after 20 s": [or_nan(error, b) for b in values]},
        "Relative error of the speed of rising or sinking after 20 s, thrusters off, 40 kg, against the closed form.",
        "-388.4 N, where the hull is so small that its turns are stiff (lambda h = 2); the thrusters hold the vehicle "
        "up to 120 N",
        "at -mass g = -392.4 N the vehicle would displace nothing; beyond max_force it rises or sinks",
        "refuses below; beyond max_force reports that it will rise or sink",
        f"{TESTS}::test_buoyancy_beyond_the_thrusters_is_reported",
        holds=(-388.4, None),
        bound=1e-6,
        scale="symlog",
    )


# --------------------------------------------------------------------------------------------------------------- water


def current_period() -> Sweep:
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

    return Sweep(
        "current_period",
        "Period of the current",
        "current, RK4",
        "current.period_s [s]",
        periods,
        {
            "ours": [or_nan(error, p, False) for p in periods],
            "if it were taken": [or_nan(error, p, True) for p in periods],
        },
        "A free vehicle without drag inherits the water's acceleration, so moves with it: largest difference of the "
        "speeds over 2 s, as a share of the fluctuation.",
        "0.1 s: 20 ticks, 10 of the fastest wave",
        "waves between the ticks are sampled at random: speeds of any size",
        "refuses shorter periods (unless there is no fluctuation)",
        f"{TESTS}::test_a_current_that_changes_faster_than_the_clock_can_follow_is_refused",
        holds=(0.1, None),
        bound=1e-3,
    )


def current_speed() -> Sweep:
    """A vehicle at rest that a current takes along."""
    speeds = [1e-6, 1e-3, 0.1, 1.0, 3.0, 10.0, 30.0, 100.0, 200.0, 239.0, 241.0, 300.0, 1e3, 1e6]
    body = sphere(description.Vehicle())

    def error(speed):
        current, ticks = Current(description.Current(velocity=(speed, 0.0, 0.0)), 0), 400
        c, k, t = body.linear_drag / body.virtual_mass, body.quadratic_drag / body.virtual_mass, ticks * H
        left = speed * np.exp(-c * t) / (1.0 + k * speed * -np.expm1(-c * t) / c)
        v = fly(body, State(), ticks, current=current).v[0]
        return max(abs((v - (speed - left)) / speed), 1e-17)

    return Sweep(
        "current_speed",
        "Speed of the current",
        "drag in a current, RK4 with substeps",
        "current.velocity [m/s]",
        speeds,
        {"speed after 2 s": [or_nan(error, s) for s in speeds]},
        "A vehicle of 40 kg released at rest: error of its speed after 2 s as a share of the current's, against the "
        "closed form of coasting in the frame of the water.",
        "240 m/s (lambda h = 2); the vehicle itself goes 1.45 m/s",
        "drag that is stiff for the clock",
        "above the vehicle's speed reports that it will be swept away; above 240 m/s refuses",
        f"{OLD_TESTS}::test_a_current_faster_than_the_vehicle_is_reported",
        holds=(None, 240.0),
    )


# ------------------------------------------------------------------------------------------------- attitude and sensors


def gimbal_lock() -> Sweep:
    """Attitudes beside the pole of the Euler angles that are written, and of look_at."""
    offs = [0.0, 1e-15, 1e-12, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6, 1e-4, 1e-2, 0.1, 1.0]

    def written(off):
        rotation = Rotation.from_euler("xyz", [[0.3, np.pi / 2 - off, -0.7], [0.3, off - np.pi / 2, -0.7]])
        back = Rotation.from_euler("xyz", euler_angles(rotation))
        return float((rotation.inv() * back).magnitude().max())

    def looked(off):
        R = look_at_matrix((0.0, 0.0, 0.0), (np.sin(off), 0.0, -np.cos(off)))
        return float(np.abs(R.T @ R - np.eye(3)).max() + np.abs(R[:, 1] - (np.sin(off), 0.0, -np.cos(off))).max())

    return Sweep(
        "gimbal_lock",
        "Gimbal lock",
        "Euler angles of the data, look_at",
        "angle to the pole [rad]",
        offs,
        {
            "Euler angles, there and back": [max(written(x), 1e-17) for x in offs],
            "look_at": [max(looked(x), 1e-17) for x in offs],
        },
        "Attitude lost by writing Euler angles and reading them back [rad], and how far look_at is from orthonormal "
        "and from its direction. Inside, attitudes are quaternions: nothing is singular.",
        "within 1e-7 rad of the pole Euler angles may be off by as much",
        "the angles about x and z are not defined apart from each other",
        "sets the third angle to 0; matrices and quaternions stand beside them and are authoritative",
        "tests/stability/test_vehicle_limits.py::test_euler_angles_lose_half_the_digits_at_the_pole_and_no_more",
        bound=1e-7,
        scale="symlog",
    )


def imu_noise() -> Sweep:
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

    return Sweep(
        "imu_noise",
        "Noise of the IMU",
        "seeded white noise and random walk",
        "density [unit / sqrt(Hz)]",
        densities,
        {"white noise": [error(d, False) for d in densities], "random walk": [error(d, True) for d in densities]},
        "Relative error of the standard deviation of 300 000 samples against density * sqrt(rate) and density / "
        "sqrt(rate); chance alone makes 0.0013.",
        "1e6",
        "near 1e308 readings would be infinite",
        "refuses more than 1e6; 0 changes no bit of the readings",
        f"{TESTS}::test_noise_so_large_that_readings_would_be_infinite_is_refused",
        holds=(None, 1e6),
        bound=5e-3,
    )


SWEEPS: Sweeps = (
    integration_step,
    attitude_step,
    quaternion_drift,
    drag_stiffness,
    righting_stiffness,
    mass,
    net_buoyancy,
    current_period,
    current_speed,
    gimbal_lock,
    imu_noise,
    *dynamics_body.SWEEPS,
    *dynamics_control.SWEEPS,
)
