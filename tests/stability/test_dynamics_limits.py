"""Where methods and vehicles fail, and what the simulator does there instead."""

import numpy as np
import pytest
from regulators import care_gain

from varos_warp.errors import InputError
from varos_warp.scene.description import Scene
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.guidance import Reference
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.actuator import propagator
from varos_warp.sim.vehicle.body import sphere
from varos_warp.sim.vehicle.control import Regulator, dare_gain, design, is_slow, plant, sampled
from varos_warp.sim.vehicle.current import Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State, substeps

H = 0.005


def still() -> Current:
    return Current(description.Current(), 0)


def course(*waypoints, vehicle=None, current=None, **options):
    return Scene(trajectory={"waypoints": list(waypoints), **options}, vehicle=vehicle or {}, current=current or {})


def steer(vehicle: description.Vehicle, state: State, seconds: float) -> list[State]:
    """Closed loop towards a fixed pose at the origin."""
    body = sphere(vehicle)
    regulator, dynamics, states = Regulator(body, vehicle.controller), Dynamics(body, still()), [state]
    goal = Reference(ZERO, ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO, ZERO)
    for tick in range(round(seconds / H)):
        command = regulator.command(goal, states[-1], dynamics.thrust(states[-1]))
        states.append(dynamics.advance(states[-1], *command, tick))
    return states


def angles(states) -> np.ndarray:
    return np.array([np.linalg.norm(quaternion.log(s.q)) for s in states])


def spectral_radius(M) -> float:
    return float(np.abs(np.linalg.eigvals(M)).max())


# ---------------------------------------------------------------------------------------------------- discretisation


def test_euler_and_rk4_blow_up_on_a_stiff_thruster_where_the_exact_filter_decays():
    z = np.array([[0.0, 1.0], [-(1000.0**2), -2.0 * 1000.0]]) * H
    euler = np.eye(2) + z
    rk4 = euler + z @ z / 2.0 + z @ z @ z / 6.0 + z @ z @ z @ z / 24.0
    assert spectral_radius(euler) == pytest.approx(4.0, abs=1e-5)
    assert spectral_radius(rk4) == pytest.approx(13.7, abs=0.02)
    assert spectral_radius(propagator(1000.0, 1.0, H)) == pytest.approx(np.exp(-5.0), rel=1e-6)


@pytest.mark.parametrize("zeta", [1e-3, 0.999999, 1.0, 1.000001, 1e4])
@pytest.mark.parametrize("wn", [1e-3, 15.0, 1e5])
def test_the_exact_filter_is_stable_at_any_frequency_and_damping(wn, zeta):
    E = propagator(wn, zeta, H)
    assert np.isfinite(E).all()
    assert spectral_radius(E) <= 1.0
    # half a step twice is a whole step; each entry within rounding of its own scale
    scale = np.array([[1.0, 1.0 / wn], [wn, 1.0]])
    half = propagator(wn, zeta, 0.5 * H)
    np.testing.assert_array_less(np.abs(half @ half - E), 1e-12 * scale)


def test_the_filter_is_continuous_through_critical_damping():
    critical = propagator(15.0, 1.0, H)
    for zeta in (1.0 - 1e-9, 1.0 + 1e-9):
        np.testing.assert_allclose(propagator(15.0, zeta, H), critical, atol=1e-9)


def test_a_very_stiff_thruster_flies_the_course_like_an_ideal_one():
    positions = []
    for wn in (1000.0, 10_000.0):
        scene = course({"position": (0, 0, 0)}, {"position": (0, 3, 0)}, vehicle={"actuator_frequency": wn})
        positions.append(simulate(scene).trajectory.position)
    count = min(map(len, positions))
    np.testing.assert_allclose(positions[0][:count], positions[1][:count], atol=1e-3)


def test_stiff_drag_is_cut_into_substeps_that_keep_the_accuracy():
    vehicle = description.Vehicle(mass_kg=40.0, linear_drag=15_000.0, quadratic_drag=0.0)
    body = sphere(vehicle)
    assert substeps(body, 0.0, H) == 3  # lambda h = 1.25
    dynamics, state = Dynamics(body, still()), State(v=(1.0, 0.0, 0.0))
    for tick in range(10):
        state = dynamics.advance(state, ZERO, ZERO, tick)
    z = body.linear_drag / body.virtual_mass * H / 3
    # RK4 misses exp(-z) by z^5 / 120 in each of 30 substeps
    assert state.v[0] == pytest.approx(np.exp(-30 * z), rel=30 * z**5 / 120 * np.exp(z))


