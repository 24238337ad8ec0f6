"""Image N: where bodies in the water, such as marine snow, are seen, and the layer that they are of A."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.nan import refuse_nan
from varos_warp.products.images.protocol import FrameFiles, ImageProduct, Source
from varos_warp.scene.description.image_types import WATER


@dataclass(frozen=True)
class Snow:
    """Bodies in the water as a camera sees them; image A has them already."""

    added: np.ndarray
    """Radiance of the bodies less its mean, as far as they let that pass, float32 [H, W, 3] [W/sr/m^2]."""
    passed: np.ndarray
    """Share of the light from behind that they let pass, over its mean, float32 [H, W]."""
    coverage: np.ndarray | None = None
    """Share of the pixel that they cover, in sharp or blurred images, float32 [H, W]; may exceed 1. None, as all below,
    unless it was asked for."""
    flow: np.ndarray | None = None
    """Motion of the brightest body of a pixel to the next frame, float32 [H, W, 2] [pixels]; 0 where there is none.
    None: nobody knows the next frame."""
    light: np.ndarray | None = None
    """Radiance of the bodies alone, float32 [H, W, 3]; datasets do not have it."""

    def over(self, radiance: np.ndarray) -> np.ndarray:
        """Radiance with the bodies, of an image [H, W, 3] of water without any."""
        return radiance * self.passed[..., None] + self.added

    def taken_out(self, radiance: np.ndarray) -> np.ndarray:
        """Radiance without the bodies, of an image [H, W, 3] with them: the inverse of `over`."""
        return (radiance - self.added) / np.maximum(self.passed[..., None], 1e-6)


class SnowImage(ImageProduct):
    """Image N."""

    letter, content = "N", "Bodies in the water: share of the pixel that they cover"
    method = "bodies in cells of the water, lit by all lamps"
    source, like, channels, dtype, bytes_a_pixel = Source.PARTICLES, WATER, 1, np.uint8, 12.0
    folders: Mapping[str, str] = {"_exr": "", "": ""}
    convention = (
        "round(255 min(1, c)), 8 bit: c is the share of the pixel that bodies cover; N_exr: float32, RGB what they add "
        "to linear A, passed what they let pass of it (A = passed times the image without bodies plus RGB), flow.x and "
        "flow.y the motion of the pixel's brightest body to the next frame [pixels], 0 where it is not known"
    )
    readme = """IMAGES N (vehicle{VEHICLE}/cam0/N, 8 bit; N_exr, float32 EXR)
  Bodies in the water (marine snow), which image A shows and C, D, S, F do not: the share of the pixel, 0 to 255, that
  they cover. N_exr has what they add to linear A (R, G, B; negative where fewer are seen than in the mean), the share
  that they let pass of what is behind (passed), and the motion of the pixel's brightest body to the next frame (flow.x,
  flow.y [pixels], 0 where it is not known). A without bodies is (A - RGB) / passed.
"""

    def pixels(self, image: Snow, render: Any) -> np.ndarray:
        """uint8 [H, W]; 255 is the whole pixel."""
        if image.coverage is None:
            raise ValueError("the bodies were rendered for image A only")
        return np.rint(255.0 * np.minimum(image.coverage, 1.0)).astype(np.uint8)

    def floats(self, image: Snow) -> dict[str, np.ndarray]:
        """Channels R, G, B, passed, flow.x, flow.y."""
        flow = np.zeros((*image.passed.shape, 2), np.float32) if image.flow is None else image.flow
        planes = {
            **dict(zip("RGB", np.moveaxis(image.added, -1, 0), strict=True)),
            "passed": image.passed,
            "flow.x": flow[..., 0],
            "flow.y": flow[..., 1],
        }
        for plane in planes.values():
            refuse_nan(plane)
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Share float32 [H, W]."""
        return pixels.astype(np.float32) / np.float32(255.0)

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """Its EXR is whole, and nothing is let through more than by water without bodies."""
        path = files.data.layout.image_files(files.camera, self.letter, files.frame, {})["_exr"]
        channels, name = files.exr(path), f"{path.parent.name}/{path.name}"
        if missing := {*"RGB", "passed", "flow.x", "flow.y"} - channels.keys():
            yield name, f"has no channel {sorted(missing)[0]}"
            return
        if not all(np.isfinite(plane).all() for plane in channels.values()):
            yield name, "has values that are not finite"
        elif channels["passed"].min() < 0.0:
            yield name, "has a negative share of light that passes"

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """Grey: white is covered."""
        return np.repeat(pixels[..., None], 3, -1)


SNOW_IMAGE = SnowImage()
