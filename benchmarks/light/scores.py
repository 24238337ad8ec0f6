"""Noise and errors of images of one scene with different seeds, and whether their ``stderr`` holds.

Images are float [n, H, W, 3], one per seed; rows of three numbers are per channel.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import norm, truncnorm, ttest_ind_from_stats

BLOCK = 8
"""Pixels along a side."""
DARKEST = 0.1
"""Errors of blocks are relative to their own mean, or to this share of the image's if that is more."""
CENTRAL = 0.98
"""Share of the deviations that the trimmed variance is of."""


@dataclass(frozen=True)
class Estimate:
    """Independent images [n, H, W, 3] of the same truth, and what their mean knows."""

    images: np.ndarray

    def of(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean of ``values`` [n, ...], and its standard error by their spread."""
        mean = values.mean(axis=0)
        if len(values) == 1:
            return mean, np.full_like(mean, np.nan)
        return mean, values.std(axis=0, ddof=1) / np.sqrt(len(values))

    @cached_property
    def pixels(self):
        """Mean and standard error [H, W, 3]."""
        return self.of(np.asarray(self.images, float))

    @cached_property
    def blocks(self):
        """Mean and standard error [h, w, 3] of blocks; neighbours may share their noise."""
        return self.of(block_means(self.images))

    @cached_property
    def whole(self):
        """Mean and standard error [3] of the image."""
        return self.of(np.asarray(self.images, float).mean(axis=(1, 2)))


def block_means(images: np.ndarray) -> np.ndarray:
    """Means [..., h, w, 3] of whole blocks of [..., H, W, 3]; what is left over at the edges is not looked at."""
    images = np.asarray(images, float)
    h, w = (max(side // BLOCK, 1) for side in images.shape[-3:-1])
    tall, wide = min(BLOCK, images.shape[-3]), min(BLOCK, images.shape[-2])
    cut = images[..., : h * tall, : w * wide, :]
    return cut.reshape(*images.shape[:-3], h, tall, w, wide, 3).mean(axis=(-4, -2))


def block_errors(images: np.ndarray, reference: Estimate) -> np.ndarray:
    """Signed relative errors [n, h, w, 3] of blocks."""
    truth, _ = reference.blocks
    return (block_means(images) - truth) / np.maximum(truth, DARKEST * reference.whole[0])


def worst_channel(errors: np.ndarray) -> np.ndarray:
    """Return the one of signed numbers [..., 3] that is farthest from 0."""
    index = np.argmax(np.abs(errors), axis=-1)[..., None]
    return np.take_along_axis(errors, index, axis=-1)[..., 0]


def noise(images: np.ndarray, reference: Estimate) -> np.ndarray:
    """RMS over pixels of the standard deviation over seeds, relative to the image's mean, [3]."""
    variance = np.asarray(images, float).var(axis=0, ddof=1)
    return np.sqrt(variance.mean(axis=(0, 1))) / reference.whole[0]


def relative_rmse(images: np.ndarray, reference: Estimate) -> np.ndarray:
    """Error over the image's mean [3], less what the reference's own noise adds."""
    mean, stderr = reference.pixels
    squares = ((np.asarray(images, float) - mean) ** 2).mean(axis=(0, 1, 2))
    excess = squares - np.nan_to_num(stderr**2).mean(axis=(0, 1))
    return np.sqrt(np.maximum(excess, 0.0)) / reference.whole[0]


def block_row(images: np.ndarray, reference: Estimate) -> dict:
    """How far blocks are off: the worst, 99 % of all, and the share of images with one off by half.

    And how well the reference knows them, and its pixels.
    """
    errors = np.abs(worst_channel(block_errors(images, reference)))
    noise = np.sqrt((reference.pixels[1] ** 2).mean(axis=(0, 1))) / reference.whole[0]
    unsure = reference.blocks[1] / np.maximum(reference.blocks[0], DARKEST * reference.whole[0])
    return {
        "block_worst": float(errors.max()),
        "block_99": float(np.quantile(errors, 0.99)),
        "half_off": float((errors.max(axis=(1, 2)) >= 0.5).mean()),
        "reference_pixel_rms": float(noise.max()),
        "reference_block_rms": float(np.sqrt((unsure**2).mean(axis=(0, 1)).max())),
    }


# ---------------------------------------------------------------------------------------- do the error bars hold?


def calibration(images: np.ndarray, stderr: np.ndarray) -> dict:
    """Return whether pixels stray as ``stderr`` says, over pixels, channels and seeds.

    Returns:
        ``z_variance``, of (pixel - mean over seeds) / stderr; ``z_trimmed``, of its central 98 % relative to a normal
        distribution cut alike; ``z_pooled``, the mean of squared deviations over that of stderr^2, which a few bright
        pixels rule: all are 1 where the error bars hold. ``beyond_4``: share of z beyond 4 (a normal one: 6e-5), with
        those that claim no error and are off all the same, ``claims_nothing``; the others' z leave these out.
    """
    images, stderr = np.asarray(images, float), np.asarray(stderr, float)
    known = np.isfinite(stderr)
    off = ((images - images.mean(axis=0)) * np.sqrt(len(images) / (len(images) - 1)))[known]
    claimed = stderr[known]
    z = off[claimed > 0.0] / claimed[claimed > 0.0]
    if not len(z):
        return dict.fromkeys(("z_variance", "z_trimmed", "z_pooled", "beyond_4", "claims_nothing"), np.nan)
    ends = [(1 - CENTRAL) / 2, (1 + CENTRAL) / 2]
    low, high = np.quantile(z, ends)
    inner, silent = z[(z >= low) & (z <= high)], np.count_nonzero((claimed == 0.0) & (off != 0.0))
    return {
        "z_variance": float(np.mean(z**2)),
        "z_trimmed": float(np.mean(inner**2) / truncnorm.var(*norm.ppf(ends))),
        "z_pooled": float(np.sum(off**2) / np.sum(claimed**2)),
        "beyond_4": float((np.count_nonzero(np.abs(z) > 4.0) + silent) / len(off)),
        "claims_nothing": float(silent / len(off)),
    }


def spread_over_claimed(images: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Standard deviation of the images' means over seeds, over the one that independent pixels claim, [3]."""
    spread = np.asarray(images, float).mean(axis=(1, 2)).std(axis=0, ddof=1)
    squares = (np.asarray(stderr, float) ** 2).sum(axis=(1, 2)) / np.prod(images.shape[1:3]) ** 2
    return spread / np.sqrt(squares.mean(axis=0))


# ------------------------------------------------------------------------------------------------------------ biases


def as_normal(mean, error, n: int, truth, unsure, n_truth: int) -> np.ndarray:
    """The difference of two means of so many images in standard errors, as a normal number of the same chance.

    By Welch's test, from the means and their standard errors; 0 where neither strays.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        spread, other = error * np.sqrt(n), unsure * np.sqrt(n_truth)
        found = ttest_ind_from_stats(mean, spread, n, truth, other, n_truth, equal_var=False)
        z = norm.isf(np.maximum(found.pvalue / 2.0, 1e-300))
    return np.where(np.hypot(error, unsure) > 0.0, np.sign(mean - truth) * z, 0.0)


def bias(estimate: Estimate, reference: Estimate) -> dict:
    """How unlikely the differences of blocks are by chance, and the difference of the images' means in %."""
    z = as_normal(*estimate.blocks, len(estimate.images), *reference.blocks, len(reference.images))
    place = np.unravel_index(np.argmax(np.abs(np.nan_to_num(z))), z.shape)
    (mean, error), (truth, unsure) = estimate.whole, reference.whole
    return {
        "block_z": float(z[place]),
        "block_z_at": [int(i) for i in place],
        "block_z_rms": float(np.sqrt(np.mean(z**2))),
        "mean_off_percent": (100 * (mean / truth - 1)).tolist(),
        "mean_off_stderr": (100 * np.hypot(error, unsure) / truth).tolist(),
    }
