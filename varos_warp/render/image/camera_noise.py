"""Image A as a noisy sensor sees it: 8 bits of linear radiance, a model of the sensor and a seed."""

from dataclasses import replace

import numpy as np

from varos_warp.products.images.radiance import encode_color
from varos_warp.render.image.exposure import FrameGain
from varos_warp.scene.description.noise_profile import CameraNoise
from varos_warp.scene.optics.camera import CameraModel, Vignetting, pixel_centres
from varos_warp.sim.sensors import image_noise


def noisy_color(
    model: CameraNoise,
    radiance: np.ndarray,
    gain: FrameGain,
    view: CameraModel,
    exposure_s: float,
    rng: np.random.Generator,
    matrix: np.ndarray | None = None,
) -> np.ndarray:
    """Pixels uint8 [H, W, 3] of A.

    Args:
        model: The sensor. Its vignetting is left out where the camera has one, which is in the radiance.
        radiance: Linear [H, W, 3].
        gain: Exposure gain of the frame. White balance comes after the noise: the sensor is exposed by the smallest of
            its gains, so that no channel saturates below white, and what it reads is multiplied by the rest.
        view: The camera.
        exposure_s: How long dark current gathers [s].
        rng: Of the frame (`image_noise.frame_generator`).
        matrix: The camera's colour matrix, which turns noise of its channels into that of sRGB.
    """
    share: np.ndarray | float = 1.0
    if model.vignetting is not None and view.vignetting is None:
        seen = replace(view, vignetting=Vignetting(**model.vignetting.model_dump()))
        share = seen.vignette(pixel_centres(*radiance.shape[1::-1]))
    of_sensor = float(np.min(gain))
    numbers = image_noise.expose(model, radiance, of_sensor, rng, share, exposure_s)
    balance = np.divide(gain, of_sensor) if isinstance(gain, tuple) else 1.0
    return encode_color(image_noise.to_linear(model, numbers), balance, matrix)
