"""Adaptive sampling: samples where an image is noisy, without bias.

A number of samples that follows from those same samples makes their mean wrong: tiles that happened to miss their rare
bright samples would stop early, and stay too dark. So the blocks of 2 x 2 pixels of every tile
belong to two sides, like the fields of a chessboard. All take a few samples first; how many more those of one side take
is decided from the first samples of the other side alone, which know nothing of theirs. So the mean of every pixel is
unbiased.

The samples of an image are shared out in proportion to the noise of one over the root of its cost, which is how they
leave the least error for the time (Neyman 1934). An image of paths is the sum of two kinds of samples, the camera's
segments and subpaths; the former cost less, so there are more of them (splitting, Arvo and Kirk 1990).
"""

from functools import reduce

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter

from varos_warp.kernels.film.film import IN_BLOCK

DARK = 0.1
"""A channel darker than this share of the brightest counts as if it had it: its error hardly shows."""
FIRST_SHARE, FEWEST_FIRST = 4, 2
"""One sample in so many of those of the pixel is taken before anything is decided, or the first two if these are no
more than half of them."""
GOLDEN = 0.6180339887
"""Golden ratio less 1: its multiples, less their whole parts, fill [0, 1) evenly, however many there are."""
PAIR = IN_BLOCK * FEWEST_FIRST
"""Samples of a block, two of each pixel, whose difference shows its noise; where there are more they come in pairs, for
of low-discrepancy samples halves of unlike number would claim too large an error."""
LEAST_FIRST, LEAST_SUBPATHS = PAIR, 1
"""Least of the first samples of a block: a pair of each pixel. What subpaths carry is smooth, so the blocks around show
its noise, and one of a block does for a start, with a denoiser or without."""
MOST_COUNTED = float(1 << 28)
"""Most samples of a pixel: those of its block are told by 32 bits."""
MOST_SHARED = 64
"""No tile gets more than so many times the samples that an even share would give it: glints on a bolt's thread want
that many."""


def first_samples(spp: float, least: int) -> int:
    """Samples of a block of pixels that are taken before anything is decided, ``least`` or more."""
    of_block = int(IN_BLOCK * spp) // FIRST_SHARE
    if spp >= 2 * FEWEST_FIRST:
        of_block = PAIR * max(of_block // PAIR, 1)
    return max(of_block, least)


def brightness(mean: np.ndarray) -> np.ndarray:
    """What errors are relative to, per channel [3]: the mean of an image [3], or ``DARK`` of its brightest channel."""
    return np.maximum(mean, DARK * np.max(mean))


def other_noise(mean: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Relative variance of one sample, float64 [kind, 2, rows, columns], as the other side of each tile saw it.

    That of the worst channel; and as the variance of a few samples may have missed the bright ones, that of the tiles
    around counts too.

    Args:
        mean: Radiance of the tiles of each kind, whose sum is the image, [kind, 2, rows, columns, 3].
        variance: Variance of one sample, alike.
    """
    level = np.array([brightness(side.mean((0, 1))) for side in mean.sum(0)[::-1]])[:, None, None] ** 2
    scale = np.divide(1.0, level, out=np.zeros_like(level), where=level > 0.0)
    other = worst_channel(variance[:, ::-1] * scale)
    return np.maximum(other, uniform_filter(other, (1, 1, 3, 3), mode="nearest"))


def worst_channel(images: np.ndarray) -> np.ndarray:
    """The largest of the channels [..., 3]; numpy's ``max`` over so short an axis takes ten times longer."""
    return reduce(np.maximum, np.moveaxis(images, -1, 0))


def share_out(noise: np.ndarray, taken: ArrayLike, spp: ArrayLike, cost: ArrayLike) -> np.ndarray:
    """Further samples of each block of pixels, int32 [kind, 2, rows, columns].

    In proportion to the deviation of one sample over the root of its cost; the numbers of each side are found by
    itself.

    Args:
        noise: Relative variance of one sample, of `other_noise`.
        taken: Samples of each kind that every block has.
        spp: Samples of each kind that the mean pixel is to have. Kinds may have more and less; all cost as much.
        cost: Of a sample of each kind.
    """
    taken = np.asarray(taken, float) / IN_BLOCK
    taken, spp, cost = (np.reshape(np.asarray(values, float), (-1, 1, 1)) for values in (taken, spp, cost))
    return np.stack([_share_out(np.sqrt(noise[:, side] / cost), taken, spp, cost) for side in range(2)], 1)


def _share_out(weight: np.ndarray, taken: np.ndarray, spp: np.ndarray, cost: np.ndarray) -> np.ndarray:
    if not weight.any():
        return np.zeros(weight.shape, np.int32)
    most, asked = np.clip(MOST_SHARED * spp, taken, MOST_COUNTED), (spp * cost).sum()
    # scales of the weight at which none gets more, and at which all have the most that they may
    low, high = taken.min() / weight.max(), most.max() / weight[weight > 0.0].min()
    for _ in range(24):
        middle = np.sqrt(low * high)
        spent = (cost * np.clip(middle * weight, taken, most)).mean((1, 2)).sum()
        low, high = (middle, high) if spent <= asked else (low, middle)
    # of a block: 1 to 4, or pairs for each pixel, with the same mean: parts go to the tiles in turn
    turn = (GOLDEN * np.arange(weight[0].size) % 1.0).reshape(weight[0].shape)
    wanted = IN_BLOCK * np.clip(low * weight, taken, most)
    step = np.where(wanted < IN_BLOCK, 1, np.where(wanted < PAIR, IN_BLOCK, PAIR))
    return (step * np.floor(wanted / step + turn) - IN_BLOCK * taken).astype(np.int32)
