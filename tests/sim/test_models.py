"""The small parts: parameters, actuator limit, design identities, current, noise, quaternions, clock."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from regulators import care_gain, ideal_gain
from scipy.linalg import solve_discrete_are
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.products.sensors.noise import noise
from varos_warp.scene.description import Scene
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.clock import HIGHEST_RATE_HZ, LONGEST_S, check_rate, frame_count, frames_until, times_ns
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.actuator import limit
from varos_warp.sim.vehicle.body import PRESETS, Sphere, preset, sphere, terminal_rate
from varos_warp.sim.vehicle.control import dare_gain, design, plant, sampled
from varos_warp.sim.vehicle.current import Current, SampledCurrent

pytestmark = pytest.mark.subject("dynamics")

# ------------------------------------------------------------------------------------------------------------ vehicle


@pytest.mark.parametrize(
    ("mass", "radius", "inertia", "speed", "rate"),
    [(12, 0.141, 0.0952, 1.24, 143), (40, 0.210, 0.708, 1.45, 124), (100, 0.286, 3.26, 1.54, 94)],
)
def test_the_presets_are_the_published_vehicles(mass, radius, inertia, speed, rate):
    body = sphere(description.Vehicle(mass_kg=mass))
    assert body.radius == pytest.approx(radius, abs=5e-4)
    assert body.inertia == pytest.approx(inertia, rel=2e-3)
    assert body.virtual_mass == pytest.approx(1.5 * mass)
    assert body.carried == pytest.approx(1.0)
    assert body.max_speed == pytest.approx(speed, abs=5e-3)
    turning = terminal_rate(body.linear_rotational_drag, body.quadratic_rotational_drag, body.max_torque)
    assert np.degrees(turning) == pytest.approx(rate, abs=0.5)


@pytest.mark.parametrize("name", [name for name in PRESETS if name != "mass_kg"])
def test_parameters_between_the_presets_follow_the_mass_smoothly(name):
    for mass, value in zip(PRESETS["mass_kg"], PRESETS[name], strict=True):
        assert preset(name, mass) == value
        assert preset(name, mass * (1 + 1e-9)) == pytest.approx(value, rel=1e-8)
    values = np.array([preset(name, m) for m in np.geomspace(1.0, 1e4, 200)])
    assert (values > 0.0).all()
    assert (np.diff(values) < 0.0).all() if name == "actuator_frequency" else (np.diff(values) > 0.0).all()


def test_a_parameter_in_the_scene_wins_over_the_preset():
    body = sphere(description.Vehicle(mass_kg=40.0, linear_drag=0.0, max_force=7.0))
    assert (body.linear_drag, body.max_force, body.quadratic_drag) == (0.0, 7.0, 50.0)


def test_a_vehicle_without_volume_is_refused():
    with pytest.raises(InputError, match="net_buoyancy"):
        sphere(description.Vehicle(mass_kg=10.0, net_buoyancy=-98.2))


def test_a_buoyant_vehicle_displaces_more_than_its_mass():
    body = sphere(description.Vehicle(mass_kg=40.0, net_buoyancy=9.81))
    assert body.volume * 1025.0 == pytest.approx(41.0)


def test_a_righting_moment_turns_the_up_axis_of_the_vehicle_to_that_of_the_world():
    body = sphere(description.Vehicle(metacentric_height=0.02))
    for rotation in Rotation.random(5, rng=4):
        moment = rotation.apply(body.righting_moment(tuple(rotation.as_quat(scalar_first=True))))
        up = rotation.apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(moment, 40.0 * 9.81 * 0.02 * np.cross(up, [0.0, 0.0, 1.0]), atol=1e-13)
        assert np.dot(np.cross(moment, up), [0.0, 0.0, 1.0]) > 0.0  # the up axis starts to rise


def test_limiting_a_vector_keeps_its_direction():
    assert limit((1.0, 2.0, 2.0), 3.0) == ((1.0, 2.0, 2.0), False)
    short, limited = limit((3.0, -6.0, 6.0), 3.0)
    assert limited
    np.testing.assert_allclose(short, (1.0, -2.0, 2.0), rtol=1e-15)


# ------------------------------------------------------------------------------------------------------------- design


def test_a_fast_actuator_and_a_short_step_give_the_closed_form_gain(truth):
    k1, k2 = ideal_gain(0.2, (1.0, 0.5), 1.0)
    A, B = np.array([[0.0, 1.0], [0.0, -0.2]]), np.array([[0.0], [1.0]])
    np.testing.assert_allclose(care_gain(A, B, np.diag([1.0, 0.5]), np.eye(1))[0], [[k1, k2]], rtol=1e-14)
    discrete, _ = dare_gain(A, B, np.diag([1.0, 0.5]), np.eye(1), 1e-4)
    truth(
        "gain (k1, k2), steps of 0.1 ms",
        source="k1 = sqrt(q1/r), k2 = -c + sqrt(c^2 + q2/r + 2 k1)",
        expected=[[k1, k2]],
        got=discrete,
        tolerance=2e-4 * k1,
        reason="order 1 in the step",
    )
    np.testing.assert_allclose(sorted(np.linalg.eigvals(A - B @ [[k1, k2]])), sorted(np.roots([1.0, 0.2 + k2, k1])))


def test_the_gains_solve_their_riccati_equations():
    A, B = plant(5.0 / 18.0, 20.0, 1.0)
    Q, R = np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1)
    K, P = care_gain(A, B, Q, R)
    residual = A.T @ P + P @ A - P @ B @ np.linalg.solve(R, B.T @ P) + Q
    assert np.abs(residual).max() < 1e-12 * np.abs(P).max() * np.abs(A).max()
    for h in (0.005, 0.1, 1.0):
        Ad, Bd, Qd, _, Nd = sampled(A, B, Q, R, h)
        K, P = dare_gain(A, B, Q, R, h)
        residual = Ad.T @ P @ Ad - P - (Ad.T @ P @ Bd + Nd) @ K + Qd
        assert np.abs(residual).max() < 1e-12 * np.abs(P).max()


def test_at_200_hz_the_sampled_design_is_close_to_the_continuous_one(truth):
    A, B = plant(5.0 / 18.0, 20.0, 1.0)
    K, _ = dare_gain(A, B, np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1), 0.005)
    assert K[0, 0] == pytest.approx(0.99673, abs=5e-6)
    Ad, Bd, *_ = sampled(A, B, np.eye(4), np.eye(1), 0.005)
    poles = np.log(np.linalg.eigvals(Ad - Bd @ K).astype(complex)) / 0.005
    continuous = np.linalg.eigvals(A - B @ care_gain(A, B, np.diag([1.0, 0.5, 0.0, 0.0]), np.eye(1))[0])
    poles, continuous = (np.array(sorted(z, key=lambda z: (z.real, z.imag))) for z in (poles, continuous))
    np.testing.assert_allclose(poles, continuous, rtol=1e-3)
    truth(
        "poles [1/s], logarithms of the sampled loop's, real parts",
        source="continuous Riccati equation (SciPy)",
        expected=continuous.real,
        got=poles.real,
        tolerance=1e-3 * abs(continuous),
        reason="order 1 in the step",
    )


def test_the_scalar_discrete_riccati_equation_has_its_closed_form(truth):
    a, b, q, r = 1.1, 0.4, 2.0, 0.7
    m = r * (1.0 - a**2) - q * b**2
    closed = (-m + np.sqrt(m**2 + 4.0 * b**2 * q * r)) / (2.0 * b**2)
    P = solve_discrete_are(*(np.array([[x]]) for x in (a, b, q, r)))
    assert P[0, 0] == pytest.approx(closed, rel=1e-13)
    # and through the sampled design: an integrator's exact sampled cost over h
    A, B, h = np.zeros((1, 1)), np.ones((1, 1)), 0.3
    _, _, Qd, Rd, Nd = sampled(A, B, np.array([[q]]), np.array([[r]]), h)
    np.testing.assert_allclose([Qd[0, 0], Nd[0, 0], Rd[0, 0]], [q * h, q * h**2 / 2, r * h + q * h**3 / 3], rtol=1e-14)
    # of x' = u with this cost: (Q - N^2/R) + P - (P h + N)^2/(R + P h^2) = P, a quadratic equation for P
    Qs, Ns, Rs = q * h, q * h**2 / 2, r * h + q * h**3 / 3
    b = 2 * Ns * h - Qs * h**2
    exact = (-b + np.sqrt(b * b + 4 * h**2 * (Qs * Rs - Ns**2))) / (2 * h**2)
    truth(
        "cost of a sampled integrator",
        source="the scalar discrete Riccati equation, solved",
        expected=exact,
        got=dare_gain(A, B, np.array([[q]]), np.array([[r]]), h)[1][0, 0],
        tolerance=1e-13 * exact,
        reason="rounding",
    )


@pytest.mark.parametrize("h", [0.005, 2.0])
def test_the_sampled_cost_of_a_fast_actuator_keeps_its_digits(h):
    """The exponential of Van Loan alone would have an entry of exp(wn h) and lose them."""
    A, B = plant(0.2, 400.0, 1.0)
    Q = np.diag([1.0, 0.5, 0.0, 0.0])
    whole = sampled(A, B, Q, np.eye(1), h)
    Ad, Bd, Qd, Rd, Nd = sampled(A, B, Q, np.eye(1), h / 4)
    x, u, cost = np.array([1.0, -0.5, 0.3, 1.0]), np.array([0.4]), 0.0
    start = x
    for _ in range(4):
        cost += x @ Qd @ x + 2.0 * x @ Nd @ u + u @ Rd @ u
        x = Ad @ x + Bd @ u
    assert start @ whole[2] @ start + 2.0 * start @ whole[4] @ u + u @ whole[3] @ u == pytest.approx(cost, rel=1e-12)


def test_the_integral_gain_appears_only_when_it_is_weighed():
    assert design(0.2, 15.0, 1.0, (1.0, 0.5), 1.0)[0] == 0.0
    assert design(0.2, 15.0, 1.0, (1.0, 0.5), 1.0, integral=0.05)[0] == pytest.approx(np.sqrt(0.05), rel=0.01)


# ------------------------------------------------------------------------------------------------------------ current


def test_the_current_has_the_asked_drift_and_fluctuation_and_a_consistent_derivative():
    current = Current(description.Current(velocity=(0.1, 0.0, -0.2), fluctuation=0.3, period_s=10.0), seed=5)
    t = np.arange(0.0, 20_000.0, 0.5)
    v = current.velocity(t)
    # sinusoids averaged over 500 to 2000 of their periods: the rest falls as one over their number
    np.testing.assert_allclose(v.mean(axis=0), [0.1, 0.0, -0.2], atol=0.3 / 500)
    assert np.sqrt(((v - current.drift) ** 2).sum(axis=1).mean()) == pytest.approx(0.3, rel=0.02)
    assert np.linalg.norm(v, axis=1).max() <= current.max_speed
    h = 1e-3
    numeric = (current.velocity(t[:50] + h) - current.velocity(t[:50] - h)) / (2.0 * h)
    np.testing.assert_allclose(current.acceleration(t[:50]), numeric, atol=(h * current.frequency.max()) ** 2 + 1e-12)


def test_the_tabulated_current_is_the_current_also_across_blocks():
    current = Current(description.Current(fluctuation=0.2), seed=1)
    table = SampledCurrent(current, 0.005, 4)
    for tick in (0, 1, 999, 1000, 1001, 2500):
        stages = table.stages(tick)
        assert len(stages) == 5
        t = (tick + np.arange(5) / 4) * 0.005
        np.testing.assert_allclose([s[0] for s in stages], current.velocity(t), atol=1e-14)
        np.testing.assert_allclose([s[1] for s in stages], current.acceleration(t), atol=1e-14)


# -------------------------------------------------------------------------------------------------------------- noise


@pytest.mark.subject("IMU and depth gauge")
def test_white_noise_and_random_walk_have_the_variances_of_their_densities(truth):
    count, rate = 100_000, 200.0
    made = noise(count, rate, 0.02, 0.003, np.random.default_rng(1))
    standard_error = np.sqrt(2.0 / (3 * count))
    for name, samples, expected in (
        ("samples", made.white, 0.02**2 * rate),
        ("steps of the bias", np.diff(made.bias, axis=0), 0.003**2 / rate),
    ):
        truth(
            f"variance of {name}",
            source="density^2 rate, and random walk^2/rate",
            expected=expected,
            got=samples.var(),
            stderr=standard_error * expected,
        )
    assert (made.bias[0] == 0.0).all()


@pytest.mark.subject("IMU and depth gauge")
@pytest.mark.parametrize("seconds", [0.5, 4.0, 32.0])
def test_allan_variances_of_the_noise_are_those_of_its_densities(truth, seconds):
    """IEEE Std 952: white noise N^2/tau; a random walk of the bias K^2 tau/3, of means over tau."""
    rate, count, density, walk = 200.0, 1 << 20, 0.02, 0.003
    m = round(seconds * rate)

    def allan(samples):
        """Allan variance [axes] of means over m samples, from neighbours without overlap."""
        blocks = samples[: len(samples) // m * m].reshape(-1, m, 3).mean(axis=1)
        return 0.5 * (np.diff(blocks, axis=0) ** 2).mean()

    made = noise(count, rate, density, walk, np.random.default_rng(3))
    pairs = 3 * (count // m - 1)
    # differences of neighbouring means are correlated: -1/2 for white noise, 1/4 for a random walk
    truth(
        f"of white noise, means over {seconds} s",
        source="N^2/tau",
        expected=density**2 / seconds,
        got=allan(made.white),
        stderr=density**2 / seconds * np.sqrt(3.0 / pairs),
    )
    # summed, not integrated: (2 m^2 + 1)/(2 m^2) of the integral's
    expected = walk**2 * seconds / 3.0 * (1.0 + 0.5 / m**2)
    truth(
        f"of the bias, means over {seconds} s",
        source="K^2 tau/3",
        expected=expected,
        got=allan(made.bias),
        stderr=expected * np.sqrt(2.25 / pairs),
    )


def test_imu_noise_is_off_by_default_seeded_and_comes_with_its_bias():
    def run(seed, noise):
        return simulate(
            Scene(
                trajectory={"poses": [{"position": (0, 0, 0)}], "duration_s": 2.0},
                seed=seed,
                vehicle={"imu": {"noise": noise}},
            )
        ).imu

    model = {
        "accelerometer_noise_density": 0.01,
        "accelerometer_random_walk": 0.001,
        "gyroscope_noise_density": 0.001,
        "gyroscope_random_walk": 1e-4,
    }
    exact, noisy, again, other = run(1, None), run(1, model), run(1, model), run(2, model)
    assert (exact.acceleration_bias == 0.0).all()
    assert noisy.acceleration.tobytes() == again.acceleration.tobytes()
    assert (noisy.acceleration != other.acceleration).any()
    rest = noisy.acceleration - exact.acceleration - noisy.acceleration_bias
    assert rest.std() == pytest.approx(0.01 * np.sqrt(200), rel=5 / np.sqrt(2 * rest.size))
    assert (run(1, {}).acceleration == exact.acceleration).all()


# ------------------------------------------------------------------------------------------------ quaternions and clock


angle = st.floats(-10.0, 10.0)
vector = st.tuples(angle, angle, angle)


@given(vector, vector)
def test_quaternions_agree_with_scipy(a, b):
    qa, qb = quaternion.exp(a), quaternion.exp(b)
    ra, rb = Rotation.from_rotvec(a), Rotation.from_rotvec(b)
    product = Rotation.from_quat(quaternion.multiply(qa, qb), scalar_first=True)
    assert (product.inv() * (ra * rb)).magnitude() < 1e-14
    np.testing.assert_allclose(quaternion.rotate(qa, b), ra.apply(b), atol=1e-13)
    np.testing.assert_allclose(quaternion.rotate_back(qa, b), ra.inv().apply(b), atol=1e-13)


@given(vector.filter(lambda v: np.linalg.norm(v) < 3.14), st.sampled_from([1.0, -1.0]), st.floats(-12.0, 0.0))
def test_log_undoes_exp_for_small_and_large_turns_and_either_sign(v, sign, scale):
    v = tuple(10.0**scale * x for x in v)
    q = tuple(sign * x for x in quaternion.exp(v))
    np.testing.assert_allclose(quaternion.log(q), v, atol=4e-15, rtol=1e-12)


@pytest.mark.parametrize("rate", [200.0, 10.0, 0.5, 29.97, 60.0, 1e3])
def test_samples_are_at_the_nearest_nanosecond_for_a_day(rate):
    count = int(LONGEST_S * min(rate, 200.0))
    last = Fraction(count - 1) * 10**9 / Fraction(rate)
    assert abs(times_ns(count, rate)[-1] - last) <= Fraction(51, 100)  # half a nanosecond, and float64's rounding


def test_rates_that_nanoseconds_cannot_tell_are_refused():
    check_rate(HIGHEST_RATE_HZ, "x")
    for rate in (1.01 * HIGHEST_RATE_HZ, 1e300):
        with pytest.raises(InputError, match="is too high"):
            check_rate(rate, "x")


def test_a_duration_has_frames_at_its_start_but_not_at_its_end():
    assert [frame_count(duration, 10.0) for duration in (20.0, 0.3, 0.1, 1e-3, 0.25)] == [200, 3, 1, 1, 3]
    assert [frames_until(end, 10.0) for end in (20.0, 0.3, 0.1, 1e-3, 0.25)] == [201, 4, 2, 1, 3]
    assert frame_count(1000 / 29.97, 29.97) == frames_until(1000 / 29.97, 29.97) - 1 == 1000


def test_all_parameters_of_the_sphere_are_fields_of_the_scene():
    assert set(Sphere.__dataclass_fields__) - {"gravity"} <= set(description.Vehicle.model_fields)
