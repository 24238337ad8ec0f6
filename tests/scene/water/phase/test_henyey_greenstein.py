"""Henyey and Greenstein on the host: the closed forms agree with what any phase function does by quadrature."""

import numpy as np
import pytest

from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.phase_function import PhaseFunction

pytestmark = pytest.mark.subject("phase functions")

HG = "Henyey and Greenstein (1941)"


@pytest.mark.parametrize("g", [-0.99, -0.5, 0.0, 0.8, 0.924, 0.999])
def test_quadrature_of_a_phase_function_gives_the_moments_g_to_the_l(truth, g):
    truth(
        f"<P_l>, l = 0 to 500, g = {g}",
        source=HG + ": g^l",
        expected=float(g) ** np.arange(501),
        got=PhaseFunction.moments(HenyeyGreenstein(g), 500),
        tolerance=1e-7,
        reason="1 - |g|, and the end behind",
    )
    assert PhaseFunction.integral.func(HenyeyGreenstein(g)) == pytest.approx(1.0, rel=1e-8)


@pytest.mark.parametrize("g", [-0.9, 0.0, 1e-6, 0.8, 0.99])
def test_closed_forms_agree(g):
    phase = HenyeyGreenstein(g)
    u = np.linspace(0.0, 1.0, 101)
    cosine = phase.sample(u)
    assert (cosine[0], cosine[-1]) == pytest.approx((-1.0, 1.0))
    np.testing.assert_allclose(phase.cdf(0.5 * (1.0 - cosine)), 1.0 - u, atol=1e-12)
    assert phase.backscatter_fraction == pytest.approx(PhaseFunction.backscatter_fraction.func(phase), rel=1e-7)
    assert phase.mean_cosine == g


def test_values(truth):
    truth(
        "p at 0, 90 and 180 degrees, g = 0.8",
        source=HG,
        expected=[3.58098621957, 0.0136403924191, 0.0049121896016],
        got=HenyeyGreenstein(0.8).eval([1.0, 0.0, -1.0]),
        tolerance=1e-11,
        reason="digits of the truth",
    )


def test_the_record_of_the_kernels_has_no_table():
    record = HenyeyGreenstein(0.8).device_record("cpu")
    assert record.g == np.float32(0.8)
    assert record.log_p is None or record.log_p.shape[0] == 0
