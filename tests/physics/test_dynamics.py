"""The moving vehicle against closed forms.

RK4 errs by (lambda h)^5 / 120 of the motion in a step that lasts h, so by (lambda h)^4 / 120 of it per time constant
1 / lambda; lambda is the slope of the drag over the inertia.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation
from scipy.special import ellipj, ellipk

from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.guidance import Reference
from varos_warp.sim.vehicle.actuator import Actuator
from varos_warp.sim.vehicle.body import Sphere, sphere
from varos_warp.sim.vehicle.control import Regulator, dare_gain, gains, plant, sampled, steady_offset
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State

pytestmark = pytest.mark.subject("dynamics")

H = 0.005
RK4 = "RK4: (lambda h)^4/120 of the motion, and rounding"
ROUNDING = 1e-13
"""Of some thousand steps, relative."""


def ball(**changes) -> Sphere:
    return sphere(description.Vehicle(mass_kg=40.0, **changes))


def still() -> Current:
    return Current(description.Current(), 0)


def fly(body, state, seconds, *, current=None, h=H, **options) -> list[State]:
    """The thrusters keep delivering what they deliver at the start."""
    dynamics = Dynamics(body, current or still(), h=h, **options)
    states = [state]
    for tick in range(round(seconds / h)):
        states.append(dynamics.advance(states[-1], state.force, state.torque, tick))
    return states


def column(states, name) -> np.ndarray:
    return np.array([getattr(state, name) for state in states])


def rk4_tolerance(slope, inertia, scale):
    return scale * ((slope / inertia * H) ** 4 / 120.0 + ROUNDING)


def translation_tolerance(body, speed):
    return rk4_tolerance(body.linear_drag + 2.0 * body.quadratic_drag * speed, body.virtual_mass, speed)


def approach(t, linear, quadratic, drive, inertia):
    """x(t) from rest with inertia x' = drive - linear x - quadratic x^2."""
    root = np.sqrt(linear**2 + 4.0 * quadratic * drive)
    terminal, other = (-linear + root) / (2.0 * quadratic), (-linear - root) / (2.0 * quadratic)
    E = np.exp(-t * root / inertia)
    return terminal * (1.0 - E) / (1.0 - terminal / other * E), terminal


# -------------------------------------------------------------------------------------------------------- translation


def test_constant_thrust_approaches_the_terminal_velocity_as_the_closed_form_says(truth):
    body, force = ball(), 30.0
    states = fly(body, State(force=(force, 0.0, 0.0)), 10.0)
    v, terminal = approach(np.arange(len(states)) * H, body.linear_drag, body.quadratic_drag, force, body.virtual_mass)
    truth(
        "velocity [m/s], 10 s at 200 Hz, 30 N",
        source="Riccati equation with linear and quadratic drag",
        expected=v,
        got=column(states, "v")[:, 0],
        tolerance=translation_tolerance(body, terminal),
        reason=RK4,
    )


def test_with_quadratic_drag_alone_speed_is_tanh_and_distance_ln_cosh(truth):
    body, force = ball(linear_drag=0.0), 30.0
    states = fly(body, State(force=(0.0, force, 0.0)), 10.0)
    terminal, tau = np.sqrt(force / body.quadratic_drag), body.virtual_mass / np.sqrt(force * body.quadratic_drag)
    t = np.arange(len(states)) * H
    tolerance = translation_tolerance(body, terminal)
    truth(
        "velocity [m/s]",
        source="v_t tanh(t/tau)",
        expected=terminal * np.tanh(t / tau),
        got=column(states, "v")[:, 1],
        tolerance=tolerance,
        reason=RK4,
    )
    truth(
        "distance [m]",
        source="v_t tau ln cosh(t/tau)",
        expected=terminal * tau * np.log(np.cosh(t / tau)),
        got=column(states, "p")[:, 1],
        tolerance=tolerance * t[-1],
        reason=RK4,
    )


