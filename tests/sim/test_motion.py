"""The motion between the rows of a trajectory: it joins them with their velocities and accelerations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from varos_warp.sim.clock import times_ns
from varos_warp.sim.motion import Trajectory


def coning(time_ns, w=3.0, tilt=0.7, spin=2.0) -> Trajectory:
    """An axis that goes around a cone while the body spins about it, on a Lissajous figure far from the origin.

    R = Rz(w t) Rx(tilt) Rz(spin t) has the angular velocity spin z + Rz(-spin t) Rx(-tilt) w z in body axes.
    """
    t = 1e-9 * np.asarray(time_ns, float)
    R = Rotation.from_euler("ZXZ", np.column_stack([w * t, np.full_like(t, tilt), spin * t]))
    s, c = np.sin(spin * t), np.cos(spin * t)
    omega = np.column_stack([w * np.sin(tilt) * s, w * np.sin(tilt) * c, spin + w * np.cos(tilt) + 0.0 * t])
    alpha = w * np.sin(tilt) * spin * np.column_stack([c, -s, 0.0 * t])
    f = np.array([1.0, 1.7, 0.6])
    p, v, a = np.sin(np.outer(t, f)), f * np.cos(np.outer(t, f)), -(f**2) * np.sin(np.outer(t, f))
    q = R.as_quat(canonical=True, scalar_first=True)
    return Trajectory(np.asarray(time_ns, np.int64), p + [1e3, -2e3, -80.0], v, a, q, omega, alpha)


def turned(one: Trajectory, other: Trajectory) -> float:
    """Largest angle between two attitudes [rad]."""
    return float((one.rotation().inv() * other.rotation()).magnitude().max())


def errors(rate_hz: float) -> np.ndarray:
    """Of place, velocity, acceleration, attitude, angular velocity and acceleration halfway between rows."""
    rows = times_ns(int(2 * rate_hz) + 1, rate_hz)
    made = coning(rows).at(between := (rows[:-1] + rows[1:]) // 2)
    truth = coning(between)
    names = ("position", "velocity", "acceleration", "angular_velocity", "angular_acceleration")
    return np.array(
        [np.abs(getattr(made, name) - getattr(truth, name)).max() for name in names] + [turned(made, truth)]
    )


def test_between_ticks_a_motion_is_itself_to_the_sixth_power_of_the_tick():
    """Halving the step takes 64, 32 and 16 times from the error of places, velocities and accelerations."""
    place, velocity, acceleration, rate, change, attitude = np.log2(errors(8.0) / errors(16.0))
    assert min(place, attitude) > 5.5
    assert min(velocity, rate) > 4.5
    assert min(acceleration, change) > 3.5


def test_at_200_hz_nothing_is_left_but_rounding():
    place, velocity, acceleration, rate, change, attitude = errors(200.0)
    step = 2.0 * np.spacing(2e3)  # of places at 2 km, twice in a difference
    assert place < step
    assert velocity < step / 5e-3 * 15 / 8  # the greatest slope of the polynomial that joins 0 and 1
    assert rate < 1e-11
    assert acceleration < step / 5e-3**2 * 6
    assert change < 1e-9
    assert attitude < 1e-14


def test_rows_are_as_they_are_and_both_sides_of_them_meet():
    motion = coning(times_ns(201, 200.0))
    at = motion.at(motion.time_ns[::7])
    for name in motion.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(at, name), getattr(motion, name)[::7])
    before, after = (motion.at(motion.time_ns[1:-1] + side) for side in (-1, 1))
    for name in ("acceleration", "angular_acceleration"):  # 2 ns, in which they change by 1e-8 of themselves
        np.testing.assert_allclose(getattr(before, name), getattr(after, name), atol=1e-7)


def test_velocities_are_the_derivatives_of_places():
    """Of the polynomials themselves: central differences over 20 microseconds within one step, large steps."""
    motion, h = coning(times_ns(21, 10.0)), 10_000
    at = np.arange(30_000_000, 2_000_000_000, 100_000_000)
    here, before, after = motion.at(at), motion.at(at - h), motion.at(at + h)
    dt = 2e-9 * h
    np.testing.assert_allclose((after.position - before.position) / dt, here.velocity, atol=1e-7)
    np.testing.assert_allclose((after.velocity - before.velocity) / dt, here.acceleration, atol=1e-7)
    np.testing.assert_allclose(
        (before.rotation().inv() * after.rotation()).as_rotvec() / dt, here.angular_velocity, atol=1e-7
    )
    np.testing.assert_allclose(
        (after.angular_velocity - before.angular_velocity) / dt, here.angular_acceleration, atol=1e-5
    )  # series of a turn of half a radian


@pytest.mark.parametrize("time_ns", [-1, 1_000_000_001])
def test_beyond_its_ends_nothing_is_known(time_ns):
    with pytest.raises(ValueError, match="known from 0 to 1000000000 ns"):
        coning(times_ns(11, 10.0)).at([time_ns])


def test_before_its_start_a_motion_goes_on_with_its_first_accelerations():
    """Long before too, after more than half a turn; and from the start on it is as it is."""
    rows, w = times_ns(5, 200.0), np.array([0.0, 0.0, 2.0])
    t, still = 1e-9 * rows[:, None], np.zeros((5, 3))
    v, a = np.array([0.5, 0.0, 0.1]), np.array([0.0, 0.2, 0.0])
    q = Rotation.from_rotvec(t * w).as_quat(canonical=True, scalar_first=True)
    motion = Trajectory(rows, t * v + t**2 / 2 * a, v + t * a, still + a, q, still + w, still)
    time_ns = np.array([-30_000_000_000, -1_700_000_000, -1, 0, 7_000_000])
    made, t = motion.from_before(time_ns), 1e-9 * time_ns[:, None]
    np.testing.assert_allclose(made.position, t * v + t**2 / 2 * a, rtol=1e-12)
    np.testing.assert_allclose(made.velocity, v + t * a, rtol=1e-12)
    assert (made.rotation().inv() * Rotation.from_rotvec(t * w)).magnitude().max() < 1e-12
    for got, expected in zip(motion.from_before(rows)._columns(), motion._columns(), strict=True):
        assert np.array_equal(got, expected)


def test_one_time_is_a_motion_of_one_row_and_seconds_are_refused():
    motion = coning(times_ns(11, 10.0))
    np.testing.assert_array_equal(motion.at(123_456_789).poses(), motion.at([123_456_789]).poses())
    assert len(motion.at([])) == 0
    for wrong in (0.5, [0.5], "a", None):
        with pytest.raises(ValueError, match="whole nanoseconds"):
            motion.at(wrong)
