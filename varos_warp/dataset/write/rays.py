"""Rays of every pixel of a camera with a port or distortion, in a file that needs no model of either.

Float32: directions are right to 6e-8 rad, about 1e-4 pixels, and origins to some nanometres.
"""

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.scene.optics.camera import CHANNELS, GREEN, CameraModel, camera_model, pixel_centres

PARTS = ("ox", "oy", "oz", "dx", "dy", "dz", "weight")
"""Components of a ray: origin [m] and direction in camera axes; radiance at the sensor over that in the water."""
BAND = 32
"""Rows that are computed at once, which bounds the memory."""


def ray_channels(model: CameraModel, width: int, height: int) -> dict[str, np.ndarray]:
    """Channels of the EXR, float32 [H, W]: ``green.ox`` ... ``green.weight`` (`PARTS`).

    Of red and blue alike, where they have rays of their own. NaN and weight 0 where no water is seen.
    """
    from varos_warp.device.devices import usable_cores

    alike = model.port is None or len(set(model.n_water)) == 1
    numbers = (GREEN,) if alike else range(len(CHANNELS))
    planes = {number: np.empty((len(PARTS), height, width), np.float32) for number in numbers}

    def fill(number: int, row: int) -> None:
        rays = model.rays(pixel_centres(width, min(BAND, height - row)) + [0.0, row], number)
        band = np.concatenate([rays.origin, rays.direction, rays.weight[..., None]], -1)
        planes[number][:, row : row + BAND] = np.moveaxis(band, -1, 0)

    with ThreadPoolExecutor(usable_cores()) as pool:
        list(pool.map(fill, *zip(*itertools.product(numbers, range(0, height, BAND)), strict=True)))
    return {
        f"{CHANNELS[number]}.{part}": plane
        for number in numbers
        for part, plane in zip(PARTS, planes[number], strict=True)
    }


def write_rays(layout: Layout, camera) -> None:
    """Write the file of one camera of a scene."""
    files.write_exr(layout.rays(camera.id), ray_channels(camera_model(camera), *camera.resolution))
