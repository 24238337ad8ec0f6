"""Owen-scrambled Sobol points: nets of every size, each point uniform, pairs independent, errors as theory says."""

import numpy as np
import pytest
import warp as wp
from chance import assert_plausible, run, two_sided, uniform_p
from scipy import stats
from scipy.stats import qmc

from varos_warp.kernels import sobol

LAST = 2**31 - 1
N = 1 << 17
WHERE = [(0, 0, 0), (1, 0, 0), (7, 921_599, 3), (2**32 - 1, LAST, 5), (12345, 640, LAST - 1)]
"""Keys, pixels and pairs whose sequences are taken apart."""


@wp.kernel(enable_backward=False)
def draw(
    key: wp.array(dtype=wp.uint32),
    pixel: wp.array(dtype=int),
    sample: wp.array(dtype=int),
    pair: wp.array(dtype=int),
    out2: wp.array(dtype=wp.vec2),
    out4: wp.array(dtype=wp.vec4),
):
    i = wp.tid()
    out2[i] = sobol.sobol2(key[i], pixel[i], sample[i], pair[i])
    out4[i] = sobol.sobol4(key[i], pixel[i], sample[i], pair[i])


@wp.kernel(enable_backward=False)
def words(
    x: wp.array(dtype=wp.uint32),
    seed: wp.array(dtype=wp.uint32),
    reverse: wp.array(dtype=wp.uint32),
    dimension_1: wp.array(dtype=wp.uint32),
    scrambled: wp.array(dtype=wp.uint32),
):
    i = wp.tid()
    reverse[i] = sobol.reverse_bits(x[i])
    dimension_1[i] = sobol.reverse_bits(sobol.sobol_dimension_1(x[i]))
    scrambled[i] = sobol.owen_scramble(x[i], seed[i])


def both(key=7, pixel=3, sample=5, pair=1):
    """Points [n, 2] of sobol2 and [n, 4] of sobol4; the arguments are broadcast and may be arrays."""
    key, pixel, sample, pair = (a.ravel() for a in np.broadcast_arrays(key, pixel, sample, pair))
    return run(draw, [key.astype(np.uint32)] + [a.astype(np.int32) for a in (pixel, sample, pair)], [wp.vec2, wp.vec4])


def points(**arguments):
    """Points [n, 4] of sobol4 in float64."""
    return both(**arguments)[1].astype(float)


def sequences(count, n, first=0):
    """The first n points of ``count`` pixels [count, n, 4]."""
    pixel, sample = np.arange(count)[:, None], first + np.arange(n)
    return points(pixel=pixel, sample=sample).reshape(count, n, 4)


# ------------------------------------------------------------------------------------------------------ building blocks


def random_words(n, seed=1):
    return np.random.default_rng(seed).integers(0, 2**32, n, dtype=np.uint32)


def test_the_unscrambled_sequence_is_that_of_sobol():
    """SciPy takes the points in the order of the Gray code."""
    i = np.arange(1 << 12, dtype=np.uint32)
    gray = i ^ (i >> np.uint32(1))
    x, y, _ = run(words, [gray, gray], [wp.uint32] * 3)
    theirs = qmc.Sobol(2, scramble=False, bits=32).random(len(i))
    assert np.array_equal(np.column_stack([x, y]) / 2.0**32, theirs)


def test_dimension_1_is_the_pascal_matrix_for_all_bits():
    """Columns of the matrix beyond the indices that fit into a test: C(k, j) is odd where j is a subset of k."""
    k = np.arange(32)
    columns = run(words, [np.uint32(1) << k.astype(np.uint32)] * 2, [wp.uint32] * 3)[1]
    digits = columns[:, None] >> (31 - k).astype(np.uint32) & 1
    assert np.array_equal(digits, (k[:, None] & k) == k)


def test_a_bit_of_a_scrambled_word_depends_on_the_bits_up_to_it_alone():
    """That is what keeps nets nets: a flipped bit flips the same bit of the result and none below."""
    x, seed = random_words(1 << 14), random_words(1 << 14, 2)
    before = run(words, [x, seed], [wp.uint32] * 3)[2]
    for bit in range(32):
        flip = np.uint32(1 << bit)
        change = run(words, [x ^ flip, seed], [wp.uint32] * 3)[2] ^ before
        assert np.all(change & np.uint32((2 << bit) - 1 & 0xFFFFFFFF) == flip)


def test_four_numbers_are_the_points_of_two_pairs():
    sample = np.arange(1000)
    two, four = both(sample=sample, pair=4)
    assert np.array_equal(four, np.hstack([two, both(sample=sample, pair=5)[0]]))


# ----------------------------------------------------------------------------------------------------------------- nets


def assert_nets(block, m):
    """Every aligned 2^m points of [n, 2] hit every elementary interval of area 2^-m once."""
    digits = np.round(block * 2**24).astype(np.int64)
    for a in range(m + 1):
        cell = (digits[:, 0] >> (24 - a) << (m - a)) + (digits[:, 1] >> (24 - m + a))
        assert np.all(np.sort(cell.reshape(-1, 1 << m), axis=1) == np.arange(1 << m)), f"2^{a} x 2^{m - a} intervals"


