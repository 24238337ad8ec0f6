"""The table of the kernels in float64, for every phase function that is one."""

import numpy as np
import pytest
from scipy.special import eval_legendre

from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.petzold import Petzold
from varos_warp.scene.water.phase.power_table import LOG_S, S_CUT
from varos_warp.scene.water.phase.rayleigh import Rayleigh

SMOOTH = [
    FournierForand(1.10, 3.5835),
    FournierForand.from_backscatter_fraction(0.0001),
    FournierForand.from_backscatter_fraction(0.15),
    Rayleigh(),
    Mixture([(0.98, FournierForand(1.1, 3.5835)), (0.02, Rayleigh())]),
]
PHASES = [*SMOOTH, Petzold()]


@pytest.mark.parametrize("phase", SMOOTH, ids=repr)
def test_it_is_right_to_a_hundred_thousandth_from_1e_4_degrees_on(phase):
    s = np.geomspace(S_CUT, 1.0, 300_001)
    np.testing.assert_allclose(phase.table.eval(s), phase.eval_s(s), rtol=1.2e-5)


def test_a_kink_is_cut_by_the_table_s_bins():
    """Rows of a measured table next to 180 degrees, where bins are degrees wide: up to 0.7 %, elsewhere 0.2 %."""
    s = np.geomspace(S_CUT, 1.0, 300_001)
    off = np.abs(Petzold().table.eval(s) / Petzold().eval_s(s) - 1.0)
    assert off.max() < 7e-3
    assert off[s < np.sin(np.radians(80.0)) ** 2].max() < 2e-3


@pytest.mark.parametrize("phase", PHASES, ids=repr)
def test_it_is_normalised_and_its_distribution_ends_at_1(phase):
    table = phase.table
    assert table.integral == pytest.approx(1.0, abs=1e-5)
    assert (np.diff(table.cdf) > 0.0).all()
    assert table.cdf[-1] == 1.0
    assert table.cdf_at(np.array([0.0, 1.0])) == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize("phase", PHASES, ids=repr)
def test_samples_are_the_inverse_of_the_distribution(phase):
    u = (np.arange(100_000) + 0.5) / 100_000
    s = phase.table.sample(u)
    np.testing.assert_allclose(phase.table.cdf_at(s), u, atol=1e-12)
    assert (np.diff(s) > 0.0).all()
    assert s[0] > 0.0
    # the mean over even shares is an integral: its error is at most the spread over a share
    for order in (1, 2, 8):
        assert eval_legendre(order, 1.0 - 2.0 * s).mean() == pytest.approx(phase.moments(8)[order], abs=2e-5)
    assert np.array_equal(phase.sample(u), 1.0 - 2.0 * phase.table.sample(1.0 - u))


def test_it_is_the_derivative_of_the_distribution():
    table = PHASES[0].table
    s = np.exp(0.5 * (LOG_S[1:] + LOG_S[:-1]))
    h = 1e-5
    slope = (table.cdf_at(s * np.exp(h)) - table.cdf_at(s * np.exp(-h))) / (8.0 * np.pi * s * h)
    np.testing.assert_allclose(slope, table.eval(s), rtol=3e-6)
