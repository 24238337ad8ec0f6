"""How large the error of an image is, told by independent estimates, and how it falls with the samples.

Errors are relative RMSE per channel: the root of the mean square of what is wrong in an image, over its mean radiance
(see `adapt.brightness` for channels that are nearly black). No reference is needed: an image that is independent of
another one tells, on average, how far that one is from the truth.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import warp as wp
from scipy.ndimage import uniform_filter

from varos_warp.device.devices import upload
from varos_warp.device.launch import launch_rows
from varos_warp.kernels.film.compare import compare_rows
from varos_warp.render.image.adapt import DARK, brightness
from varos_warp.scene.block import plain_number

FIREFLY = 3.0
"""A pixel of an estimate is cut to this many times the image there and around it: otherwise one rare bright path would
decide, and a pilot of few samples cannot measure those. In the mean of the image the pixel counts in full."""
AROUND = 9
"""Side [pixels] of the surroundings of a pixel."""
COMPARED_ROWS = 96
"""Rows of a tile in which images are compared: enough tiles for some cores, and few launches."""
PRECISE = 0.2
"""Estimates tell the square of an error if its standard error is at most this share of it."""
BLOCK, BLOCK_QUANTILE, BLOCKS_WITHIN = 8, 0.99, 5.0
"""A tolerance also bounds blocks of 8 x 8 pixels: 99 % of them must be within 5 times the tolerance."""


def error(
    images: Sequence[np.ndarray],
    estimates: Sequence[np.ndarray],
    sigmas: float | Sequence[float] = 1.0,
    spp: Sequence[float] | None = None,
) -> np.ndarray:
    """Relative RMSE [3] of images, from estimates that know nothing of them, nor of each other.

    With M, M' two independent unbiased images and D any other, the mean of (D - M)(D - M') is that of the square of D's
    error, noise, blur and all, however noisy the two are: what is wrong with them cancels. The upper end of what chance
    leaves open is taken. Where blocks of pixels are off by more than `BLOCKS_WITHIN` times that, they decide.

    Args:
        images: Radiance [H, W, 3] of each D.
        estimates: Radiance of the others, two or more.
        sigmas: That end, in standard errors; of several the result is [sigmas, 3].
        spp: Samples of each estimate, which count in proportion; absent: all count alike.
    """
    square, unsure = squared_error(images, estimates, spp)
    whole = relative(square + np.asarray(sigmas)[..., None] * unsure, estimates)
    return np.maximum(whole, block_error(images, estimates, spp) / BLOCKS_WITHIN)


class Made(NamedTuple):
    """An image of a view, by which errors are told: its own, if it is denoised, and those of others."""

    spp: float
    """Samples per pixel."""
    radiance: np.ndarray
    """Radiance as it is sampled, without bias [H, W, 3]."""
    denoised: np.ndarray | None = None
    """Radiance after the denoiser, where its error is asked for."""


def of_others(compare, one: Made, made: Sequence[Made], *how):
    """What `error` or `squared_error` says of one denoised image by all other images that were made of the view."""
    others = [other for other in made if other is not one]
    return compare([one.denoised], [other.radiance for other in others], *how, spp=[other.spp for other in others])


def worst_errors(sets: Sequence[Sequence[Made]], made: Sequence[Made]) -> np.ndarray:
    """The largest `error` of any one image of each set [set, 3], by all that were made."""
    with ThreadPoolExecutor() as pool:
        found = [[pool.submit(of_others, error, one, made) for one in images] for images in sets]
    return np.array([np.max([job.result() for job in jobs], axis=0) for jobs in found])


def mean_square(images: Sequence[Made], made: Sequence[Made]) -> tuple[np.ndarray, np.ndarray]:
    """`squared_error` [3] of images, by all that were made, and its standard error [3]."""
    with ThreadPoolExecutor() as pool:
        found = [*pool.map(lambda one: of_others(squared_error, one, made), images)]
    return tuple(np.mean(found, axis=0))


def block_error(
    images: Sequence[np.ndarray], estimates: Sequence[np.ndarray], spp: Sequence[float] | None = None
) -> np.ndarray:
    """Error [3] that `BLOCK_QUANTILE` of the blocks of 8 x 8 pixels of images stay within.

    Of a block's mean, relative to the block's or to `DARK` of the image's, whichever is brighter. What of it may be the
    noise of the estimates is taken off.
    """
    weights, known = weights_of(estimates, spp), np.array([block_means(estimate) for estimate in estimates])
    mean = np.tensordot(weights, known, 1)
    level = np.maximum(mean, DARK * brightness(mean.mean((0, 1))))
    if not level.any():
        return np.zeros(3)
    off = np.array([off_squared(block_means(image), known, weights) for image in images])
    share = np.sqrt(np.maximum(off, 0.0)) / np.maximum(level, 1e-30)
    return np.quantile(share, BLOCK_QUANTILE, axis=(0, 1, 2))


def block_means(image: np.ndarray) -> np.ndarray:
    """Means [H/8, W/8, 3] over whole blocks; of a smaller image, over all of it."""
    height, width = (max(side // BLOCK, 1) for side in image.shape[:2])
    tall, wide = (min(BLOCK, side) for side in image.shape[:2])
    rows = image[: height * tall, : width * wide].reshape(height, tall, width * wide, -1).mean(1, dtype=np.float64)
    return rows.reshape(height, width, wide, -1).mean(2)


def mean_of(image: np.ndarray) -> np.ndarray:
    """Mean [3] over the pixels of an image, row by row: numpy's over both axes at once takes ten times longer."""
    return image.mean(0, dtype=np.float64).mean(0)


