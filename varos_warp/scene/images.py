"""sRGB images as linear reflectances."""

import contextlib
import logging
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from varos_warp.limits import check_limit

logging.getLogger("PIL").addHandler(logging.NullHandler())  # what it logs of damaged files: not to stderr

LARGEST = 8192
"""Longest side of an image [texels]; larger ones are reduced to it."""


@contextlib.contextmanager
def open_image(path: Path, key: str | None = None) -> Iterator[Image.Image]:
    """An image file whose pixels can be decoded without filling the memory.

    Raises:
        InputError: If it has more pixels than the limit.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit is ours
        with Image.open(path) as image:
            check_limit("TEXTURE_PIXELS", image.width * image.height, file=path, key=key)
            yield image


def decode_image(image: Image.Image) -> np.ndarray:
    """Linear reflectances, float32 [H, W, 3], of an sRGB image; sides become powers of two, at most LARGEST."""
    check_limit("TEXTURE_PIXELS", image.width * image.height)
    if image.mode in ("I;16", "I", "F"):  # gray of more than 8 bits, which Pillow would cut off
        values = np.asarray(image, np.float32)
        image = Image.fromarray(np.clip(values / max(65535.0, values.max()) * 255.0, 0, 255).astype(np.uint8))
    image = image.convert("RGB")
    size = tuple(min(1 << int(np.ceil(np.log2(side))), LARGEST) for side in image.size)
    if size != image.size:
        image = image.resize(size, Image.Resampling.BICUBIC)
    return _SRGB_TO_LINEAR[np.asarray(image)]


def srgb_to_linear(values: np.ndarray) -> np.ndarray:
    """Linear values of sRGB ones in 0..1 (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


_SRGB_TO_LINEAR = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)
