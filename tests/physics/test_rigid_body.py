"""The rigid body with six coupled degrees of freedom, its thrusters and turbulence against closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import lsim
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from benchmarks.stability.dynamics import ROV, truth_of
from varos_warp.scene.description import vehicle as description
from varos_warp.sim import quaternion
from varos_warp.sim.vehicle.body import sphere
from varos_warp.sim.vehicle.current import Current, Turbulence
from varos_warp.sim.vehicle.dynamics import Dynamics, State
from varos_warp.sim.vehicle.rigid_body import RigidBody, rigid_body

pytestmark = pytest.mark.subject("dynamics")

H = 0.005
NO_DRAG = {"linear_drag": 6 * (0.0,), "quadratic_drag": 6 * (0.0,)}
STILL = {}
TURBULENT = {"velocity": (0.1, -0.2, 0.05), "turbulence": {"rms": (0.1, 0.1, 0.05), "correlation_time_s": 5.0}}


def rov(block=None, **vehicle) -> RigidBody:
    return rigid_body(description.Vehicle(mass_kg=13.5, rigid_body=ROV | (block or {}), **vehicle))


def fly(body, state, seconds, current=STILL, h=H) -> list[State]:
    """Thrusters that turn with the vehicle keep delivering what they deliver at the start."""
    dynamics = Dynamics(body, Current(description.Current(**current), 3), actuator_frame="body", h=h)
    states = [state]
    for tick in range(round(seconds / h)):
        force = quaternion.rotate(states[-1].q, state.force)
        states.append(dynamics.advance(states[-1], force, state.torque, tick))
    return states


def column(states, name) -> np.ndarray:
    return np.array([getattr(state, name) for state in states])


def energy(body: RigidBody, states) -> np.ndarray:
    """Kinetic energy of body and water, and that of the centre of buoyancy [J], in still water."""
    R = Rotation.from_quat(column(states, "q"), scalar_first=True)
    v, lift = R.inv().apply(column(states, "v")), body.displaced * body.gravity * body.metacentric_height
    return 0.5 * (v**2 @ body.masses + column(states, "omega") ** 2 @ body.inertias) - lift * R.as_matrix()[:, 2, 2]


# --------------------------------------------------------------------------------------------------------------- body


@pytest.mark.parametrize("current", [STILL, TURBULENT], ids=["still", "turbulent"])
def test_with_the_spheres_numbers_it_is_the_sphere(truth, current):
    vehicle = description.Vehicle(mass_kg=40.0, metacentric_height=0.02)
    state = State(v=(0.3, -0.2, 0.5), omega=(0.5, -0.4, 0.7), force=(10.0, -5.0, 3.0), torque=(0.5, 2.0, -1.5))
    ball, body = (fly(make(vehicle), state, 5.0, {**current, "turbulence": None}) for make in (sphere, rigid_body))
    for name, unit in (("p", "m"), ("v", "m/s"), ("omega", "rad/s")):
        truth(
            f"{name} [{unit}] over 5 s",
            source="the sphere's own equations",
            expected=column(ball, name),
            got=column(body, name),
            tolerance=1e-8,
            reason="two RK4 of the same, (lambda h)^4/120",
        )


@pytest.mark.parametrize("tilt_deg", [1.0, 30.0, 120.0])
def test_a_pitching_body_has_the_pendulums_period(truth, tilt_deg):
    """4 K(sin(theta_0/2))/w with w^2 = rho V g h/J: 2 pi/w for small tilts. It crosses upright twice a period."""
    body = rov(NO_DRAG, metacentric_height=0.05)
    w = np.sqrt(body.displaced * body.gravity * body.metacentric_height / body.inertias[0])
    period = 4.0 * ellipk(np.sin(0.5 * np.radians(tilt_deg)) ** 2) / w
    states = fly(body, State(q=quaternion.exp((np.radians(tilt_deg), 0.0, 0.0))), 3.0 * period)
    q = column(states, "q")
    angle = 2.0 * np.arctan2(q[:, 1], q[:, 0])
    at = np.flatnonzero(np.diff(np.sign(angle)))
    assert len(at) >= 5
    # between two ticks the angle is a cubic of which the second derivative vanishes upright
    crossed = (at + angle[at] / (angle[at] - angle[at + 1])) * H
    truth(
        f"period [s], released at {tilt_deg:g} degrees",
        source="elliptic integral",
        expected=period,
        got=crossed[2:] - crossed[:-2],
        tolerance=period * (w * H) ** 2 / 6.0,
        reason="crossings by straight lines",
    )


def test_all_six_degrees_of_freedom_converge_with_the_fourth_power_of_the_step(truth):
    body = rov(metacentric_height=0.05)
    state = State(v=(0.5, 0.8, -0.3), omega=(1.5, -1.0, 0.7), force=(5.0, 10.0, -3.0), torque=(0.1, 0.2, -0.1))
    expected = truth_of(body, state, 1.6)
    errors = [
        np.linalg.norm(np.concatenate([end.v, end.omega]) - expected)
        for end in (fly(body, state, 1.6, h=h)[-1] for h in (0.005, 0.0025, 0.00125))
    ]
    truth(
        "order of convergence, all coupled, steps of 5, 2.5 and 1.25 ms",
        source="Munthe-Kaas, RK4: 4; truth by DOP853",
        expected=4.0,
        got=np.log2(errors[:-1]) - np.log2(errors[1:]),
        tolerance=0.4,
        reason="terms of fifth order",
    )


def test_without_drag_it_keeps_its_energy_to_the_order_of_the_step(truth):
    """Tumbling and drifting, with a righting moment; what is lost falls with the fifth power, as RK4 dissipates."""
    body = rov(NO_DRAG, metacentric_height=0.05)
    state = State(v=(0.5, 0.8, -0.3), omega=(1.5, -1.0, 0.7))
    lost = []
    for h in (0.005, 0.0025, 0.00125):
        kept = energy(body, fly(body, state, 3.0, h=h))
        lost.append(np.abs(kept - kept[0]).max() / np.ptp([body.displaced * body.gravity * 0.05, kept[0]]))
    truth(
        "energy lost in 3 s, as a share, at 5 ms",
        source="conservation",
        expected=0.0,
        got=lost[0],
        tolerance=3.0 * 200 * (6.0 * H) ** 5 / 120,
        reason="(w h)^5/120 a step, w = 6 rad/s",
    )
    assert np.log2(lost[0] / lost[2]) / 2.0 > 3.6


# --------------------------------------------------------------------------------------------------------- turbulence


def test_turbulence_tilts_a_body_with_a_righting_moment_as_it_does_a_linear_oscillator(truth):
    """Water that accelerates pushes at the centre of buoyancy: J phi'' + d phi' + k phi = -+ k a/g, about x and y.

    Of equal masses along all axes, so that Munk's moment is none. Then the variance of the oscillator's tilt by the
    spectrum of the acceleration, over 5000 s.
    """
    equal = {
        "added_mass": (7.0, 7.0, 7.0, 0.19, 0.19, 0.22),
        "inertia": (0.26, 0.26, 0.37),
        "linear_drag": (18.0, 18.0, 18.0, 1.1, 1.1, 1.2),
        "quadratic_drag": 6 * (0.0,),
    }
    body, T, S = rov(equal, metacentric_height=0.05), 2.0, 0.25
    k, J, d = body.displaced * body.gravity * body.metacentric_height, body.inertias[0], 1.1
    oscillator = ([1.0], [J, d, k])
    current = {"turbulence": {"rms": (0.1, 0.1, 0.0), "correlation_time_s": T, "smoothing_s": S}}
    tilt = Rotation.from_quat(column(fly(body, State(), 10.0, current), "q"), scalar_first=True).as_rotvec()[:, :2]

    water, t = Current(description.Current(**current), 3), H * np.arange(len(tilt))
    pushed = -k / body.gravity * water.acceleration(t)[:, [1, 0]] * [1.0, -1.0]
    expected = np.column_stack([lsim(oscillator, push, t)[1] for push in pushed.T])
    truth(
        "tilt [rad] in turbulence over 10 s",
        source="a linear oscillator",
        expected=expected,
        got=tilt,
        tolerance=1e-3 * np.abs(expected).max(),
        reason="squares of a tilt of at most 2 degrees",
    )

    t = 0.05 * np.arange(100_001)
    pushed = k / body.gravity * water.acceleration(t)[:, 0]
    found = lsim(oscillator, pushed, t)[1].var()

    def density(w):
        return 1.0 / ((1.0 + T**2 * w**2) * (1.0 + S**2 * w**2) ** 2)

    moved = quad(
        lambda w: density(w) * w**2 * (k / body.gravity) ** 2 / ((k - J * w**2) ** 2 + (d * w) ** 2), 0, np.inf
    )[0]
    truth(
        "variance of the tilt [rad^2] in turbulence",
        source="its spectrum",
        got=found,
        expected=0.1**2 * moved / quad(density, 0, np.inf)[0],
        reason="four standard errors",
        tolerance=4.0 * found * np.sqrt(2.0 * (S + J / d) / t[-1]),
    )


def draw(count, step=H, seed=0, **changes):
    block = description.Turbulence(
        **{"rms": (0.3, 0.2, 0.1), "correlation_time_s": 2.0, "smoothing_s": 0.25, "seed": seed} | changes
    )
    return Turbulence(block, 1, step).knots(count)[:, 2] * block.rms


def correlation(lag, T, S) -> float:
    """From the spectral density 1/((1 + T^2 w^2) (1 + S^2 w^2)^2)."""

    def density(w):
        return 1.0 / ((1.0 + T**2 * w**2) * (1.0 + S**2 * w**2) ** 2)

    whole = quad(density, 0.0, np.inf)[0]
    return quad(density, 0.0, np.inf, weight="cos", wvar=lag)[0] / whole if lag else 1.0


@pytest.mark.parametrize(("step", "T"), [(0.005, 0.8), (0.05, 2.0), (1.0, 2.0)])
def test_turbulence_has_the_stated_variance_and_correlation_at_any_step(truth, step, T):
    """Also its correlation; the standard error of a covariance over N correlation times is about sqrt(2/N)."""
    S, seconds = T / 8.0, 10_000.0 * T
    v = draw(round(seconds / step), step, correlation_time_s=T, smoothing_s=S) / [0.3, 0.2, 0.1]
    error = np.sqrt(2.0 * (T + 2.0 * S) / seconds)
    for lag in (0.0, T / 2.0, 1.5 * T):
        n = round(lag / step)
        got = (v[: len(v) - n] * v[n:]).mean(axis=0)
        expected = correlation(lag, T, S)
        truth(
            f"covariance at a lag of {lag:g} s, step {step:g} s, in units of rms^2",
            source="Ornstein-Uhlenbeck process behind two lags: its spectrum",
            expected=expected,
            got=got,
            tolerance=4.0 * error,
            reason="four standard errors",
        )


def test_its_first_state_is_drawn_from_the_stationary_distribution(truth):
    first = np.array([draw(1, seed=seed)[0] for seed in range(200)]) / [0.3, 0.2, 0.1]
    truth(
        "mean square of the first velocity over its variance",
        source="normal distribution",
        expected=1.0,
        got=(first**2).mean(),
        stderr=np.sqrt(2.0 / first.size),
    )


def test_the_same_seed_draws_the_same_bytes_in_blocks_of_any_size_and_another_seed_others():
    whole = draw(5000)
    piecewise = Turbulence(description.Turbulence(rms=(0.3, 0.2, 0.1), correlation_time_s=2.0, smoothing_s=0.25), 1)
    for count in (1, 700, 2100, 5000):
        piecewise.knots(count)
    assert (piecewise.knots(5000)[:, 2] * [0.3, 0.2, 0.1]).tobytes() == whole.tobytes()
    assert np.abs(draw(5000, seed=1) - whole).max() > 0.1


def test_its_acceleration_is_the_derivative_of_its_velocity_and_continuous(truth):
    turbulence = Turbulence(description.Turbulence(rms=(0.3, 0.2, 0.1), correlation_time_s=2.0, smoothing_s=0.25), 1)
    t = np.arange(1, 4000) * (H / 4.0)
    h = 1e-6
    slope = (turbulence.motion(t + h)[0] - turbulence.motion(t - h)[0]) / (2.0 * h)
    acceleration = turbulence.motion(t)[1]
    # across a knot the second derivative jumps: the mean of both sides differs from either by half the jump, times h
    truth(
        "acceleration of the water [m/s^2]",
        source="differences over 2 us",
        expected=slope,
        got=acceleration,
        tolerance=1e-16 / h * 10 + 1e3 * h,
        reason="rounding; the kinks at the knots",
    )


def test_a_free_neutral_body_drifts_with_turbulent_water(truth):
    body = rov(NO_DRAG)
    current = Current(description.Current(**TURBULENT), 3)
    states = fly(body, State(v=tuple(current.velocity([0.0])[0])), 20.0, TURBULENT)
    truth(
        "velocity [m/s], 20 s",
        source="that of the water",
        got=column(states, "v"),
        expected=current.velocity(np.arange(len(states)) * H),
        tolerance=1e-12,
        reason="Simpson's rule is exact for the cubics between ticks",
    )
