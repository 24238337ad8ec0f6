"""Petzold's average particles: what the published table integrates to."""

import numpy as np
import pytest

from varos_warp.scene.water.phase.petzold import ANGLE_DEG, SLOPE, P, Petzold

pytestmark = pytest.mark.subject("phase functions")

SOURCE = "Mobley et al. (1993), table 2, log-log interpolation"


def test_the_table_has_the_known_integral_and_backscatter(truth):
    phase = Petzold()
    truth(
        "integral of the table over the sphere",
        source=SOURCE,
        expected=0.99295,
        got=phase.integral,
        tolerance=6e-6,
        reason="digits of the truth",
    )
    truth(
        "mean cosine",
        source=SOURCE,
        expected=0.92412,
        got=phase.mean_cosine,
        tolerance=6e-6,
        reason="digits of the truth",
    )
    truth(
        "B",
        source=SOURCE,
        expected=0.018259,
        got=phase.backscatter_fraction,
        tolerance=6e-7,
        reason="digits of the truth",
    )
    truth(
        "B as published",
        source="Mobley et al. (1993)",
        expected=0.0183,
        got=phase.backscatter_fraction,
        tolerance=5e-5,
        reason="digits of the truth",
    )
    truth(
        "share within 0.1 degrees",
        source=SOURCE,
        expected=0.052,
        got=phase.cdf(np.sin(np.radians(0.05)) ** 2),
        tolerance=6e-4,
        reason="digits of the truth",
    )


def test_moments(truth):
    chi = Petzold().moments(256)
    truth(
        "<P_l>, l = 8, 64, 256",
        source=SOURCE,
        expected=[0.615, 0.233, 0.093],
        got=chi[[8, 64, 256]],
        tolerance=6e-4,
        reason="digits of the truth",
    )


def test_rows_are_the_table_s_over_its_integral():
    phase = Petzold()
    got = phase.eval_s(np.sin(0.5 * np.radians(ANGLE_DEG)) ** 2)
    np.testing.assert_allclose(got, np.array(P) / phase.integral, rtol=1e-9)
    half = phase.eval_s(np.sin(np.radians(0.025)) ** 2)
    assert half == pytest.approx(P[0] / phase.integral * 0.5**SLOPE)
    assert phase.key == ("petzold",)
