"""Owen-scrambled Sobol points: they fill the unit square evenly, for the few dimensions that matter most.

Pairs of dimensions are padded (Pharr, Jakob and Humphreys 2023, "Physically Based Rendering", section 8.7.2): each pair
is the same (0,2)-sequence, scrambled and shuffled separately, so that pairs are independent of each other.
Scrambling by hashing follows Laine and Karras 2011 ("Stratified Sampling for Stochastic Transparency") and Burley 2020
("Practical Hash-based Owen Scrambling", JCGT 9(4)). Digits are stored *reversed* in a word, the first digit after the
point in the lowest bit: the hash needs them so, and the index of a Sobol point is then its dimension 0.
"""

import warp as wp

from varos_warp.kernels.sampling import pcg4d, to_unit

wp.set_module_options({"enable_backward": False})


@wp.func
def reverse_bits(x: wp.uint32):
    """The word with its bits reversed."""
    x = ((x >> wp.uint32(1)) & wp.uint32(0x55555555)) | ((x & wp.uint32(0x55555555)) << wp.uint32(1))
    x = ((x >> wp.uint32(2)) & wp.uint32(0x33333333)) | ((x & wp.uint32(0x33333333)) << wp.uint32(2))
    x = ((x >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F)) | ((x & wp.uint32(0x0F0F0F0F)) << wp.uint32(4))
    x = ((x >> wp.uint32(8)) & wp.uint32(0x00FF00FF)) | ((x & wp.uint32(0x00FF00FF)) << wp.uint32(8))
    return (x >> wp.uint32(16)) | (x << wp.uint32(16))


@wp.func
def owen_scramble(x: wp.uint32, seed: wp.uint32):
    """Nested uniform scramble of reversed digits: each bit is flipped by a hash of the bits below it and ``seed``.

    The constants are those of Vegdahl 2021 ("Building a Better LK Hash"); ``seed`` must itself be a hash.
    """
    x = x ^ (x * wp.uint32(0x3D20ADEA))
    x = (x + seed) * ((seed >> wp.uint32(16)) | wp.uint32(1))
    x = x ^ (x * wp.uint32(0x05526C56))
    return x ^ (x * wp.uint32(0x53A22864))


@wp.func
def sobol_dimension_1(index: wp.uint32):
    """Reversed digits of dimension 1 of Sobol point ``index``; those of dimension 0 are ``index`` itself.

    Digit j is the sum of C(k, j) index_k mod 2 (Pascal's matrix). C(k, j) is odd where the bits of j are among those of
    k (Lucas), and a sum over supersets takes one step for each bit of j.
    """
    x = index ^ ((index >> wp.uint32(1)) & wp.uint32(0x55555555))
    x = x ^ ((x >> wp.uint32(2)) & wp.uint32(0x33333333))
    x = x ^ ((x >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F))
    x = x ^ ((x >> wp.uint32(8)) & wp.uint32(0x00FF00FF))
    return x ^ (x >> wp.uint32(16))


@wp.func
def scrambled_point(reversed_sample: wp.uint32, shuffle: wp.uint32, seed_0: wp.uint32, seed_1: wp.uint32):
    """Point of the (0,2)-sequence under three independent seeds; the sample's bits are given in reverse order.

    The order is scrambled like the digits: every aligned block of 2^m samples holds an aligned block of 2^m points.
    """
    index = reverse_bits(owen_scramble(reversed_sample, shuffle))
    x = reverse_bits(owen_scramble(index, seed_0))
    y = reverse_bits(owen_scramble(sobol_dimension_1(index), seed_1))
    return wp.vec2(to_unit(x), to_unit(y))


@wp.func
def pair_seeds(key: wp.uint32, pixel: int, pair: int):
    """Four independent seeds of a pair of dimensions; no random number of ``uniforms`` has dimension -1."""
    return pcg4d(wp.uint32(pixel), wp.uint32(pair), wp.uint32(-1), key)


@wp.func
def sobol2(key: wp.uint32, pixel: int, sample: int, pair: int):
    """Point ``sample`` (0 .. 2^31 - 1) in [0, 1)^2 of the sequence that belongs to ``key``, ``pixel`` and ``pair``."""
    shuffle, seed_0, seed_1, _ = pair_seeds(key, pixel, pair)
    return scrambled_point(reverse_bits(wp.uint32(sample)), shuffle, seed_0, seed_1)


@wp.func
def sobol4(key: wp.uint32, pixel: int, sample: int, pair: int):
    """The points of ``pair`` and of ``pair`` + 1."""
    p = sobol2(key, pixel, sample, pair)
    q = sobol2(key, pixel, sample, pair + 1)
    return wp.vec4(p[0], p[1], q[0], q[1])
