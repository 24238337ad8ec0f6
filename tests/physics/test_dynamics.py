"""The moving vehicle against closed forms.

RK4 errs by (lambda h)^5 / 120 of the motion in a step that lasts h, so by (lambda h)^4 / 120 of it per time constant
1 / lambda; lambda is the slope of the drag over the inertia.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from varos_warp.scene import description
from varos_warp.sim import quaternion
from varos_warp.sim.actuator import Actuator
from varos_warp.sim.control import Regulator, dare_gain, gains, plant, sampled, steady_offset
from varos_warp.sim.current import Current
from varos_warp.sim.dynamics import ZERO, Dynamics, State
from varos_warp.sim.guidance import Reference
from varos_warp.sim.vehicle import Sphere, sphere

H = 0.005
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
    return scale * ((slope / inertia * H)**4 / 120.0 + ROUNDING)


def translation_tolerance(body, speed):
    return rk4_tolerance(body.linear_drag + 2.0 * body.quadratic_drag * speed, body.virtual_mass, speed)


def approach(t, linear, quadratic, drive, inertia):
    """x(t) from rest with inertia x' = drive - linear x - quadratic x^2."""
    root = np.sqrt(linear**2 + 4.0 * quadratic * drive)
    terminal, other = (-linear + root) / (2.0 * quadratic), (-linear - root) / (2.0 * quadratic)
    E = np.exp(-t * root / inertia)
    return terminal * (1.0 - E) / (1.0 - terminal / other * E), terminal


# -------------------------------------------------------------------------------------------------------- translation


def test_constant_thrust_approaches_the_terminal_velocity_as_the_closed_form_says():
    body, force = ball(), 30.0
    states = fly(body, State(force=(force, 0.0, 0.0)), 10.0)
    v, terminal = approach(np.arange(len(states)) * H, body.linear_drag, body.quadratic_drag, force, body.virtual_mass)
    np.testing.assert_allclose(column(states, "v")[:, 0], v, atol=translation_tolerance(body, terminal))


def test_with_quadratic_drag_alone_speed_is_tanh_and_distance_ln_cosh():
    body, force = ball(linear_drag=0.0), 30.0
    states = fly(body, State(force=(0.0, force, 0.0)), 10.0)
    terminal, tau = np.sqrt(force / body.quadratic_drag), body.virtual_mass / np.sqrt(force * body.quadratic_drag)
    t = np.arange(len(states)) * H
    tolerance = translation_tolerance(body, terminal)
    np.testing.assert_allclose(column(states, "v")[:, 1], terminal * np.tanh(t / tau), atol=tolerance)
    np.testing.assert_allclose(column(states, "p")[:, 1], terminal * tau * np.log(np.cosh(t / tau)),
                               atol=tolerance * t[-1])


def test_the_error_of_the_velocity_falls_with_the_fourth_power_of_the_step():
    body, force = ball(linear_drag=0.0, max_torque=0.01), 100.0  # a weak moment, or ticks would be cut
    terminal, tau = np.sqrt(force / body.quadratic_drag), body.virtual_mass / np.sqrt(force * body.quadratic_drag)
    steps = np.array([0.16, 0.08, 0.04])
    errors = [abs(fly(body, State(force=(force, 0.0, 0.0)), 0.96, h=h)[-1].v[0] - terminal * np.tanh(0.96 / tau))
              for h in steps]
    np.testing.assert_allclose(np.log2(errors[:-1]) - np.log2(errors[1:]), 4.0, atol=0.3)


