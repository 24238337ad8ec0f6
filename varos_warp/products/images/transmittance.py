"""Image T: the share of light that the water lets through between the camera and what it sees."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.nan import refuse_nan
from varos_warp.products.images.protocol import FirstHits, FrameFiles, ImageProduct
from varos_warp.products.images.radiance import encode_color
from varos_warp.scene.description.image_types import DEPTH
from varos_warp.scene.passes import BandWater

HALF_STEP = 0.51
"""Largest error of D in its steps: its rounding, and a little for that of its float32."""
ROUNDING = 2.0**-22
"""Share by which one channel of T may be off by another: twice what their two roundings to float32 make."""
LEAST = 1e-30
"""Value below which float32 loses the digits of T."""


@dataclass(frozen=True)
class TransmittanceImage:
    """What is left of light that comes from the first hit: neither absorbed nor scattered on its way to the camera."""

    transmittance: np.ndarray
    """exp(-sigma_t r) in channels R, G, B, float32 [H, W, 3], with the distance r that image D has by the kind
    ``range``: from where the ray of the pixel's centre enters the water; 0 where nothing is hit. In water by
    wavelength, the mean over what the channel sees of white light of the first lamp."""


class Transmittance(ImageProduct):
    """Image T."""

    letter, content = "T", "Transmittance of the water to each pixel"
    method = "first hits of pixel centres, extinction of the water"
    planes, channels, dtype, bytes_a_pixel, suffix = ("distance",), 3, np.float32, 9.0, ".exr"
    convention = (
        "exp(-sigma_t r), float32 EXR, channels R, G, B: the share of light from what the pixel's centre sees that the "
        "water lets through; r is its distance along the ray in the water (channel range of D_exr), also "
        "beyond depth.range_m; 0: nothing hit"
    )
    readme = """IMAGES T (vehicle{VEHICLE}/cam0/T, float32 EXR with channels R, G, B)
  exp(-sigma_t r) per channel: the share of light from what the pixel's centre sees that reaches the camera, neither
  absorbed nor scattered; r is the distance along the ray in the water, from the port if there is one (channel range of
  D_exr), also beyond the range of D. 0: nothing hit. sigma_t stands in dataset.json under water. In water by
  wavelength it is the mean of exp(-c r) over what the channel sees of white light of the first lamp: the sum over the
  camera's bands of white times exp(-(a + b) r) (dataset.json, water.bands). -ln(T) / r then falls with r.
"""

    def of_hits(self, hits: FirstHits) -> TransmittanceImage:
        """Transmittance by the law of Beer and Lambert: the water is the same everywhere."""
        distance = hits.planes["distance"]
        hit = np.isfinite(distance)
        found = np.where(hit[..., None], hits.water.left(np.where(hit, distance, 0.0)), 0.0)
        return TransmittanceImage(found.astype(np.float32))

    def pixels(self, image: TransmittanceImage, render: Any) -> np.ndarray:
        """Transmittance as it is, never NaN."""
        refuse_nan(image.transmittance)
        return image.transmittance

    def is_empty(self, image: TransmittanceImage, render: Any) -> bool:
        """Return whether nothing is hit, or is too far to be seen."""
        return not image.transmittance.any()

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """It is from 0 to 1, all channels are those of one distance in the water, and it is D's where there is D."""
        found, name = files.pixels(self.letter).astype(float), files.file(self.letter).name
        if not ((found >= 0.0) & (found <= 1.0)).all():
            yield name, "has values that are not between 0 and 1"
            return
        water = files.data.meta["water"]
        if "bands" in water:
            yield from self._against_bands(files, found)
            return
        sigma_t = np.add(water["sigma_a"], water["sigma_s"])
        strongest = int(np.argmax(sigma_t))
        known = found[..., strongest] > LEAST
        if not sigma_t.any():
            if not np.isin(found, (0.0, 1.0)).all():
                yield name, "is not 1, though the water lets all light through"
            elif DEPTH in files.data.outputs:
                yield from self._against_surfaces(files, found[..., 0] > 0.0, 0.0)
            return
        distance = np.where(known, -np.log(np.where(known, found[..., strongest], 1.0)) / sigma_t[strongest], np.inf)
        made = np.exp(-sigma_t * np.where(known, distance, 0.0)[..., None])
        if count := np.count_nonzero(known & (np.abs(found - made) > ROUNDING * made).any(-1)):
            yield name, f"has channels in {count} pixels that no distance in this water makes"
        if DEPTH in files.data.outputs:
            yield from self._against_depth(files, distance, known, ROUNDING / sigma_t[strongest])
            yield from self._against_surfaces(files, known, sigma_t[strongest])

    def _against_bands(self, files: FrameFiles, found: np.ndarray) -> Iterator[tuple[str, str]]:
        """What is not what the bands of the camera let through over the distances of D, if there is D."""
        if DEPTH not in files.data.outputs:
            return
        water = BandWater.of(files.data.meta["water"], files.camera)
        nowhere = np.zeros(files.shape)
        at_port = files.along_axis(nowhere)
        along = files.along_axis(nowhere + 1.0) - at_port
        known = np.isfinite(files.planar) & (files.planar > at_port)
        distance = np.where(known, (files.planar - at_port) / along, 0.0)
        slack = (HALF_STEP * files.data.meta["depth"]["scale_m"] + 1e-5 * distance) / along
        made = water.left(distance)
        limit = (water.sigma_t.max() * slack[..., None] + ROUNDING) * made + LEAST
        if count := np.count_nonzero(known & (np.abs(found - made) > limit).any(-1)):
            yield files.file(self.letter).name, f"has another distance than D in {count} pixels"

    def _against_depth(
        self, files: FrameFiles, distance: np.ndarray, known: np.ndarray, slack_m: float
    ) -> Iterator[tuple[str, str]]:
        """What is wrong with the distances [m] of T where they are ``known``, beside those of D."""
        planar, seen = files.planar, files.along_axis(distance)
        both, depth = known & np.isfinite(planar), files.data.meta["depth"]
        limit = HALF_STEP * depth["scale_m"] + slack_m + 1e-5 * np.abs(np.where(known, seen, 0.0))
        if count := np.count_nonzero(np.abs(seen[both] - planar[both]) > limit[both]):
            yield files.file(self.letter).name, f"has another distance than D in {count} pixels"
        within = (seen if depth["kind"] == "z" else distance) < depth["range_m"][1] - limit
        if count := np.count_nonzero(known & ~np.isfinite(planar) & within):
            yield files.file(self.letter).name, f"has a surface in {count} pixels where D has none"

    def _against_surfaces(self, files: FrameFiles, known: np.ndarray, sigma_t: float) -> Iterator[tuple[str, str]]:
        """What is 0, not ``known``, though the surface of D there is near enough for light to get through."""
        nowhere = np.zeros(files.shape)
        at_port = files.along_axis(nowhere)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            distance = (files.planar - at_port) / (files.along_axis(nowhere + 1.0) - at_port)
            lost = ~known & np.isfinite(distance) & (np.exp(-sigma_t * distance) > 2.0 * LEAST)
        if count := np.count_nonzero(lost):
            yield files.file(self.letter).name, f"is 0 in {count} pixels where D has a surface"

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """1 is white, by the sRGB curve."""
        return encode_color(pixels, 1.0)


TRANSMITTANCE_IMAGE = Transmittance()