def test_the_error_of_the_velocity_falls_with_the_fourth_power_of_the_step(truth):
    body, force = ball(linear_drag=0.0, max_torque=0.01), 100.0  # a weak moment, or ticks would be cut
    terminal, tau = np.sqrt(force / body.quadratic_drag), body.virtual_mass / np.sqrt(force * body.quadratic_drag)
    steps = np.array([0.16, 0.08, 0.04])
    errors = [
        abs(fly(body, State(force=(force, 0.0, 0.0)), 0.96, h=h)[-1].v[0] - terminal * np.tanh(0.96 / tau))
        for h in steps
    ]
    truth(
        "order of convergence, steps of 160, 80 and 40 ms",
        source="Runge and Kutta: 4",
        expected=4.0,
        got=np.log2(errors[:-1]) - np.log2(errors[1:]),
        tolerance=0.3,
        reason="terms of fifth order",
    )


def test_a_coasting_vehicle_keeps_its_direction_and_follows_the_closed_form(truth):
    body, start = ball(), np.array([0.6, -0.9, 0.4])
    states = fly(body, State(v=tuple(start)), 10.0)
    v, t, s0 = column(states, "v"), np.arange(len(states)) * H, np.linalg.norm(start)
    c, k = body.linear_drag / body.virtual_mass, body.quadratic_drag / body.virtual_mass
    lost = k * s0 * (1.0 - np.exp(-c * t)) / c
    tolerance = translation_tolerance(body, s0)
    truth(
        "speed [m/s], 10 s",
        source="c s0 e^-ct/(c + k s0 (1 - e^-ct))",
        expected=s0 * np.exp(-c * t) / (1.0 + lost),
        got=np.linalg.norm(v, axis=1),
        tolerance=tolerance,
        reason=RK4,
    )
    direction = v / np.linalg.norm(v, axis=1, keepdims=True)
    np.testing.assert_allclose(direction, np.tile(start / s0, (len(v), 1)), atol=ROUNDING)
    truth(
        "distance [m], 10 s",
        source="ln(1 + k s0 (1 - e^-ct)/c)/k",
        expected=np.log1p(lost) / k,
        got=np.linalg.norm(column(states, "p"), axis=1),
        tolerance=tolerance * t[-1],
        reason=RK4,
    )
    assert (np.diff(np.linalg.norm(v, axis=1)) < 0.0).all()


def test_drag_takes_the_energy_out_that_the_force_balance_says(truth):
    body = ball()
    dynamics, state = Dynamics(body, still()), State(v=(0.6, -0.9, 0.4))
    power = body.virtual_mass * np.dot(dynamics.accelerations(state, 0)[0], state.v)
    speed = np.linalg.norm(state.v)
    expected = -(body.linear_drag * speed**2 + body.quadratic_drag * speed**3)
    truth(
        "power [W]",
        source="-(d1 v^2 + d2 v^3)",
        expected=expected,
        got=power,
        tolerance=-ROUNDING * expected,
        reason="rounding",
    )


def test_a_buoyant_vehicle_rises_with_the_terminal_velocity_of_its_net_buoyancy(truth):
    body = ball(net_buoyancy=8.0)
    states = fly(body, State(), 15.0)
    v, terminal = approach(np.arange(len(states)) * H, body.linear_drag, body.quadratic_drag, 8.0, body.virtual_mass)
    truth(
        "velocity [m/s], 15 s, 8 N",
        source="Riccati equation with linear and quadratic drag",
        expected=v,
        got=column(states, "v")[:, 2],
        tolerance=translation_tolerance(body, terminal),
        reason=RK4,
    )
    assert (column(states, "v")[:, :2] == 0.0).all()


