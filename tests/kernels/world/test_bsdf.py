"""The metal's lobe: normalisation, orientation, reciprocity of the bare lobe, and energy (white furnace)."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, rng_array, run, two_sided
from scipy import stats

from varos_warp.kernels.world import bsdf as kernels
from varos_warp.kernels.world.texture import Bsdf
from varos_warp.scene.materials.lobe import lobe_albedo_table

NORMAL = np.array([0.36, -0.48, 0.8])
COUNT = 200_000


@wp.kernel(enable_backward=False)
def sample_kernel(
    table: wp.array2d(dtype=float),
    bsdf: Bsdf,
    n: wp.vec3,
    v: wp.vec3,
    u: wp.array(dtype=wp.vec3),
    # out
    direction: wp.array(dtype=wp.vec3),
    pdf: wp.array(dtype=float),
    f: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    l = kernels.bsdf_sample(bsdf, n, v, u[i][0], u[i][1], u[i][2])
    direction[i] = l
    pdf[i] = kernels.bsdf_pdf(bsdf, n, v, l)
    f[i] = kernels.bsdf_eval(table, bsdf, n, v, l)


@wp.kernel(enable_backward=False)
def eval_kernel(
    table: wp.array2d(dtype=float),
    bsdf: Bsdf,
    n: wp.vec3,
    v: wp.array(dtype=wp.vec3),
    l: wp.array(dtype=wp.vec3),
    # out
    pdf: wp.array(dtype=float),
    f: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    pdf[i] = kernels.bsdf_pdf(bsdf, n, v[i], l[i])
    f[i] = kernels.bsdf_eval(table, bsdf, n, v[i], l[i])


@wp.kernel(enable_backward=False)
def albedo_kernel(
    table: wp.array2d(dtype=float),
    bsdf: Bsdf,
    n: wp.vec3,
    v: wp.array(dtype=wp.vec3),
    # out
    albedo: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    albedo[i] = kernels.directional_albedo(table, bsdf, n, v[i])


def table():
    return wp.array(lobe_albedo_table(), dtype=float, device="cpu")


def metal(roughness, base=1.0, share=1.0, diffuse=0.0):
    """A surface of ``share`` bare metal, the rest diffuse."""
    made = Bsdf()
    made.specular, made.metal, made.roughness = wp.vec3(base * share), share, roughness
    made.reflectance = wp.vec3((1.0 - share) * diffuse)
    return made


def towards(cosine, azimuth=0.4):
    """Unit vector at an angle to NORMAL."""
    x = np.cross(NORMAL, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    y, sine = np.cross(NORMAL, x), np.sqrt(1.0 - np.square(cosine))
    return (
        np.multiply.outer(sine * np.cos(azimuth), x)
        + np.multiply.outer(sine * np.sin(azimuth), y)
        + np.multiply.outer(cosine, NORMAL)
    )


def sampled(made, cosine, count=COUNT, seed=1):
    v = wp.vec3(*towards(cosine))
    return run(
        sample_kernel, [table(), made, wp.vec3(*NORMAL), v, rng_array(seed, (count, 3))], [wp.vec3, float, wp.vec3]
    )


def sphere(count=400_000, seed=2):
    """Directions spread evenly over the sphere."""
    l = np.random.default_rng(seed).normal(size=(count, 3))
    return l / np.linalg.norm(l, axis=1, keepdims=True)


def evaluated(made, v, l):
    v = np.broadcast_to(v, l.shape).copy()
    return run(eval_kernel, [table(), made, wp.vec3(*NORMAL), v, l], [float, wp.vec3])


@pytest.mark.parametrize("roughness", [0.4, 0.7, 1.0])
@pytest.mark.parametrize("cosine", [0.1, 0.6, 1.0])
def test_the_density_of_directions_integrates_to_one(roughness, cosine):
    pdf, _ = evaluated(metal(roughness), towards(cosine), sphere())
    values = 4 * np.pi * pdf.astype(float)
    assert values.mean() == pytest.approx(1.0, abs=4 * values.std() / np.sqrt(len(values)) + 1e-6)
    assert values.std() / np.sqrt(len(values)) < 0.02


@pytest.mark.parametrize(("roughness", "share"), [(0.5, 1.0), (1.0, 1.0), (0.6, 0.5)])
@pytest.mark.parametrize("cosine", [0.15, 0.7])
def test_directions_are_drawn_from_their_density(roughness, share, cosine):
    """Chi-square over 8 x 16 cells of cosine and azimuth about the normal; those under the surface are one cell."""
    made = metal(roughness, share=share, diffuse=0.8)
    drawn, _, _ = sampled(made, cosine)
    even = sphere(2_000_000)
    pdf, _ = evaluated(made, towards(cosine), even)

    def cells(l):
        azimuth = np.arctan2(l @ np.cross(NORMAL, towards(1.0, 0.0) + [0.0, 1.0, 0.0]), l @ [0.0, 1.0, 0.0])
        column = np.clip((azimuth / (2 * np.pi) + 0.5) * 16, 0, 15).astype(int)
        up = l @ NORMAL
        return np.where(up > 0, 16 * np.clip(up * 8, 0, 7).astype(int) + column, 128)

    weights = 4 * np.pi * pdf.astype(float) / len(even)
    expected = np.bincount(cells(even), weights, 129) * COUNT
    spread = np.bincount(cells(even), weights**2, 129) * COUNT**2
    counts = np.bincount(cells(drawn), minlength=129)
    used = expected > 20
    statistic = ((counts - expected) ** 2 / (expected + spread))[used].sum()
    assert_plausible(stats.chi2.sf(statistic, used.sum()))


def test_the_lobe_is_around_the_mirror_direction():
    """Not around the viewer, nor around the light's way on."""
    v = towards(0.6)
    mirror = 2 * (NORMAL @ v) * NORMAL - v
    drawn, _, f = sampled(metal(0.2), 0.6)
    assert drawn.mean(axis=0) @ mirror > 0.95
    _, at = evaluated(metal(0.2), v, np.array([mirror, v, -mirror]))
    assert at[0, 0] > 100 * at[1, 0]
    assert at[2, 0] == 0.0
    assert np.isfinite(f).all()