def test_drag_too_stiff_for_the_clock_is_refused_with_its_number():
    scene = course({"position": (0, 0, 0)}, {"position": (0, 3, 0)}, vehicle={"linear_drag": 60_000.0})
    with pytest.raises(InputError, match=r"lambda h = 5"):
        simulate(scene)


def test_rk4_itself_would_diverge_where_the_simulator_refuses():
    def growth(z):
        return abs(1.0 + z + z**2 / 2.0 + z**3 / 6.0 + z**4 / 24.0)

    assert growth(-2.785) < 1.0 < growth(-2.786)
    assert all(growth(-z) < 1.0 for z in np.linspace(0.01, 0.5, 50))


# ------------------------------------------------------------------------------------------------------------ control


Q_DEFAULT, Q_STIFF = np.diag([1.0, 0.5, 0.0, 0.0]), np.diag([400.0, 20.0, 0.0, 0.0])


@pytest.mark.parametrize(("Q", "dt", "radius"), [(Q_DEFAULT, 2.0, 2.17), (Q_STIFF, 0.3, 1.22)])
def test_a_continuous_gain_held_over_long_steps_diverges_where_the_discrete_design_is_stable(Q, dt, radius):
    A, B = plant(5.0 / 18.0, 20.0, 1.0)  # the mini ROV
    Ad, Bd, *_ = sampled(A, B, Q, np.eye(1), dt)
    assert spectral_radius(Ad - Bd @ care_gain(A, B, Q, np.eye(1))[0]) == pytest.approx(radius, abs=0.01)
    assert spectral_radius(Ad - Bd @ dare_gain(A, B, Q, np.eye(1), dt)[0]) < 1.0


def test_the_regulator_still_settles_with_a_slow_thruster_where_one_that_ignores_it_oscillates():
    A, B = plant(1.0 / 6.0, 1.0, 1.0)  # wn = sqrt(k1)
    _, k2 = 1.0, -1.0 / 6.0 + np.sqrt(1.0 / 36.0 + 2.5)
    ignoring = A - B @ np.array([[1.0, k2, 0.0, 0.0]])
    aware = A - B @ care_gain(A, B, Q_DEFAULT, np.eye(1))[0]
    assert np.linalg.eigvals(ignoring).real.max() > 0.0
    assert np.linalg.eigvals(aware).real.max() < 0.0


@pytest.mark.parametrize("c", [0.0, 1.0 / 6.0, 1.0])
@pytest.mark.parametrize("zeta", [0.7, 1.0])
def test_the_routh_criterion_tells_when_a_gain_that_ignores_the_thruster_oscillates(c, zeta):
    for wn in np.linspace(0.3, 6.0, 40):
        k1, k2 = 1.0, -c + np.sqrt(c**2 + 2.5)
        a3, a2, a1, a0 = 2 * zeta * wn + c, wn**2 + 2 * zeta * wn * c, wn**2 * (c + k2), wn**2 * k1
        margin = a3 * a2 * a1 - a1**2 - a3**2 * a0
        A, B = plant(c, wn, zeta)
        unstable = np.linalg.eigvals(A - B @ np.array([[k1, k2, 0.0, 0.0]])).real.max() > 0.0
        assert unstable == (margin < 0.0)


def test_a_slow_thruster_is_reported():
    assert is_slow(4.9, 1.0)
    assert not is_slow(5.1, 1.0)
    scene = course({"position": (0, 0, 0)}, {"position": (0, 2, 0)}, vehicle={"actuator_frequency": 4.0})
    assert any("actuator_frequency" in message for message in simulate(scene).messages)


@pytest.mark.parametrize("wn", [0.5, 15.0, 1e3, 1e5])
def test_a_stabilising_gain_is_found_for_slow_and_fast_thrusters(wn):
    A, B = plant(0.2, wn, 1.0)
    Ad, Bd, *_ = sampled(A, B, Q_DEFAULT, np.eye(1), H)
    K = np.array([design(0.2, wn, 1.0, (1.0, 0.5), 1.0)[1:]])
    assert spectral_radius(Ad - Bd @ K) < 1.0


def test_weights_without_a_stabilising_gain_are_refused():
    scene = course({"position": (0, 0, 0)}, vehicle={"controller": {"translation_q": (0.0, 0.0)}})
    with pytest.raises(InputError, match="translation_q"):
        simulate(scene)