def test_a_free_neutral_vehicle_moves_exactly_with_an_unsteady_current(truth):
    body = ball()
    current = Current(description.Current(velocity=(0.2, -0.1, 0.0), fluctuation=0.2, period_s=5.0), seed=3)
    states = fly(body, State(v=tuple(current.velocity([0.0])[0])), 20.0, current=current)
    expected = current.velocity(np.arange(len(states)) * H)
    # Simpson's rule on sinusoids: (omega h)^4 / 2880 of the amplitude, and rounding
    fastest = current.frequency.max()
    truth(
        "velocity [m/s], 20 s",
        source="v = v_c(t): (rho V + m_a)/m_t = 1",
        expected=expected,
        got=column(states, "v"),
        tolerance=(fastest * H) ** 4 + ROUNDING,
        reason="order 4 in the step: Simpson's rule",
    )


def test_the_motion_relative_to_a_uniform_current_does_not_depend_on_the_current(truth):
    """Galilean invariance of a neutrally buoyant body."""
    body, drift, state = ball(), np.array([0.3, 0.1, -0.2]), State(v=(0.5, 0.0, 0.2), force=(10.0, -20.0, 5.0))
    carried = state._replace(v=tuple(np.add(state.v, drift)))
    alone, moved = (
        fly(body, s, 5.0, current=Current(description.Current(velocity=tuple(d)), 0))
        for s, d in ((state, np.zeros(3)), (carried, drift))
    )
    t = np.arange(len(alone))[:, None] * H
    truth(
        "position [m] in the frame of the water, 5 s",
        source="Galilean invariance",
        expected=column(alone, "p"),
        got=column(moved, "p") - t * drift,
        tolerance=1e3 * ROUNDING,
        reason="rounding of 1000 steps",
    )


# ----------------------------------------------------------------------------------------------------------- rotation


def test_a_spin_with_linear_drag_decays_exponentially_about_a_fixed_axis(truth):
    body, start = ball(quadratic_rotational_drag=0.0), np.array([0.3, -0.5, 0.8])
    states = fly(body, State(omega=tuple(start)), 10.0)
    t, rate = np.arange(len(states))[:, None] * H, body.linear_rotational_drag / body.inertia
    tolerance = rk4_tolerance(body.linear_rotational_drag, body.inertia, 1.0)
    truth(
        "angular velocity [rad/s], 10 s",
        source="omega_0 e^(-r1 t/J)",
        expected=start * np.exp(-rate * t),
        got=column(states, "omega"),
        tolerance=tolerance,
        reason=RK4,
    )
    turned = Rotation.from_quat(column(states, "q"), scalar_first=True)
    expected = Rotation.from_rotvec(start / rate * (1.0 - np.exp(-rate * t)))
    truth(
        "attitude [rad] off, 10 s",
        source="J/r1 omega_0 (1 - e^(-r1 t/J))",
        expected=0.0,
        got=(expected.inv() * turned).magnitude(),
        tolerance=10.0 * tolerance,
        reason=RK4,
    )


def test_a_constant_moment_reaches_its_terminal_rate(truth):
    body = ball(linear_rotational_drag=0.1, quadratic_rotational_drag=0.6)
    omega = column(fly(body, State(torque=(0.0, 0.0, 0.5)), 60.0), "omega")[-1]
    truth(
        "rate [rad/s] after 60 s at 0.5 N m",
        source="(-r1 + sqrt(r1^2 + 4 r2 tau))/2 r2 = 5/6",
        expected=[0.0, 0.0, 5.0 / 6.0],
        got=omega,
        tolerance=1e-9,
        reason="what is left of the approach",
    )