def weights_of(estimates: Sequence[np.ndarray], spp: Sequence[float] | None) -> np.ndarray:
    """Shares of the estimates in their mean [count]."""
    weights = np.ones(len(estimates)) if spp is None else np.asarray(spp, float)
    return weights / weights.sum()


def off_squared(values: np.ndarray, estimates: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Square of what is wrong with values [...], from independent unbiased estimates [count, ...] of the right ones.

    The mean of (D - M)(D - M') over all pairs of estimates, weighted by the product of their ``weights``, whose sum is
    one.
    """
    off = values - estimates
    own = np.tensordot(weights**2, off**2, 1)
    return (np.tensordot(weights, off, 1) ** 2 - own) / (1.0 - np.sum(weights**2))


def squared_error(
    images: Sequence[np.ndarray], estimates: Sequence[np.ndarray], spp: Sequence[float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean square of what is wrong with images [3], and its standard error [3] by the noise of the estimates.

    As if pixels were independent.
    """
    weights = weights_of(estimates, spp)
    means = np.array([mean_of(estimate) for estimate in estimates])
    return tuple(np.mean([_squared_error(image, estimates, means, weights) for image in images], axis=0))


def _squared_error(
    image: np.ndarray, estimates: Sequence[np.ndarray], means: np.ndarray, weights: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`squared_error` of one image; ``means`` [count, 3] are those of the estimates."""
    level = mean_of(image)
    (square, deviation), sane_means = _against_sane(image, estimates, weights, level)
    offset, sane_offset = (level - weights @ values for values in (means, sane_means))
    off, sane_off = (off_squared(level, values, weights) for values in (means, sane_means))
    chance = offset**2 - off - (sane_offset**2 - sane_off)  # of the mean of fireflies
    unsure = np.hypot(deviation / np.sqrt(image[..., 0].size), 2.0 * offset * np.sqrt(np.maximum(chance, 0.0)))
    return square + off - sane_off, unsure


def _against_sane(
    image: np.ndarray, estimates: Sequence[np.ndarray], weights: np.ndarray, level: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation [2, 3] of the squares of what is wrong, by estimates without fireflies; and their means.

    On the CPU whatever the renderer's device: its kernel lets other threads render meanwhile.
    """
    rows, pixels = len(image), image[..., 0].size
    around = uniform_filter(image, (AROUND, AROUND, 1))
    squares = wp.zeros((2, rows), dtype=wp.vec3d, device="cpu")
    sane = wp.zeros((len(estimates), rows), dtype=wp.vec3d, device="cpu")
    images = {"image": image, "around": around, "estimates": np.stack(estimates)}
    launch_rows(
        compare_rows,
        (rows,),
        {
            **{name: upload(values, wp.vec3, "cpu") for name, values in images.items()},
            "weights": upload(weights, wp.float64, "cpu"),
            "firefly": FIREFLY,
            "dark": wp.vec3d(*(DARK * level)),
            "squares": squares,
            "sane": sane,
        },
        "cpu",
        rows=COMPARED_ROWS,
    )
    mean, mean_square = squares.numpy().sum(1) / pixels
    return np.array([mean, np.sqrt(np.maximum(mean_square - mean**2, 0.0))]), sane.numpy().sum(1) / pixels


def relative(square: np.ndarray, images: Sequence[np.ndarray]) -> np.ndarray:
    """Root of mean squares [3] over the brightness of images [H, W, 3]; 0 where all is black."""
    level = brightness(np.mean([mean_of(image) for image in images], axis=0))
    return np.divide(np.sqrt(np.maximum(square, 0.0)), level, out=np.zeros(square.shape), where=level > 0.0)


# --------------------------------------------------------------------------------------------- errors against samples


MOST_SPP = 4096
FLATTEST = -0.15
"""Exponent of the error in the number of samples: the least that a denoiser has shown."""
REACH = 3
"""Factor by which samples may exceed those that were tried where their error is extrapolated."""


class Samples(NamedTuple):
    """What an integrator does with samples per pixel."""

    fewest: float
    """Fewest that are ever planned: as many as tell their noise."""
    step: float
    """The smallest step between two numbers of them; with the field they are a mean over the image."""
    steepest: float
    """Exponent of the error, at the least: by a low-discrepancy sequence, or by independent samples."""

    def in_multiples(self, step: int) -> "Samples":
        """These rules where all pixels take equally many, in multiples of ``step``: one would not tell its noise."""
        return self._replace(fewest=max(step, 2), step=float(step)) if step else self

    def rounded(self, spp: float) -> float:
        """Smallest number not below ``spp`` in steps of about an eighth or less, within what is ever taken."""
        step = self.step * np.ceil(2.0 ** np.floor(np.log2(max(spp, 1.0))) / 8.0 / self.step)
        return plain_number(float(np.clip(step * np.ceil(spp / step), self.fewest, MOST_SPP)))


SAMPLES = {"field": Samples(0.25, 0.125, -0.75), "path": Samples(2, 1.0, -0.5), "reference": Samples(2, 1.0, -0.5)}
"""`Samples` of each integrator."""


@dataclass(frozen=True)
class ErrorLaw:
    """Relative RMSE against samples per pixel: a power law through what was measured, one per channel.

    What a denoiser leaves falls steeply at first and slower then. So beyond the most samples that were tried, the
    exponent is half-way to that between the last two numbers of them, if that is slower; they alone tell it roughly. So
    chance in these two asks for more samples, never for fewer.

    There must be two numbers of samples or more.
    """

    spp: list[float]
    measured: np.ndarray
    """Errors [level, 3]."""
    steepest: float = SAMPLES["field"].steepest
    """Exponent, at the least."""

    def _fit(self) -> tuple[np.ndarray, np.ndarray]:
        """Error [3] with one sample, and the exponents [3]: least squares of the logarithms."""
        x, y = np.log(self.spp), np.log(np.maximum(self.measured, 1e-12))
        exponent = np.clip((x - x.mean()) @ (y - y.mean(0)) / np.sum((x - x.mean()) ** 2), self.steepest, FLATTEST)
        return np.exp(y.mean(0) - exponent * x.mean()), exponent

    def _beyond(self) -> np.ndarray:
        """Exponents [3] beyond the most samples that were tried."""
        before, last = np.log(np.maximum(self.measured[-2:], 1e-12))
        slope = (last - before) / np.log(self.spp[-1] / self.spp[-2])
        _, exponent = self._fit()
        return 0.5 * (exponent + np.clip(slope, exponent, FLATTEST))

    def error(self, spp: float) -> np.ndarray:
        """Error [3] with a number of samples."""
        one, exponent = self._fit()
        tried = min(float(spp), self.spp[-1])
        found = one * tried**exponent * (float(spp) / tried) ** self._beyond()
        return np.where(self.measured.any(0), found, 0.0)

    def samples(self, target: float) -> float:
        """The fewest samples whose error is below ``target`` in every channel, in fractions."""
        one, exponent = self._fit()
        most = self.spp[-1]
        with np.errstate(divide="ignore", over="ignore"):  # no number of samples may be enough
            needed = (target / one) ** (1.0 / exponent)
            farther = most * (target / (one * most**exponent)) ** (1.0 / self._beyond())
        needed = np.where(self.measured.any(0), np.where(needed > most, farther, needed), 0.0)
        return float(min(needed.max(), 1e9))
