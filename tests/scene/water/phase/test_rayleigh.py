"""Pure water."""

import numpy as np
import pytest

from varos_warp.scene.water.phase.rayleigh import Rayleigh

pytestmark = pytest.mark.subject("phase functions")


def test_the_published_constant_normalises_it(truth):
    phase = Rayleigh()
    truth(
        "0.06225 (1 + 0.835 cos^2) over the sphere",
        source="4 pi 0.06225 (1 + 0.835/3)",
        got=phase.integral,
        expected=4 * np.pi * 0.06225 * (1 + 0.835 / 3),
        tolerance=1e-9,
        reason="the end behind, 1e-12 wide",
    )
    truth(
        "p at 0, 90 and 180 degrees",
        source="Morel (1974), normalised",
        expected=np.array([1.835, 1.0, 1.835]) / (4 * np.pi * (1 + 0.835 / 3)),
        got=phase.eval([1.0, 0.0, -1.0]),
        tolerance=1e-10,
        reason="rounding",
    )


def test_moments(truth):
    """1 + a cos^2 is (1 + a/3) P_0 + 2a/3 P_2."""
    expected = np.zeros(301)
    expected[0], expected[2] = 1.0, 2 * 0.835 / 3 / 5 / (1 + 0.835 / 3)
    truth(
        "<P_l>, l = 0 to 300",
        source="1 + a cos^2 in Legendre polynomials",
        expected=expected,
        got=Rayleigh().moments(300),
        tolerance=1e-10,
        reason="rounding, and the end behind",
    )
    assert Rayleigh().backscatter_fraction == pytest.approx(0.5)
