"""Bands against integration by the nanometre, and against that of colour-science."""

import numpy as np
import pytest

from varos_warp.scene.description.water import Constituents
from varos_warp.scene.spectra.bands import PAINTS, choose_bands
from varos_warp.scene.spectra.lamps import black_body, camera_response, lamp_spectrum, per_watt, watts_of_lumen
from varos_warp.scene.spectra.seawater import pure_scattering
from varos_warp.scene.spectra.spectrum import GRID, STEPS, Spectrum
from varos_warp.scene.spectra.surfaces import chart_reflectances, reflectance_of_rgb
from varos_warp.scene.spectra.water import WaterSpectra, _constituents, _jerlov, pure_absorption

colour = pytest.importorskip("colour")
NIKON = camera_response("nikon_5100", None, "")
BROAD = np.array([np.exp(-0.5 * ((GRID - m) / s) ** 2) for m, s in ((600, 45), (540, 45), (460, 35))])


def led(number: int) -> Spectrum:
    return lamp_spectrum(f"led_b{number}", None, "")


PURE = WaterSpectra(pure_absorption(), pure_scattering(GRID), np.zeros(len(GRID)), 0.5, "pure")
CASES = {
    "pure, LED, far": (PURE, [led(4)], NIKON, (2.0, 20.0), 6),
    "pure, halogen, near": (PURE, [black_body(3200.0)], NIKON, (0.5, 4.0), 4),
    "Jerlov I, two lamps": (_jerlov("I", 0.0183), [led(1), led(5)], NIKON, (1.0, 15.0), 9),
    "Jerlov 1C": (_jerlov("1C", 0.0183), [led(4)], NIKON, (1.0, 10.0), 6),
    "Jerlov 9C": (_jerlov("9C", 0.0183), [led(3)], NIKON, (0.2, 2.0), 12),
    "bloom": (_constituents(Constituents(chlorophyll_mg_m3=10.0), 0.01), [led(5)], BROAD, (0.5, 5.0), 6),
    "brown": (_constituents(Constituents(cdom_440_per_m=1.0, minerals_g_m3=3.0), 0.02), [led(2)], BROAD, (0.5, 4.0), 9),
    "laser-like": (
        PURE,
        [Spectrum(np.array([400.0, 528.0, 532.0, 536.0, 700.0]), np.array([0.0, 0.0, 1.0, 0.0, 0.0]))],
        BROAD,
        (1.0, 8.0),
        3,
    ),
}


def worst_and_rms(bands, water, lamps, response, distances, patches):
    """Relative errors by the nanometre, each case by itself."""
    errors = []
    for lamp, powers in zip(lamps, bands.lamps, strict=True):
        for patch in patches:
            for d in distances:
                exact = (response * per_watt(lamp) * patch.at() * np.exp(-water.c * d)) @ STEPS
                c = bands.a + bands.b_water + bands.b_particles
                found = bands.weights @ (powers * patch.at(bands.wavelength_nm) * np.exp(-c * d))
                errors.append(found / exact - 1.0)
    return np.abs(errors).max(axis=0), np.sqrt(np.mean(np.square(errors), axis=0))


@pytest.mark.parametrize("name", CASES)
def test_bands_keep_their_stated_error(name):
    """At distances between those that were judged: the error is smooth, 5 % more of it is room enough."""
    water, lamps, response, distances, count = CASES[name]
    bands = choose_bands(water, lamps, response, distances, count)
    assert len(bands.wavelength_nm) == count
    assert (bands.weights >= 0.0).all()
    paints = [Spectrum(GRID, curve) for curve in reflectance_of_rgb(PAINTS)]
    worst, rms = worst_and_rms(
        bands, water, lamps, response, np.linspace(*distances, 23), [*chart_reflectances().values(), *paints]
    )
    assert (worst <= 1.05 * bands.worst + 1e-9).all()
    np.testing.assert_allclose(rms, bands.rms, rtol=0.1, atol=1e-9)


def test_a_number_of_bands_is_as_good_as_what_auto_makes_of_as_many():
    water = _constituents(Constituents(chlorophyll_mg_m3=0.05), 0.0183)
    auto = choose_bands(water, [led(4)], NIKON, (1.0, 20.0), "auto", 0.02)
    number = choose_bands(water, [led(4)], NIKON, (1.0, 20.0), len(auto.wavelength_nm))
    assert number.rms.max() <= 1.01 * auto.rms.max()


