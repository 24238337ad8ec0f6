"""The soft hand-over: smooth, convex, at most two legs at a time, exact where a waypoint is strict."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.scene.description import Scene
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import guidance
from varos_warp.sim.guidance import PEAK_ACCELERATION, PEAK_RATE, Course, Gate, Guidance, Leg, plan, weight
from varos_warp.sim.trajectory import simulate

H = 0.005
NO_TURN = np.zeros(3)


def at(*position, **more) -> dict:
    return {"position": position, **more}


def drive(course: Course) -> tuple[np.ndarray, Guidance]:
    """Reference rows (position, velocity, acceleration) of a vehicle that is always where it should be."""
    guide, rows, last = Guidance(course), [], course.positions[0]
    for tick in range(200_000):
        reference = guide.reference(tick, tuple(last), course.attitudes[0].as_quat(scalar_first=True))
        last = reference.position
        rows.append((*reference.position, *reference.velocity, *reference.acceleration))
        if guide.finished:
            return np.array(rows), guide
    raise AssertionError("the course does not end")


def legs_course(durations, overlap, steps=None, radius=np.inf) -> Course:
    """Legs along the axes x, y, z in turn, so that the position shows the weight of each leg."""
    steps = np.eye(3)[: len(durations)] if steps is None else np.asarray(steps, float)
    legs = [Leg(step, NO_TURN, duration, 1.0) for step, duration in zip(steps, durations, strict=True)]
    gates = [Gate(overlap * min(durations[i : i + 2]) if i + 1 < len(legs) else 0.0, radius) for i in range(len(legs))]
    positions = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    return Course(positions, [Rotation.identity()] * len(positions), legs, gates, 30.0)


# --------------------------------------------------------------------------------------------------------- the weight


def test_the_weight_goes_from_0_to_1_and_three_derivatives_vanish_at_its_ends():
    polynomial = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])
    s = np.linspace(0.0, 1.0, 1001)
    for order, value in enumerate(weight(s)):
        np.testing.assert_allclose(value, polynomial.deriv(order)(s), atol=1e-12)
    for order in (1, 2, 3):
        assert polynomial.deriv(order)(0.0) == 0.0
        assert polynomial.deriv(order)(1.0) == pytest.approx(0.0, abs=1e-12)
    assert weight(-0.5)[0] == 0.0
    assert weight(1.5)[0] == 1.0


def test_the_weight_never_leaves_0_to_1_not_even_by_rounding():
    w = weight(np.linspace(0.0, 1.0, 100_001))[0]
    assert w.min() == 0.0
    assert w.max() == 1.0
    assert (np.diff(w) >= 0.0).all()


@pytest.mark.subject("dynamics")
def test_the_peak_factors_are_those_of_the_septic(truth):
    _, rate, acceleration = weight(np.linspace(0.0, 1.0, 20_001))
    for name, expected, factor, made in (
        ("rate", 35 / 16, PEAK_RATE, rate.max()),
        ("acceleration", 84 * np.sqrt(5) / 25, PEAK_ACCELERATION, np.abs(acceleration).max()),
    ):
        truth(
            f"peak {name} of the hand-over's weight, as planned with",
            source="-20 s^7 + 70 s^6 - 84 s^5 + 35 s^4",
            expected=expected,
            got=factor,
            tolerance=1e-12,
            reason="rounding",
        )
        truth(
            f"peak {name} of the hand-over's weight, as driven",
            source="-20 s^7 + 70 s^6 - 84 s^5 + 35 s^4",
            expected=expected,
            got=made,
            tolerance=1e-7 * expected,
            reason="20 000 points, order 2",
        )


# ------------------------------------------------------------------------------------------------------ the hand-over


@pytest.mark.parametrize("durations", [(4.0, 4.0, 4.0), (10.0, 1.0, 10.0), (1.0, 12.0, 1.0), (3.0, 1.0, 1.0)])
@pytest.mark.parametrize("overlap", [0.0, 0.4, 0.5])
def test_the_reference_is_a_convex_mix_of_at_most_three_waypoints(durations, overlap):
    rows, _ = drive(legs_course(durations, overlap))
    w = rows[:, :3]
    weights = np.column_stack([1.0 - w[:, 0], w[:, 0] - w[:, 1], w[:, 1] - w[:, 2], w[:, 2]])
    assert weights.min() >= -1e-15
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-15)
    active = (w > 0.0) & (w < 1.0 - 1e-15)
    assert active.sum(axis=1).max() <= 2


@pytest.mark.parametrize("speeds", [(0.1, 2.0, 0.1), (2.0, 0.1, 2.0), (0.5, 2.0, 0.1)])
def test_a_planned_course_of_very_unequal_legs_stays_convex(speeds):
    corners = np.concatenate([np.zeros((1, 3)), np.cumsum(np.eye(3), axis=0)])
    points = [at(*corners[0])] + [at(*p, speed=v) for p, v in zip(corners[1:], speeds, strict=True)]
    course = plan(description.Trajectory(waypoints=points, handover_radius_m=100.0, overlap=0.5, max_acceleration=50.0))
    w = drive(course)[0][:, :3]
    assert min((w[:, 0] - w[:, 1]).min(), (w[:, 1] - w[:, 2]).min()) >= -1e-15
    assert ((w > 0.0) & (w < 1.0 - 1e-15)).sum(axis=1).max() == 2


def test_overlapping_by_a_share_of_the_longer_leg_would_make_a_weight_negative():
    """Why the shorter leg bounds the overlap."""
    course = legs_course((10.0, 1.0, 10.0), 0.4)
    gates = [Gate(0.4 * 10.0, np.inf), Gate(0.9 * 1.0, np.inf), course.gates[2]]
    rows, _ = drive(Course(course.positions, course.attitudes, course.legs, gates, 30.0))
    assert (rows[:, 0] - rows[:, 1]).min() < -0.1


@pytest.mark.parametrize("overlap", [0.1, 0.3, 0.5])
@pytest.mark.subject("dynamics")
def test_a_corner_is_cut_by_the_weight_at_half_the_overlap(truth, overlap):
    """The smallest |r - P| is w(beta / 2) |d_B - d_A| for legs of equal time and length."""
    steps = np.array([[4.0, 0.0, 0.0], [0.0, 4.0, 0.0]])
    rows, _ = drive(legs_course((8.0, 8.0), overlap, steps))
    distance = np.linalg.norm(rows[:, :3] - steps[0], axis=1)
    expected = weight(overlap / 2.0)[0] * np.linalg.norm(steps[1] - steps[0])
    # the nearest point, in the middle of the overlap, is on a tick
    truth(
        f"nearest distance [m] to a waypoint, overlap {overlap}",
        source="w(beta/2) |d_B - d_A|",
        expected=expected,
        got=distance.min(),
        tolerance=1e-12,
        reason="rounding",
    )


@pytest.mark.parametrize("overlap", [0.0, 0.4, 0.5])
def test_overlapping_legs_ahead_never_exceed_the_leg_speed(overlap):
    steps = np.tile([3.0, 0.0, 0.0], (3, 1))
    rows, _ = drive(legs_course((6.0, 6.0, 6.0), overlap, steps))
    assert rows[:, 3].max() <= PEAK_RATE * 3.0 / 6.0 * (1.0 + 1e-12)


def test_the_reference_is_three_times_continuously_differentiable():
    length, duration = 6.0, 12.0
    rows, _ = drive(legs_course((duration, duration), 0.4, [[length, 0.0, 0.0], [0.0, length, 0.0]]))
    velocity, acceleration = rows[:, 3:6], rows[:, 6:9]
    jerk = np.diff(acceleration, axis=0) / H
    limit = 52.5 * length / duration**3
    assert np.abs(jerk).max() <= limit * (1.0 + 1e-9)
    snap = 840.0 * length / duration**4  # largest fourth derivative, at the ends
    assert np.abs(np.diff(jerk, axis=0)).max() <= snap * H
    # the rates are those of the positions: central differences of second order
    np.testing.assert_allclose(velocity[1:-1], (rows[2:, :3] - rows[:-2, :3]) / (2 * H), atol=limit * H**2)
    np.testing.assert_allclose(acceleration[1:-1], (velocity[2:] - velocity[:-2]) / (2 * H), atol=snap * H**2)


def test_the_angular_rates_are_the_derivatives_of_the_attitude():
    """Two overlapping legs that turn about different axes."""
    turns = [np.array([0.9, -0.4, 0.3]), np.array([-0.2, 0.5, 1.6])]
    ticks = np.arange(961)
    rest = guidance.at_rest(np.zeros(3), Rotation.identity())
    first = guidance.add_leg(rest, Leg(NO_TURN, turns[0], 3.0, 1.0), ticks)
    both = guidance.add_leg(first, Leg(NO_TURN, turns[1], 3.0, 1.0), ticks - 360)
    q = both.attitude
    omega = (q[:-2].inv() * q[2:]).as_rotvec() / (2.0 * H)
    alpha = (both.omega[2:] - both.omega[:-2]) / (2.0 * H)
    scale = 52.5 * 2.0 / 3.0**3 + 10.0  # third derivatives of the turns, and products of the lower ones
    np.testing.assert_allclose(both.omega[1:-1], omega, atol=scale * H**2)
    np.testing.assert_allclose(both.alpha[1:-1], alpha, atol=10.0 * scale * H**2)
    goal = Rotation.from_rotvec(turns[0]) * Rotation.from_rotvec(turns[1])
    assert (goal.inv() * q[-1]).magnitude() < 1e-14
    np.testing.assert_allclose(both.omega[-1], 0.0, atol=1e-14)


@pytest.mark.parametrize("heading", [0.0, 17.0, 90.0, 133.0, -60.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_way_of_half_a_turn_follows_the_sign_of_the_angle_from_any_heading(heading, sign):
    """Not the rounding of a cosine that should be zero."""
    first, second = (Rotation.from_euler("xyz", (0.0, 0.0, a), degrees=True) for a in (heading, heading + sign * 180.0))
    np.testing.assert_allclose(guidance.turn(first, second), [0.0, 0.0, sign * np.pi], atol=1e-14)


def test_a_leg_takes_the_time_that_its_slowest_limit_asks_for():
    def duration(goal, **limits):
        points = [at(0, 0, 0), goal]
        return plan(description.Trajectory(waypoints=points, **limits)).legs[0].duration

    assert duration(at(0, 8, 0), max_acceleration=100.0) == pytest.approx(PEAK_RATE * 8 / 0.5)
    assert duration(at(0, 8, 0, speed=1.0), max_acceleration=100.0) == pytest.approx(PEAK_RATE * 8)
    assert duration(at(0, 8, 0), speed=50.0) == pytest.approx(np.sqrt(PEAK_ACCELERATION * 8 / 0.25))
    assert duration(at(0, 0, 0, rotation_euler_deg=(0, 0, 90))) == pytest.approx(PEAK_RATE * 3.0)
    assert duration(at(0, 0, 0)) == guidance.MIN_LEG_S


def test_a_waypoint_without_attitude_keeps_the_one_before_it():
    points = [at(0, 0, 0), at(0, 1, 0, rotation_euler_deg=(0, 0, 40)), at(0, 2, 0), at(0, 3, 0, look_at=(0, 3, -1))]
    turned = plan(description.Trajectory(waypoints=points)).attitudes
    np.testing.assert_allclose(turned[0].as_matrix(), np.eye(3))
    assert (turned[1].inv() * turned[2]).magnitude() == 0.0
    np.testing.assert_allclose(turned[3].apply([0.0, 1.0, 0.0]), [0.0, 0.0, -1.0], atol=1e-15)


def test_the_hand_over_waits_for_a_vehicle_that_lags_and_gives_up_after_the_timeout():
    course = legs_course((2.0, 2.0), 0.4, [[4.0, 0.0, 0.0], [4.0, 0.0, 0.0]], radius=0.5)
    course = Course(course.positions, course.attitudes, course.legs, course.gates, timeout=7.0)
    guide, identity = Guidance(course), (1.0, 0.0, 0.0, 0.0)
    started = next(tick for tick in range(10_000) if guide.reference(tick, (0.0, 0.0, 0.0), identity) and guide.leg)
    assert started * H == pytest.approx(2.0 - 0.8 + 7.0)
    assert len(guide.messages) == 1
    assert "waypoint 1" in guide.messages[0]


# -------------------------------------------------------------------------------------------------------- strictness


def closest(waypoints, goal, **options) -> tuple[float, float]:
    """How near the simulated vehicle comes to a pose: distance [m] and, there, angle [deg]."""
    vehicle = {"controller": {"feed_forward": options.pop("feed_forward", "full")}}
    trajectory = simulate(Scene(trajectory={"waypoints": waypoints, **options}, vehicle=vehicle)).trajectory
    distance = np.linalg.norm(trajectory.position - goal["position"], axis=1)
    nearest = int(distance.argmin())
    wanted = Rotation.from_euler("xyz", goal.get("rotation_euler_deg", (0, 0, 0)), degrees=True)
    return distance[nearest], np.degrees((wanted.inv() * trajectory.rotation()[nearest]).magnitude())


@pytest.mark.parametrize("feed_forward", ["full", "none"])
def test_a_strict_waypoint_is_reached_and_a_soft_one_passed_closely(feed_forward):
    goal = at(0, 5, 0, rotation_euler_deg=(0, 0, 50))
    soft, strict = ([at(0, 0, 0), goal | {"strict": s}, at(5, 5, 0)] for s in (False, True))
    distance, angle = closest(strict, goal, feed_forward=feed_forward)
    assert distance < guidance.STRICT_M
    assert angle < guidance.STRICT_DEG
    assert guidance.STRICT_M < closest(soft, goal, feed_forward=feed_forward)[0] < 0.5


def test_two_waypoints_close_together_are_a_strict_one():
    """The way of the paper to ask for a pose (section 3.3.2)."""
    pair = [at(0, 0, 0), at(0, 5, 0), at(0, 5.05, 0), at(5, 5, 0)]
    assert [gate.radius for gate in plan(description.Trajectory(waypoints=pair)).gates] == [0.005, 0.005, 0.5]
    assert closest(pair, pair[1])[0] < guidance.STRICT_M


def test_the_vehicle_rests_at_a_strict_waypoint_for_its_dwell():
    points = [at(0, 0, 0), at(0, 2, 0, strict=True, dwell_s=3.0), at(2, 2, 0)]
    trajectory = simulate(Scene(trajectory={"waypoints": points})).trajectory
    rests = np.linalg.norm(trajectory.position - [0, 2, 0], axis=1) < 0.01
    assert rests.sum() * H >= 3.0
