"""Development of the half floats of A, B and P to their 8 bit files: gain, curve, dither and the noise of a sensor."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.products.images.radiance import by_value, encode_color, exposed, srgb_oetf
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.image.camera_noise import noisy_color
from varos_warp.render.image.dither import Dither
from varos_warp.render.image.exposure import FrameGain
from varos_warp.scene.description.noise_profile import CameraNoise
from varos_warp.scene.optics.camera import camera_model
from varos_warp.scene.spectra.matrix import color_matrix
from varos_warp.sim.sensors.image_noise import frame_generator

_EVERY_HALF = np.nan_to_num(np.arange(1 << 16, dtype=np.uint16).view(np.float16), posinf=np.inf, neginf=-np.inf)
"""Every half float, indexed by its bits; 0 for what is not a number, which no image has."""


def develop(half: np.ndarray, gain: FrameGain, matrix: np.ndarray | None = None) -> np.ndarray:
    """Pixels of A, B or P, uint8 [H, W, 3], of half floats: the curve of every half float, looked up.

    That is what `encode_color` makes of them, in a sixth of its time at 1280 x 720. A colour matrix leaves none to look
    up.
    """
    if matrix is not None:
        return encode_color(half, gain, matrix)
    return by_value(encode_color(_EVERY_HALF[:, None], gain), half.view(np.uint16))


def dithered(
    half: np.ndarray,
    gain: FrameGain,
    dither: Dither,
    camera: str,
    letter: str,
    frame: int,
    matrix: np.ndarray | None = None,
) -> np.ndarray:
    """Dithered pixels of `develop`; the curve is in float64, so that every machine rounds the same to 8 bits."""
    if matrix is not None:
        curve = 255.0 * srgb_oetf(exposed(half, gain, matrix).astype(np.float64))
        return dither.rounded(curve.astype(np.float32), camera, letter, frame)
    curve = (255.0 * srgb_oetf(exposed(_EVERY_HALF[:, None], gain).astype(np.float64))).astype(np.float32)
    return dither.rounded(by_value(curve, half.view(np.uint16)), camera, letter, frame)


@dataclass(frozen=True)
class Developer:
    """Writes the 8 bit files of the radiance images of a scene, from any thread."""

    layout: Layout
    scene: Any

    def files(self, camera: str, letter: str, frame: int) -> list[Path]:
        """What it writes of an image: the finished one, and without the noise of a sensor if it has some."""
        clean = [self.layout.clean(camera, frame)] if self.sensor(letter) else []
        return [*clean, self.layout.image(camera, letter, frame)]

    def sensor(self, letter: str) -> CameraNoise | None:
        """The image sensor that an image type is seen by, if the scene says so."""
        key = OUTPUTS[letter].noise_key
        return getattr(self.scene.render, key) if key else None

    def write(self, camera: str, letter: str, frame: int, half: np.ndarray, gain: FrameGain) -> None:
        """Write them of half floats [H, W, 3]."""
        *clean, finished = self.files(camera, letter, frame)
        for path in clean or [finished]:
            files.write_png(path, self._without_noise(camera, letter, frame, half, gain))
        if (sensor := self.sensor(letter)) is not None:
            view = next(each for each in self.scene.vehicle.cameras if each.id == camera)
            rng, linear = frame_generator(self.scene.seed, frame, camera), half.astype(np.float32)
            files.write_png(
                finished,
                noisy_color(
                    sensor, linear, gain, camera_model(view), view.exposure.time_s, rng, self._matrices[camera]
                ),
            )

    def _without_noise(self, camera: str, letter: str, frame: int, half: np.ndarray, gain: FrameGain) -> np.ndarray:
        dither, matrix = Dither.of(self.scene), self._matrices[camera]
        if dither is None:
            return develop(half, gain, matrix)
        return dithered(half, gain, dither, camera, letter, frame, matrix)

    @cached_property
    def _matrices(self) -> dict[str, np.ndarray | None]:
        """Colour matrix of each camera: fitted ones read files, which is not to be done for every image."""
        return {view.id: color_matrix(self.scene, view) for view in self.scene.vehicle.cameras}
