"""Fournier and Forand: published values, distribution, backscatter and moments."""

import numpy as np
import pytest

from varos_warp.scene.water.phase.fournier_forand import NEAR_ONE, FournierForand
from varos_warp.scene.water.phase.phase_function import PhaseFunction

pytestmark = pytest.mark.subject("phase functions")

FORM = "Fournier and Jonasz (1999), quadrature in float64"
MOBLEY = "Mobley, Sundman and Boss (2002)"
DIGITS = "digits of the truth"
PETZOLD_LIKE = FournierForand(1.10, 3.5835)


def s_at(degrees):
    return np.sin(0.5 * np.radians(np.asarray(degrees, float))) ** 2


@pytest.mark.parametrize(
    ("n", "mu", "fraction", "values"),
    [
        (1.10, 3.5835, 0.0183127, (72.7838, 4.70228, 1.09624, 0.0730563, 0.00419332, 0.00285777)),
        (1.082513, 3.470254, 0.0100, (82.748, 4.24454, 0.879691, 0.0487263, 0.00238122, 0.00150619)),
    ],
)
def test_the_density_has_the_known_values(truth, n, mu, fraction, values):
    phase, values = FournierForand(n, mu), np.array(values)
    truth(
        f"p at 1, 5.0001, 10, 30, 90 and 180 degrees, n = {n}, mu = {mu}",
        source=FORM,
        expected=values,
        got=phase.eval_s(s_at([1, 5.0001, 10, 30, 90, 180])),
        tolerance=6e-6 * values,
        reason=DIGITS,
    )
    truth(
        f"B, n = {n}, mu = {mu}",
        source=MOBLEY,
        expected=fraction,
        got=phase.backscatter_fraction,
        tolerance=1e-7,
        reason=DIGITS,
    )


def test_the_distribution_has_the_known_values(truth):
    shares = np.array([0.068287, 0.254567, 0.558957, 0.711860, 0.895457, 0.981687, 0.997678])
    truth(
        "share of light within 0.1, 1, 5, 10, 30, 90 and 150 degrees, n = 1.10, mu = 3.5835",
        source=FORM,
        expected=shares,
        got=PETZOLD_LIKE.cdf(s_at([0.1, 1, 5, 10, 30, 90, 150])),
        tolerance=6e-7,
        reason=DIGITS,
    )
    median = np.degrees(np.arccos(PETZOLD_LIKE.sample(0.5)))
    truth("median angle [degrees]", source=FORM, expected=3.8353, got=median, tolerance=6e-5, reason=DIGITS)


def test_moments(truth):
    chi = PETZOLD_LIKE.moments(256)
    truth(
        "<P_l>, l = 8, 64, 256, n = 1.10, mu = 3.5835",
        source=FORM,
        expected=[0.660, 0.253, 0.114],
        got=chi[[8, 64, 256]],
        tolerance=6e-4,
        reason=DIGITS,
    )
    # the truth leaves out what is scattered by less than 1e-10 rad, in proportion to the angle to the power mu - 3
    left_out = PETZOLD_LIKE.cdf(s_at(0.1)) * (1e-10 / np.radians(0.1)) ** 0.5835
    truth("mean cosine", source=FORM, expected=0.929959 + left_out, got=chi[1], tolerance=6e-7, reason=DIGITS)


@pytest.mark.parametrize(("n", "mu"), [(1.10, 3.5835), (1.02, 3.07), (1.2, 4.24), (1.0001, 3.01), (1.5, 5.0)])
def test_it_is_normalised_and_positive(truth, n, mu):
    phase = FournierForand(n, mu)
    truth(
        f"integral over the sphere, n = {n}, mu = {mu}",
        source=FORM,
        expected=1.0,
        got=phase.integral,
        tolerance=1e-9,
        reason="the closed form's rounding near delta = 1",
    )
    truth(
        f"B, n = {n}, mu = {mu}",
        source=MOBLEY + ", against quadrature",
        expected=phase.backscatter_fraction,
        got=PhaseFunction.backscatter_fraction.func(phase),
        tolerance=1e-12 + 1e-9 * phase.backscatter_fraction,
        reason="rounding of a difference from 1",
    )
    assert (phase.eval_s(np.geomspace(1e-13, 1.0, 20001)) > 0.0).all()


def test_the_closed_form_meets_the_series_where_delta_is_1(truth):
    """At 9.936 degrees for n = 1.10, from both sides."""
    s_one = 1.0 / PETZOLD_LIKE._per_s
    assert np.degrees(2.0 * np.arcsin(np.sqrt(s_one))) == pytest.approx(9.936, abs=5e-4)
    inside, outside = (
        s_one * (1.0 + NEAR_ONE * np.array([-0.999, 0.999])),
        s_one * (1.0 + NEAR_ONE * 1.001 * np.array([-1.0, 1.0])),
    )
    ratio = PETZOLD_LIKE.eval_s(outside) / PETZOLD_LIKE.eval_s(inside)
    slope = np.log(PETZOLD_LIKE.eval_s(s_one * 1.01) / PETZOLD_LIKE.eval_s(s_one * 0.99)) / 0.02
    truth(
        "ratio of the two",
        source=FORM,
        expected=(outside / inside) ** slope,
        got=ratio,
        tolerance=3e-10,
        reason="rounding of the closed form, and what the series leaves out",
    )


@pytest.mark.parametrize("fraction", [0.0001, 0.001, 0.0183, 0.05, 0.15])
def test_the_family_of_one_parameter_has_the_backscatter_fraction_asked_for(truth, fraction):
    phase = FournierForand.from_backscatter_fraction(fraction)
    truth(
        f"B of the member with B = {fraction}",
        source=MOBLEY,
        expected=fraction,
        got=PhaseFunction.backscatter_fraction.func(phase),
        tolerance=1e-9,
        reason="rounding of a difference from 1",
    )
    assert phase.n == pytest.approx(1.01 + 0.1542 * (phase.mu - 3.0))


def test_the_family_has_the_published_member(truth):
    phase = FournierForand.from_backscatter_fraction(0.01)
    truth(
        "n and mu of B = 0.01",
        source=MOBLEY,
        expected=[1.082513, 3.470254],
        got=[phase.n, phase.mu],
        tolerance=6e-7,
        reason=DIGITS,
    )


def test_light_within_the_table_s_first_node_keeps_its_share(truth):
    """1e-4 degrees: the table's density ends there, its light does not."""
    share = PETZOLD_LIKE.cdf(s_at(0.1)) * 1e-3**0.5835  # a power of the angle
    truth(
        "share of light within 1e-4 degrees, n = 1.10, mu = 3.5835",
        source=FORM,
        expected=share,
        got=PETZOLD_LIKE.cdf(s_at(1e-4)),
        tolerance=5e-3 * share,
        reason="a pure power up to 0.1 degrees is near",
    )
    assert PETZOLD_LIKE.table.integral == pytest.approx(1.0, abs=1e-6)
