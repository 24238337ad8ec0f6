"""THE table of image types A, B, C, D, S, P and F: what each holds, how it becomes the pixels of a file, and back.

A, B and P: linear radiance -> half-float EXR -> times the exposure gain -> sRGB curve -> 8 bit RGB PNG (paper 3.2.1).
C: world normals, [-1, 1] -> [0, 255]. D: distance, `depth_range_m` -> [0, 65535] (paper eq. (1) and 4.1).
S: number of the object, 0 where there is none. F: optical flow as in KITTI. CONTRIBUTING.md lists what else a new type
needs.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from varos_warp.errors import warn
from varos_warp.scene.images import srgb_to_linear

HALF_MAX = 65504.0
"""Largest finite half float."""
HALF_NORMAL = 2.0**-14
"""Smallest half float with all its digits; below 2^-25 there is only 0."""
SEGMENT_LEVELS = 65535
"""Most objects that S can number."""
FLOW_STEPS, FLOW_ZERO = 64.0, 32768
"""Of F: steps a pixel, and the value of no motion (KITTI's)."""
DEPTH_LEVELS = 65535
"""Highest value of D: at or beyond the end of the depth range, or nothing hit."""


def srgb_oetf(linear: np.ndarray) -> np.ndarray:
    """Linear light in [0, 1] to the sRGB curve (IEC 61966-2-1); what lies outside is clipped."""
    linear = np.clip(linear, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def to_half(radiance: np.ndarray) -> tuple[np.ndarray, int]:
    """Half floats of linear radiance, and how many values above 65504 were cut to it.

    Warns of an image that is not black but too dark for half floats, which then is black, or has steps.

    Raises:
        ValueError: If a value is NaN.
    """
    _refuse_nan(radiance)
    clamped = int(np.count_nonzero(np.abs(radiance) > HALF_MAX))
    if 0.0 < np.max(radiance, initial=0.0) < HALF_NORMAL:
        warn(f"an image is darker than {HALF_NORMAL:.1g} W/sr/m^2 everywhere: half floats lose its digits, "
             "and below 3e-8 its light; brighter lights would help")
    return np.clip(radiance, -HALF_MAX, HALF_MAX).astype(np.float16), clamped


def encode_color(radiance: np.ndarray, gain: float) -> np.ndarray:
    """uint8 [H, W, 3] of linear radiance [H, W, 3] after exposure with ``gain``."""
    _refuse_nan(radiance)
    with np.errstate(over="ignore"):
        return np.rint(255.0 * srgb_oetf(np.asarray(radiance, np.float32) * np.float32(gain))).astype(np.uint8)


def decode_color(pixels: np.ndarray, gain: float) -> np.ndarray:
    """Linear radiance float32 [H, W, 3] of an 8 bit image; exact to its rounding, 255 stands for anything above."""
    return np.take((srgb_to_linear(np.arange(256) / 255.0) / gain).astype(np.float32), pixels, mode="clip")


def encode_normal(normal: np.ndarray, _scale: None = None) -> np.ndarray:
    """uint8 [H, W, 3] of world normals; where nothing was hit (the zero vector) it is (0, 0, 0)."""
    _refuse_nan(normal)
    pixels = np.rint((np.clip(normal, -1.0, 1.0) + 1.0) * 127.5).astype(np.uint8)
    x, y, z = np.moveaxis(normal, -1, 0)
    pixels[(x == 0.0) & (y == 0.0) & (z == 0.0)] = 0  # `any` over an axis of 3 takes ten times longer
    return pixels


def decode_normal(pixels: np.ndarray, _scale: None = None) -> np.ndarray:
    """Unit world normals float32 [H, W, 3], good to about 0.4 degrees; zero where nothing was hit."""
    normal = 2.0 * pixels.astype(np.float32) - 255.0  # odd whole numbers: exact, and never of length 0
    scale = 1.0 / np.sqrt(np.einsum("...i,...i", normal, normal))  # sums over an axis of 3 are slow in numpy
    scale[(pixels[..., 0] | pixels[..., 1] | pixels[..., 2]) == 0] = 0.0
    normal *= scale[..., None]
    return normal


def encode_depth(depth: np.ndarray, depth_range_m: tuple[float, float]) -> np.ndarray:
    """uint16 [H, W] of distances [m] (paper eq. (1)): 0..65535 over the range, what lies outside is clamped.

    Planar depths below 0, of what a wide fisheye sees behind its lens, have no place in the range: 65535, as nothing.
    """
    _refuse_nan(depth)
    start, end = depth_range_m
    share = np.clip((np.asarray(depth, float) - start) / (end - start), 0.0, 1.0)
    return np.where(depth < 0.0, DEPTH_LEVELS, np.rint(share * DEPTH_LEVELS)).astype(np.uint16)


def decode_depth(pixels: np.ndarray, depth_range_m: tuple[float, float]) -> np.ndarray:
    """Distances [m] float32 [H, W], good to half a step of eq. (1); inf at or beyond the end of the range."""
    start, end = depth_range_m
    depth = start + pixels.astype(float) * ((end - start) / DEPTH_LEVELS)
    return np.where(pixels == DEPTH_LEVELS, np.inf, depth).astype(np.float32)


def encode_segments(instance: np.ndarray, _scale: None = None) -> np.ndarray:
    """uint16 [H, W] of the numbers of objects."""
    return np.asarray(instance).astype(np.uint16)


def decode_segments(pixels: np.ndarray, _scale: None = None) -> np.ndarray:
    """Numbers of objects int32 [H, W]; 0 where nothing was hit."""
    return pixels.astype(np.int32)


def encode_flow(flow: np.ndarray, _scale: None = None) -> np.ndarray:
    """uint16 [H, W, 3] of optical flow [H, W, 2] [pixels]: 64 u + 2^15, 64 v + 2^15, and 1 (KITTI's development kit).

    All three are 0 where the flow is not known (NaN) or beyond what 16 bits hold, about 512 pixels.
    """
    steps = np.rint(np.asarray(flow, float) * FLOW_STEPS) + FLOW_ZERO
    known = ((steps >= 0) & (steps <= 65535)).all(-1, keepdims=True)  # not where it is NaN
    return np.concatenate([np.where(known, steps, 0.0), known], -1).astype(np.uint16)


def decode_flow(pixels: np.ndarray, _scale: None = None) -> np.ndarray:
    """Optical flow float32 [H, W, 2] [pixels], good to 1/128; NaN where it is not known."""
    flow = (pixels[..., :2].astype(np.float32) - FLOW_ZERO) / np.float32(FLOW_STEPS)
    flow[pixels[..., 2] == 0] = np.nan
    return flow


@dataclass(frozen=True)
class Output:
    """One row of the table."""

    letter: str
    content: str
    """The paper's words (table 6)."""
    channels: int
    dtype: type
    """Of the PNG (table 4)."""
    is_color: bool
    """Linear radiance, which has an EXR and an exposure."""
    encode: Callable[..., np.ndarray]
    """(image, scale) -> pixels; the scale is the gain of A, B and P, the depth range of D, None for C, S and F."""
    decode: Callable[..., np.ndarray]
    """(pixels, scale) -> image."""
    like: str = ""
    """Another letter, with whose samples, denoiser and exposure it is made."""

    @property
    def settings(self) -> str:
        """The letter under which the scene says how it is made."""
        return self.like or self.letter


OUTPUTS = {row.letter: row for row in (
    Output("A", "RGB image with water", 3, np.uint8, True, encode_color, decode_color),
    Output("B", "RGB image without water", 3, np.uint8, True, encode_color, decode_color),
    Output("C", "World space normal image", 3, np.uint8, False, encode_normal, decode_normal),
    Output("D", "Depth map with distance to each pixel", 1, np.uint16, False, encode_depth, decode_depth),
    Output("S", "Number of the object in each pixel", 1, np.uint16, False, encode_segments, decode_segments),
    Output("P", "A without port, lens distortion and vignetting", 3, np.uint8, True, encode_color, decode_color,
           like="A"),
    Output("F", "Optical flow to the next frame", 3, np.uint16, False, encode_flow, decode_flow),
)}


def linear_channels(image) -> dict[str, np.ndarray]:
    """Channels of the float32 EXR of a `RadianceImage` A or P: RGB, ``stderr.R`` ... and a triple for each layer."""
    layers = {f"{name}.": layer for name, layer in image.layers.items()}
    triples = {"": image.radiance, "stderr.": image.stderr} | layers
    channels = {}
    for prefix, values in triples.items():
        _refuse_nan(values)
        channels |= {f"{prefix}{c}": np.ascontiguousarray(values[..., i], np.float32) for i, c in enumerate("RGB")}
    return channels


def flow_channels(image) -> dict[str, np.ndarray]:
    """Channels of the float32 EXR of a `FlowImage`: ``flow.u``, ``flow.v``, ``motion.x`` ..., ``occluded`` (0 or 1)."""
    planes = {"flow.u": image.flow[..., 0], "flow.v": image.flow[..., 1], "occluded": image.occluded}
    planes |= {f"motion.{axis}": image.motion[..., i] for i, axis in enumerate("xyz")}
    return {name: np.ascontiguousarray(plane, np.float32) for name, plane in planes.items()}


def _refuse_nan(image: np.ndarray) -> None:
    if np.isnan(image).any():
        first = ", ".join(map(str, np.argwhere(np.isnan(image))[0]))
        raise ValueError(f"the image has {np.isnan(image).sum()} NaN values, the first at [{first}]")
