"""Images A, B and P: linear radiance, which is denoised, exposed and curved (paper 3.2.1).

Linear radiance -> half-float EXR -> times the exposure gain -> sRGB curve -> 8 bit RGB PNG.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from varos_warp.errors import warn
from varos_warp.products.images.nan import refuse_nan
from varos_warp.products.images.protocol import FrameFiles, ImageProduct, Source
from varos_warp.products.images.snow import Snow
from varos_warp.scene.description import Scene
from varos_warp.scene.description.image_types import AMBIENT, TWIN, WATER
from varos_warp.scene.description.looks import LOOKS_OF_WATER
from varos_warp.scene.description.optics import twin
from varos_warp.scene.description.vehicle import Camera
from varos_warp.scene.images import srgb_to_linear

HALF_MAX = 65504.0
"""Largest finite half float."""
HALF_NORMAL = 2.0**-14
"""Smallest half float with all its digits; below 2^-25 there is only 0."""


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
    """Layers of A: direct, single, multiple, and snow where there are particles; those that were asked for, and they
    sum to ``radiance``."""
    correction: np.ndarray | None = None
    """Part of A that subpaths carry, and with the field of open water what is blocked of single scattering; nearly all
    of the noise. With the field it may be negative. It is contained in the layers single and multiple."""
    base_variance: np.ndarray | None = None
    """Estimate from each pixel's own samples of the variance of the mean of all but the correction, for denoising; inf
    for one sample."""
    albedo: np.ndarray | None = None
    normal: np.ndarray | None = None
    """Guides for denoising the correction of A with the field, or B where an exposure blurs it: what the surface
    reflects at the pixel's centre, and its normal there, in the world as in C; zero where nothing is hit. Of A they
    count in proportion to the surface's direct light in all but the correction; the water's albedo 1 and no normal
    count for the rest. Of B that nothing blurs, the albedo is the mean over its samples, 1 where nothing is hit, and
    there is no normal: the image is divided by it for denoising."""
    denoised: np.ndarray | None = None
    """The radiance with less noise, where that was asked for."""
    snow: Snow | None = None
    """Bodies that ``radiance`` and ``denoised`` have in front of the water; no denoiser touches them.
    None on a GPU that gives away nothing but what is done (``copied``)."""
    spp: float | None = None
    """Samples per pixel, mean over the image."""
    subpaths: float = np.inf
    """Subpaths per pixel, mean over the image, of which ``correction`` is the mean; infinite without any."""
    lost_samples: int = 0
    """Least number of samples that were infinite or not a number. They count as black, with a warning."""

    def without_snow(self) -> "RadianceImage":
        """The image of the water without bodies, not denoised."""
        taken_out = self.radiance
        if self.snow is not None and taken_out is not None:
            taken_out = self.snow.taken_out(taken_out)
        return replace(self, radiance=taken_out, snow=None, denoised=None)


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
    refuse_nan(radiance)
    clamped = int(np.count_nonzero(np.abs(radiance) > HALF_MAX))
    if 0.0 < np.max(radiance, initial=0.0) < HALF_NORMAL:
        warn(
            f"an image is darker than {HALF_NORMAL:.1g} W/sr/m^2 everywhere: half floats lose its digits, "
            "and below 3e-8 its light; brighter lights would help"
        )
    return np.clip(radiance, -HALF_MAX, HALF_MAX).astype(np.float16), clamped


def in_srgb(channels: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """Linear sRGB float32 [..., 3] of a camera's channels [..., 3], by its colour matrix [3, 3].

    Products and sums of float32, which every machine rounds alike.
    """
    r, g, b = np.moveaxis(np.asarray(channels, np.float32), -1, 0)
    return np.stack([row[0] * r + row[1] * g + row[2] * b for row in np.asarray(matrix, np.float32)], axis=-1)


def exposed(radiance: np.ndarray, gain: ArrayLike, matrix: np.ndarray | None = None) -> np.ndarray:
    """Linear values float32 [..., 3], 1 is white, of radiance by a gain, or one for each channel, and a colour matrix.

    White balance is of the camera's own channels, so it comes before their matrix.
    """
    with np.errstate(over="ignore"):
        gain, linear = np.asarray(gain, np.float32), np.asarray(radiance, np.float32)
        if matrix is None:
            return linear * gain
        return in_srgb(linear * gain, matrix) if gain.ndim else in_srgb(linear, matrix) * gain


def encode_color(radiance: np.ndarray, gain: ArrayLike, matrix: np.ndarray | None = None) -> np.ndarray:
    """uint8 [H, W, 3] of linear radiance [H, W, 3] after exposure with ``gain``, and by a colour matrix if any."""
    refuse_nan(radiance)
    return np.rint(255.0 * srgb_oetf(exposed(radiance, gain, matrix))).astype(np.uint8)


def decode_color(pixels: np.ndarray, gain: ArrayLike, matrix: np.ndarray | None = None) -> np.ndarray:
    """Linear radiance float32 [H, W, 3] of an 8 bit image; exact to its rounding, 255 stands for anything above."""
    if matrix is not None and np.ndim(gain):
        return (in_srgb(decode_color(pixels, 1.0), np.linalg.inv(matrix)) / np.asarray(gain)).astype(np.float32)
    if matrix is not None:
        return in_srgb(decode_color(pixels, gain), np.linalg.inv(matrix))
    linear = srgb_to_linear(np.arange(256) / 255.0)[:, None] / np.asarray(gain)
    return by_value(linear.astype(np.float32), pixels)


def by_value(table: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """What a table [values, 1 or 3] has at numbers [H, W, 3], for all channels or for each."""
    if table.shape[1] == 1:
        return np.take(table[:, 0], numbers, mode="clip")
    return np.stack([np.take(table[:, c], numbers[..., c], mode="clip") for c in range(3)], axis=-1)


class Radiance(ImageProduct):
    """What the three have in common."""

    channels, dtype, is_color = 3, np.uint8, True

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """Linear radiance float32 [H, W, 3] of 8 bits and a gain."""
        return decode_color(pixels, scale)

    def floats(self, image: Any) -> dict[str, np.ndarray]:
        """Channels of the image as it was rendered: RGB, ``stderr.R`` ... and a triple for each layer."""
        layers = {f"{name}.": layer for name, layer in image.layers.items()}
        triples = {"": image.radiance, "stderr.": image.stderr} | layers
        channels: dict[str, np.ndarray] = {}
        for prefix, values in triples.items():
            refuse_nan(values)
            channels |= {f"{prefix}{c}": np.ascontiguousarray(values[..., i], np.float32) for i, c in enumerate("RGB")}
        return channels

    def check(self, files: FrameFiles) -> Iterator[tuple[str, str]]:
        """The EXR has its size, finite values and errors, layers that sum to it; undenoised, the image is the EXR."""
        path = files.data.layout.linear(files.camera, files.frame, self.letter)
        if not path.is_file():
            return
        channels, name = files.exr(path), f"{path.parent.name}/{path.name}"
        if problem := _unreadable(channels, files.shape):
            yield name, problem
            return
        for c in "RGB":
            layers = [
                values.astype(float)
                for channel, values in channels.items()
                if channel.endswith(f".{c}") and not channel.startswith("stderr.")
            ]
            if layers and np.abs(sum(layers) - channels[c]).max() > 1e-4 * max(np.abs(channels[c]).max(), 1e-30):
                yield name, f"has layers that do not sum to channel {c}"
            if f"stderr.{c}" in channels and channels[f"stderr.{c}"].min() < 0.0:
                yield name, "has a negative standard error"
        if files.data.meta["samples"][self.denoise_key] == "none":
            made = to_half(np.stack([channels[c] for c in "RGB"], -1))[0]
            if not np.array_equal(made.astype(np.float32), files.data.linear(self.letter, files.frame, files.camera)):
                yield name, f"is not the image of {self.letter}_exr, though nothing was denoised"


def _unreadable(channels: dict[str, np.ndarray], shape: tuple[int, int]) -> str | None:
    """What keeps an image as it was rendered from being looked at."""
    if any(c.shape != shape for c in channels.values()):
        return "has another size"
    # one sample does not tell its error
    unsure = {channel for channel, c in channels.items() if channel.startswith("stderr.") and np.isposinf(c).all()}
    if not all(np.isfinite(channels[channel]).all() for channel in channels.keys() - unsure):
        return "has values that are not finite"
    missing = {"R", "G", "B"} - set(channels)
    return f"has no channel {sorted(missing)[0]}" if missing else None


class Water(Radiance):
    """Image A."""

    letter, content, method, released = WATER, "RGB image with water", "{water}", True
    source, denoise_key, bytes_a_pixel, parts = Source.WATER, "denoise", 4.0, ("radiance",)
    noise_key = "noise"
    folders: Mapping[str, str] = {"_linear": "linear_exr", "_exr": "", "": ""}
    convention = (
        "8 bit sRGB of linear radiance times the gain of camXX_exposure_A.csv; A_exr: linear, half float, denoised"
    )


class Ambient(Radiance):
    """Image B."""

    letter, content, method, released = AMBIENT, "RGB image without water", "{ambient}", True
    source, denoise_key, bytes_a_pixel, parts = Source.AMBIENT, "denoise_b", 5.0, ("radiance",)
    beside = LOOKS_OF_WATER
    folders: Mapping[str, str] = {"_exr": "", "": ""}
    constant_gain = 1.0
    """B is lit by ambient radiance 1: a reflectance of 0.5 becomes linear 0.5, which is 188 in the 8 bit image."""
    convention = "as A, without water, ambient light of radiance 1, no depth of field"


class Twin(Radiance):
    """Image P."""

    letter, content, method = TWIN, "A without port, lens distortion and vignetting", "{water}"
    like, blurs = WATER, False
    source, denoise_key, bytes_a_pixel, parts = Source.WATER, "denoise", 4.0, ("radiance",)
    folders: Mapping[str, str] = {"_linear": "linear_exr", "_exr": "", "": ""}
    convention = (
        "as A, without port, lens distortion, vignetting and what follows from them (radiance in the water, not at the "
        "sensor); its gain is that of A times green.weight in the middle of the image"
    )

    def seen_by(self, scene: Scene, camera: Camera) -> Camera:
        """Camera without port, distortion and vignetting; strobes light its image as they do A."""
        strobes = any(light.strobe for light in scene.lights)
        return twin(camera).model_copy(update={"exposure": camera.exposure}) if strobes else twin(camera)


WATER_IMAGE, AMBIENT_IMAGE, TWIN_IMAGE = Water(), Ambient(), Twin()
