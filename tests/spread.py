"""Claimed standard errors against how images with other random numbers differ."""

import numpy as np
import warp as wp
from chance import assert_plausible
from scipy import stats

from varos_warp.kernels.film.develop import SHARE_AROUND
from varos_warp.kernels.film.film import BLOCK, IN_BLOCK, TILE


def tile_means(image, sides):
    """Means [H, W, 3] over what standard errors are averaged over, with a share of those of tiles around.

    That is the tile, or its pixels of the same side; at the edge with pixels before it.
    """
    (height, width), reach = image.shape[:2], int(TILE)
    tops, lefts = range(0, height, reach), range(0, width, reach)
    side = (np.indices((height, width)) // int(BLOCK)).sum(0) % sides
    means = np.empty((sides, len(tops), len(lefts), 3))
    for i, row in enumerate(tops):
        for j, col in enumerate(lefts):
            top, left = (
                max(min(row, height - reach), 0),
                max(min(col, width - reach), 0),
            )
            of_tile = (slice(top, row + reach), slice(left, col + reach))
            for one in range(sides):
                means[one, i, j] = image[of_tile][side[of_tile] == one].mean(0)
    around = np.array(
        [
            [means[:, max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].mean((1, 2)) for j in range(len(lefts))]
            for i in range(len(tops))
        ]
    ).transpose(2, 0, 1, 3)
    mixed = (1.0 - SHARE_AROUND) * means + SHARE_AROUND * around
    row, col = np.indices((height, width))
    return mixed[side, row // reach, col // reach]


def spread_and_expected(radiance, count):
    """Variance of images [seeds, H, W, 3], and what it makes their claims be on average [H, W, 3].

    Images may be the sum of several kinds of samples, [seeds, kind, H, W, 3].
    """
    if radiance.ndim == 4:
        radiance, count = radiance[:, None], count[:, None]
    spread, inverse = radiance.var(axis=0, ddof=1), np.mean(1.0 / count, axis=0)
    sides = 1 + (np.ptp(count) > 0)
    expected = sum(one * tile_means(own / one, sides) for own, one in zip(spread, inverse, strict=True))
    return radiance.sum(axis=1).var(axis=0, ddof=1), expected


def absolute(radiance, claimed, count, where):
    """Mean of what is claimed over what is to be expected [3]: noisy pixels count most."""
    _, expected = spread_and_expected(radiance, count)
    return claimed.mean(axis=0)[where].mean(0) / expected[where].mean(0)


def relative(radiance, claimed, count, where):
    """The same of the mean of squares of (pixel - mean)/stderr, n/(n - 1) times: quiet pixels count as much.

    These squares are more than 1 where a noisy pixel has quiet ones around, and less beside it: alike in both.
    """
    spread, expected = spread_and_expected(radiance, count)
    spread, expected, claimed = spread[where], expected[where], claimed.mean(axis=0)[where]
    return (spread / claimed).mean(0) / (spread / expected).mean(0)


def assert_honest(ratio, radiance, stderr, count=None, where=None, bias=0.0, precision=0.1):
    """Is a ratio 1? A t-test of the jackknife over the seeds, in three channels.

    Args:
        ratio: `absolute` or `relative`.
        radiance: Images [seeds, H, W, 3], or the kinds of samples whose sum they are [seeds, kind, H, W, 3].
        stderr: What they claim.
        count: Samples of the pixels, alike with one channel, where not alike.
        where: Pixels that count [H, W].
        bias: Stated bound of the ratio's bias.
        precision: The jackknife's error must be smaller.
    """
    n = len(radiance)
    count = np.ones((*radiance.shape[:-1], 1)) if count is None else count
    where = np.ones(radiance.shape[-3:-1], bool) if where is None else where
    radiance, claimed = np.asarray(radiance, float), np.square(stderr, dtype=float)

    def log_ratio(kept):
        return np.log(ratio(radiance[kept], claimed[kept], count[kept], where))

    every = np.arange(n)
    pseudo = n * log_ratio(every) - (n - 1) * np.array([log_ratio(every != k) for k in every])
    error = pseudo.std(axis=0, ddof=1) / np.sqrt(n)
    assert error.max() < precision, f"too noisy to tell: {error}"
    off = np.maximum(np.abs(pseudo.mean(axis=0)) - bias, 0.0)
    assert_plausible(2.0 * stats.t.sf(off / error, n - 1))


def evenly(launcher, noise, taken, spp, cost):
    """In place of `varos_warp.render.image.adapt.share_out`: all tiles take as many samples."""
    more = np.subtract(IN_BLOCK * np.asarray(spp), taken)[:, None, None, None]
    return wp.array(np.broadcast_to(more, noise.shape), dtype=int, device=launcher.device)