def reference_attitude(body, state, seconds) -> Rotation:
    """The same equations by another integrator, on the quaternion itself."""

    def rates(_, y):
        q, omega = tuple(y[:4] / np.linalg.norm(y[:4])), tuple(y[4:])
        torque = np.add(state.torque, body.righting_moment(q))
        return np.concatenate(
            [0.5 * np.array(quaternion.multiply(tuple(y[:4]), (0.0, *omega))), body.angular_acceleration(omega, torque)]
        )

    y = solve_ivp(rates, (0.0, seconds), [*state.q, *state.omega], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return Rotation.from_quat(y[:4], scalar_first=True)


@pytest.mark.parametrize("height", [0.0, 0.02])
def test_the_attitude_converges_with_the_fourth_power_of_the_step(truth, height):
    """A tumbling vehicle whose axis of rotation keeps changing, with and without a righting moment."""
    body = ball(metacentric_height=height, quadratic_rotational_drag=0.3)  # little drag, or ticks would be cut
    state = State(omega=(1.5, -1.0, 0.7), torque=(0.5, 2.0, -1.5))
    expected, steps = reference_attitude(body, state, 2.0), [0.05, 0.025, 0.0125]
    errors = [
        (expected.inv() * Rotation.from_quat(fly(body, state, 2.0, h=h)[-1].q, scalar_first=True)).magnitude()
        for h in steps
    ]
    truth(
        f"order of convergence, tumbling, metacentric height {height} m, steps of 50, 25 and 12.5 ms",
        source="Munthe-Kaas, RK4: 4; truth by DOP853 on the quaternion",
        expected=4.0,
        got=np.log2(errors[:-1]) - np.log2(errors[1:]),
        tolerance=0.4,
        reason="terms of fifth order",
    )


def test_the_quaternion_keeps_unit_length():
    q = column(fly(ball(), State(omega=(2.0, 1.0, -1.0), torque=(3.0, 0.0, 1.0)), 20.0), "q")
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=0.0, atol=4e-16)


def test_a_righting_moment_swings_a_tilted_vehicle_back_upright_as_a_pendulum(truth):
    """Small tilt without drag: J theta'' = -M g h theta."""
    body = ball(metacentric_height=0.01, linear_rotational_drag=0.0, quadratic_rotational_drag=0.0)
    tilt = 1e-4
    q = column(fly(body, State(q=quaternion.exp((tilt, 0.0, 0.0))), 3.0), "q")
    t = np.arange(len(q)) * H
    swing = np.sqrt(body.mass_kg * body.gravity * body.metacentric_height / body.inertia)
    # sin(theta) differs from theta by theta^3 / 6, over some swings
    tolerance = tilt * (tilt**2 * swing * t[-1] + (swing * H) ** 4 * swing * t[-1])
    truth(
        "tilt [rad], 3 s",
        source="theta_0 cos(sqrt(M g h/J) t)",
        expected=tilt * np.cos(swing * t),
        got=2.0 * np.arcsin(q[:, 1]),
        tolerance=tolerance,
        reason="sin(theta) for theta; order 4 in the step",
    )


@pytest.mark.parametrize("tilt_deg", [30.0, 90.0, 170.0])
def test_a_righting_moment_swings_a_vehicle_at_any_tilt_as_the_elliptic_functions_say(truth, tilt_deg):
    """sin(theta/2) = k sn(K + w t, k) with k = sin(theta_0/2): the exact pendulum, and its period 4 K/w."""
    body = ball(metacentric_height=0.01, linear_rotational_drag=0.0, quadratic_rotational_drag=0.0)
    tilt, w = np.radians(tilt_deg), np.sqrt(body.mass_kg * body.gravity * body.metacentric_height / body.inertia)
    k = np.sin(0.5 * tilt)
    period = 4.0 * ellipk(k * k) / w
    q = column(fly(body, State(q=quaternion.exp((tilt, 0.0, 0.0))), period), "q")
    t = np.arange(len(q)) * H
    expected = 2.0 * np.arcsin(k * ellipj(ellipk(k * k) + w * t, k * k)[0])
    # per unit of time the error grows as (w h)^4/120; near the top it is stretched by the unstable rest, e^(w t)
    tolerance = (w * H) ** 4 / 120.0 * w * period * np.exp(np.arccosh(1.0 / np.cos(0.5 * tilt))) + 1e3 * ROUNDING
    truth(
        f"tilt [rad] over a period of {period:.4f} s, released at {tilt_deg:.0f} degrees",
        source="Jacobi's elliptic functions",
        expected=expected,
        got=2.0 * np.arctan2(q[:, 1], q[:, 0]),
        tolerance=tolerance,
        reason="RK4: (w h)^4/120 per radian, stretched towards the top",
    )