def test_looking_straight_up_or_down_is_no_special_attitude():
    """Euler angles would be singular at +-90 degrees; a slew through such an attitude is as good as any other."""
    vehicle = description.Vehicle()
    through = [
        quaternion.multiply(quaternion.exp((0.0, np.radians(89.5), 0.0)), quaternion.exp(offset))
        for offset in ((0.09, 0.0, 0.0), (0.0, 0.0, 0.09))
    ]
    body = sphere(vehicle)
    for start in through:
        goal = Reference(ZERO, ZERO, ZERO, quaternion.exp((0.0, np.radians(89.5), 0.0)), ZERO, ZERO)
        regulator, dynamics, state = Regulator(body, vehicle.controller), Dynamics(body, still()), State(q=start)
        for tick in range(4000):
            state = dynamics.advance(state, *regulator.command(goal, state, (ZERO, ZERO)), tick)
        error = quaternion.log(quaternion.multiply(quaternion.conjugate(goal.attitude), state.q))
        assert np.linalg.norm(error) < 1e-6


def test_an_attitude_error_of_exactly_half_a_turn_settles():
    state = State(q=(0.0, 0.6, 0.0, 0.8))
    turned = angles(steer(description.Vehicle(), state, 20.0))
    assert turned[0] == pytest.approx(np.pi)
    assert turned[-1] < 1e-6


def test_a_quaternion_and_its_negative_are_steered_alike():
    q = quaternion.exp((0.0, 0.0, np.radians(170.0)))
    one, other = (steer(description.Vehicle(), State(q=tuple(s * x for x in q)), 15.0) for s in (1.0, -1.0))
    assert [s.omega for s in one] == [s.omega for s in other]
    assert angles(one).max() <= np.radians(170.0) + 1e-12  # the short way, never through 190 degrees


@pytest.mark.parametrize("low_drag", [False, True])
def test_a_saturated_thruster_overshoots_without_drag_but_converges(low_drag):
    drag = {"linear_drag": 0.05, "quadratic_drag": 0.0} if low_drag else {}
    vehicle = description.Vehicle(mass_kg=12.0, max_force=2.0 if low_drag else 3.0, **drag)
    x = np.array([s.p[0] for s in steer(vehicle, State(p=(30.0, 0.0, 0.0)), 250.0 if low_drag else 120.0)])
    overshoot = -x.min()
    assert abs(x[-1]) < 1e-3
    assert overshoot > 1.0 if low_drag else overshoot < 0.05


def test_a_saturated_moment_overshoots_without_drag_but_converges():
    vehicle = description.Vehicle(
        mass_kg=12.0, max_torque=0.05, linear_rotational_drag=0.0, quadratic_rotational_drag=0.0
    )
    start = np.radians(170.0)
    z = np.array([quaternion.log(s.q)[2] for s in steer(vehicle, State(q=quaternion.exp((0.0, 0.0, start))), 60.0)])
    assert np.radians(1.0) < -z.min() < start
    assert abs(z[-1]) < 1e-3


def test_the_integral_does_not_wind_up_while_the_thrusters_are_at_their_limit():
    """A step of 10 m that saturates for long: with the integral it overshoots little more than without."""
    x = {}
    for integral in (0.0, 0.05):
        vehicle = description.Vehicle(max_force=10.0, controller={"integral": integral})
        x[integral] = np.array([s.p[0] for s in steer(vehicle, State(p=(10.0, 0.0, 0.0)), 100.0)])
    assert abs(x[0.05][-1]) < 1e-2
    # unwound, the integral would have stored 10 m for some 20 s, worth 0.2 * 100 of k1 e
    assert -x[0.05].min() < 1.0


# ------------------------------------------------------------------------------------------------------------ courses


def test_a_weight_that_follows_the_distance_to_the_next_waypoint_stalls_at_a_right_angle():
    """Why time drives the weight: w(d) and d(w) have a fixed point short of the second waypoint."""
    corner, goal = np.array([5.0, 0.0]), np.array([5.0, 5.0])
    p = np.zeros(2)
    for _ in range(20_000):  # an ideal vehicle that goes straight to the weighted reference
        share = np.clip(1.0 - np.linalg.norm(p - corner) / 5.0, 0.0, 1.0)
        target = corner + share * (goal - corner)
        p = p + 0.01 * (target - p)
    assert np.linalg.norm(p - goal) > 2.0


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 135.0, 180.0])
def test_the_vehicle_never_stalls_at_a_turn(turn_deg):
    angle = np.radians(turn_deg)
    goal = (float(5.0 * np.sin(angle)), 5.0 + float(5.0 * np.cos(angle)), 0.0)
    for mode in ("none", "full"):
        simulation = simulate(
            course(
                {"position": (0, 0, 0)},
                {"position": (0, 5, 0)},
                {"position": goal},
                vehicle={"controller": {"feed_forward": mode}},
            )
        )
        last = simulation.frames.position[-1]
        assert np.linalg.norm(last - goal) < 0.55  # the hand-over radius and a frame's way
        assert not simulation.messages


