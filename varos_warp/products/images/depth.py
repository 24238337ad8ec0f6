"""Image D: distance of the first hits, ``depth_range_m`` -> [0, 65535] (paper eq. (1) and 4.1)."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.nan import refuse_nan
from varos_warp.products.images.protocol import FirstHits, FrameFiles, ImageProduct
from varos_warp.scene.description.image_types import DEPTH
from varos_warp.scene.description.looks import LOOKS

DEPTH_LEVELS = 65535
"""Highest value of D: at or beyond the end of the depth range, or nothing hit."""
FEWEST_LEVELS = 40
"""Levels of D that are all even by chance once in 2^39 images."""


@dataclass(frozen=True)
class DepthImage:
    """Distances [m] of the pixel centres' first hits, float32 [H, W]; inf where nothing is hit."""

    depth: np.ndarray
    """Planar depth, along the camera's z axis."""
    range: np.ndarray
    """Distance along the ray."""


def encode_depth(depth: np.ndarray, depth_range_m: tuple[float, float]) -> np.ndarray:
    """uint16 [H, W] of distances [m] (paper eq. (1)): 0..65535 over the range, what lies outside is clamped.

    Planar depths below 0, of what a wide fisheye sees behind its lens, have no place in the range: 65535, as nothing.
    """
    refuse_nan(depth)
    start, end = depth_range_m
    share = np.clip((np.asarray(depth, float) - start) / (end - start), 0.0, 1.0)
    return np.where(depth < 0.0, DEPTH_LEVELS, np.rint(share * DEPTH_LEVELS)).astype(np.uint16)


def decode_depth(pixels: np.ndarray, depth_range_m: tuple[float, float]) -> np.ndarray:
    """Distances [m] float32 [H, W], good to half a step of eq. (1); inf at or beyond the end of the range."""
    start, end = depth_range_m
    depth = start + pixels.astype(float) * ((end - start) / DEPTH_LEVELS)
    return np.where(pixels == DEPTH_LEVELS, np.inf, depth).astype(np.float32)


def level_step(depth: np.ndarray) -> int:
    """What all differences in D are multiples of: 256 of 8 bits in 16; 1 of sound images, or if levels are few."""
    levels = np.flatnonzero(np.bincount(depth.ravel())[:DEPTH_LEVELS])
    return int(np.gcd.reduce(np.diff(levels))) if len(levels) >= FEWEST_LEVELS else 1


class Depth(ImageProduct):
    """Image D."""

    letter, content, released = DEPTH, "Depth map with distance to each pixel", True
    method = "first hits of pixel centres"
    planes, channels, dtype, bytes_a_pixel = ("depth", "distance"), 1, np.uint16, 0.6
    beside = LOOKS
    folders: Mapping[str, str] = {"_exr": "depth_exr", "": ""}
    averages = False  # across an edge nothing has the mean of two distances
    convention = (
        "round((d - start) / (end - start) * 65535), clamped; 65535: at or beyond the end, or nothing hit; d is planar "
        "(along the camera's z) or range (along the ray), as depth.kind says"
    )

    def of_hits(self, hits: FirstHits) -> DepthImage:
        """Planar depth and range of the first hits."""
        return DepthImage(hits.planes["depth"], hits.planes["distance"])

    def pixels(self, image: DepthImage, render: Any) -> np.ndarray:
        """Depth in 16 bits, of the kind that is asked for: `encode_depth`."""
        return encode_depth(_of_kind(image, render), render.depth_range_m)

    def floats(self, image: DepthImage) -> dict[str, np.ndarray]:
        """Channels Z and range."""
        channels = {"Z": image.depth, "range": image.range}
        return {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}

    def is_empty(self, image: DepthImage, render: Any) -> bool:
        """Return whether nothing is within the range."""
        return not (_of_kind(image, render) < render.depth_range_m[1]).any()

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Distances [m]: `decode_depth`."""
        return decode_depth(pixels, scale)

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """It is its EXR in steps, where there is one, uses all of its 16 bits, and nothing is where the camera is."""
        levels, meta = files.pixels(DEPTH), files.data.meta["depth"]
        name, path = files.file(DEPTH).name, files.data.layout.exr(files.camera, DEPTH, files.frame)
        if path.is_file():
            made = encode_depth(files.exr(path)["Z" if meta["kind"] == "z" else "range"], meta["range_m"])
            if not np.array_equal(made, levels):
                yield name, "is not its EXR (D_exr) in steps of D"
        if (step := level_step(levels)) > 1:
            yield name, f"holds only one level in {step}, as if it had fewer than 16 bits"
        if meta["range_m"][0] == 0.0 and (levels == 0).any():
            yield name, f"is 0 m in {(levels == 0).sum()} pixels, the place of the camera itself"

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """Colours of D, even steps of its logarithm between two distances; black where nothing is within the range."""
        from matplotlib import colormaps

        hit, (start, end) = pixels < DEPTH_LEVELS, meta["depth"]["range_m"]
        depth = np.maximum(start + pixels * ((end - start) / DEPTH_LEVELS), 1e-4)
        near, far = near_far or ((depth[hit].min(), depth[hit].max() * 1.001) if hit.any() else (1.0, 2.0))
        share = np.log(far / depth) / np.log(far / near)
        colors = (colormaps["viridis"](np.clip(share, 0, 1))[..., :3] * 255).astype(np.uint8)
        colors[~hit] = 0
        return colors


def _of_kind(image: DepthImage, render: Any) -> np.ndarray:
    return image.depth if render.depth_kind == "z" else image.range


DEPTH_IMAGE = Depth()
