"""The bodies of a block: their number, sizes and phase function, against quadrature."""

import re
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from varos_warp.errors import InputError
from varos_warp.scene.description.particles import Particles
from varos_warp.scene.file.load import scene_from_dict
from varos_warp.scene.water.particles import ParticleLaw, particle_laws
from varos_warp.scene.water.phase.lambert_sphere import LambertSphere
from varos_warp.scene.water.properties import optical_properties

SLOPES = [2.0, 2.7, 3.0, 3.6, 4.0, 5.5]
FOURNIER_FORAND = {"jerlov": {"type": "1C", "phase": {"kind": "fournier_forand", "n": 1.10, "mu": 3.5835}}}


def law_of(water=FOURNIER_FORAND, **block):
    scene = scene_from_dict(
        {
            "water": water,
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "vehicle": {"cameras": [{"id": "M0"}], "lights": [{}]},
        }
    )
    return ParticleLaw(Particles(**block), optical_properties(scene))


def over_radii(f, low, high):
    """Integral over radii, by quadrature in the logarithm."""
    return quad(lambda x: f(np.exp(x)) * np.exp(x), np.log(low), np.log(high), epsrel=1e-13, epsabs=0.0)[0]


@pytest.mark.parametrize("slope", SLOPES)
def test_bodies_carry_their_share_of_the_scattering(slope):
    """The sum of their projected areas is f max(b)."""
    law = law_of(slope=slope, share=0.004, radius_m=[1e-4, 4e-3])
    area = over_radii(lambda r: law.density * r**-slope * np.pi * r**2, 1e-4, 4e-3)
    np.testing.assert_allclose(area, 0.004 * law.water.sigma_s.max(), rtol=1e-10)
    np.testing.assert_allclose(law.extinction * law.albedo, law.sigma_s, rtol=1e-14)


@pytest.mark.parametrize("slope", SLOPES)
@pytest.mark.parametrize("above", [1e-4, 3.3e-4, 2e-3])
def test_number_of_bodies_above_a_radius(slope, above):
    law = law_of(slope=slope, radius_m=[1e-4, 4e-3])
    expected = over_radii(lambda r: law.density * r**-slope, above, 4e-3)
    np.testing.assert_allclose(law.number(above, 1.0), expected, rtol=1e-10)


@pytest.mark.parametrize("slope", SLOPES)
def test_the_drawn_share_is_that_of_the_areas_of_bodies_that_seem_large_enough(slope):
    """At distances where all, some and none are drawn."""
    law, least, fade = law_of(slope=slope, radius_m=[1e-4, 4e-3]), 1e-3, 0.5
    for t in (0.02, 0.08, 0.3, 1.0, 2.9, 3.99, 5.0):
        begin = least * t
        kinks = sorted({1e-4, *(float(np.clip(k, 1e-4, 4e-3)) for k in (begin, (1 + fade) * begin)), 4e-3})
        drawn = sum(
            over_radii(lambda r: r ** (2 - slope) * np.clip((r / (least * t) - 1) / fade, 0, 1), a, b)  # noqa: B023
            for a, b in pairwise(kinks)
        )
        whole = over_radii(lambda r: r ** (2 - slope), 1e-4, 4e-3)
        # a difference of two powers, divided by the fade, loses three digits of sixteen
        np.testing.assert_allclose(law.drawn(t, least, fade), drawn / whole, rtol=1e-10, atol=1e-12, err_msg=f"{t}")


# -------------------------------------------------------------------------------------------------- phase function


@pytest.mark.parametrize("opacity", [0.0, 0.3, 1.0])
def test_the_phase_function_integrates_to_1(opacity):
    phase = LambertSphere(opacity)
    total = 2 * np.pi * quad(lambda a: float(phase.density(np.sin(a / 2) ** 2)) * np.sin(a), 0, np.pi, epsrel=1e-12)[0]
    assert total == pytest.approx(1.0, abs=1e-10)


