"""What the water does to the pictures: contrast, veil and optical depth."""

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.render.image.exposure import LUMINANCE
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.passes import BandWater

VEILS = ("single", "multiple")


def rms_contrast(radiance: np.ndarray) -> float | None:
    """Standard deviation of the luminance over its mean, of linear [H, W, 3]; None of a black image."""
    luminance = radiance.astype(float) @ LUMINANCE
    mean = float(luminance.mean())
    return float(luminance.std() / mean) if mean > 0 else None


def black_level(radiance: np.ndarray) -> float | None:
    """First percentile of the luminance over its mean, of linear [H, W, 3]: a veil lifts it; None of a black image."""
    luminance = radiance.astype(float) @ LUMINANCE
    mean = float(luminance.mean())
    return float(np.percentile(luminance, 1.0) / mean) if mean > 0 else None


def layers_of(data: Dataset, frame: int, camera: str) -> dict[str, np.ndarray]:
    """Layers [H, W, 3] of A by name, where ``--linear-exr`` wrote them; empty where it did not."""
    path = data.layout.linear(camera, frame, WATER)
    if not path.exists():
        return {}
    planes = files.read_exr(path)
    return {
        name: np.stack([planes[f"{name}.{c}"] for c in "RGB"], -1)
        for name in ("direct", *VEILS)
        if f"{name}.R" in planes
    }


def veil_over_signal(layers: dict[str, np.ndarray]) -> float | None:
    """Mean luminance of the scattered layers, over that of direct; None without direct or light in it."""
    veils = [layers[name] for name in VEILS if name in layers]
    if "direct" not in layers or not veils:
        return None
    direct = float((layers["direct"].astype(float) @ LUMINANCE).mean())
    return float((sum(veil.astype(float) for veil in veils) @ LUMINANCE).mean() / direct) if direct > 0 else None


def median_range(data: Dataset, frame: int, camera: str) -> float | None:
    """Median distance [m] along the rays to what pixels see, from D; None where nothing is seen or D is not there."""
    if DEPTH not in data.outputs:
        return None
    depth, model = data.depth(frame, camera).astype(float), data.camera_model(camera)
    there = np.isfinite(depth)
    if not there.any():
        return None
    if data.meta["depth"]["kind"] == "z":
        row, col = np.nonzero(there)
        rays = model.rays(np.column_stack([col, row]) + 0.5)
        return float(np.median((depth[row, col] - rays.origin[:, 2]) / rays.direction[:, 2]))
    return float(np.median(depth[there]))


def attenuation(data: Dataset, camera: str) -> np.ndarray:
    """Extinction a + b [1/m] of red, green and blue for a camera; in water by wavelength, over the first metre."""
    water = data.meta["water"]
    if "bands" in water:
        return -np.log(BandWater.of(water, camera).left(np.array(1.0)))
    return np.add(water["sigma_a"], water["sigma_s"])