@pytest.mark.parametrize("roughness", [0.0, 0.15, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("cosine", [0.05, 0.3, 0.7, 1.0])
def test_a_white_metal_loses_nothing(roughness, cosine):
    """White furnace: the mean of f/pdf is 1, to the table's 0.6 % (see lobe_albedo_table) and the standard error."""
    _, pdf, f = sampled(metal(roughness), cosine)
    weight = np.where(f[:, 0] > 0, f[:, 0] / np.maximum(pdf, 1e-30), 0.0).astype(float)
    error = weight.std() / np.sqrt(COUNT)
    assert weight.mean() == pytest.approx(1.0, abs=0.006 + 4 * error)
    assert error < 0.004


@pytest.mark.parametrize("base", [0.1, 0.5, 0.9])
def test_a_coloured_metal_reflects_no_more_than_white(base):
    """And more than F0 E, what single reflections without Fresnel's rise would."""
    for roughness in (0.2, 0.6, 1.0):
        _, pdf, f = sampled(metal(roughness, base), 0.5)
        albedo = np.where(f[:, 0] > 0, f[:, 0] / np.maximum(pdf, 1e-30), 0.0).mean()
        single = base * np.interp(np.sqrt(0.5), np.linspace(0, 1, 32), lobe_albedo_table()[round(31 * roughness)])
        assert single < albedo < 1.0


@pytest.mark.parametrize("cosine", [0.0, -0.02, -0.3, -0.9])
def test_a_smoothed_normal_that_faces_away_makes_no_light(cosine):
    """At the rim of a smooth object: what is drawn weighs no more than what a viewer in its plane sees."""
    for roughness in (0.1, 0.4, 1.0):
        _, pdf, f = sampled(metal(roughness), cosine)
        weight = np.where(f[:, 0] > 0, f[:, 0] / np.maximum(pdf, 1e-30), 0.0).astype(float)
        assert weight.max() < 1.1
        assert weight.mean() == pytest.approx(1.0, abs=0.006 + 4 * weight.std() / np.sqrt(COUNT))


def test_the_table_has_the_closed_form_of_the_roughest_lobe_seen_from_above():
    """For alpha = 1 and v = n microfacets point everywhere alike, G2/G1 = 2 c/(1 + c), and E = 1 - ln 2."""
    assert lobe_albedo_table()[-1, -1] == pytest.approx(1.0 - np.log(2.0), abs=2e-4)


def test_the_bare_lobe_is_reciprocal():
    """f(v, l) = f(l, v) once the cosine of the light and the factor for repeated reflections are taken out."""
    v, l = towards(np.linspace(0.1, 0.9, 50)), towards(np.linspace(0.8, 0.2, 50), 2.5)
    made = metal(0.6, base=1e-4)  # a dark metal has no repeated reflections to speak of, but Fresnel's rise
    there, back = (evaluated(made, a, b)[1][:, 0] / (b @ NORMAL) for a, b in ((v, l), (l, v)))
    np.testing.assert_allclose(there, back, rtol=2e-3)


def test_patches_of_metal_keep_the_energy_of_both_parts():
    """Half white metal, half white paint: nothing is lost either."""
    _, pdf, f = sampled(metal(0.4, share=0.5, diffuse=1.0), 0.6)
    weight = np.where(f[:, 0] > 0, f[:, 0] / np.maximum(pdf, 1e-30), 0.0).astype(float)
    z = (weight.mean() - 1.0) / (weight.std() / np.sqrt(COUNT))
    assert abs(weight.mean() - 1.0) < 0.003 or two_sided(z) > 0.01


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("base", [0.0, 0.02, 0.3, 0.9, 1.0])
def test_the_albedo_of_a_direction_is_near_what_the_lobe_reflects(roughness, base):
    """As the fit is, whose largest error is 0.06; it is never so small that what is divided by it grows."""
    for cosine in (0.05, 0.2, 0.5, 0.8, 1.0):
        made = metal(roughness, base)
        _, pdf, f = sampled(made, cosine)
        real = np.where(f[:, 0] > 0, f[:, 0] / np.maximum(pdf, 1e-30), 0.0).mean()
        v = towards(np.array([cosine]))
        albedo = run(albedo_kernel, [table(), made, wp.vec3(*NORMAL), v], [wp.vec3])
        assert albedo[0, 0] == pytest.approx(real, abs=0.08)
        assert real < 2.0 * albedo[0, 0] + 1e-3


def test_lobes_of_black_metal_are_drawn():
    """By the cosine alone samples at grazing angles weigh up to a hundred."""
    _, pdf, f = sampled(metal(0.3, 0.0), 0.1)
    weight = np.where(pdf > 0, f[:, 0] / np.maximum(pdf, 1e-30), 0.0)
    assert weight.max() < 1.5
