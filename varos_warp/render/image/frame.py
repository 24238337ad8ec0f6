"""The images of a frame, as arrays on the host."""

from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import uniform_filter

from varos_warp.render.image.films import tile_pixels


@dataclass(frozen=True)
class RadianceImage:
    """Linear radiance [W/sr/m^2] before exposure, float32 [H, W, 3]; None where it was not asked for."""

    radiance: np.ndarray | None
    stderr: np.ndarray | None
    """Standard error of the mean; inf for one sample, but with the field, where neighbours tell it."""
    block_error: np.ndarray | None = None
    """Standard error of the means of blocks of 8 x 8 pixels, float32 [H/8, W/8, 3], the last ones cut by the edge.
    What neighbours have in common of their errors counts here, and not in ``stderr``."""
    layers: dict[str, np.ndarray] = field(default_factory=dict)
    """Of A: direct, single, multiple; those that were asked for, and they sum to ``radiance``."""
    correction: np.ndarray | None = None
    """Of A: what subpaths carry, and with the field of open water what is blocked of single scattering; nearly all of
    the noise. With the field it may be negative. It is contained in the layers single and multiple."""
    base_variance: np.ndarray | None = None
    """Estimate from each pixel's own samples of the variance of the mean of all but the correction, for denoising; inf
    for one sample."""
    albedo: np.ndarray | None = None
    normal: np.ndarray | None = None
    """Guides for denoising B, or the correction of A with the field: what the surface reflects, at the pixel's centre
    or, for B where nothing blurs it, as the mean over its samples; and the surface's normal at the centre, in the world
    as in C. Both are zero where nothing is hit, but in that mean the albedo is 1 there. Of A they count in proportion
    to the surface's direct light in all but the correction; the water's albedo 1 and no normal count for the rest."""
    denoised: np.ndarray | None = None
    """The radiance with less noise, where that was asked for."""
    spp: float | None = None
    """Samples per pixel, mean over the image."""
    lost_samples: int = 0
    """Least number of samples that were infinite or not a number. They count as black, with a warning."""


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


@dataclass(frozen=True)
class NormalImage:
    """World normals towards the camera, float32 [H, W, 3]; zeros where nothing is hit."""

    normal: np.ndarray


@dataclass(frozen=True)
class DepthImage:
    """Distances [m] of the pixel centres' first hits, float32 [H, W]; inf where nothing is hit."""

    depth: np.ndarray
    """Planar, along the camera's z axis."""
    range: np.ndarray
    """Along the ray."""


@dataclass(frozen=True)
class SegmentImage:
    """What the pixel centres' rays hit first, int32 [H, W]; 0 where nothing is hit. See `FrameRenderer.segments`."""

    instance: np.ndarray
    """Number of the terrain or object, from 1."""
    material_ids: np.ndarray
    """Number of the material of each instance in the scene file, from 1, and of nothing (0), int32 [N + 1]; 0: none."""

    @property
    def material(self) -> np.ndarray:
        """Number of the material that each ray hits, as ``instance``."""
        return self.material_ids[self.instance]


@dataclass(frozen=True)
class FlowImage:
    """Where what the pixel centres see is seen in the next frame of the same camera, also on objects that move."""

    flow: np.ndarray
    """Its image point there less the pixel's centre, to the right and down, float32 [H, W, 2] [pixels]; NaN where
    nothing is hit, or where the camera cannot see it (behind it, or past its port). It may leave the image."""
    occluded: np.ndarray
    """Whether something hides it there, bool [H, W]; False where the flow is not known."""
    motion: np.ndarray
    """Scene flow: its place in the axes of the next frame's camera less that in this one's, float32 [H, W, 3] [m]; NaN
    where nothing is hit."""

    @property
    def valid(self) -> np.ndarray:
        """Where the flow is known, bool [H, W]: also of what is hidden or outside of the image in the next frame."""
        return np.isfinite(self.flow[..., 0])


@dataclass(frozen=True)
class Frame:
    """What was asked for of one pose; the rest is None."""

    A: RadianceImage | None = None
    B: RadianceImage | None = None
    C: NormalImage | None = None
    D: DepthImage | None = None
    S: SegmentImage | None = None
    P: RadianceImage | None = None
    F: FlowImage | None = None