def test_a_coasting_vehicle_keeps_its_direction_and_follows_the_closed_form():
    body, start = ball(), np.array([0.6, -0.9, 0.4])
    states = fly(body, State(v=tuple(start)), 10.0)
    v, t, s0 = column(states, "v"), np.arange(len(states)) * H, np.linalg.norm(start)
    c, k = body.linear_drag / body.virtual_mass, body.quadratic_drag / body.virtual_mass
    lost = k * s0 * (1.0 - np.exp(-c * t)) / c
    tolerance = translation_tolerance(body, s0)
    np.testing.assert_allclose(np.linalg.norm(v, axis=1), s0 * np.exp(-c * t) / (1.0 + lost), atol=tolerance)
    direction = v / np.linalg.norm(v, axis=1, keepdims=True)
    np.testing.assert_allclose(direction, np.tile(start / s0, (len(v), 1)), atol=ROUNDING)
    np.testing.assert_allclose(np.linalg.norm(column(states, "p"), axis=1), np.log1p(lost) / k, atol=tolerance * t[-1])
    assert (np.diff(np.linalg.norm(v, axis=1)) < 0.0).all()


def test_drag_takes_the_energy_out_that_the_force_balance_says():
    body = ball()
    dynamics, state = Dynamics(body, still()), State(v=(0.6, -0.9, 0.4))
    power = body.virtual_mass * np.dot(dynamics.accelerations(state, 0)[0], state.v)
    speed = np.linalg.norm(state.v)
    np.testing.assert_allclose(power, -(body.linear_drag * speed**2 + body.quadratic_drag * speed**3), rtol=ROUNDING)


def test_a_buoyant_vehicle_rises_with_the_terminal_velocity_of_its_net_buoyancy():
    body = ball(net_buoyancy=8.0)
    states = fly(body, State(), 15.0)
    v, terminal = approach(np.arange(len(states)) * H, body.linear_drag, body.quadratic_drag, 8.0, body.virtual_mass)
    np.testing.assert_allclose(column(states, "v")[:, 2], v, atol=translation_tolerance(body, terminal))
    assert (column(states, "v")[:, :2] == 0.0).all()


def test_a_free_neutral_vehicle_moves_exactly_with_an_unsteady_current():
    body = ball()
    current = Current(description.Current(velocity=(0.2, -0.1, 0.0), fluctuation=0.2, period_s=5.0), seed=3)
    states = fly(body, State(v=tuple(current.velocity([0.0])[0])), 20.0, current=current)
    expected = current.velocity(np.arange(len(states)) * H)
    # Simpson's rule on sinusoids: (omega h)^4 / 2880 of the amplitude, and rounding
    fastest = current.frequency.max()
    np.testing.assert_allclose(column(states, "v"), expected, atol=(fastest * H)**4 + ROUNDING)


def test_the_motion_relative_to_a_uniform_current_does_not_depend_on_the_current():
    """Galilean invariance of a neutrally buoyant body."""
    body, drift, state = ball(), np.array([0.3, 0.1, -0.2]), State(v=(0.5, 0.0, 0.2), force=(10.0, -20.0, 5.0))
    carried = state._replace(v=tuple(np.add(state.v, drift)))
    alone, moved = (fly(body, s, 5.0, current=Current(description.Current(velocity=tuple(d)), 0))
                    for s, d in ((state, np.zeros(3)), (carried, drift)))
    t = np.arange(len(alone))[:, None] * H
    np.testing.assert_allclose(column(moved, "p") - t * drift, column(alone, "p"), atol=1e3 * ROUNDING)


# ----------------------------------------------------------------------------------------------------------- rotation


def test_a_spin_with_linear_drag_decays_exponentially_about_a_fixed_axis():
    body, start = ball(quadratic_rotational_drag=0.0), np.array([0.3, -0.5, 0.8])
    states = fly(body, State(omega=tuple(start)), 10.0)
    t, rate = np.arange(len(states))[:, None] * H, body.linear_rotational_drag / body.inertia
    tolerance = rk4_tolerance(body.linear_rotational_drag, body.inertia, 1.0)
    np.testing.assert_allclose(column(states, "omega"), start * np.exp(-rate * t), atol=tolerance)
    turned = Rotation.from_quat(column(states, "q"), scalar_first=True)
    expected = Rotation.from_rotvec(start / rate * (1.0 - np.exp(-rate * t)))
    assert (expected.inv() * turned).magnitude().max() < 10.0 * tolerance


