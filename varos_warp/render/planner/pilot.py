"""A look at a few poses before a sequence is rendered: what the planner's predictions follow from.

Errors are relative RMSE per channel: the root of the mean square of what is wrong in an image, over its mean radiance
(see `adapt.brightness` for channels that are nearly black). None needs a reference: an image that is independent of
another one tells, on average, how far that one is from the truth.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import uniform_filter

from varos_warp.render.image.adapt import DARK, brightness
from varos_warp.render.image.denoise import denoise_image
from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera

SCOUT_POSES = 5
SCOUT_PIXELS, SCOUT_SPP = 160 * 90, 4
"""Size of an image that tells where the noise is; smaller ones get more samples per pixel, the same in all."""
PIXELS, LONG = 320 * 180, 1000
"""Most pixels of an image in which errors are measured, of a short sequence; one of so many frames is worth a pilot of
its own resolution. A larger image has more pixels for the same edges and details, so it needs fewer samples."""
SEED, TWIN_SEED = 1 << 31, 3 << 30
"""Random numbers of the pilot's images, and of the scout's twins: a scene's seed is below the first."""


@dataclass(frozen=True)
class View:
    """One image of the pilot, and where it was taken."""

    frame: int
    camera: Camera
    """With the resolution of the pilot."""
    T_w_v: np.ndarray
    image: Any
    """`RadianceImage` of A."""
    twin: Any
    """The same with other random numbers."""
    given_camera: Camera | None = None
    """With the resolution of the scene."""

    @property
    def label(self) -> str:
        """In words."""
        return f"frame {self.frame}, camera {self.camera.id}"


def pilot_camera(camera: Camera, pixels: int = SCOUT_PIXELS) -> Camera:
    """The same field of view with at most so many pixels."""
    scale = min(1.0, np.sqrt(pixels / np.prod(camera.resolution)))
    return camera.model_copy(update={"resolution": tuple(max(1, round(scale * side)) for side in camera.resolution)})


def judged_pixels(camera: Camera, frames: int) -> int:
    """Pixels of the images in which the errors of a sequence of so many frames are measured."""
    return max(PIXELS, round(min(1.0, frames / LONG) * np.prod(camera.resolution)))


def pilot_frames(count: int) -> list[int]:
    """A few frames of ``count``, evenly spread and with the first and the last."""
    return np.unique(np.linspace(0, count - 1, SCOUT_POSES).round().astype(int)).tolist()


def scout(scene: Scene, renderer, poses: Sequence[np.ndarray]) -> Iterator[View]:
    """A small image of a few poses through every camera."""
    render = scene.render
    for frame in pilot_frames(len(poses)):
        for given in scene.vehicle.cameras:
            camera = pilot_camera(given)
            spp = round(SCOUT_SPP * SCOUT_PIXELS / np.prod(camera.resolution))
            how = {"spp": spp, "max_scatterings": render.max_scatterings, "max_bounces": render.max_bounces,
                   "layers": tuple(render.layers), "frame": frame, "integrator": render.integrator}
            image = renderer.render(poses[frame], camera, "A", **how).A
            twin = renderer.render(poses[frame], camera, "A", seed=TWIN_SEED, **how).A
            yield View(frame, camera, poses[frame], image, twin, given)


def twins(renderer, view: View, **how) -> View:
    """A view with two images of A of its own."""
    image, twin = (renderer.render(view.T_w_v, view.camera, "A", seed=SEED + k, **how).A for k in range(2))
    return replace(view, image=image, twin=twin)


RARE = 1e-3
"""Share of the pixels that are left out where views are compared, those with most noise: one bright sample in one of a
scout's two images would else decide, by chance, and it says little of what the other views need."""


def scouted_noise(view: View, method: str, rare: float = RARE) -> np.ndarray:
    """Relative RMS [3] of the noise that a denoiser leaves in an image of the scout.

    Views are compared by it, not by that before it: what is noisy in many pixels at once, a denoiser finds easy, and
    rare pixels it does not.

    Args:
        view: Two images.
        method: Of denoising.
        rare: Share of the pixels, those with most noise, that do not count.
    """
    one, two = (denoise_image(image, method).astype(np.float64) for image in (view.image, view.twin))
    square = np.sort(0.5 * (one - two).reshape(-1, 3) ** 2, axis=0)
    return _relative(square[:max(1, int((1.0 - rare) * len(square)))].mean(0), np.array([one, two]))


# ------------------------------------------------------------------------------------------ errors without reference


FIREFLY = 3.0
"""A pixel of a judge that is brighter than so many times what it judges, there and around, is cut to that: what one
path in a million carries is beyond a pilot, and alone would decide. In the mean of the image it counts in full."""
AROUND = 9
"""Side [pixels] of what is around."""
BAND = 32
"""Rows that are judged at a time."""
SIGMAS = 1.0
JUDGED_TO = 0.2
"""Judges tell the square of an error if its standard error is at most this share of it."""


BLOCK, BLOCK_QUANTILE, BLOCKS_WITHIN = 8, 0.99, 5.0
"""A tolerance also asks that so large a share of the blocks of 8 x 8 pixels is within so many times itself."""


