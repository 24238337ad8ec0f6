"""Claimed standard errors against how images with other random numbers differ."""

import numpy as np
from chance import assert_plausible
from scipy import stats

from varos_warp.kernels.film.film import TILE


def alike(image, sides):
    """Means [H, W, 3] over the pixels that standard errors are averaged over: those of a tile and side."""
    row, col = np.indices(image.shape[:2])
    group = (row // TILE * image.shape[1] + col // TILE) * sides + (row + col) % sides
    number = np.bincount(group.ravel())
    sums = np.stack([np.bincount(group.ravel(), channel.ravel()) for channel in np.moveaxis(image, -1, 0)], -1)
    return (sums / np.maximum(number, 1)[:, None])[group]


def absolute(radiance, claimed, sides, where):
    """Mean of what is claimed over what is to be expected [3]: noisy pixels count most."""
    return claimed.mean(axis=0)[where].mean(0) / alike(radiance.var(axis=0, ddof=1), sides)[where].mean(0)


def relative(radiance, claimed, sides, where):
    """The same of the mean of squares of (pixel - mean)/stderr, n/(n - 1) times: quiet pixels count as much.

    These squares are more than 1 where a noisy pixel has quiet ones around, and less beside it: alike in both.
    """
    spread = radiance.var(axis=0, ddof=1)
    spread, expected, claimed = spread[where], alike(spread, sides)[where], claimed.mean(axis=0)[where]
    return (spread / claimed).mean(0) / (spread / expected).mean(0)


def assert_honest(ratio, radiance, stderr, sides=1, where=None, precision=0.1):
    """Is a ratio 1? A t-test of the jackknife over the seeds, in three channels.

    Args:
        ratio: `absolute` or `relative`.
        radiance: Images [seeds, H, W, 3].
        stderr: What they claim.
        sides: Of the tiles.
        where: Pixels that count [H, W].
        precision: The jackknife's error must be smaller.
    """
    n = len(radiance)
    where = np.ones(radiance.shape[1:3], bool) if where is None else where
    radiance, claimed = np.asarray(radiance, float), np.square(stderr, dtype=float)

    def log_ratio(kept):
        return np.log(ratio(radiance[kept], claimed[kept], sides, where))

    every = np.arange(n)
    pseudo = n * log_ratio(every) - (n - 1) * np.array([log_ratio(every != k) for k in every])
    error = pseudo.std(axis=0, ddof=1) / np.sqrt(n)
    assert error.max() < precision, f"too noisy to tell: {error}"
    assert_plausible(2.0 * stats.t.sf(np.abs(pseudo.mean(axis=0)) / error, n - 1))
