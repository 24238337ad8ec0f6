"""Non-local means, a filter for `denoise.Denoiser` on a CPU where Open Image Denoise cannot be had."""

import functools
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import numpy as np
import warp as wp
from scipy.ndimage import gaussian_filter, uniform_filter


class NonLocalMeans:
    """Makes filters for images of a size."""

    @contextmanager
    def filter(self, shape: tuple[int, int], quality: str, guides: Iterable[str]) -> Iterator["_Filter"]:
        """A filter; it looks at no guides and has one quality."""
        yield _Filter(shape)


class _Filter:
    """Denoises ``color`` into ``output`` by ``stderr``, its standard error."""

    def __init__(self, shape: tuple[int, int]):
        self.images = {name: wp.empty(shape, dtype=wp.vec3, device="cpu") for name in ("color", "stderr", "output")}

    def run(self) -> None:
        """Denoise."""
        color, stderr = (self.images[name].numpy() for name in ("color", "stderr"))
        self.images["output"].assign(non_local_means(color, stderr))


def non_local_means(radiance: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Radiance float32 [H, W, 3] with less noise, by its standard error.

    Non-local means in the square-root domain, where the noise of a path tracer is more nearly uniform. What is left of
    its variation (shadows are noisier than open places) is met by a few strengths, between which each pixel takes its
    own. The mean of square roots is too dark, so the local mean of the linear image is restored.
    """
    from skimage.restoration import denoise_nl_means

    sigma = _sigma_of_root(radiance, stderr)
    low, high = np.percentile(sigma[sigma > 0.0], [10.0, 98.0]) if np.any(sigma > 0.0) else (0.0, 0.0)
    if not high > 0.0:
        return radiance
    steps = int(np.ceil(np.log(high / low) / np.log(_STRENGTH_RATIO)))
    levels = np.geomspace(low, high, min(steps, _STRENGTHS - 1) + 1)
    root = np.sqrt(radiance)
    smooth = [
        denoise_nl_means(
            root, patch_size=5, patch_distance=3, h=0.8 * level, sigma=level, fast_mode=True, channel_axis=-1
        )
        .reshape(root.shape)  # it drops an axis of one pixel
        .astype(np.float32)
        ** 2
        for level in levels
    ]
    smooth = _between(smooth, levels, np.clip(sigma, low, high))
    blur = functools.partial(gaussian_filter, sigma=(_BLUR_PX, _BLUR_PX, 0.0))
    tiny = np.float32(1e-12) * max(float(smooth.max()), 1e-20)
    return smooth * (blur(radiance) + tiny) / (blur(smooth) + tiny)


_BLUR_PX = 4.0
_STRENGTHS, _STRENGTH_RATIO = 3, 1.5
"""Most strengths, and the largest factor between two of them where fewer suffice."""


def _between(images: list[np.ndarray], levels: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Image [H, W, 3] that takes from the images at ``levels`` what suits each pixel's ``sigma`` [H, W]."""
    place = np.interp(np.log(sigma), np.log(levels), np.arange(len(levels)))[..., None]
    return sum(np.maximum(1.0 - np.abs(place - i), 0.0) * image for i, image in enumerate(images)).astype(np.float32)


def _sigma_of_root(radiance: np.ndarray, stderr: np.ndarray) -> np.ndarray:
    """Standard error [H, W] of the square root of the radiance, from neighbourhoods; 0 where there is no light.

    One sample per pixel has no known error (inf); its noise is taken to be as large as its radiance.
    """
    stderr = np.where(np.isfinite(stderr), stderr, radiance)
    mean = uniform_filter(radiance.astype(np.float64), size=(7, 7, 1)).mean(-1)
    variance = uniform_filter(np.square(stderr, dtype=np.float64), size=(7, 7, 1)).mean(-1)
    lit = mean > 1e-6 * mean.max()
    return np.sqrt(np.divide(variance, 4.0 * mean, out=np.zeros_like(mean), where=lit).clip(min=0.0))
