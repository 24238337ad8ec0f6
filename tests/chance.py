"""Statistics of the tests: chi-square against a density, and one level of significance for any number of p-values."""

import numpy as np
import warp as wp
from scipy import stats

ALPHA = 0.01
"""Chance that one test rejects a right implementation. Seeds are fixed, so a test that passes goes on passing."""


def assert_plausible(p_values):
    """No p-value of a family is too small: its threshold is corrected for how many there are (Sidak 1967)."""
    p_values = np.ravel(p_values)
    threshold = 1.0 - (1.0 - ALPHA) ** (1.0 / len(p_values))
    worst = p_values.min()
    assert worst >= threshold, f"p = {worst:.3g}, item {p_values.argmin()} of {len(p_values)}, at least {threshold:.3g}"


def uniform_p(samples, bins=64):
    """p-value of the chi-square test that ``samples`` [N] or [N, dimensions] are uniform in the unit cube."""
    samples = np.asarray(samples, float)
    samples = samples[:, None] if samples.ndim == 1 else samples
    assert samples.min() >= 0.0
    assert samples.max() <= 1.0
    cell = np.minimum((samples * bins).astype(int), bins - 1)  # a tenth of the time of np.histogramdd
    shape = (bins,) * samples.shape[1]
    return stats.chisquare(np.bincount(np.ravel_multi_index(tuple(cell.T), shape), minlength=np.prod(shape))).pvalue


def uniform_moment_z(samples):
    """Standard scores of the first three moments of uniform samples [N]."""
    n = np.arange(1, 4)[:, None]
    spread = np.sqrt(1 / (2 * n[:, 0] + 1) - 1 / (n[:, 0] + 1) ** 2)
    return ((np.asarray(samples, float) ** n).mean(axis=1) - 1 / (n[:, 0] + 1)) / spread * np.sqrt(len(samples))


def two_sided(z):
    """p-value of standard scores."""
    return 2.0 * stats.norm.sf(np.abs(z))


def rng_array(seed, shape):
    """Uniform numbers in [0, 1) as float32: what the kernels' own generator gives."""
    return np.random.default_rng(seed).integers(0, 1 << 24, shape).astype(np.float32) * np.float32(2.0**-24)


def run(kernel, inputs, outputs, dim=None):
    """Launch a test kernel on the CPU over arrays of one length; numpy in, numpy out.

    Args:
        kernel: the kernel; its index runs over the first axis.
        inputs: scalars, structs or arrays; [N, 2..4] float arrays become vectors.
        outputs: Warp types of the outputs.
        dim: number of threads; absent: the length of the first array.
    """
    converted = [_to_device(x) for x in inputs]
    dim = dim or next(len(x) for x in inputs if isinstance(x, np.ndarray))
    results = [wp.empty(dim, dtype=dtype, device="cpu") for dtype in outputs]
    wp.launch(kernel, dim=dim, inputs=converted, outputs=results, device="cpu")
    arrays = [result.numpy() for result in results]
    return arrays[0] if len(arrays) == 1 else arrays


def _to_device(x):
    if not isinstance(x, np.ndarray):
        return x
    if x.dtype.kind == "f":
        dtype = {1: float, 2: {2: wp.vec2, 3: wp.vec3, 4: wp.vec4}.get(x.shape[-1])}[x.ndim]
        return wp.array(x.astype(np.float32), dtype=dtype, device="cpu")
    return wp.array(x, dtype={"i": wp.int32, "u": wp.uint32}[x.dtype.kind], device="cpu")