def test_a_body_without_drag_and_moments_keeps_energy_and_momentum(truth):
    """A sphere's free rotation: Euler's top with three equal moments turns about a fixed axis for ever."""
    none = dict.fromkeys(("linear_drag", "quadratic_drag", "linear_rotational_drag", "quadratic_rotational_drag"), 0.0)
    body, omega, v = ball(**none), np.array([0.9, -1.4, 2.0]), np.array([0.3, -0.2, 0.5])
    states = fly(body, State(v=tuple(v), omega=tuple(omega)), 60.0)
    t, rows = np.arange(len(states))[:, None] * H, len(states) * 1e-15
    turned = Rotation.from_quat(column(states, "q"), scalar_first=True)
    energy = 0.5 * (
        body.virtual_mass * (column(states, "v") ** 2).sum(axis=1)
        + body.inertia * (column(states, "omega") ** 2).sum(axis=1)
    )
    kept = {"tolerance": rows, "reason": "rounding of 12 000 steps"}
    truth(
        "energy [J], a minute",
        source="conservation",
        got=energy,
        **kept,
        expected=0.5 * (body.virtual_mass * v @ v + body.inertia * omega @ omega),
    )
    truth(
        "angular momentum in world axes [kg m^2/s]",
        source="conservation",
        got=body.inertia * turned.apply(column(states, "omega")),
        expected=body.inertia * omega,
        **kept,
    )
    truth(
        "position [m]",
        source="v t",
        got=column(states, "p"),
        expected=v * t,
        tolerance=rows * 30.0,
        reason="rounding of 12 000 steps",
    )
    # the step of the exponential map is exact for a fixed axis; half a rounding of each quaternion adds up
    truth(
        "attitude [rad] off",
        source="exp(omega t)",
        expected=0.0,
        tolerance=rows,
        got=(Rotation.from_rotvec(omega * t).inv() * turned).magnitude(),
        reason="rounding of 12 000 steps",
    )


# ---------------------------------------------------------------------------------------------- thrusters and coupling


