"""Image F: optical flow to the next frame, as in KITTI; render/image/flow.py computes it."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.protocol import FrameFiles, ImageProduct, Source
from varos_warp.scene.description.image_types import FLOW
from varos_warp.scene.description.looks import LOOKS

FLOW_STEPS, FLOW_ZERO = 64.0, 32768
"""Steps per pixel in F, and the value of no motion (KITTI's)."""


@dataclass(frozen=True)
class FlowImage:
    """Optical flow of what the pixel centres see, to the next frame of the same camera, also on objects that move."""

    flow: np.ndarray
    """Image point in the next frame less the pixel's centre, to the right and down, float32 [H, W, 2] [pixels]; NaN
    where nothing is hit, or where the camera cannot see it then (behind it, or past its port). It may leave the
    image."""
    occluded: np.ndarray
    """True where something hides it in the next frame, bool [H, W]; False where the flow is not known."""
    motion: np.ndarray
    """Scene flow: its place in the axes of the next frame's camera less that in this one's, float32 [H, W, 3] [m]; NaN
    where nothing is hit."""

    @property
    def valid(self) -> np.ndarray:
        """True where the flow is known, bool [H, W]: also of what is hidden or outside the image in the next frame."""
        return np.isfinite(self.flow[..., 0])


def encode_flow(flow: np.ndarray) -> np.ndarray:
    """uint16 [H, W, 3] of optical flow [H, W, 2] [pixels]: 64 u + 2^15, 64 v + 2^15, and 1 (KITTI's development kit).

    All three are 0 where the flow is not known (NaN) or beyond what 16 bits hold, about 512 pixels.
    """
    steps = np.rint(np.asarray(flow, float) * FLOW_STEPS) + FLOW_ZERO
    known = ((steps >= 0) & (steps <= 65535)).all(-1, keepdims=True)  # not where it is NaN
    return np.concatenate([np.where(known, steps, 0.0), known], -1).astype(np.uint16)


def flow_colors(flow: np.ndarray) -> np.ndarray:
    """uint8 [H, W, 3] of a flow [H, W, 2]: the wheel of Baker et al. (2011), white at rest, black where it is NaN.

    Hue is the direction: red to the right, yellow down, blue to the left, violet up. The 99 % quantile of the lengths
    has full colour.
    """
    known = np.isfinite(flow).all(-1)
    u, v = np.moveaxis(np.where(known[..., None], flow, 0.0), -1, 0)
    length = np.hypot(u, v)
    longest = max(float(np.quantile(length[known], 0.99)), 1e-6) if known.any() else 1.0
    turn = (np.arctan2(-v, -u) / np.pi + 1.0) / 2.0
    wheel = np.cumsum([0, 15, 6, 4, 11, 13, 6]) / 55  # red, yellow, green, cyan, blue, magenta, red
    hue = np.stack(
        [
            np.interp(turn, wheel, ends)
            for ends in ((1, 1, 0, 0, 0, 1, 1), (0, 1, 1, 1, 0, 0, 0), (0, 0, 0, 1, 1, 1, 0))
        ],
        -1,
    )
    colors = 1.0 - np.minimum(length / longest, 1.0)[..., None] * (1.0 - hue)
    return np.where(known[..., None], np.rint(255 * colors), 0).astype(np.uint8)


class Flow(ImageProduct):
    """Image F."""

    letter, content = FLOW, "Optical flow to the next frame"
    method = "first hits of pixel centres, seen again from the next pose"
    source, planes = Source.NEXT_FRAME, ("distance",)
    beside = LOOKS
    channels, dtype, bytes_a_pixel = 3, np.uint16, 12.0  # its EXR hardly compresses
    folders: Mapping[str, str] = {"_exr": "", "": ""}
    parts = ("occluded", "motion")
    averages = False  # across an edge nothing has the mean of two motions
    convention = (
        "optical flow of the pixel centres to the next frame of the sequence, one frame interval later, of a world "
        "that stands still: PNG of 16-bit R = 64 u + 2^15, G = 64 v + 2^15, B = 1 (KITTI; u right, v down, in pixels), "
        "all 0 where it is not known. F_exr, float32: flow.u, flow.v without steps; occluded, 1 where something nearer "
        "hides the point in the next frame; motion.x, y, z [m], the point in the axes of the next camera less that in "
        "those of this one; NaN is not known"
    )

    def pixels(self, image: FlowImage, render: Any) -> np.ndarray:
        """Flow in 16 bits: `encode_flow`."""
        return encode_flow(image.flow)

    def floats(self, image: FlowImage) -> dict[str, np.ndarray]:
        """Channels ``flow.u``, ``flow.v``, ``motion.x`` ..., ``occluded`` (0 or 1)."""
        planes = {"flow.u": image.flow[..., 0], "flow.v": image.flow[..., 1], "occluded": image.occluded}
        planes |= {f"motion.{axis}": image.motion[..., i] for i, axis in enumerate("xyz")}
        return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Optical flow float32 [H, W, 2] [pixels], good to 1/128; NaN where it is not known."""
        flow = (pixels[..., :2].astype(np.float32) - FLOW_ZERO) / np.float32(FLOW_STEPS)
        flow[pixels[..., 2] == 0] = np.nan
        return flow

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """It is its EXR in steps."""
        pixels, made = files.pixels(FLOW), files.flow
        name, exr = files.file(FLOW).name, files.data.layout.exr(files.camera, FLOW, files.frame).name
        if made.flow.shape[:2] != files.shape:
            yield exr, "has another size than its PNG"
            return
        if not np.array_equal(encode_flow(made.flow), pixels):
            yield name, "is not its EXR (F_exr) in steps of 1/64 pixel"
        if (made.occluded & ~made.valid).any():
            yield exr, "is occluded where its flow is not known"

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """Colours by direction and length: `flow_colors`."""
        return flow_colors(self.decode(pixels))


FLOW_IMAGE = Flow()
