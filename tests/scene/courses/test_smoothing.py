"""Smoothing takes noise out of recorded poses as a filter whose gain is known in closed form, without delay."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline
from scipy.spatial.transform import Rotation

from varos_warp.errors import InputError
from varos_warp.scene.courses.smoothing import smoothed, smoothed_attitudes

TIMES = np.arange(0.0, 20.0, 0.01)
MIDDLE = slice(800, 1200)


def gain(period_s, smoothing_s):
    return 1.0 / (1.0 + (smoothing_s / period_s) ** 4)


@pytest.mark.parametrize("period_s", [0.5, 1.0, 2.0])
def test_an_oscillation_keeps_its_phase_and_the_share_that_its_period_says(period_s):
    """Half at the period of the key, 94 % at twice; the ends fade out as exp(-2 pi t / (2^0.5 T))."""
    wave = np.sin(2.0 * np.pi * TIMES / period_s)[:, None]
    found = smoothed(TIMES, wave, 1.0)
    # sums for integrals: splines follow a wave to (step / period)^4, and the ends are exp(-36) away
    np.testing.assert_allclose(
        found[MIDDLE], gain(period_s, 1.0) * wave[MIDDLE], atol=(2 * np.pi * 0.01 / period_s) ** 4
    )


def test_a_straight_line_at_constant_speed_stays_up_to_its_ends_however_its_times_lie():
    times = np.cumsum(np.random.default_rng(2).uniform(0.001, 0.1, 300))
    line = np.array([7_033_000.0, -80.0]) + times[:, None] * [0.5, -0.1]
    np.testing.assert_allclose(smoothed(times, line, 2.0), line, rtol=0.0, atol=1e-8)


def test_it_is_the_smoothing_spline_of_scipy():
    rng = np.random.default_rng(3)
    times, values = np.cumsum(rng.uniform(0.02, 0.2, 200)), rng.normal(size=200)
    step = np.diff(times)
    weight = 0.5 * (np.append(step, 0.0) + np.append(0.0, step))
    expected = make_smoothing_spline(times, values, w=weight, lam=(0.8 / (2.0 * np.pi)) ** 4)(times)
    np.testing.assert_allclose(smoothed(times, values[:, None], 0.8)[:, 0], expected, atol=1e-12)


def test_a_turn_at_constant_rate_stays_also_where_quaternions_change_their_signs():
    turns = Rotation.from_rotvec(TIMES[:, None] * [0.3, -0.2, 0.9])
    q = turns.as_quat() * np.where(np.arange(len(TIMES)) % 7 < 3, 1.0, -1.0)[:, None]
    found = smoothed_attitudes(TIMES, Rotation.from_quat(q), 1.0)
    assert (found.inv() * turns)[MIDDLE].magnitude().max() < 1e-9


def test_a_small_oscillation_of_the_attitude_is_filtered_as_one_of_the_place():
    angle = 1e-4 * np.sin(2.0 * np.pi * TIMES / 0.8)
    found = smoothed_attitudes(TIMES, Rotation.from_rotvec(angle[:, None] * [0.0, 0.6, 0.8]), 1.0).as_rotvec()
    np.testing.assert_allclose(found[MIDDLE], gain(0.8, 1.0) * angle[MIDDLE, None] * [0.0, 0.6, 0.8], atol=1e-4 * 4e-5)


def test_a_course_is_smoothed_and_says_by_how_much(course):
    rng = np.random.default_rng(4)
    places = np.stack([0.5 * TIMES, 0.0 * TIMES, 0.0 * TIMES], axis=1)
    noisy = places + rng.normal(size=places.shape) * 0.01
    text = "".join(
        f"{t!r} {' '.join(map(repr, p))} 0 0 0 1\n" for t, p in zip(TIMES.tolist(), noisy.tolist(), strict=True)
    )
    stops = course(text, smoothing_s=1.0, of="vehicle")
    # of white noise up to 50 Hz the mean of gain^2 is left
    share = np.sqrt(np.mean(gain(1.0 / np.linspace(1e-6, 50.0, 200_001), 1.0) ** 2))
    off = (stops.position - places)[100:-100].std()
    assert off == pytest.approx(0.01 * share, rel=0.3)  # some 40 independent values in each axis: 6 % standard error
    moved = np.linalg.norm(stops.position - noisy, axis=1)
    told = stops.about["smoothing"]
    assert told["moved_m"] == {"rms": pytest.approx(np.sqrt(np.mean(moved**2))), "peak": pytest.approx(moved.max())}
    assert told["turned_deg"]["peak"] == pytest.approx(0.0, abs=1e-6)
    assert stops.messages == ()
    np.testing.assert_array_equal(course(text).position, noisy)


def test_a_period_of_more_poses_than_digits_last_for_is_refused(course):
    text = "".join(f"{t!r} {t!r} 0 0 0 0 0 1\n" for t in TIMES[:50].tolist())
    with pytest.raises(InputError, match=r"is more than 5000 of the 0\.01 s between poses") as error:
        course(text, smoothing_s=51.0)
    assert error.value.key == "trajectory.smoothing_s"
    course(text, smoothing_s=49.0)