@pytest.mark.parametrize("zeta", [0.3, 0.7, 1.0, 1.7, 10.0])
def test_the_thruster_follows_the_textbook_step_response(truth, zeta):
    wn, filtered = 15.0, Actuator(15.0, zeta, H)
    y, rate, out = ZERO, ZERO, []
    for _ in range(400):
        y, rate = filtered.advance(y, rate, (1.0, 0.0, -2.0))
        out.append(y)
    t = np.arange(1, 401) * H
    if zeta < 1.0:
        wd = wn * np.sqrt(1.0 - zeta**2)
        step = 1.0 - np.exp(-zeta * wn * t) * (np.cos(wd * t) + zeta * wn / wd * np.sin(wd * t))
    elif zeta == 1.0:
        step = 1.0 - np.exp(-wn * t) * (1.0 + wn * t)
    else:
        root = np.sqrt(zeta**2 - 1.0)
        slow, fast = -wn * (zeta - root), -wn * (zeta + root)
        step = 1.0 - (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (fast - slow)
    truth(
        f"output, damping {zeta}, 2 s",
        source="step response of a second-order filter",
        expected=np.outer(step, [1.0, 0.0, -2.0]),
        got=out,
        tolerance=1e-13,
        reason="400 roundings, and of the formula",
    )


@pytest.mark.parametrize("zeta", [0.3, 1.0, 2.0])
def test_the_thruster_follows_a_swinging_command_as_its_transfer_function_says(truth, zeta):
    """Of commands that are held over each step, as the filter's own but for half a step's delay."""
    wn, w, h = 15.0, 8.0, 1e-3
    filtered, y, rate, out = Actuator(wn, zeta, h), ZERO, ZERO, []
    for tick in range(8000):
        phase = w * h * tick
        y, rate = filtered.advance(y, rate, (np.cos(phase), np.sin(phase), 0.0))
        out.append(complex(y[0], y[1]) * np.exp(-1j * w * h * (tick + 1)))
    # a command held over h lags by half of it and is weaker by sinc(w h/2): second order in h
    transfer = wn**2 / (wn**2 - w**2 + 2j * zeta * wn * w) * np.exp(-0.5j * w * h)
    order2 = {"tolerance": (w * h) ** 2, "reason": "order 2 in the step, for a command that is held"}
    source = "wn^2/(wn^2 - w^2 + 2 i zeta wn w), half a step late"
    truth(
        f"gain at 8 rad/s, damping {zeta}, of 15 rad/s",
        source=source,
        expected=abs(transfer),
        got=abs(out[-1]),
        **order2,
    )
    truth(
        f"phase [rad] at 8 rad/s, damping {zeta}, of 15 rad/s",
        source=source,
        expected=np.angle(transfer),
        got=np.angle(out[-1]),
        **order2,
    )


def test_rotation_does_not_disturb_translation_when_thrusters_lag_in_world_axes():
    body, turning = ball(), State(omega=(0.5, 1.0, -1.0), torque=(2.0, 1.0, 0.0), force=(20.0, 5.0, -3.0))
    calm = turning._replace(omega=ZERO, torque=ZERO)
    assert (column(fly(body, turning, 2.0), "p") == column(fly(body, calm, 2.0), "p")).all()


def test_thrusters_that_lag_in_body_axes_push_where_the_vehicle_points(truth):
    """Thrust fixed in the body while it turns at a constant rate, without drag: a circular acceleration."""
    none = dict.fromkeys(("linear_drag", "quadratic_drag", "linear_rotational_drag", "quadratic_rotational_drag"), 0.0)
    body, rate, thrust = ball(**none), 0.8, 30.0
    dynamics = Dynamics(body, still(), actuator_frame="body")
    state = State(omega=(0.0, 0.0, rate), force=(thrust, 0.0, 0.0))
    for tick in range(400):  # the command turns with the body, so the thrusters deliver the same all the time
        state = dynamics.advance(state, quaternion.rotate(state.q, (thrust, 0.0, 0.0)), ZERO, tick)
    t, a = 400 * H, thrust / body.virtual_mass
    truth(
        "velocity [m/s] after 2 s",
        source="thrust that turns with the body: a/w (sin wt, 1 - cos wt, 0)",
        expected=[a / rate * np.sin(rate * t), a / rate * (1.0 - np.cos(rate * t)), 0.0],
        got=state.v,
        tolerance=a * t * (rate * H) ** 4,
        reason="order 4 in the step",
    )


# ------------------------------------------------------------------------------------------------------------ control


def hover(position=ZERO, attitude=(1.0, 0.0, 0.0, 0.0), velocity=ZERO) -> Reference:
    return Reference(position, velocity, ZERO, attitude, ZERO, ZERO)


def steer(body, controller, state, reference, seconds, current=None) -> list[State]:
    """Closed loop; ``reference`` is a function of the tick."""
    regulator, dynamics, states = Regulator(body, controller), Dynamics(body, current or still()), [state]
    for tick in range(round(seconds / H)):
        command = regulator.command(reference(tick), states[-1], dynamics.thrust(states[-1]))
        states.append(dynamics.advance(states[-1], *command, tick))
    return states


@pytest.mark.parametrize("angle_deg", [5.0, 90.0, 179.0])
def test_a_slew_about_one_axis_is_the_scalar_linear_closed_loop_at_any_angle(truth, angle_deg):
    body = ball(quadratic_rotational_drag=0.0, max_torque=1e6)
    controller, axis = description.Controller(), np.array([2.0, -1.0, 2.0]) / 3.0
    start = quaternion.exp(tuple(np.radians(angle_deg) * axis))
    states = steer(body, controller, State(q=start), lambda tick: hover(), 10.0)
    A, B = plant(body.linear_rotational_drag / body.inertia, body.actuator_frequency, body.actuator_damping)
    Ad, Bd, *_ = sampled(A, B, np.eye(4), np.eye(1), H)
    loop = Ad - Bd @ np.array([gains(body, controller).rotation[1:]])
    x, expected = np.array([np.radians(angle_deg), 0.0, 0.0, 0.0]), []
    for _ in states:
        expected.append(x[0])
        x = loop @ x
    error = np.array([quaternion.log(s.q) for s in states])
    # RK4 follows the fastest mode of the loop, that of the actuator
    tolerance = np.radians(angle_deg) * (body.actuator_frequency * H) ** 4 / 120
    truth(
        f"error of attitude [rad], {angle_deg:.0f} degrees, 10 s",
        source="powers of the closed loop A - B K",
        expected=np.outer(expected, axis),
        got=error,
        tolerance=tolerance,
        reason="RK4: (wn h)^4/120",
    )
    assert np.abs(error[-1]).max() < 1e-3


def test_a_current_pushes_the_vehicle_off_by_the_predicted_distance_and_the_integral_brings_it_back(truth):
    body = sphere(description.Vehicle(mass_kg=12.0))
    current = Current(description.Current(velocity=(0.3, 0.0, 0.0)), 0)
    plain, integral = description.Controller(), description.Controller(integral=0.05)
    offset = steady_offset(body, gains(body, plain).translation, body.drag_force(0.3))
    assert offset == pytest.approx(0.2197, abs=5e-5)
    left = steer(body, plain, State(), lambda tick: hover(), 25.0, current)[-1]
    settled = {"tolerance": 1e-6, "reason": "what is left of the approach"}
    truth(
        "offset [m] in 0.3 m/s without integral",
        source="F/m_t (1 + k3)/k1",
        expected=[offset, 0.0, 0.0],
        got=left.p,
        **settled,
    )
    back = steer(body, integral, State(), lambda tick: hover(), 80.0, current)[-1]
    truth("offset [m] with integral", source="an integral leaves none", expected=0.0, got=back.p, **settled)


def test_a_controller_that_knows_only_the_pose_lags_behind_a_steady_motion(truth):
    """k1 lag = k2 v + (1 + k3) drag / m_t; with full feed-forward nothing is left."""
    body, speed = ball(), 0.6

    def moving(tick):
        return hover((speed * tick * H, 0.0, 0.0), velocity=(speed, 0.0, 0.0))

    for mode in ("none", "velocity", "full"):
        controller = description.Controller(feed_forward=mode)
        _, k1, k2, k3, _ = gains(body, controller).translation
        drag = body.drag_force(speed) / body.virtual_mass
        lag = {"none": k2 * speed + (1.0 + k3) * drag, "velocity": (1.0 + k3) * drag, "full": 0.0}[mode] / k1
        states = steer(body, controller, State(), moving, 40.0)
        truth(
            f"lag [m] at 0.6 m/s, feed_forward: {mode}",
            source="(k2 v + (1 + k3) drag/m_t)/k1",
            expected=lag,
            got=speed * 40.0 - states[-1].p[0],
            tolerance=1e-6,
            reason="what is left of the approach",
        )


@pytest.mark.parametrize("mode", ["velocity", "full"])
def test_a_steadily_accelerating_turn_is_followed_without_lag_only_with_full_feed_forward(truth, mode):
    """Without drag k1 lag = (1 + k3) alpha; the turn goes through many revolutions about a slanted axis."""
    body = ball(linear_rotational_drag=0.0, quadratic_rotational_drag=0.0)
    alpha, axis = 0.1, np.array([2.0, -1.0, 2.0]) / 3.0

    def turning(tick):
        t = tick * H
        angle, rate, acceleration = (tuple(x * axis) for x in (0.5 * alpha * t * t, alpha * t, alpha))
        return Reference(ZERO, ZERO, ZERO, quaternion.exp(angle), rate, acceleration)

    controller, seconds = description.Controller(feed_forward=mode), 40.0
    end = steer(body, controller, State(), turning, seconds)[-1]
    _, k1, _, k3, _ = gains(body, controller).rotation
    goal = turning(round(seconds / H)).attitude
    lag = -np.dot(quaternion.log(quaternion.multiply(quaternion.conjugate(goal), end.q)), axis)
    truth(
        f"lag [rad] at 0.1 rad/s^2, feed_forward: {mode}",
        source="(1 + k3) alpha/k1, or none",
        expected=(1.0 + k3) * alpha / k1 if mode == "velocity" else 0.0,
        got=lag,
        tolerance=1e-8,
        reason="what is left of the approach",
    )


def test_the_regulators_gain_is_the_limit_of_the_riccati_recursion(truth):
    """By dynamic programming backwards from no cost at all, not by the eigenvectors that the design uses."""
    A, B = plant(1.0 / 6.0, 15.0, 1.0)
    Q, R = np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1)
    Ad, Bd, Qd, Rd, Nd = sampled(A, B, Q, R, H)
    P = np.zeros((4, 4))
    for _ in range(10_000):  # 50 s, a hundred time constants of the slowest pole in its square
        K = np.linalg.solve(Rd + Bd.T @ P @ Bd, Bd.T @ P @ Ad + Nd.T)
        P = Qd + Ad.T @ P @ Ad - (Ad.T @ P @ Bd + Nd) @ K
    truth(
        "gain (k1, k2, k3, k4)",
        source="value iteration of the discrete Riccati equation",
        expected=K,
        got=dare_gain(A, B, Q, R, H)[0],
        tolerance=1e-10,
        reason="rounding of 10 000 steps",
    )


