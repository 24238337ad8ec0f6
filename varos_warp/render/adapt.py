"""Adaptive sampling: tiles of an image stop once their standard error is below a tolerance, without bias.

A number of samples that follows from those same samples makes their mean wrong: tiles that happened to miss their rare
bright samples would stop early, and stay too dark. So the film has two halves. Each takes a few samples first; how many
more one takes is decided from the first samples of the other alone, which know nothing of it. So the mean of each half
is unbiased, and so is the image, the mean of both.
"""

import numpy as np
from scipy.ndimage import uniform_filter

DARK = 0.1
"""A channel darker than this share of the brightest is judged as if it had it: its error hardly shows."""
FIRST_SHARE, FEWEST_FIRST = 8, 4
"""Each half first takes one sample in so many of those planned for the pixel, but never fewer than so many."""


def first_samples(spp: int) -> int:
    """Samples per pixel that each half takes before anything is decided."""
    return max(FEWEST_FIRST, spp // FIRST_SHARE)


def brightness(mean: np.ndarray) -> np.ndarray:
    """What errors are relative to, per channel [3]: the mean of an image [3], or ``DARK`` of its brightest channel."""
    return np.maximum(mean, DARK * np.max(mean))


def more_samples(mean: np.ndarray, variance: np.ndarray, taken: int, tolerance: float, spp: int) -> np.ndarray:
    """Further samples per pixel of each half and tile, int32 [2, rows, columns].

    The image's variance is (v / N + v / N) / 4, with v the variance of one sample and N the samples of a half; a tile
    is done when its root is below the tolerance, relative to the brightness of the image, in every channel. As the
    variance of a few samples may have missed the bright ones, that of the tiles around counts too.

    Args:
        mean: Radiance of the tiles [2, rows, columns, 3], of each half by itself.
        variance: Variance of one sample, alike.
        taken: Samples that each half has.
        tolerance: Relative standard error asked.
        spp: Samples per pixel that both halves together are planned to need; no tile takes more than four times that.
    """
    other_mean, other = mean[::-1], variance[::-1]
    scale = np.array([brightness(half.mean((0, 1))) for half in other_mean])[:, None, None]
    around = np.stack([uniform_filter(half, (3, 3, 1), mode="nearest") for half in other])
    allowed = 2.0 * (tolerance * scale) ** 2
    needed = np.divide(np.maximum(other, around), allowed, out=np.zeros_like(other), where=allowed > 0.0).max(-1)
    return (np.clip(np.ceil(needed), taken, max(2 * spp, taken)) - taken).astype(np.int32)
