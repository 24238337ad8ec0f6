"""The images of a frame, as arrays on the host."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter

from varos_warp.products.images.depth import DepthImage
from varos_warp.products.images.flow import FlowImage
from varos_warp.products.images.normals import NormalImage
from varos_warp.products.images.radiance import RadianceImage
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.products.images.segments import SegmentImage
from varos_warp.render.image.films import tile_pixels


def without_noise(radiance: np.ndarray, layers: dict[str, np.ndarray] | None = None) -> RadianceImage:
    """An image that is known."""
    blocks = np.zeros((*tile_pixels(*radiance.shape[:2]).shape, 3), np.float32)
    return RadianceImage(radiance, np.zeros_like(radiance), blocks, layers or {})


BLOCKS_AROUND = 5
"""Side [blocks] of the squares over which the variance of blocks is averaged: 25 estimates tell an error to 14 %."""


def block_error(variance: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Standard errors of blocks from single estimates of their variance (kernels/film `tile_variances`).

    Args:
        variance: [h, w, 3].
        pixels: How many each has [h, w]: those that the edge cuts vary more.
    """
    if not np.isfinite(variance).all():
        return np.full(variance.shape, np.inf, np.float32)
    pixels = pixels[..., None]
    mean = uniform_filter(variance * pixels, (BLOCKS_AROUND, BLOCKS_AROUND, 1), mode="reflect") / pixels
    return np.sqrt(np.maximum(mean, 0.0)).astype(np.float32)


class Frame(SimpleNamespace):
    """What was asked for of one pose, by the letters of the image types; the rest is None.

    Args:
        images: What was rendered, by letter.

    Raises:
        TypeError: If there is no such image type.
    """

    A: RadianceImage | None
    B: RadianceImage | None
    C: NormalImage | None
    D: DepthImage | None
    S: SegmentImage | None
    P: RadianceImage | None
    F: FlowImage | None

    def __init__(self, **images: Any):
        if unknown := images.keys() - OUTPUTS.keys():
            raise TypeError(f"there are no images {', '.join(sorted(unknown))}")
        super().__init__(**dict.fromkeys(OUTPUTS) | images)
