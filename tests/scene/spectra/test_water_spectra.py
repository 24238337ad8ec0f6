"""Water by wavelength against printed values, and what spectral is worth."""

import numpy as np
import pytest

from varos_warp.scene.description.water import Constituents
from varos_warp.scene.spectra.lamps import camera_response, lamp_spectrum
from varos_warp.scene.spectra.seawater import pure_scattering
from varos_warp.scene.spectra.spectrum import GRID, STEPS
from varos_warp.scene.spectra.water import MEASURED, _constituents, _jerlov, pure_absorption
from varos_warp.scene.water import JERLOV


def test_pure_water_absorbs_as_pope_and_fry_and_smith_and_baker_print():
    printed = {
        400: 0.00663,
        417.5: 0.00442,
        440: 0.00635,
        500: 0.0204,
        550: 0.0565,
        600: 0.2224,
        650: 0.340,
        700: 0.624,
        710: 0.839,
        800: 2.07,
    }
    np.testing.assert_allclose(pure_absorption(list(printed)), list(printed.values()), rtol=1e-12)


def test_pure_sea_water_scatters_as_zhang_2009():
    """An independent port of their formulas has 2.54734e-3 1/m at 500 nm, 20 degrees and 35 g/kg."""
    assert pure_scattering(500.0, 20.0, 35.0) == pytest.approx(2.54734e-3, rel=1e-5)


def test_pure_sea_water_scatters_more_blue_and_more_salt():
    """Steeper than Rayleigh's w^-4, by the dispersion of water, and salt adds 30 %, as Morel (1974) measured, too."""
    w = np.array([400.0, 450.0, 550.0, 600.0])
    slope = np.log(pure_scattering(w) / pure_scattering(500.0)) / np.log(500.0 / w)
    assert ((slope > 4.0) & (slope < 4.32)).all()
    assert pure_scattering(500.0) / pure_scattering(500.0, 20.0, 0.0) == pytest.approx(1.30, abs=0.01)


@pytest.mark.parametrize("kind", sorted(JERLOV))
def test_jerlov_types_pass_through_the_three_wavelengths_known_before(kind):
    """Absorption and scattering at 600, 550, 450 nm, to the three digits they are printed with."""
    water = _jerlov(kind, 0.0183)
    at = [int(nm - 400) for nm in (600, 550, 450)]
    np.testing.assert_allclose(water.a[at], JERLOV[kind][0], rtol=5e-3)
    np.testing.assert_allclose(water.b[at], JERLOV[kind][1], rtol=5e-3)


def test_jerlov_types_are_measured_or_inverted():
    assert "measured" in _jerlov("II", 0.0183).source
    assert "inverted" in _jerlov("I", 0.0183).source
    assert set(MEASURED) < set(JERLOV)


def test_water_without_constituents_is_pure():
    water = _constituents(Constituents(temperature_C=20.0, salinity=35.0), 0.0183)
    np.testing.assert_allclose(water.a, pure_absorption())
    np.testing.assert_allclose(water.b, pure_scattering(GRID, 20.0, 35.0))
    np.testing.assert_allclose(water.b_b, 0.5 * water.b)


def test_constituents_add_what_the_model_says():
    """Morel and Maritorena (2001): b_p(550) = 0.416 chl^0.766, even at 2 mg/m^3; Bricaud's A is a_ph at 1 mg/m^3."""
    water = _constituents(Constituents(chlorophyll_mg_m3=2.0), 0.0183)
    np.testing.assert_allclose(water.b_particles, 0.416 * 2.0**0.766, rtol=2e-3)
    one = _constituents(Constituents(chlorophyll_mg_m3=1.0), 0.0183)
    assert one.a[0] - pure_absorption()[0] == pytest.approx(0.0240515)
    cdom = _constituents(Constituents(cdom_440_per_m=0.1), 0.0183).a - pure_absorption()
    assert cdom[40] == pytest.approx(0.1)
    assert cdom[40] / cdom[140] == pytest.approx(np.exp(1.4))
    stones = _constituents(Constituents(minerals_g_m3=2.0), 0.0183)
    np.testing.assert_allclose(stones.b_particles, 1.0)


def signal(d, power=0, a=pure_absorption()):
    """What each channel has of an LED after a path [m] through pure water, times a power of the attenuation."""
    light = lamp_spectrum("led_b4", None, "").at() * camera_response("nikon_5100", None, "")
    return (light * a**power * np.exp(-a * d)) @ STEPS


RED = [0.193, 0.173, 0.154, 0.103, 0.055]
"""Local attenuation after 0, 2, 4, 10, 20 m, computed elsewhere from Pope and Fry's table in steps of 10 nm."""


def test_local_attenuation_of_red_falls_with_distance():
    """With the table in the same steps, to half of the last digit; with the whole table it is 1 % lower at 10 m."""
    nm = np.arange(400.0, 701.0, 10.0)
    every_tenth = np.interp(GRID, nm, pure_absorption(nm))
    local = [signal(d, 1, every_tenth)[0] / signal(d, 0, every_tenth)[0] for d in (0, 2, 4, 10, 20)]
    np.testing.assert_allclose(local, RED, atol=5.1e-4)
    whole = [signal(d, 1)[0] / signal(d)[0] for d in (0, 2, 4, 10, 20)]
    np.testing.assert_allclose(whole, local, rtol=0.01)


@pytest.mark.parametrize(("channel", "at_10", "at_20"), [(0, 0.756, 0.284), (1, 0.952, 0.817), (2, 0.992, 0.968)])
def test_one_coefficient_of_4_m_falls_short(channel, at_10, at_20):
    c = -np.log(signal(4)[channel] / signal(0)[channel]) / 4.0
    left = [np.exp(-c * d) * signal(0)[channel] / signal(d)[channel] for d in (10, 20)]
    np.testing.assert_allclose(left, [at_10, at_20], rtol=0.01)
