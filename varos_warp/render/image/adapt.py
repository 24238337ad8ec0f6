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

from collections.abc import Sequence

import numpy as np
import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.film.adapt import DARK, FEWEST_FIRST, PAIR, Sharing, find_levels, noise_around, share_samples
from varos_warp.kernels.film.film import IN_BLOCK

FIRST_SHARE = 4
"""One sample in so many of those of the pixel is taken before anything is decided, or the first two if these are no
more than half of them."""
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


def other_noise(launcher: Launcher, mean: wp.array, variance: wp.array) -> wp.array:
    """Relative variance of one sample, float64 [kind, 2, rows, columns], as the other side of each tile saw it.

    That of the worst channel; and as the variance of a few samples may have missed the bright ones, that of the tiles
    around counts too.

    Args:
        launcher: Of the device.
        mean: Radiance of the tiles of each kind, whose sum is the image, vec3d [kind, 2, rows, columns].
        variance: Variance of one sample, alike.
    """
    scale = wp.empty(mean.shape[1], dtype=wp.vec3d, device=launcher.device)
    noise = wp.empty(mean.shape, dtype=wp.float64, device=launcher.device)
    launcher.blocks(find_levels, scale.shape, {"mean": mean, "scale": scale})
    launcher.run(noise_around, noise.shape, {"variance": variance, "scale": scale, "noise": noise})
    return noise


def share_out(
    launcher: Launcher, noise: wp.array, taken: Sequence[int], spp: Sequence[float], cost: Sequence[float]
) -> wp.array:
    """Further samples of each block of pixels, int32 [kind, 2, rows, columns].

    In proportion to the deviation of one sample over the root of its cost; the numbers of each side are found by
    itself.

    Args:
        launcher: Of the device.
        noise: Relative variance of one sample, of `other_noise`.
        taken: Samples of each kind that every block has.
        spp: Samples of each kind that the mean pixel is to have. Kinds may have more and less; all cost as much.
        cost: Of a sample of each kind.
    """
    kinds = np.zeros(len(taken), Sharing.numpy_dtype())
    kinds["taken"], kinds["cost"] = np.divide(taken, IN_BLOCK), cost
    kinds["most"] = np.clip(np.multiply(MOST_SHARED, spp), kinds["taken"], MOST_COUNTED)
    wanted = wp.empty(noise.shape, dtype=int, device=launcher.device)
    launcher.blocks(
        share_samples,
        (noise.shape[1],),
        {
            "noise": noise,
            "kinds": wp.array(kinds, dtype=Sharing, device=launcher.device),
            "asked": wp.float64(np.dot(spp, cost)),
            "weight": wp.empty_like(noise),
            "wanted": wanted,
        },
    )
    return wanted
