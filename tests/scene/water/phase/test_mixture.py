"""Mixtures: weighted means in everything that is linear."""

import numpy as np
import pytest

from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.henyey_greenstein import HenyeyGreenstein
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.petzold import Petzold
from varos_warp.scene.water.phase.rayleigh import Rayleigh

PARTS = [(4.9, FournierForand(1.1, 3.5835)), (0.1, Rayleigh()), (2.0, Petzold()), (3.0, HenyeyGreenstein(0.7))]


def test_a_mixture_is_the_weighted_mean_of_its_parts():
    mixture = Mixture(PARTS)
    assert [weight for weight, _ in mixture.parts] == pytest.approx([0.49, 0.01, 0.2, 0.3])
    assert mixture.integral == pytest.approx(1.0, abs=1e-9)
    cosine = np.array([1.0, 0.99, 0.0, -1.0])
    np.testing.assert_allclose(mixture.eval(cosine), sum(w * p.eval(cosine) for w, p in mixture.parts), rtol=1e-9)
    np.testing.assert_allclose(mixture.moments(200), sum(w * p.moments(200) for w, p in mixture.parts), atol=1e-8)
    fractions = [p.backscatter_fraction for _, p in mixture.parts]
    assert mixture.backscatter_fraction == pytest.approx(np.dot([0.49, 0.01, 0.2, 0.3], fractions), rel=1e-6)


def test_a_mixture_is_a_table_on_the_device_even_of_one():
    mixture = Mixture([(2.0, HenyeyGreenstein(0.8))])
    assert not mixture.is_henyey_greenstein
    assert mixture.key == ("mixture", (1.0, ("henyey_greenstein", 0.8)))
    s = np.geomspace(1e-12, 1.0, 1001)
    np.testing.assert_allclose(mixture.table.eval(s), HenyeyGreenstein(0.8).eval_s(s), rtol=1e-5)


def test_the_most_backward_part_that_a_scene_may_name():
    mixture = Mixture([(1.0, HenyeyGreenstein(-0.6))])
    s = np.geomspace(1e-12, 1.0, 100_001)
    np.testing.assert_allclose(mixture.table.eval(s), HenyeyGreenstein(-0.6).eval_s(s), rtol=5e-4)