def error(images: Sequence[np.ndarray], judges: Sequence[np.ndarray],
          sigmas: float | Sequence[float] = SIGMAS) -> np.ndarray:
    """Relative RMSE [3] of images, from others that know nothing of them, nor of each other.

    With M, M' two independent unbiased images and D any other, the mean of (D - M)(D - M') is that of the square of D's
    error, noise, blur and all, however noisy the two are: what is wrong with them cancels. The upper end of what chance
    leaves open is taken. Where blocks of pixels are off by more than `BLOCKS_WITHIN` times that, they decide.

    Args:
        images: Radiance [H, W, 3] of each D.
        judges: Radiance of the others, two or more.
        sigmas: That end, in standard errors; of several the result is [sigmas, 3].
    """
    square, unsure = squared_error(images, judges)
    whole = _relative(square + np.asarray(sigmas)[..., None] * unsure, np.asarray(judges, np.float64))
    return np.maximum(whole, block_error(images, judges) / BLOCKS_WITHIN)


def block_error(images: Sequence[np.ndarray], judges: Sequence[np.ndarray]) -> np.ndarray:
    """Error [3] that `BLOCK_QUANTILE` of the blocks of 8 x 8 pixels of images stay within, as other images judge them.

    Of a block's mean, relative to the block's or to `DARK` of the image's, whichever is brighter. What of it may be the
    judges' noise is taken off.
    """
    known = np.array([block_means(judge) for judge in judges])
    mean, chance = known.mean(0), known.var(0, ddof=1) / len(known)
    level = np.maximum(mean, DARK * brightness(mean.mean((0, 1))))
    if not level.any():
        return np.zeros(3)
    off = np.array([(block_means(image) - mean) ** 2 - chance for image in images])
    share = np.sqrt(np.maximum(off, 0.0)) / np.maximum(level, 1e-30)
    return np.quantile(share, BLOCK_QUANTILE, axis=(0, 1, 2))


def block_means(image: np.ndarray) -> np.ndarray:
    """Means [H/8, W/8, 3] over whole blocks; of a smaller image, over all of it."""
    height, width = (max(side // BLOCK, 1) for side in image.shape[:2])
    tall, wide = (min(BLOCK, side) for side in image.shape[:2])
    blocks = image[:height * tall, :width * wide].astype(np.float64)
    return blocks.reshape(height, tall, width, wide, -1).mean((1, 3))


def squared_error(images: Sequence[np.ndarray], judges: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Mean square of what is wrong with images [3], and its standard error [3] by the noise of the judges.

    As if pixels were independent, which those of tables are not quite: they share the grid of the veil.
    """
    judges = np.array(judges)
    means, squares, unsure = judges.mean((1, 2), dtype=np.float64), [], []
    for image in np.asarray(images):
        level = image.mean((0, 1), dtype=np.float64)
        (square, deviation), sane_means = _against_sane(image, judges, level)
        (offset, chance), (sane_offset, sane_chance) = (_offset(level, of) for of in (means, sane_means))
        rare = offset**2 - chance - (sane_offset**2 - sane_chance)
        squares.append(square + rare)
        unsure.append(np.hypot(deviation / np.sqrt(image[..., 0].size),
                               2.0 * offset * np.sqrt(np.maximum(chance - sane_chance, 0.0))))
    return np.mean(squares, axis=0), np.mean(unsure, axis=0)


def _against_sane(image: np.ndarray, judges: np.ndarray, level: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and deviation [2, 3] of the squares of what is wrong, by judges without fireflies; and the judges' means.

    In bands of rows: what lies in the cache takes a fraction of the time.
    """
    around = uniform_filter(image, (AROUND, AROUND, 1))
    sums, means = np.zeros((2, 3)), np.zeros((len(judges), 3))
    for rows in np.array_split(np.arange(len(image)), -(-len(image) // BAND)):
        here = image[rows].astype(np.float64)
        limit = FIREFLY * np.maximum(np.maximum(here, around[rows]), DARK * level)
        sane = np.clip(judges[:, rows], -limit, limit)
        square = (here - sane.mean(0)) ** 2 - sane.var(axis=0, ddof=1) / len(sane)
        sums += square.sum((0, 1)), (square**2).sum((0, 1))
        means += sane.sum((1, 2))
    mean, mean_square = sums / image[..., 0].size
    return np.array([mean, np.sqrt(np.maximum(mean_square - mean**2, 0.0))]), means / image[..., 0].size


def _offset(level: np.ndarray, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the mean of an image [3] is from the ``means`` [judge, 3] of its judges, and the variance of theirs."""
    return level - means.mean(0), means.var(axis=0, ddof=1) / len(means)


def _relative(square: np.ndarray, radiance: np.ndarray) -> np.ndarray:
    """Root of mean squares [3] over the brightness of images [count, H, W, 3]; 0 where all is black."""
    level = brightness(radiance.mean((0, 1, 2)))
    return np.divide(np.sqrt(np.maximum(square, 0.0)), level, out=np.zeros(square.shape), where=level > 0.0)