def test_the_realised_sampled_cost_is_the_optimal_one(truth):
    """The sum of the exact cost along the closed loop is x0' P x0, and every other gain costs more."""
    A, B = plant(1.0 / 6.0, 15.0, 1.0)
    Q, R, x0 = np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1), np.array([1.0, -0.3, 0.2, 0.0])
    K, P = dare_gain(A, B, Q, R, H)
    Ad, Bd, Qd, Rd, Nd = sampled(A, B, Q, R, H)

    def cost(K):
        x, total = x0, 0.0
        for _ in range(5_000):
            u = -K @ x
            total += x @ Qd @ x + 2.0 * x @ Nd @ u + u @ Rd @ u
            x = Ad @ x + Bd @ u
        return total

    truth(
        "cost of the closed loop",
        source="x0' P x0",
        expected=x0 @ P @ x0,
        got=cost(K),
        tolerance=1e-11 * (x0 @ P @ x0),
        reason="rounding of 5000 steps",
    )
    assert all(cost(K * (1.0 + change)) > cost(K) for change in (-0.05, 0.05))


def test_the_sampled_cost_is_the_integral_of_the_continuous_one(truth):
    A, B = plant(0.2, 15.0, 0.8)
    Q, h = np.diag([1.0, 0.5, 0.1, 0.0]), 0.3
    _, _, Qd, Rd, Nd = sampled(A, B, Q, np.eye(1), h)
    x, u = np.array([0.3, -1.0, 0.4, 2.0]), np.array([0.7])
    F = np.block([[A, B], [np.zeros((1, 5))]])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    z = [expm(F * 0.5 * h * (1.0 + n)) @ np.concatenate([x, u]) for n in nodes]
    integral = 0.5 * h * sum(w * (y[:4] @ Q @ y[:4] + y[4] ** 2) for w, y in zip(weights, z, strict=True))
    truth(
        "cost over a step of 0.3 s",
        source="Gauss-Legendre of x'Qx + u'Ru",
        expected=integral,
        got=x @ Qd @ x + 2.0 * x @ Nd @ u + u @ Rd @ u,
        tolerance=1e-12 * integral,
        reason="rounding",
    )
