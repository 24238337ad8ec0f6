"""Optical properties of the three forms of water."""

import numpy as np
import pytest

from varos_warp.scene.description import Scene
from varos_warp.scene.water import JERLOV, optical_properties


def properties(water):
    return optical_properties(Scene(water=water, trajectory={"poses": [{"position": [0, 0, 0]}]}))


def test_principled_water_is_the_papers_table_1():
    water = properties(
        {
            "principled": {
                "density": 0.125,
                "color": [0.014, 0.146, 0.345],
                "absorption_color": [0.0, 0.392, 1.0],
                "anisotropy": 0.8,
            }
        }
    )
    np.testing.assert_allclose(water.sigma_s, [0.00175, 0.01825, 0.043125])
    np.testing.assert_allclose(water.sigma_t, water.sigma_s + water.sigma_a)
    assert (water.g, water.source, water.phase.key) == (0.8, "principled", ("henyey_greenstein", 0.8))


@pytest.mark.parametrize("kind", [*JERLOV, "IC"])
def test_jerlov_types(kind):
    water = properties({"jerlov": {"type": kind}})
    absorption, scattering = JERLOV[kind.replace("IC", "1C")]
    assert (tuple(water.sigma_a), tuple(water.sigma_s)) == (absorption, scattering)
    assert (water.albedo < 1.0).all()
    assert water.g == water.phase.mean_cosine


def test_no_water_neither_scatters_nor_absorbs():
    water = properties("none")
    assert not water.sigma_t.any()
    assert not water.albedo.any()
    assert (water.g, water.source) == (0.0, "none")
