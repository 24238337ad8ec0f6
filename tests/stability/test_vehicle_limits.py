"""Vehicles, currents and sensors over decades: what is simulated right, and what is refused or reported."""

import warnings

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.stability.dynamics import SECONDS, end_of, misallocated, rov, truth_of
from varos_warp.errors import InputError
from varos_warp.products.sensors.imu import ImuNoise
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.frames import euler_angles
from varos_warp.sim import quaternion
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.body import sphere
from varos_warp.sim.vehicle.current import SHORTEST_PERIOD_S, Current
from varos_warp.sim.vehicle.dynamics import ZERO, Dynamics, State, substeps

H = 0.005
WITHOUT_DRAG = dict.fromkeys(
    ("linear_drag", "quadratic_drag", "linear_rotational_drag", "quadratic_rotational_drag"), 0.0
)


def scene(vehicle=None, positions=((0, 0, 0), (0, 2, 0)), trajectory=None, **blocks):
    waypoints = [{"position": p} for p in positions]
    return scene_from_dict(
        {"trajectory": {"waypoints": waypoints} | (trajectory or {}), "vehicle": vehicle or {}} | blocks
    )


def still() -> Current:
    return Current(description.Current(), 0)


def refuses(vehicle, **blocks) -> str:
    """The one message, without warnings beside it."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InputError) as caught:
            simulate(scene(vehicle, **blocks))
    assert caught.value.key
    assert caught.value.remedy
    return str(caught.value)


# ------------------------------------------------------------------------------------------------------- mass and drag


@pytest.mark.parametrize("mass", [0.05, 1.0, 1e3, 1e6])
def test_a_vehicle_of_any_mass_that_can_be_built_drives_the_course(mass):
    simulation = simulate(scene({"mass_kg": mass}, trajectory={"speed": 0.1, "max_acceleration": 0.01}))
    end = simulation.frames.position[-1]
    assert np.linalg.norm(end - [0.0, 2.0, 0.0]) < 0.5
    assert not any("gave up" in message for message in simulation.messages)


def test_a_vehicle_lighter_than_its_own_drag_allows_is_refused():
    assert "lambda h" in refuses({"mass_kg": 0.04})


@pytest.mark.parametrize(
    ("vehicle", "blocks", "word"),
    [
        ({"actuator_damping": 1e-3}, {}, "actuator_damping"),
        ({"max_force": 1e8}, {}, "max_force"),
        ({"metacentric_height": 100.0}, {}, "metacentric_height"),
        ({}, {"current": {"velocity": (1e4, 0, 0)}}, "current"),
    ],
)
def test_motion_too_stiff_for_the_clock_is_refused_with_what_made_it_so_among_the_remedies(vehicle, blocks, word):
    message = refuses(vehicle, **blocks)
    assert "lambda h" in message
    assert word in message.partition(". ")[2] or word in message.rpartition("simulated")[2]


def test_a_stiff_righting_moment_without_drag_is_cut_into_substeps_like_drag():
    """J theta'' = -M g h theta: at omega h = 1 a whole tick would be wrong, beyond 2.83 it would diverge."""
    J, weight = sphere(description.Vehicle()).inertia, 40.0 * 9.81
    heights = {z: (z / H) ** 2 * J / weight for z in (0.1, 1.0, 1.9, 2.1)}
    body = {z: sphere(description.Vehicle(metacentric_height=h, **WITHOUT_DRAG)) for z, h in heights.items()}
    assert [substeps(body[z], 0.0, H) for z in (0.1, 1.0, 1.9)] == [1, 2, 4]
    with pytest.raises(InputError, match="metacentric_height"):
        substeps(body[2.1], 0.0, H)


def test_a_rigid_body_is_right_up_to_where_it_is_refused():
    """Substeps keep the error where it is, up to lambda h = 2."""
    body = rov()
    truth, limit = truth_of(body), 2.0 / body.stiffness()
    steps = [SECONDS / np.ceil(share * SECONDS / limit) for share in (1.0, 8.0)]
    error = [np.linalg.norm(end_of(body, h) - truth) for h in steps]
    assert max(error) < 1e-6
    with pytest.raises(InputError, match="lambda h"):
        end_of(body, 1.02 * limit)


def test_thrusters_that_are_all_but_parallel_are_refused():
    for degrees in (45.0, 1.0, 0.1):
        assert misallocated(np.radians(degrees)) < 1e-10
    with pytest.raises(InputError, match=r"force to the right \(x\)"):
        misallocated(np.radians(0.03))


@pytest.mark.parametrize("z", [0.1, 1.0, 1.9])
def test_a_stiff_pendulum_keeps_its_swing(z):
    J = sphere(description.Vehicle()).inertia
    body = sphere(description.Vehicle(metacentric_height=(z / H) ** 2 * J / (40.0 * 9.81), **WITHOUT_DRAG))
    tilt, ticks = 1e-4, 100
    dynamics, state = Dynamics(body, still()), State(q=quaternion.exp((tilt, 0.0, 0.0)))
    for tick in range(ticks):
        state = dynamics.advance(state, ZERO, ZERO, tick)
    per_step = z / substeps(body, 0.0, H)
    # RK4 misses the phase by z^5 / 120 and the swing by z^6 / 144 in each step
    tolerance = tilt * (per_step**5 / 120 + per_step**6 / 144) * ticks * substeps(body, 0.0, H) * 1.1 + 1e-12
    angle, rate = quaternion.log(state.q)[0], state.omega[0]
    assert abs(angle - tilt * np.cos(z * ticks)) < tolerance
    assert abs(rate * H / z + tilt * np.sin(z * ticks)) < tolerance


# ------------------------------------------------------------------------------------------------- buoyancy and gravity


@pytest.mark.parametrize(("buoyancy", "told"), [(-100.0, False), (100.0, False), (130.0, True), (-130.0, True)])
def test_buoyancy_beyond_the_thrusters_is_reported(buoyancy, told):
    simulation = simulate(scene({"net_buoyancy": buoyancy}, positions=((0, 0, 0),), trajectory={"duration_s": 20.0}))
    assert any("vehicle.net_buoyancy" in message for message in simulation.messages) == told
    drift = np.abs(simulation.trajectory.position[-1, 2])
    assert (drift > 1.0) == told


@pytest.mark.parametrize("gravity", [1e-9, 1.62, 9.81, 274.0])
def test_a_neutral_vehicle_drives_alike_at_any_gravity_and_its_imu_at_rest_feels_it(gravity):
    simulation, earth = simulate(scene(gravity=gravity)), simulate(scene())
    assert (simulation.trajectory.position == earth.trajectory.position).all()
    np.testing.assert_allclose(simulation.imu.acceleration[0], [0.0, 0.0, gravity], atol=1e-15)


# -------------------------------------------------------------------------------------------------------------- current


@pytest.mark.parametrize("period", [SHORTEST_PERIOD_S, 1.0])
def test_a_free_vehicle_still_moves_with_the_fastest_current_that_is_taken(period):
    """It inherits the water's acceleration; Simpson's rule on sinusoids misses (omega h)^4 / 2880 of them."""
    current = Current(description.Current(fluctuation=0.1, period_s=period), seed=5)
    dynamics = Dynamics(sphere(description.Vehicle(linear_drag=0.0, quadratic_drag=0.0)), current)
    state = State(v=tuple(current.velocity([0.0])[0]))
    for tick in range(400):
        state = dynamics.advance(state, ZERO, ZERO, tick)
    error = np.linalg.norm(state.v - current.velocity([400 * H])[0])
    assert error < 2 * current.max_speed * (current.frequency.max() * H) ** 4 / 2880 + 1e-13


@pytest.mark.parametrize("period", [0.099, 1e-4, 1e-9, 1e-300])
def test_a_current_that_changes_faster_than_the_clock_can_follow_is_refused(period):
    assert "current.period_s" in refuses({}, current={"fluctuation": 0.1, "period_s": period})


def test_a_steady_current_has_no_period():
    """However short, it changes nothing of what the current does."""
    currents = ({"velocity": (0.1, 0.0, 0.0), "period_s": 1e-9}, {"velocity": (0.1, 0.0, 0.0)}, {})
    short, steady, none = (
        simulate(scene(current=current, trajectory={"duration_s": 0.1})).trajectory.position for current in currents
    )
    np.testing.assert_array_equal(short, steady)
    assert not np.array_equal(short, none)


# -------------------------------------------------------------------------------------------------------------- sensors


NOISE = ("accelerometer_noise_density", "accelerometer_random_walk", "gyroscope_noise_density", "gyroscope_random_walk")


@pytest.mark.parametrize("name", NOISE)
def test_noise_so_large_that_readings_would_be_infinite_is_refused(name):
    simulation = simulate(scene({"imu": {"noise": {name: 1e6}}}, trajectory={"duration_s": 1.0}))
    assert np.isfinite(simulation.imu.acceleration).all()
    assert np.isfinite(simulation.imu.angular_velocity).all()
    with pytest.raises(ValidationError):
        ImuNoise(**{name: 1.1e6})


def test_a_vanishing_noise_changes_no_digit_and_none_at_all_no_bit():
    exact = simulate(scene(trajectory={"duration_s": 1.0})).imu
    for density, tolerance in ((0.0, 0.0), (1e-300, 1e-298), (1e-12, 1e-9)):
        noisy = simulate(scene({"imu": {"noise": dict.fromkeys(NOISE, density)}}, trajectory={"duration_s": 1.0})).imu
        assert np.abs(noisy.acceleration - exact.acceleration).max() <= tolerance


@pytest.mark.parametrize("rate", [200.0, 100.0, 66.66666666667, 1.0, 1 / 60])
def test_every_rate_that_is_a_whole_number_of_ticks_is_taken(rate):
    simulation = simulate(scene({"imu": {"rate_hz": rate}}, trajectory={"duration_s": 0.1}))
    assert (np.diff(simulation.imu.time_ns) == round(200 / rate) * 5_000_000).all()


@pytest.mark.parametrize("rate", [24.0, 29.97, 199.999, 201.0, 1000.0])
def test_every_other_rate_is_taken_and_its_samples_are_on_the_motion(rate):
    """The motion between ticks: what one tick of 5 ms leaves undone is known to a nanometre."""
    simulation = simulate(scene({"imu": {"rate_hz": rate}}, trajectory={"duration_s": 1.0}))
    assert np.abs(np.diff(simulation.imu.time_ns) - 1e9 / rate).max() <= 1.0
    fine = simulate(scene({"imu": {"rate_hz": 200.0}}, trajectory={"duration_s": 1.0}))
    between = CubicSpline(fine.imu.time_ns, fine.imu.acceleration)(simulation.imu.time_ns)
    assert np.abs(simulation.imu.acceleration - between).max() < 1e-3 * np.ptp(fine.imu.acceleration)


# ------------------------------------------------------------------------------------------------------------- attitude


def test_the_quaternion_does_not_drift():
    """At a constant rate of turning, 20 000 steps: unit length to the last digit, the attitude to rounding."""
    omega, ticks = (1.1, -0.7, 0.4), 20_000
    dynamics, state = Dynamics(sphere(description.Vehicle(**WITHOUT_DRAG)), still()), State(omega=omega)
    for tick in range(ticks):
        state = dynamics.advance(state, ZERO, ZERO, tick)
    assert abs(np.linalg.norm(state.q) - 1.0) < 4e-16
    angle = np.fmod(np.linalg.norm(omega) * ticks * H, 2.0 * np.pi)
    expected = quaternion.exp(tuple(angle * np.array(omega) / np.linalg.norm(omega)))
    error = quaternion.log(quaternion.multiply(quaternion.conjugate(expected), state.q))
    # roundings of a few units in the last place, all in one direction at worst
    assert np.linalg.norm(error) < 4e-16 * ticks


@pytest.mark.parametrize(("off", "tolerance"), [(0.0, 1e-7), (1e-12, 1e-7), (1e-8, 1e-7), (1e-3, 1e-12), (1.0, 1e-14)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_euler_angles_lose_half_the_digits_at_the_pole_and_no_more(off, tolerance, sign):
    rotation = Rotation.from_euler("xyz", [[0.3, sign * (np.pi / 2 - off), -0.7]])
    back = Rotation.from_euler("xyz", euler_angles(rotation))
    assert (rotation.inv() * back).magnitude()[0] < tolerance
