"""Image C: world normals of the first hits, [-1, 1] -> [0, 255]."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.nan import refuse_nan
from varos_warp.products.images.protocol import FirstHits, ImageProduct
from varos_warp.scene.description.image_types import NORMALS
from varos_warp.scene.description.looks import LOOKS


@dataclass(frozen=True)
class NormalImage:
    """World normals towards the camera, float32 [H, W, 3]; zeros where nothing is hit."""

    normal: np.ndarray


def encode_normal(normal: np.ndarray) -> np.ndarray:
    """uint8 [H, W, 3] of world normals; where nothing was hit (the zero vector) it is (0, 0, 0)."""
    refuse_nan(normal)
    pixels = np.rint((np.clip(normal, -1.0, 1.0) + 1.0) * 127.5).astype(np.uint8)
    x, y, z = np.moveaxis(normal, -1, 0)
    pixels[(x == 0.0) & (y == 0.0) & (z == 0.0)] = 0  # `any` over an axis of 3 takes ten times longer
    return pixels


def decode_normal(pixels: np.ndarray) -> np.ndarray:
    """Unit world normals float32 [H, W, 3], good to about 0.4 degrees; zero where nothing was hit."""
    normal = 2.0 * pixels.astype(np.float32) - 255.0  # odd whole numbers: exact, and never of length 0
    scale = 1.0 / np.sqrt(np.einsum("...i,...i", normal, normal))  # sums over an axis of 3 are slow in numpy
    scale[(pixels[..., 0] | pixels[..., 1] | pixels[..., 2]) == 0] = 0.0
    normal *= scale[..., None]
    return normal


class Normals(ImageProduct):
    """Image C."""

    letter, content, released = NORMALS, "World space normal image", True
    method = "first hits of pixel centres, smoothed normals"
    planes, channels, dtype, bytes_a_pixel = ("normal",), 3, np.uint8, 0.6
    beside = LOOKS
    convention = (
        "world normal n in [-1, 1] as round((n + 1) * 127.5); pixels (0, 0, 0) have no normal, nothing is hit there"
    )

    def of_hits(self, hits: FirstHits) -> NormalImage:
        """Normals of the first hits."""
        return NormalImage(hits.planes["normal"])

    def pixels(self, image: NormalImage, render: Any) -> np.ndarray:
        """Normals in 8 bits: `encode_normal`."""
        return encode_normal(image.normal)

    def is_empty(self, image: NormalImage, render: Any) -> bool:
        """Return whether nothing has a normal."""
        return not image.normal.any()

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Unit normals: `decode_normal`."""
        return decode_normal(pixels)


NORMAL_IMAGE = Normals()
