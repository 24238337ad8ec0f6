"""Phase functions of the kernels, the closed form and tables: values, normalisation, moments, and samples."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, rng_array, run, two_sided, uniform_p
from scipy.special import chdtrc, eval_legendre

from varos_warp.kernels.world import phase
from varos_warp.scene.water.phase.fournier_forand import FournierForand
from varos_warp.scene.water.phase.mixture import Mixture
from varos_warp.scene.water.phase.petzold import Petzold
from varos_warp.scene.water.phase.power_table import S_CUT
from varos_warp.scene.water.phase.rayleigh import Rayleigh

pytestmark = pytest.mark.subject("phase functions")

N = 1 << 17
HG = "Henyey and Greenstein (1941)"
ANISOTROPIES = [-0.99, -0.5, 0.0, 1e-4, 0.5, 0.8, 0.924, 0.99]
MOMENTS = [-0.95, -0.5, -0.1, 0.1, 0.5, 0.8, 0.924, 0.99]


@wp.kernel(enable_backward=False)
def evaluate(g: float, one_minus_cos: wp.array(dtype=float), pdf: wp.array(dtype=float)):
    i = wp.tid()
    hg = phase.Phase()
    hg.g = g
    pdf[i] = phase.phase_eval(hg, one_minus_cos[i])


@wp.kernel(enable_backward=False)
def sample(
    g: float,
    d: wp.vec3,
    u: wp.array(dtype=wp.vec2),
    one_minus_cos: wp.array(dtype=float),
    direction: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    hg = phase.Phase()
    hg.g = g
    one_minus_cos[i] = phase.phase_sample_one_minus_cos(hg, u[i][0])
    direction[i] = phase.phase_sample(hg, d, u[i][0], u[i][1])


def density(one_minus_cos, g):
    return run(evaluate, [float(g), np.asarray(one_minus_cos)], [float]).astype(float)


def samples(g, u, d=(0.0, 0.0, 1.0)):
    one_minus_cos, direction = run(sample, [float(g), wp.vec3(*d), u], [float, wp.vec3])
    return one_minus_cos.astype(float), direction.astype(float)


def distribution(x, g):
    """P(1 - cos(theta) <= x) in float64; the distribution below is 1 minus that of the notes."""
    x = np.asarray(x, float)
    if abs(g) < 1e-12:
        return x / 2
    return (1 + g) * (1 / (1 - g) - 1 / np.sqrt((1 - g) ** 2 + 2 * g * x)) * (1 - g) / (2 * g)


def test_the_density_has_the_known_values(truth):
    known = np.array([3.58098621957, 0.0136403924191, 0.0049121896016])
    for cosine, expected, got in zip((1, 0, -1), known, density([0.0, 1.0, 2.0], 0.8), strict=True):
        truth(
            f"p(cos = {cosine}) [1/sr], g = 0.8",
            source=HG,
            expected=expected,
            got=got,
            tolerance=1e-6 * expected,
            reason="float32 rounding",
        )


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_the_density_has_the_moments_g_to_the_l(truth, g):
    """Quadrature over the logarithm of 1 - cos, or of 1 + cos for g < 0, where the peak is; l = 0 is its integral."""
    edges, weights = np.polynomial.legendre.leggauss(100)
    s = 0.5 * (edges + 1) * np.log(2 / 1e-9) + np.log(1e-9)
    small = np.exp(s)
    x = small if g >= 0 else 2 - small
    # next to the peak of a negative g, 1 - cos = 2 is all that float32 sees: the integrand is known there
    p = np.where(small > 1e-5, density(x, g), (1 - g * g) / (4 * np.pi * ((1 - g) ** 2 + 2 * g * x) ** 1.5))
    w = 2 * np.pi * p * small * weights * 0.5 * np.log(2 / 1e-9)
    mu = 1 - x
    moments = [(w * eval_legendre(l, mu)).sum() for l in range(7)]
    # 1 - |g| is known to 6e-8/(1 - |g|); at g = -0.99 the peak is 5e-5 wide in a 1 - cos that is known to 1e-7
    truth(
        f"<P_l>, l = 0 to 6, of the density, g = {g}",
        source=HG + ": g^l",
        expected=float(g) ** np.arange(7),
        got=moments,
        tolerance=1e-3 if g < -0.9 else 2e-6 + 3 * 6e-8 / (1 - abs(g)),
        reason="float32 rounding of 1 - |g| and of 1 - cos",
    )


@pytest.mark.parametrize("g", MOMENTS)
def test_samples_have_the_moments_g_to_the_l(truth, g):
    mu = 1.0 - samples(g, rng_array(5, (8 * N, 2)))[0]
    P = np.array([eval_legendre(l, mu) for l in range(1, 7)])
    truth(
        f"<P_l>, l = 1 to 6, of samples, g = {g}",
        source=HG + ": g^l",
        expected=g ** np.arange(1, 7),
        got=P.mean(axis=1),
        stderr=P.std(axis=1) / np.sqrt(len(mu)),
        tolerance=1e-6,
        reason="float32 rounding of 1 - g",
    )


def test_samples_are_the_inverse_of_the_distribution(truth):
    """The notes count u from the back: cos(u) = -1 at 0."""
    u = np.array([0, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99])
    cosine = [-1, 0.4, 0.8, 0.944, 0.983673469388, 0.99488399762, 0.999549558608]
    x, _ = samples(0.8, np.column_stack([u, u * 0]))
    truth(
        "cos(u) at u = 0, .1, .25, .5, .75, .9, .99, g = 0.8",
        source=HG + ", inverse of the distribution",
        expected=cosine,
        got=1 - x,
        tolerance=3e-7,
        reason="float32 rounding",
    )
    np.testing.assert_allclose(x, 1 - np.array(cosine), rtol=1e-5)


@pytest.mark.parametrize(
    ("cosine", "share"), [(-0.5, 0.0190414899245), (0.0, 0.0506954821247), (0.5, 0.120495126515), (0.9, 0.378115294937)]
)
def test_the_share_of_light_scattered_beyond_an_angle(truth, cosine, share):
    x, _ = samples(0.8, rng_array(1, (N, 2)))
    hits = np.count_nonzero(1 - x <= cosine)
    truth(
        f"P(cos <= {cosine}), g = 0.8", source=HG, expected=share, got=hits / N, stderr=np.sqrt(share * (1 - share) / N)
    )
    np.testing.assert_allclose(1 - distribution(1 - cosine, 0.8), share, rtol=1e-9)


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_samples_follow_the_density(g):
    """Polar angle by the exact distribution, azimuth uniform; mean cosine g."""
    axis = np.array([0.48, -0.6, -0.64])
    x, d = samples(g, rng_array(2, (N, 2)), axis)
    np.testing.assert_allclose(np.linalg.norm(d, axis=1), 1.0, atol=5e-7)
    # the direction's own angle, from |d - axis|^2 / 2, which does not cancel
    np.testing.assert_allclose(0.5 * ((d - axis) ** 2).sum(axis=1), x, rtol=1e-3, atol=1e-6)
    e1 = np.cross(axis, [0, 0, 1]) / np.linalg.norm(np.cross(axis, [0, 0, 1]))
    azimuth = np.arctan2(d @ np.cross(axis, e1), d @ e1) / (2 * np.pi) % 1.0
    assert_plausible([uniform_p(np.clip(distribution(x, g), 0, 1)), uniform_p(azimuth)])
    assert_plausible(two_sided((1 - x.mean() - g) / x.std() * np.sqrt(N)))


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_samples_keep_their_digits_in_both_peaks(g):
    """Relative error of 1 - cos ahead, absolute error behind, against float64 for the same g and u."""
    u = rng_array(3, (N, 2))
    x, _ = samples(g, u)
    g32, v = float(np.float32(g)), u[:, 0].astype(float)
    b = 1 - g32 + 2 * g32 * v
    exact = 2 * (1 - v) * (1 + g32 * v) * (1 - g32) ** 2 / b**2
    # 1 - g is rounded once for all samples: 6e-8/(1 - |g|)
    np.testing.assert_allclose(x, exact, rtol=4e-7 + 4 * 6e-8 / (1 - abs(g)) * (abs(g) > 0.9))
    assert x.min() >= 0.0


def test_positive_g_scatters_forward():
    assert density([0.1], 0.8)[0] > 50 * density([1.9], 0.8)[0]
    assert samples(0.8, rng_array(4, (N, 2)), (0.0, 1.0, 0.0))[1].mean(axis=0)[1] > 0.79
    assert samples(-0.8, rng_array(4, (N, 2)), (0.0, 1.0, 0.0))[1].mean(axis=0)[1] < -0.79


# -------------------------------------------------------------------------------------------------------------- tables


TABLES = [
    FournierForand(1.10, 3.5835),
    FournierForand.from_backscatter_fraction(0.001),
    Rayleigh(),
    Petzold(),
    Mixture([(0.9, FournierForand(1.10, 3.5835)), (0.1, Rayleigh())]),
]
PER_ORDER = (1, 2, 8, 64)


@wp.kernel(enable_backward=False)
def evaluate_table(table: phase.Phase, one_minus_cos: wp.array(dtype=float), pdf: wp.array(dtype=float)):
    i = wp.tid()
    pdf[i] = phase.phase_eval(table, one_minus_cos[i])


@wp.kernel(enable_backward=False)
def sample_table(
    table: phase.Phase,
    d: wp.vec3,
    u: wp.array(dtype=wp.vec2),
    one_minus_cos: wp.array(dtype=float),
    direction: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    one_minus_cos[i] = phase.phase_sample_one_minus_cos(table, u[i][0])
    direction[i] = phase.phase_sample(table, d, u[i][0], u[i][1])


def table_samples(host, seed, n, d=(0.0, 0.0, 1.0)):
    """Of n samples (1 - cos)/2 and directions."""
    u = rng_array(seed, (n, 2))
    x, direction = run(sample_table, [host.device_record("cpu"), wp.vec3(*d), u], [float, wp.vec3])
    return 0.5 * x.astype(float), direction.astype(float)


@pytest.mark.parametrize("host", TABLES, ids=repr)
def test_a_table_on_the_device_has_the_host_s_values(host):
    """From 1e-4 to 180 degrees. A place in the table is known to 1e-3 of a bin, over which p changes by up to 2 %."""
    x = (2.0 * np.geomspace(1.001 * S_CUT, 1.0, N)).astype(np.float32)
    got = run(evaluate_table, [host.device_record("cpu"), x], [float]).astype(float)
    np.testing.assert_allclose(got, host.table.eval(0.5 * x.astype(float)), rtol=3e-5)


@pytest.mark.parametrize("host", [p for p in TABLES if not isinstance(p, Petzold)], ids=repr)
def test_the_device_has_the_values_of_the_formula(truth, host):
    x = (2.0 * np.geomspace(1.001 * S_CUT, 1.0, N)).astype(np.float32)
    expected = host.eval_s(0.5 * x.astype(float))
    truth(
        f"p from 1e-4 to 180 degrees over that of the formula, {host.kind}",
        source="the formula in float64",
        expected=1.0,
        got=run(evaluate_table, [host.device_record("cpu"), x], [float]) / expected,
        tolerance=2.5e-5,
        reason="float32 rounding of log s, and the table's 1e-5",
    )


@pytest.mark.parametrize("host", TABLES, ids=repr)
def test_samples_of_a_table_follow_its_distribution(host):
    """A million by the host's distribution, and in bins even in the angle's logarithm; azimuth even."""
    axis = np.array([0.48, -0.6, -0.64])
    s, d = table_samples(host, 6, 1_000_000, axis)
    assert s.min() >= 0.0
    edges = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 200)])
    counts, expected = np.histogram(s, edges)[0], np.diff(host.cdf(edges)) * len(s)
    full = expected > 25.0
    rest = [[counts[~full].sum()], [expected[~full].sum()]] if not full.all() else [[], []]
    counts, expected = (np.concatenate([x[full], more]) for x, more in zip((counts, expected), rest, strict=True))
    keep = expected > 0.0
    chi2 = ((counts - expected)[keep] ** 2 / expected[keep]).sum()
    e1 = np.cross(axis, [0, 0, 1]) / np.linalg.norm(np.cross(axis, [0, 0, 1]))
    azimuth = np.arctan2(d @ np.cross(axis, e1), d @ e1) / (2 * np.pi) % 1.0
    wide = s > 1e-10  # where a direction in float32 has an azimuth
    assert_plausible([chdtrc(keep.sum() - 1, chi2), uniform_p(np.clip(host.cdf(s), 0, 1)), uniform_p(azimuth[wide])])
    far = s > 1e-4
    np.testing.assert_allclose(0.25 * ((d[far] - axis) ** 2).sum(axis=1), s[far], rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("host", TABLES, ids=repr)
def test_samples_of_a_table_have_the_host_s_moments(truth, host):
    mu = 1.0 - 2.0 * table_samples(host, 7, 1_000_000)[0]
    P = np.array([eval_legendre(l, mu) for l in PER_ORDER])
    truth(
        f"<P_l>, l = 1, 2, 8, 64, of samples, {host.kind}, B = {host.backscatter_fraction:.3g}",
        source="quadrature of the formula in float64",
        expected=host.moments(64)[list(PER_ORDER)],
        got=P.mean(axis=1),
        stderr=P.std(axis=1) / np.sqrt(len(mu)),
    )


def test_samples_at_the_ends():
    record = TABLES[0].device_record("cpu")
    u = np.array([[0.0, 0.0], [1.0 - 2.0**-24, 0.5], [1.0, 0.0]], np.float32)
    x, d = run(sample_table, [record, wp.vec3(0.0, 0.0, 1.0), u], [float, wp.vec3])
    assert np.isfinite(d).all()
    assert x[0] == 0.0
    assert x[2] == pytest.approx(2.0, rel=1e-5)


def test_a_record_keeps_its_arrays_as_long_as_the_phase_function_lives():
    host = FournierForand(1.10, 3.5835)
    first, again = host.device_record("cpu"), host.device_record("cpu")
    assert first.log_p.ptr == again.log_p.ptr
    assert first.cdf.ptr == again.cdf.ptr


@pytest.mark.gpu
def test_a_table_has_the_same_values_on_cpu_and_gpu():
    """Their logarithms and exponentials differ in the last bits."""
    host, x = FournierForand(1.10, 3.5835), (2.0 * np.geomspace(1.001 * S_CUT, 1.0, N)).astype(np.float32)
    pdf = []
    for device in ("cpu", "cuda:0"):
        out = wp.empty(N, dtype=float, device=device)
        wp.launch(
            evaluate_table,
            N,
            [host.device_record(device), wp.array(x, dtype=float, device=device)],
            [out],
            device=device,
        )
        pdf.append(out.numpy())
    np.testing.assert_allclose(pdf[1], pdf[0], rtol=3e-5)