def test_a_constant_moment_reaches_its_terminal_rate():
    body = ball(linear_rotational_drag=0.1, quadratic_rotational_drag=0.6)
    omega = column(fly(body, State(torque=(0.0, 0.0, 0.5)), 60.0), "omega")[-1]
    np.testing.assert_allclose(omega, [0.0, 0.0, 0.8333333333333334], atol=1e-9)  # (-r1 + sqrt(r1^2 + 4 r2 tau)) / 2 r2


def reference_attitude(body, state, seconds) -> Rotation:
    """The same equations by another integrator, on the quaternion itself."""
    def rates(_, y):
        q, omega = tuple(y[:4] / np.linalg.norm(y[:4])), tuple(y[4:])
        torque = np.add(state.torque, body.righting_moment(q))
        return np.concatenate([0.5 * np.array(quaternion.multiply(tuple(y[:4]), (0.0, *omega))),
                               body.angular_acceleration(omega, torque)])
    y = solve_ivp(rates, (0.0, seconds), [*state.q, *state.omega], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return Rotation.from_quat(y[:4], scalar_first=True)


@pytest.mark.parametrize("height", [0.0, 0.02])
def test_the_attitude_converges_with_the_fourth_power_of_the_step(height):
    """A tumbling vehicle whose axis of rotation keeps changing, with and without a righting moment."""
    body = ball(metacentric_height=height, quadratic_rotational_drag=0.3)  # little drag, or ticks would be cut
    state = State(omega=(1.5, -1.0, 0.7), torque=(0.5, 2.0, -1.5))
    expected, steps = reference_attitude(body, state, 2.0), [0.05, 0.025, 0.0125]
    errors = [(expected.inv() * Rotation.from_quat(fly(body, state, 2.0, h=h)[-1].q, scalar_first=True)).magnitude()
              for h in steps]
    np.testing.assert_allclose(np.log2(errors[:-1]) - np.log2(errors[1:]), 4.0, atol=0.4)


def test_the_quaternion_keeps_unit_length():
    q = column(fly(ball(), State(omega=(2.0, 1.0, -1.0), torque=(3.0, 0.0, 1.0)), 20.0), "q")
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0, rtol=0.0, atol=4e-16)


def test_a_righting_moment_swings_a_tilted_vehicle_back_upright_as_a_pendulum():
    """Small tilt without drag: J theta'' = -M g h theta."""
    body = ball(metacentric_height=0.01, linear_rotational_drag=0.0, quadratic_rotational_drag=0.0)
    tilt = 1e-4
    q = column(fly(body, State(q=quaternion.exp((tilt, 0.0, 0.0))), 3.0), "q")
    t = np.arange(len(q)) * H
    swing = np.sqrt(body.mass_kg * body.gravity * body.metacentric_height / body.inertia)
    # sin(theta) differs from theta by theta^3 / 6, over some swings
    tolerance = tilt * (tilt**2 * swing * t[-1] + (swing * H)**4 * swing * t[-1])
    np.testing.assert_allclose(2.0 * np.arcsin(q[:, 1]), tilt * np.cos(swing * t), atol=tolerance)


# ---------------------------------------------------------------------------------------------- thrusters and coupling


@pytest.mark.parametrize("zeta", [0.3, 0.7, 1.0, 1.7, 10.0])
def test_the_thruster_follows_the_textbook_step_response(zeta):
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
    np.testing.assert_allclose(out, np.outer(step, [1.0, 0.0, -2.0]), atol=1e-13)  # 400 roundings, and of the formula


def test_rotation_does_not_disturb_translation_when_thrusters_lag_in_world_axes():
    body, turning = ball(), State(omega=(0.5, 1.0, -1.0), torque=(2.0, 1.0, 0.0), force=(20.0, 5.0, -3.0))
    calm = turning._replace(omega=ZERO, torque=ZERO)
    assert (column(fly(body, turning, 2.0), "p") == column(fly(body, calm, 2.0), "p")).all()