def test_a_speed_beyond_the_vehicle_is_reported_and_the_course_still_ends():
    scene = course(
        {"position": (0, 0, 0)}, {"position": (0, 30, 0), "speed": 2.0}, vehicle={"mass_kg": 12.0}, max_acceleration=2.0
    )
    simulation = simulate(scene)
    assert any("cannot go faster than 1.24 m/s" in message for message in simulation.messages)
    lag = np.linalg.norm(simulation.reference_position - simulation.trajectory.position, axis=1)
    assert lag.max() > 1.0
    assert np.linalg.norm(simulation.trajectory.position[-1] - [0.0, 30.0, 0.0]) < 0.5


def test_a_leg_that_needs_more_moment_than_there_is_is_reported():
    scene = course(
        {"position": (0, 0, 0)}, {"position": (0, 0, 0), "rotation_euler_deg": (0, 0, 90)}, vehicle={"max_torque": 0.2}
    )
    assert any("vehicle.max_torque" in message for message in simulate(scene).messages)


def test_a_current_without_integral_is_reported_and_the_waypoints_time_out():
    points = ({"position": (0, 0, 0)}, {"position": (0, 3, 0)}, {"position": (3, 3, 0)})
    options = {"current": {"velocity": (0.3, 0.0, 0.0)}, "handover_radius_m": 0.1, "handover_timeout_s": 5.0}
    simulation = simulate(course(*points, **options))
    assert any("steady force" in message for message in simulation.messages)
    assert sum("gave up waiting" in message for message in simulation.messages) == 2
    helped = simulate(course(*points, vehicle={"controller": {"integral": 0.05}}, **options))
    assert not any("gave up" in message or "steady force" in message for message in helped.messages)


def test_a_current_faster_than_the_vehicle_is_reported():
    scene = course({"position": (0, 0, 0)}, current={"velocity": (0.0, 3.0, 0.0)}, duration_s=2.0)
    assert any("swept away" in message for message in simulate(scene).messages)


def test_half_a_turn_between_waypoints_is_reported_and_its_sign_chooses_the_way():
    rates = {}
    for sign in (1.0, -1.0):
        simulation = simulate(
            course({"position": (0, 0, 0)}, {"position": (0, 2, 0), "rotation_euler_deg": (0, 0, sign * 180.0)})
        )
        rates[sign] = simulation.trajectory.angular_velocity[:, 2]
        assert any("half a turn" in message for message in simulation.messages)
        assert np.degrees(simulation.trajectory.rotation()[-1].magnitude()) == pytest.approx(180.0, abs=0.5)
    assert rates[1.0].max() > 0.3
    assert rates[-1.0].min() < -0.3


def test_waypoints_without_distance_or_turn_are_held_and_nothing_is_divided_by_zero():
    with np.errstate(all="raise"):
        simulation = simulate(course(*[{"position": (1, 2, 3)}] * 3))
    assert np.isfinite(simulation.trajectory.position).all()
    np.testing.assert_allclose(
        simulation.trajectory.position, np.tile([1.0, 2.0, 3.0], (len(simulation.trajectory.position), 1)), atol=1e-12
    )


def test_a_single_waypoint_is_held_for_the_duration():
    simulation = simulate(course({"position": (1, 2, 3), "rotation_euler_deg": (0, 0, 30)}, duration_s=3.0))
    assert len(simulation.frames) == 30
    assert set(simulation.waypoint) == {0}
    np.testing.assert_allclose(simulation.trajectory.velocity, 0.0, atol=1e-12)


def test_no_waypoints_are_an_error():
    with pytest.raises(ValueError, match="at least one waypoint"):
        course()


def test_the_wrong_gravity_in_a_reader_costs_metres():
    """Why g is part of the data: 9.80665 instead of 9.81 is half g-difference times time squared."""
    assert 0.5 * (9.81 - 9.80665) * 98.0**2 == pytest.approx(16.0, abs=0.2)
    simulation = simulate(Scene(trajectory={"poses": [{"position": (0, 0, 0)}]}, gravity=9.80665))
    np.testing.assert_allclose(simulation.imu.acceleration[:, 2], 9.80665, rtol=1e-15)
