"""Rough diffuse reflection: energy, reciprocity, the closed form of its albedo, and directions from their density."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible
from kernels.world.test_bsdf import COUNT, NORMAL, evaluated, sampled, towards
from scipy import stats

from varos_warp.kernels.world import rough_diffuse as kernels
from varos_warp.kernels.world.texture import Bsdf

POLYNOMIAL = 1e-3
"""Stated error of the albedo's polynomial."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(400)
AZIMUTHS = (np.arange(256) + 0.5) / 256 * 2.0 * np.pi


@wp.kernel(enable_backward=False)
def albedo_kernel(
    roughness: float,
    reflectance: float,
    cosine: wp.array(dtype=float),
    once: wp.array(dtype=float),
    out: wp.array(dtype=float),
):
    i = wp.tid()
    once[i] = kernels.single_albedo(roughness, cosine[i])
    out[i] = kernels.rough_diffuse_albedo(wp.vec3(reflectance), roughness, cosine[i])[0]


def matte(roughness, reflectance=1.0):
    made = Bsdf()
    made.reflectance, made.diffuse_roughness = wp.vec3(reflectance), roughness
    return made


def hemisphere():
    """Directions above the surface, and their weights in an integral over the hemisphere."""
    cosine, azimuth = np.meshgrid(0.5 * (NODES + 1.0), AZIMUTHS, indexing="ij")
    weights = np.broadcast_to(0.5 * WEIGHTS[:, None], cosine.shape) * 2.0 * np.pi / len(AZIMUTHS)
    return towards(cosine.ravel(), azimuth.ravel()), weights.ravel()


LIGHT, SOLID_ANGLES = hemisphere()


def albedo(made, v):
    """Integral of the scattering function times the cosine over the directions of the light."""
    _, f = evaluated(made, v, LIGHT)
    return float(SOLID_ANGLES @ f[:, 0].astype(float))


def told(roughness, reflectance, cosine):
    """`single_albedo` and `rough_diffuse_albedo` of the kernels."""
    given = wp.array(np.atleast_1d(cosine), dtype=float, device="cpu")
    once, both = wp.zeros_like(given), wp.zeros_like(given)
    wp.launch(albedo_kernel, len(given), [roughness, reflectance, given], [once, both], device="cpu")
    return once.numpy(), both.numpy()


@pytest.mark.parametrize("roughness", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("cosine", [0.05, 0.3, 0.7, 1.0])
def test_a_white_surface_loses_no_light(roughness, cosine):
    assert albedo(matte(roughness), towards(cosine)) == pytest.approx(1.0, abs=POLYNOMIAL)


@pytest.mark.parametrize("reflectance", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("cosine", [0.05, 0.3, 0.7, 1.0])
def test_the_albedo_is_the_integral_over_the_light(reflectance, cosine):
    _, expected = told(0.8, reflectance, cosine)
    assert albedo(matte(0.8, reflectance), towards(cosine)) == pytest.approx(expected[0], abs=POLYNOMIAL)
    assert albedo(matte(0.8, reflectance), towards(cosine)) < reflectance * 1.15


@pytest.mark.parametrize("roughness", [0.2, 1.0])
def test_light_reflected_once_has_the_albedo_of_the_closed_form(roughness):
    """Portsmouth et al., equation for the albedo of Fujii's form: A + B / pi G(theta)."""
    cosine = np.linspace(0.02, 1.0, 50)
    sine, theta = np.sqrt(1.0 - cosine**2), np.arccos(cosine)
    G = sine * (theta - sine * cosine) + 2.0 / 3.0 * (sine / cosine * (1.0 - sine**3) - sine)
    A = 1.0 / (1.0 + roughness * (0.5 - 2.0 / (3.0 * np.pi)))
    once, _ = told(roughness, 1.0, cosine)
    np.testing.assert_allclose(once, A * (1.0 + roughness * G / np.pi), atol=POLYNOMIAL)


def test_light_and_viewer_may_change_places():
    rng = np.random.default_rng(3)
    v, l = (LIGHT[rng.integers(len(LIGHT) // 20, len(LIGHT), 2000)] for _ in range(2))
    forth, back = (evaluated(matte(0.7, 0.6), a, b)[1][:, 0] / (b @ NORMAL) for a, b in ((v, l), (l, v)))
    np.testing.assert_allclose(forth, back, rtol=2e-5)


def test_without_roughness_it_is_lamberts_law():
    _, f = evaluated(matte(0.0, 0.6), towards(0.4), LIGHT)
    np.testing.assert_allclose(f[:, 0], 0.6 / np.pi * (LIGHT @ NORMAL), rtol=1e-5, atol=1e-7)
    for least in (1e-6, 1e-8, 1e-30):
        _, nearly = evaluated(matte(least, 0.6), towards(0.4), LIGHT)
        np.testing.assert_allclose(nearly, f, rtol=1e-4, atol=1e-7)


def test_a_rim_lit_from_beside_the_viewer_is_as_bright_as_the_middle():
    """With Lambert's law it is a fifth; of facets of the greatest roughness the rim shows the lit ones."""
    v = np.array([towards(0.2), towards(1.0)])
    _, f = evaluated(matte(1.0, 0.2), v, v)
    assert 0.9 < f[0, 0] / f[1, 0] < 1.3
    _, f = evaluated(matte(0.0, 0.2), v, v)
    assert f[0, 0] / f[1, 0] == pytest.approx(0.2, rel=1e-4)


@pytest.mark.parametrize("cosine", [0.02, 0.15, 0.7])
def test_directions_are_drawn_from_their_density(cosine):
    """Chi-square over 16 x 16 cells of cosine and azimuth about the normal; their expectations by quadrature."""
    made = matte(1.0, 0.5)
    drawn, _, _ = sampled(made, cosine)
    pdf, _ = evaluated(made, towards(cosine), LIGHT)
    x = towards(0.0, 0.0)
    y = np.cross(NORMAL, x)

    def cells(l):
        column = np.floor((np.arctan2(l @ y, l @ x) / (2 * np.pi) + 0.5) * 16).astype(int) % 16
        return 16 * np.clip(l @ NORMAL * 16, 0, 15).astype(int) + column

    expected = np.bincount(cells(LIGHT), SOLID_ANGLES * pdf.astype(float), 256) * COUNT
    assert expected.sum() == pytest.approx(COUNT, rel=1e-5)
    counts = np.bincount(cells(drawn), minlength=256)
    assert_plausible(stats.chi2.sf(((counts - expected) ** 2 / expected).sum(), 255))


@pytest.mark.parametrize("cosine", [0.001, 0.05, 0.5, 1.0])
def test_weights_have_a_bound_and_the_mean_of_the_albedo(cosine):
    """Seen at grazing angles, directions by the cosine alone had weights up to the inverse of the viewer's cosine."""
    _, pdf, f = sampled(matte(1.0, 0.9), cosine)
    weights = f[:, 0].astype(float) / pdf
    assert weights.max() < 4.0
    expected = albedo(matte(1.0, 0.9), towards(cosine))
    assert weights.mean() == pytest.approx(expected, abs=4.0 * weights.std() / np.sqrt(COUNT) + POLYNOMIAL)