def test_thrusters_that_lag_in_body_axes_push_where_the_vehicle_points():
    """Thrust fixed in the body while it turns at a constant rate, without drag: a circular acceleration."""
    none = dict.fromkeys(("linear_drag", "quadratic_drag", "linear_rotational_drag", "quadratic_rotational_drag"), 0.0)
    body, rate, thrust = ball(**none), 0.8, 30.0
    dynamics = Dynamics(body, still(), actuator_frame="body")
    state = State(omega=(0.0, 0.0, rate), force=(thrust, 0.0, 0.0))
    for tick in range(400):  # the command turns with the body, so the thrusters deliver the same all the time
        state = dynamics.advance(state, quaternion.rotate(state.q, (thrust, 0.0, 0.0)), ZERO, tick)
    t, a = 400 * H, thrust / body.virtual_mass
    np.testing.assert_allclose(state.v, [a / rate * np.sin(rate * t), a / rate * (1.0 - np.cos(rate * t)), 0.0],
                               atol=a * t * (rate * H)**4)


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
def test_a_slew_about_one_axis_is_the_scalar_linear_closed_loop_at_any_angle(angle_deg):
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
    tolerance = np.radians(angle_deg) * (body.actuator_frequency * H)**4 / 120
    np.testing.assert_allclose(error, np.outer(expected, axis), atol=tolerance)
    assert np.abs(error[-1]).max() < 1e-3


def test_a_current_pushes_the_vehicle_off_by_the_predicted_distance_and_the_integral_brings_it_back():
    body = sphere(description.Vehicle(mass_kg=12.0))
    current = Current(description.Current(velocity=(0.3, 0.0, 0.0)), 0)
    plain, integral = description.Controller(), description.Controller(integral=0.05)
    offset = steady_offset(body, gains(body, plain).translation, body.drag_force(0.3))
    assert offset == pytest.approx(0.2197, abs=5e-5)
    left = steer(body, plain, State(), lambda tick: hover(), 25.0, current)[-1]
    np.testing.assert_allclose(left.p, [offset, 0.0, 0.0], atol=1e-6)
    back = steer(body, integral, State(), lambda tick: hover(), 80.0, current)[-1]
    np.testing.assert_allclose(back.p, 0.0, atol=1e-6)


def test_a_controller_that_knows_only_the_pose_lags_behind_a_steady_motion():
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
        assert speed * 40.0 - states[-1].p[0] == pytest.approx(lag, abs=1e-6), mode


@pytest.mark.parametrize("mode", ["velocity", "full"])
def test_a_steadily_accelerating_turn_is_followed_without_lag_only_with_full_feed_forward(mode):
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
    assert lag == pytest.approx((1.0 + k3) * alpha / k1 if mode == "velocity" else 0.0, abs=1e-8)


def test_the_realised_sampled_cost_is_the_optimal_one():
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
    assert cost(K) == pytest.approx(x0 @ P @ x0, rel=1e-11)
    assert all(cost(K * (1.0 + change)) > cost(K) for change in (-0.05, 0.05))


def test_the_sampled_cost_is_the_integral_of_the_continuous_one():
    A, B = plant(0.2, 15.0, 0.8)
    Q, h = np.diag([1.0, 0.5, 0.1, 0.0]), 0.3
    _, _, Qd, Rd, Nd = sampled(A, B, Q, np.eye(1), h)
    x, u = np.array([0.3, -1.0, 0.4, 2.0]), np.array([0.7])
    F = np.block([[A, B], [np.zeros((1, 5))]])
    nodes, weights = np.polynomial.legendre.leggauss(40)
    z = [expm(F * 0.5 * h * (1.0 + n)) @ np.concatenate([x, u]) for n in nodes]
    integral = 0.5 * h * sum(w * (y[:4] @ Q @ y[:4] + y[4]**2) for w, y in zip(weights, z, strict=True))
    assert x @ Qd @ x + 2.0 * x @ Nd @ u + u @ Rd @ u == pytest.approx(integral, rel=1e-12)