@pytest.mark.parametrize("degrees", [30.0, 90.0, 150.0, 180.0])
def test_it_is_that_of_a_sphere_whose_surface_scatters_after_lamberts_law(degrees):
    """The integral over the surface that is both lit and seen: cos_in cos_out / pi over the projected area pi."""
    angle = np.radians(degrees)
    nodes, weights = np.polynomial.legendre.leggauss(400)
    # longitude phi from the sun's meridian, in the plane of sun and eye; the eye is at the phase angle pi - angle
    eye = np.pi - angle
    low, high = eye - np.pi / 2, np.pi / 2
    phi, w = 0.5 * (low + high) + 0.5 * (high - low) * nodes, 0.5 * (high - low) * weights
    across = (np.cos(phi) * np.cos(phi - eye)) @ w
    along = quad(lambda x: np.cos(x) ** 3, -np.pi / 2, np.pi / 2, epsrel=1e-13)[0]
    expected = across * along / np.pi / np.pi
    assert float(LambertSphere().density(np.sin(angle / 2) ** 2)) == pytest.approx(expected, rel=1e-10)


def test_a_translucent_body_sends_the_rest_ahead():
    s = np.array([0.03, 0.4, 0.8])
    expected = 0.3 * LambertSphere().density(s) + 0.7 * LambertSphere().density(1.0 - s)
    np.testing.assert_allclose(LambertSphere(0.3).density(s), expected, rtol=1e-12)


def test_largest_share_in_fournier_forands_water():
    """Fournier and Forand's phase function at 180 degrees over the sphere's, 2 / (3 pi)."""
    law = law_of()
    assert law.largest_share == pytest.approx(0.01347, abs=5e-6)
    assert law.largest_share == pytest.approx(
        float(law.water.phase.eval_s(np.array([1.0]))[0]) / (2 / (3 * np.pi)), rel=1e-6
    )


def test_without_particles_there_are_no_laws():
    scene = scene_from_dict(
        {
            "water": FOURNIER_FORAND,
            "trajectory": {"poses": [{"position": [0, 0, 0]}]},
            "vehicle": {"cameras": [{"id": "M0"}], "lights": [{}]},
        }
    )
    assert particle_laws(scene) == []


def test_white_bodies_in_blue_water_are_bounded_by_the_channel_that_scatters_least():
    blue = {"coefficients": {"sigma_s": [0.002, 0.02, 0.04], "sigma_a": [0.1, 0.1, 0.1], "phase": {"g": 0.8}}}
    as_b, white = (law_of(water=blue, share=1e-4, **more) for more in ({}, {"reflectance": [1.0, 1.0, 1.0]}))
    np.testing.assert_allclose(white.sigma_s, 1e-4 * 0.04, rtol=1e-12)
    np.testing.assert_allclose(as_b.sigma_s, 1e-4 * np.array([0.002, 0.02, 0.04]), rtol=1e-12)
    assert white.extinction == as_b.extinction
    assert white.largest_share == pytest.approx(as_b.largest_share * 0.002 / 0.04, rel=1e-12)


def test_black_bodies_are_bounded_by_nothing_but_the_share():
    assert law_of(reflectance=[0.0, 0.0, 0.0], share=0.9).largest_share == 1.0


@pytest.mark.parametrize("opacity", [0.0, 0.3, 0.5, 1.0])
def test_the_limit_that_a_refusal_names_can_be_given(opacity):
    def laws(share):
        return particle_laws(
            scene_from_dict(
                {
                    "water": FOURNIER_FORAND,
                    "trajectory": {"poses": [{"position": [0, 0, 0]}]},
                    "particles": [{"share": share, "opacity": opacity}],
                    "vehicle": {"cameras": [{"id": "M0"}], "lights": [{}]},
                }
            )
        )

    with pytest.raises(InputError, match="at most") as refused:
        laws(0.5)
    named = float(re.search(r"at most ([\d.]+)", str(refused.value))[1])
    assert laws(named)[0].describe()["largest_share"] == named