@pytest.mark.parametrize("first", [0, 1 << 16, 5 << 16, 1 << 24, (1 << 30) + (3 << 12), LAST - (1 << 12) + 1])
def test_every_aligned_block_of_samples_is_a_net(first):
    """2^m points, m = 0..10: in the beginning, beyond 2^16 samples and up to the last index there is."""
    for key, pixel, pair in WHERE:
        block = points(key=key, pixel=pixel, pair=pair, sample=first + np.arange(1 << 12))
        for m in range(11):
            assert_nets(block[:, :2], m)
            assert_nets(block[:, 2:], m)


def test_each_dimension_visits_every_stratum_once():
    """2^m strata of the line, m up to 18: prefixes, and the last 2^18 indices."""
    for first in (0, LAST - (1 << 18) + 1):
        u = points(sample=first + np.arange(1 << 18))
        for m in range(0, 19, 3):
            stratum = np.floor(u[: 1 << m] * 2**m).astype(int)
            assert np.all(np.sort(stratum, axis=0) == np.arange(1 << m)[:, None])


def test_large_blocks_beyond_the_first_are_nets():
    block = points(sample=(1 << 16) + np.arange(1 << 16))
    for m in (12, 14, 16):
        assert_nets(block[:, :2], m)


def test_points_lie_in_the_half_open_unit_square():
    """With 24 bits, whatever the arguments, so that float32 holds them exactly and none becomes 1."""
    key, pixel, sample, pair = (random_words(1 << 20, seed) for seed in range(3, 7))
    u = np.vstack(
        [
            points(key=key, pixel=pixel >> 1, sample=sample >> 1, pair=pair >> 1),
            points(sample=LAST - np.arange(1000)),
            points(sample=np.arange(1 << 20)),
        ]
    )
    assert u.min() >= 0.0
    assert u.max() < 1.0
    assert np.array_equal(np.round(u * 2**24), u * 2**24)


def test_all_bits_of_the_arguments_count():
    bits = np.append(2 ** np.arange(31), 0)
    for name in ("key", "pixel", "sample", "pair"):
        assert len(np.unique(points(**{name: bits}), axis=0)) == 32


# ----------------------------------------------------------------------------------------------------------- uniformity

