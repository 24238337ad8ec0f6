"""Bodies of the cells of the water: how many, where, how large, and the same for whoever asks."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, two_sided, uniform_p
from scipy import stats

from varos_warp.kernels.particles import bodies
from varos_warp.kernels.particles.bodies import Cells

MEAN = 8.0
LOW, HIGH, SLOPE = 5e-4, 1.25e-3, 3.6


@wp.kernel(enable_backward=False)
def count_bodies(cells: Cells, counts: wp.array(dtype=int)):
    i = wp.tid()
    counts[i] = bodies.bodies_in_cell(cells, bodies.cell_of(cells, i))


@wp.kernel(enable_backward=False)
def list_bodies(
    cells: Cells,
    starts: wp.array(dtype=int),
    counts: wp.array(dtype=int),
    p: wp.array(dtype=wp.vec3),
    r: wp.array(dtype=float),
    u: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    at = bodies.cell_of(cells, i)
    for n in range(counts[i]):
        body = bodies.body_of(cells, at, n)
        p[starts[i] + n] = body.p
        r[starts[i] + n] = body.r
        u[starts[i] + n] = body.u


def cells_at(base=(5, 0, 7), size=(24, 24, 24), key=12345, corner=(0.0, 0.0, 0.0), slope=SLOPE):
    cells = Cells()
    cells.base, cells.size = wp.vec3ui(*(b & 0xFFFFFFFF for b in base)), wp.vec3i(*size)
    cells.corner, cells.side, cells.mean = wp.vec3(*corner), 1.0, MEAN
    cells.r_low, cells.r_high, cells.slope, cells.key = LOW, HIGH, slope, wp.uint32(key)
    return cells


def bodies_of(cells):
    """Counts by cell, and places, radii and numbers of all bodies in the order of the cells."""
    n = int(np.prod(cells.size))
    counts = wp.empty(n, dtype=int, device="cpu")
    wp.launch(count_bodies, n, [cells], [counts], device="cpu")
    total = counts.numpy()
    out = [wp.empty(int(total.sum()), dtype=kind, device="cpu") for kind in (wp.vec3, float, wp.vec4)]
    starts = wp.array((np.cumsum(total) - total).astype(np.int32), dtype=int, device="cpu")
    wp.launch(list_bodies, n, [cells, starts, counts], out, device="cpu")
    return total, *(array.numpy() for array in out)


@pytest.fixture(scope="module")
def many():
    """110 000 bodies."""
    return bodies_of(cells_at())


def test_counts_of_cells_follow_poissons_distribution(many):
    k = np.arange(1, 20)
    edges = np.concatenate([[-0.5], k + 0.5, [1e3]])  # 0 and 1 together, 20 and more together
    observed = np.histogram(many[0], edges)[0]
    expected = np.diff(np.concatenate([[0.0], stats.poisson.cdf(k, MEAN), [1.0]])) * len(many[0])
    assert_plausible(stats.chisquare(observed, expected * observed.sum() / expected.sum()).pvalue)


@pytest.mark.parametrize("slope", [2.0, 3.6, 6.0])
def test_radii_follow_the_power_law(slope):
    """Kolmogorov and Smirnov's test of 1e5 radii; float32 resolves 1e-7 of them, the test 4e-3."""
    _, _, r, _ = bodies_of(cells_at(slope=slope))
    assert len(r) > 1e5
    k = 1.0 - slope
    assert_plausible(stats.kstest(r, lambda x: (LOW**k - np.asarray(x, float) ** k) / (LOW**k - HIGH**k)).pvalue)
    assert r.min() >= np.float32(LOW)
    assert r.max() <= np.float32(HIGH)


def test_places_and_numbers_are_uniform_in_cells_and_independent_of_each_other(many):
    _, p, r, u = many
    inside, k = p - np.floor(p), 1.0 - SLOPE
    size = (LOW**k - np.float64(r) ** k) / (LOW**k - HIGH**k)
    columns = np.clip(np.column_stack([inside, size, u]), 0.0, 1.0)
    assert_plausible(
        [uniform_p(columns[:, i]) for i in range(8)]
        + [uniform_p(columns[:, [i, j]], 16) for i in range(8) for j in range(i)]
    )


def correlation_p(a, b):
    """p-value of the correlation of two samples; 0 of independent ones."""
    r = np.corrcoef(np.ravel(a), np.ravel(b))[0, 1]
    return two_sided(r * np.sqrt(np.size(a)))


def test_neighbouring_cells_and_other_classes_are_uncorrelated(many):
    counts = many[0].reshape(24, 24, 24)
    p = [correlation_p(np.delete(counts, 0, axis), np.delete(counts, -1, axis)) for axis in range(3)]
    for key in np.random.SeedSequence([1, 1, 0, 0x736E6F77]).generate_state(4):  # as render/particles draws them
        p.append(correlation_p(counts, bodies_of(cells_at(key=int(key)))[0]))
    first = np.cumsum(many[0]) - many[0]
    leading = many[1][first[many[0] > 0]]
    inside = leading - np.floor(leading)
    p += [correlation_p(inside[:-1, i], inside[1:, j]) for i in range(3) for j in range(3)]
    assert_plausible(p)


def test_bodies_are_the_same_for_whoever_asks():
    """Cells from another first cell on, as another camera asks for, and across the end of 32 bits."""
    for base in ((5, 0, 7), (-2, -3, -1)):
        counts, p, r, u = bodies_of(cells_at(base, (6, 6, 6)))
        part = bodies_of(cells_at(tuple(b + 2 for b in base), (3, 3, 3), corner=(2.0, 2.0, 2.0)))
        x, y, z = np.meshgrid(*[np.arange(2, 5)] * 3, indexing="ij")
        index = (x + 6 * y + 36 * z).transpose(2, 1, 0).ravel()
        assert np.array_equal(part[0], counts[index])
        starts = np.cumsum(counts) - counts
        rows = np.concatenate([np.arange(starts[i], starts[i] + counts[i]) for i in index])
        assert np.array_equal(part[2], r[rows])
        assert np.array_equal(part[3], u[rows])
        np.testing.assert_allclose(part[1], p[rows], atol=2e-6)  # a place in float32


def test_another_key_has_other_bodies(many):
    assert not np.array_equal(many[0], bodies_of(cells_at(key=99))[0])
