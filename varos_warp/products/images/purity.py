"""Image U: the share of each pixel that shows the object that image S names at its centre."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.protocol import FirstHits, FrameFiles, ImageProduct
from varos_warp.scene.description.image_types import SEGMENTS
from varos_warp.scene.description.looks import LOOKS

RAYS = 32
"""Rays of a pixel, whose share U is; as in kernels/transport/purity.py."""
LEVELS = np.rint(255.0 * np.arange(RAYS + 1) / RAYS).astype(np.uint8)
"""Values that U has."""
FEWEST = 20
"""Places at borders of S by which U is judged."""


@dataclass(frozen=True)
class PurityImage:
    """How much of each pixel is of one object."""

    purity: np.ndarray
    """Share of the pixel's samples that hit first what its centre hits, or nothing where that is nothing, float32
    [H, W] in [0, 1]."""


class Purity(ImageProduct):
    """Image U."""

    letter, content = "U", "Purity: share of the pixel that shows its object of S"
    method = f"first hits of {RAYS} rays over each pixel, its lens and its exposure"
    rays, planes, channels, dtype, bytes_a_pixel = RAYS, ("purity",), 1, np.uint8, 0.1
    beside = tuple(key for key in LOOKS if not key.endswith("lights"))  # a strobe decides when a shutter sees
    convention = (
        f"round(255 p), 8 bit: p is the share of the pixel (of {RAYS} rays over its area, the aperture and the "
        "exposure, as A is made) whose first hit is the object that S names there; where S is 0, that hits nothing"
    )
    readme = """IMAGES U (vehicle{VEHICLE}/cam0/U, 8 bit)
  Purity: the share, 0 to 255, of what A averages over a pixel that shows the object which S names at its centre; where
  S is 0, that shows nothing. Below 255 a pixel is mixed: edges, things thinner than a pixel, blur of the lens and of
  motion. C, D and S hold for its centre only.
"""

    def of_hits(self, hits: FirstHits) -> PurityImage:
        """Purity as it was traced."""
        return PurityImage(hits.planes["purity"])

    def pixels(self, image: PurityImage, render: Any) -> np.ndarray:
        """uint8 [H, W]; 255 is the whole pixel."""
        return np.rint(255.0 * image.purity).astype(np.uint8)

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Share float32 [H, W]."""
        return pixels.astype(np.float32) / np.float32(255.0)

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """Its values are shares of so many rays, and pixels are mixed where S has borders rather than elsewhere."""
        pixels, name = files.pixels(self.letter), files.file(self.letter).name
        if count := np.count_nonzero(~np.isin(pixels, LEVELS)):
            yield name, f"has values in {count} pixels that are no shares of {RAYS} rays"
        if SEGMENTS not in files.data.outputs:
            return
        border, steps, inside = _places(files.pixels(SEGMENTS))
        mixed = 255.0 - pixels
        if np.count_nonzero(steps) >= FEWEST and not mixed[border].any():
            yield name, "has no mixed pixel, though S has borders that cross some"
        elif (
            np.count_nonzero(border) >= FEWEST
            and np.count_nonzero(inside) >= FEWEST
            and mixed[border].mean() < mixed[inside].mean()
        ):
            yield name, "has pixels that are more mixed inside the objects of S than at their borders"

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """Grey: white is pure."""
        return np.repeat(pixels[..., None], 3, -1)


def _places(labels: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masks of S [H, W]: pixels beside others, bool [H, W]; steps of borders, [H - 1, W - 1]; and pixels far from any.

    A border that has steps, three pixels of four on one side, runs across pixels: one along a row or a column may run
    between them.
    """
    across, down = labels[:, 1:] != labels[:, :-1], labels[1:] != labels[:-1]
    border = np.zeros(labels.shape, bool)
    for pixels, change in ((border[:, 1:], across), (border[:, :-1], across), (border[1:], down), (border[:-1], down)):
        pixels |= change
    changes = across[1:].astype(int) + across[:-1] + down[:, 1:] + down[:, :-1]
    far = ~border
    for shift in (1, -1):
        for axis in (0, 1):
            far &= ~np.roll(border, shift, axis)
    return border, changes == 2, far


PURITY_IMAGE = Purity()
