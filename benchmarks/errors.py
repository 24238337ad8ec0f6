"""Errors of an image against a reference that is noisy itself, and what that reference cannot resolve.

Rows of numbers are per channel; a single number is for the worst channel.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from skimage.metrics import structural_similarity

from varos_warp.products.images.radiance import encode_color
from varos_warp.render.image.exposure import statistics

MEDIAN_OF_NORMAL = 0.6744897501960817
"""Median of the absolute value of a standard normal."""
SIGMAS = 2.0
"""An error is resolved if it stands out of the reference's noise by so many standard errors of that noise."""


KNOWN = 0.05
"""Pixels whose reference has a larger relative standard error, in any channel, are left out: a firefly of its own."""


@dataclass(frozen=True)
class Reference:
    """Linear radiance [W/sr/m^2] and its standard error, float64 [H, W, 3]."""

    mean: np.ndarray
    stderr: np.ndarray

    def __post_init__(self):
        for name in ("mean", "stderr"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), np.float64))

    @cached_property
    def known(self) -> np.ndarray:
        """Pixels that are compared, bool [H, W]."""
        return (self.stderr <= KNOWN * self.mean).all(axis=-1)


def relative_rmse(images: np.ndarray, reference: Reference) -> tuple[np.ndarray, np.ndarray]:
    """Root of the mean squared error over the mean of the reference, less what the reference's noise adds.

    With e the error of a pixel and s the standard error of the reference, d = image - mean has E[d^2] = e^2 + s^2, and
    the mean of d^2 - s^2 over n pixels has the standard error sqrt(sum(4 e^2 s^2 + 2 s^4)) / n by the reference's
    (normal) noise alone. Of images [k, H, W, 3]: the error per channel [3], 0 where noise exceeds it, and its upper
    limit [3] of `SIGMAS`.
    """
    known, mean, s2 = reference.known, reference.mean, reference.stderr[reference.known] ** 2
    squares = np.mean((np.asarray(images, float) - mean)[:, known] ** 2, axis=0)
    excess = squares - s2
    unsure = np.sqrt(np.sum(4.0 * np.maximum(excess, 0.0) * s2 + 2.0 * s2**2, axis=0)) / len(s2)
    mse, scale = excess.mean(axis=0), mean[known].mean(axis=0)
    limit = np.sqrt(np.maximum(mse, 0.0) + SIGMAS * unsure)
    return np.sqrt(np.where(mse > SIGMAS * unsure, mse, 0.0)) / scale, limit / scale


def median_relative_error(images: np.ndarray, reference: Reference) -> tuple[np.ndarray, np.ndarray]:
    """Median over the pixels of |image - mean| / mean, per channel [3], and what the reference's noise alone makes [3].

    The noise cannot be taken off a median; where it makes half of it or more, the error is not resolved.
    """
    known = reference.known
    scale = np.maximum(reference.mean[known], 1e-30)
    error = np.abs(np.asarray(images, float)[:, known] - reference.mean[known]) / scale
    return np.median(error, axis=(0, 1)), MEDIAN_OF_NORMAL * np.median(reference.stderr[known] / scale, axis=0)


def dissimilarity(images: np.ndarray, reference: Reference) -> tuple[float, float]:
    """1 - SSIM of the 8-bit images after exposure, mean over the images, and of the reference with its noise once more.

    The gain is the one the project would expose the reference with, so that a wrong brightness counts. Settings of
    Wang et al. (2004): Gaussian window of 1.5 pixels, population covariances.
    """
    gain = statistics(reference.mean).target_gain
    truth = encode_color(reference.mean, gain)

    def against(image):
        return 1.0 - structural_similarity(
            truth,
            encode_color(image, gain),
            channel_axis=2,
            data_range=255,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
        )

    noise = np.random.default_rng(0).standard_normal(truth.shape) * reference.stderr
    return float(np.mean([against(image) for image in images])), float(against(reference.mean + noise))


def measure(images: np.ndarray, reference: Reference) -> dict:
    """All of these as one row: ``rmse``, ``median``, ``ssim`` (1 - SSIM), and what the reference resolves of each.

    ``pixels`` is the share of them that RMSE and median are of.

    Where ``*_resolved`` is false the error is not known but to be below ``*_limit`` (for the median and SSIM: it is
    mostly the reference's own noise).
    """
    images = np.asarray(images, float)
    rmse, limit = relative_rmse(images, reference)
    median, floor = median_relative_error(images, reference)
    ssim, ssim_floor = dissimilarity(images, reference)
    worst, middle = int(np.argmax(limit)), int(np.argmax(median))
    known = reference.known
    off = images[:, known].mean(axis=(0, 1)) / reference.mean[known].mean(axis=0) - 1.0
    row = {"pixels": float(known.mean())}
    for name, error, upper, resolved in (
        ("rmse", rmse[worst], limit[worst], rmse[worst] > 0.0),
        ("median", median[middle], median[middle], median[middle] > 2.0 * floor[middle]),
        ("ssim", ssim, ssim, ssim > 2.0 * ssim_floor),
    ):
        row |= {name: float(error), f"{name}_limit": float(upper), f"{name}_resolved": bool(resolved)}
    for name, values in (("rmse", rmse), ("median", median), ("mean_off", off)):
        row |= {f"{name}_{channel}": float(value) for channel, value in zip("rgb", values, strict=True)}
    return row