COUNT = np.arange(N)
STREAMS = {
    "keys": {"key": COUNT},
    "pixels": {"pixel": COUNT},
    "pairs": {"pair": 2 * COUNT},
    "a column of a 1280 pixel wide image": {"pixel": 1280 * (COUNT % 720), "key": COUNT // 720},
}


@pytest.mark.parametrize("sample", [0, 1, 2, 3, 63, 1023, 65537, LAST])
@pytest.mark.parametrize("stream", STREAMS)
def test_every_sample_is_uniform_over_independent_sequences(stream, sample):
    u = points(sample=sample, **STREAMS[stream])
    squares = [(a, b) for a in range(4) for b in range(a)]
    assert_plausible([uniform_p(u[:, c], 256) for c in range(4)] + [uniform_p(u[:, c], 32) for c in squares])


@pytest.mark.parametrize("lag", [1, 2, 64])
def test_sequences_of_neighbours_are_independent(lag):
    """Equal samples of neighbouring keys, pixels and pairs fill the square and the cube, in and across dimensions."""
    p_values = []
    for stream in STREAMS.values():
        u = points(sample=9, **stream)
        a, b = u[:-lag], u[lag:]
        p_values += [uniform_p(np.column_stack([a[:, i], b[:, j]]), 32) for i in range(4) for j in range(4)]
        p_values += [uniform_p(np.column_stack([a[:, :2], b[:, 1]]), 16)]
    assert_plausible(p_values)


def in_disk(u):
    return (u[..., 0] ** 2 + u[..., 1] ** 2 < 1.0) - np.pi / 4


def below_diagonal(u):
    return (u[..., 0] < u[..., 1]) - 0.5


def in_corner_of_four(u):
    return (u < 0.7).all(axis=-1) - 0.7**4


def in_ball_of_four(u):
    return ((u**2).sum(axis=-1) < 1.0) - np.pi**2 / 32


@pytest.mark.parametrize("f", [in_disk, below_diagonal, in_corner_of_four, in_ball_of_four])
def test_estimates_of_discontinuous_integrals_are_unbiased(f):
    """For any number of samples, also those that are no power of two; the errors of 8192 sequences are independent."""
    values = f(sequences(8192, 64))
    assert_plausible([stats.ttest_1samp(values[:, :n].mean(axis=1), 0.0).pvalue for n in (1, 2, 3, 4, 7, 16, 33, 64)])


# --------------------------------------------------------------------------------------------------------------- errors


def variance_z(errors, variance, excess=0.0):
    """Standard scores of the mean square of errors [count, ...] against a variance; the excess is the kurtosis'."""
    return ((errors**2).mean(axis=0) / variance - 1.0) * np.sqrt(len(errors) / (2.0 + excess))


def test_the_mean_of_a_dimension_has_the_variance_of_independent_strata():
    """1/(12 N^3): a digital shift, 1/(12 N^2), keeps every net but not this: that takes nested scrambles."""
    u = sequences(8192, 256) - 0.5
    z = [variance_z(u[:, :n].mean(axis=1), 1 / (12 * n**3), excess=-1.2 / n) for n in 2 ** np.arange(9)]
    assert_plausible(two_sided(np.array(z)))


def haar(u, level):
    """Sum of the Haar waves of a level on [0, 1): +-1."""
    return 1.0 - 2.0 * (np.floor(u * 2 ** (level + 1)) % 2)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_two_dimensions_of_a_pair_are_scrambled_independently(level):
    """Haar waves of level l in both dimensions have 1, 2 and 0 times the variance of random points (Owen 1997, t = 0).

    The factor is 1 for up to 4^l points: they share no interval of l digits in both dimensions. With 2 * 4^l points two
    share one, in opposite quarters; with more, each quarter is hit equally often. Equal scrambles would repeat flips.
    """
    u = sequences(1 << 14, 4 * 4**level)
    product = haar(u[:, :, 0], level) * haar(u[:, :, 1], level)
    p_values = []
    for n in 2 ** np.arange(1, 2 * level + 2):
        mean = product[:, :n].mean(axis=1)
        variance = (1 if n <= 4**level else 2) / n
        p_values += [stats.ttest_1samp(mean, 0.0).pvalue, stats.ttest_1samp(mean**2, variance).pvalue]
    assert_plausible(p_values)
    assert not product.mean(axis=1).any()


@pytest.mark.parametrize("n", [4, 16, 64, 256])
def test_padded_pairs_are_shuffled_independently(n):
    """Mean products of dimensions of different pairs are 0 on average, and their variance is that of nested shuffles.

    Haar waves of one level l in both dimensions meet with the variance 1 + 2^-l times that of random points, all others
    with that of random points (a block of 2^(l+1) samples has 2^l flips of its own); a linear function has the share
    3/4^(l+1) of its variance in level l. Digits beyond log2 n see random points, too.
    """
    u = sequences(16384, n) - 0.5
    levels = np.arange(np.log2(n))
    gain = 1 + ((3 / 4 ** (levels + 1)) ** 2 * 2**-levels).sum()
    p_values = []
    for a, b in [(0, 2), (0, 3), (1, 2), (1, 3)]:
        product = (u[:, :, a] * u[:, :, b]).mean(axis=1)
        z = product / np.sqrt(gain / 144 / n)
        p_values += [two_sided(z.mean() * np.sqrt(len(z))), two_sided(variance_z(z, 1.0, stats.kurtosis(z)))]
    assert_plausible(p_values)


@pytest.mark.parametrize("other", [{"pixel": 4}, {"key": 8}, {"pair": 2}])
def test_the_order_of_samples_differs_between_sequences(other):
    """Which quarter of the square a sample of one sequence visits says nothing about that of another one."""

    def quarters(**arguments):
        u = points(sample=np.arange(1 << 12), **arguments)
        return (2 * (u[:, 0] >= 0.5) + (u[:, 1] >= 0.5)).astype(int)

    table = np.histogram2d(quarters(), quarters(**other), 4)[0]
    # nested orders have up to twice the variance of random ones, hence half the statistic
    assert_plausible(stats.chi2.sf(((table - 256) ** 2 / 256).sum() / 2, 9))


def smooth(u):
    """Product of exp(x) over dimensions, less its integral."""
    return np.exp(u.sum(axis=-1)) - (np.e - 1) ** u.shape[-1]


def rms(values, n):
    return np.sqrt((values[:, :n].mean(axis=1) ** 2).mean())


@pytest.mark.parametrize("dimensions", [(0, 1), (2, 3)])
def test_errors_of_smooth_integrals_fall_as_the_power_three_halves(dimensions):
    """N^-1.5 up to a power of log N (Owen 1997) that flattens the fit; random points fall as N^-0.5."""
    values = smooth(sequences(512, 1024)[..., dimensions])
    n = 2 ** np.arange(2, 11)
    slope = np.polyfit(np.log(n), np.log([rms(values, k) for k in n]), 1)[0]
    assert -1.6 < slope < -1.3


def test_padded_pairs_beat_random_points_in_four_dimensions():
    """What the two pairs add up to is stratified; what they do together has at most twice its random variance."""
    values = smooth(sequences(512, 1024))
    pair = ((np.e**2 - 1) / 2) ** 2 - (np.e - 1) ** 4
    sigma = np.sqrt(((np.e**2 - 1) / 2) ** 4 - (np.e - 1) ** 8)
    ratio = np.array([rms(values, n) * np.sqrt(n) / sigma for n in 2 ** np.arange(2, 11)])
    assert np.all(ratio < 0.5)
    assert np.all(ratio[2:] < np.sqrt(2) * pair / sigma)