@pytest.mark.parametrize(("kind", "lamp", "count"), [("7C", black_body(3200.0), 9), ("9C", led(4), 30)])
def test_a_fit_that_takes_many_steps_ends(kind, lamp, count):
    """In turbid water what a lamp sends over 20 m is nothing beside 1 m, and the fit takes more steps than usual."""
    bands = choose_bands(_jerlov(kind, 0.0183), [lamp], NIKON, (1.0, 20.0), count)
    assert len(bands.wavelength_nm) == count
    assert bands.rms.max() < 0.02


def test_more_bands_are_no_worse_and_auto_keeps_the_tolerance():
    water, lamps, response, distances, _ = CASES["Jerlov 1C"]
    few, more = (choose_bands(water, lamps, response, distances, n) for n in (3, 9))
    assert more.rms.max() < 0.5 * few.rms.max()
    auto = choose_bands(water, lamps, response, distances, "auto", 0.03)
    assert auto.rms.max() <= 0.03
    assert len(auto.wavelength_nm) % 3 == 0
    fewer = choose_bands(water, lamps, response, distances, len(auto.wavelength_nm) - 3)
    assert fewer.rms.max() > 0.03


@pytest.mark.parametrize("distance", [0.0, 1.0, 5.0, 20.0])
def test_beer_lambert_is_that_of_colour_science(distance):
    """Its own spectral distributions, interpolated to 1 nm linearly, multiplied and integrated by its trapezoids."""

    def distribution(values):
        return colour.SpectralDistribution(dict(zip(GRID, values, strict=True)))

    water, lamp = _jerlov("1C", 0.0183), led(4)
    theirs = (
        colour.SDS_ILLUMINANTS["LED-B4"]
        .copy()
        .interpolate(colour.SpectralShape(400, 700, 1), interpolator=colour.LinearInterpolator)
    )
    cameras = (
        colour.MSDS_CAMERA_SENSITIVITIES["Nikon 5100 (NPL)"]
        .copy()
        .interpolate(colour.SpectralShape(400, 700, 1), interpolator=colour.LinearInterpolator)
    )
    beam = distribution(np.exp(-water.c * distance))
    ours = (lamp.at() * NIKON * np.exp(-water.c * distance)) @ STEPS
    for k, channel in enumerate(cameras.to_sds()):
        seen = theirs * channel * beam
        assert ours[k] == pytest.approx(np.trapezoid(seen.values, seen.wavelengths), rel=1e-4)


def test_planck_is_that_of_colour_science():
    theirs = colour.sd_blackbody(3200.0, colour.SpectralShape(400, 700, 10)).values
    ours = black_body(3200.0).at(np.arange(400.0, 701.0, 10.0))
    np.testing.assert_allclose(ours / ours[16], theirs / theirs[16], rtol=1e-4)


def test_lumen_and_watt():
    """One watt of green light at 555 nm is 683 lm; of an LED about 300 lm within the visible."""
    green = Spectrum(np.array([400.0, 554.0, 555.0, 556.0, 700.0]), np.array([0.0, 0.0, 1.0, 0.0, 0.0]))
    assert watts_of_lumen(green, 683.0) == pytest.approx(1.0, rel=1e-4)
    sd = (
        colour.SDS_ILLUMINANTS["LED-B4"]
        .copy()
        .interpolate(colour.SpectralShape(400, 700, 1), interpolator=colour.LinearInterpolator)
    )
    seen = colour.luminous_flux(sd, colour.SDS_LEFS["CIE 1924 Photopic Standard Observer"])
    assert watts_of_lumen(led(4), seen) == pytest.approx(np.trapezoid(sd.values, sd.wavelengths), rel=1e-3)
    assert STEPS @ per_watt(led(4)) == pytest.approx(1.0)


@pytest.mark.filterwarnings("ignore:Aligning")
@pytest.mark.parametrize("rgb", [(0, 0, 0), (1, 1, 1), (0.5, 0.5, 0.5), (0.8, 0.2, 0.1), (0.1, 0.3, 0.9), (0, 1, 0)])
def test_colours_come_back_from_their_spectra(rgb):
    """Under D65, by colour-science; the curves are printed for 380 to 780 nm in steps of 5 nm."""
    nm = np.arange(380.0, 781.0, 5.0)
    spectrum = reflectance_of_rgb(rgb, nm)
    assert (spectrum >= 0.0).all()
    assert (spectrum <= 1.0 + 1e-12).all()
    xyz = (
        colour.sd_to_XYZ(
            colour.SpectralDistribution(dict(zip(nm, spectrum, strict=True))), illuminant=colour.SDS_ILLUMINANTS["D65"]
        )
        / 100.0
    )
    np.testing.assert_allclose(colour.XYZ_to_RGB(xyz, "sRGB"), rgb, atol=2e-3)
