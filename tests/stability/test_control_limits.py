"""Gains over decades of weights, thrusters and steps, against Riccati equations solved in 200 digits."""

import numpy as np
import pytest
from pydantic import ValidationError
from regulators import exact_gain

from varos_warp.errors import InputError
from varos_warp.scene.description import vehicle as description
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.sim.trajectory import simulate
from varos_warp.sim.vehicle.control import design, plant

DRAG = 1.0 / 6.0


def gain_error(q, r=1.0, *, wn=15.0, zeta=1.0, integral=0.0, h=0.005) -> float:
    """Largest error of a gain, of the largest one."""
    A, B = plant(DRAG, wn, zeta, integral > 0.0)
    weights = ([integral] if integral > 0.0 else []) + [*q, 0.0, 0.0]
    exact = exact_gain(A, B, np.diag(weights), r, h)[0]
    made = np.array(design(DRAG, wn, zeta, q, r, integral=integral, h=h))[0 if integral > 0.0 else 1 :]
    return float(np.abs(made - exact).max() / np.abs(exact).max())


def test_the_truth_itself_is_the_closed_form_of_the_scalar_equation():
    """The plant x' = -x + u with the cost x^2 + u^2, u held over h = 1/2."""
    a, h = np.exp(-0.5), 0.5
    Q_d = (1.0 - a**2) / 2.0
    b, N_d = 1.0 - a, (1.0 - a) - (1.0 - a**2) / 2.0
    R_d = h + h - 2.0 * (1.0 - a) + (1.0 - a**2) / 2.0
    # P = a^2 P + Q_d - (a b P + N_d)^2 / (R_d + b^2 P), a quadratic in P
    roots = np.roots(
        [(a**2 - 1) * b**2 - (a * b) ** 2, (a**2 - 1) * R_d + Q_d * b**2 - 2 * a * b * N_d, Q_d * R_d - N_d**2]
    )
    P = roots.max()
    K = (a * b * P + N_d) / (R_d + b**2 * P)
    made = exact_gain(np.array([[-1.0]]), np.array([[1.0]]), np.array([[1.0]]), 1.0, h)
    assert made[0, 0] == pytest.approx(K, rel=1e-13)


@pytest.mark.parametrize("decades", [-12, -6, 0, 6, 12])
def test_gains_are_right_over_24_decades_of_the_weights(decades):
    scale = 10.0**decades
    assert gain_error((scale, 0.5 * scale)) < 1e-6
    assert gain_error((1.0, 0.5), 1.0 / scale) < 1e-6


@pytest.mark.parametrize(
    ("q", "r", "integral"),
    [
        ((9e-13, 0.0), 1.0, 0.0),
        ((1.1e12, 1.0), 1.0, 0.0),
        ((1.0, 1.1e12), 1.0, 0.0),
        ((1.0, 0.5), 1.1e12, 0.0),
        ((1.0, 0.5), 1e-300, 0.0),
        ((1.0, 0.5), 1.0, 1.1e12),
        ((0.0, 0.0), 1.0, 0.0),
    ],
)
def test_weights_so_far_apart_that_gains_lose_their_digits_are_refused(q, r, integral):
    with pytest.raises(InputError) as caught:
        design(DRAG, 15.0, 1.0, q, r, integral=integral)
    assert caught.value.key
    assert "1e-12" in caught.value.remedy


@pytest.mark.parametrize("wn", [1e-3, 1.0, 1e3, 1e6])
def test_gains_are_right_for_any_thruster(wn):
    assert gain_error((1.0, 0.5), wn=wn) < 1e-9


@pytest.mark.parametrize("zeta", [1e-3, 1.0, 1e3, 1e6])
def test_gains_are_right_for_any_damping(zeta):
    assert gain_error((1.0, 0.5), zeta=zeta) < 1e-6


@pytest.mark.parametrize("h", [1e-6, 1e-4, 0.005, 1.0, 100.0])
def test_gains_are_right_for_any_step(h):
    assert gain_error((1.0, 0.5), h=h) < 1e-8


@pytest.mark.parametrize("integral", [1e-12, 1e-3, 1.0, 1e6, 1e12])
def test_gains_are_right_for_any_weight_of_the_integral(integral):
    assert gain_error((1.0, 0.5), integral=integral) < 1e-10


@pytest.mark.parametrize(
    ("key", "good", "bad"),
    [("actuator_frequency", 1e-6, 9e-7), ("actuator_frequency", 1e9, 1.1e9), ("actuator_damping", 1e6, 1.1e6)],
)
def test_thrusters_for_which_gains_lose_their_digits_are_refused(key, good, bad):
    description.Vehicle(**{key: good})
    with pytest.raises(ValidationError):
        description.Vehicle(**{key: bad})


# ----------------------------------------------------------------------------------------------------------- saturation


def drive(force):
    return simulate(
        scene_from_dict(
            {
                "vehicle": {"max_force": force},
                "trajectory": {
                    "waypoints": [{"position": (0, 0, 0)}, {"position": (0, 3, 0)}],
                    "handover_timeout_s": 5.0,
                },
            }
        )
    )


@pytest.mark.parametrize(("force", "enough"), [(30.0, True), (20.0, True), (19.0, False), (1.0, False)])
def test_a_leg_that_takes_more_thrust_than_there_is_is_told_and_less_is_not(force, enough):
    """The leg of the course takes 19.5 N."""
    messages = drive(force).messages
    assert any("vehicle.max_force" in message for message in messages) != enough


@pytest.mark.parametrize("force", [1.0, 1e-2, 1e-6, 1e-300])
def test_a_vehicle_with_hardly_any_thrust_goes_nowhere_and_says_so(force):
    simulation = drive(force)
    assert any("gave up waiting" in message for message in simulation.messages)
    virtual_mass = 60.0  # the distance of a free mass at full thrust all the time bounds the way
    seconds = simulation.trajectory.time_ns[-1] * 1e-9
    assert simulation.trajectory.position[-1, 1] <= 0.5 * force / virtual_mass * seconds**2
    assert np.isfinite(simulation.trajectory.position).all()
