"""Images to look at: denoised ones beside the reference, and the errors of blocks."""

from pathlib import Path

import numpy as np
from matplotlib import colormaps
from PIL import Image

from benchmarks.light.scores import BLOCK, Estimate, block_errors, worst_channel
from varos_warp.products.images.radiance import encode_color
from varos_warp.render.image.exposure import statistics

ENLARGED = 4
FULL_SCALE = 0.5
"""Relative error of a block that is shown in full red (too bright) or blue (too dark)."""


def side_by_side(path: Path, denoised: np.ndarray, reference: Estimate) -> None:
    """Write `row_of_images`, enlarged."""
    row = row_of_images(denoised, reference)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(row.repeat(ENLARGED, axis=0).repeat(ENLARGED, axis=1)).save(path)


def row_of_images(denoised: np.ndarray, reference: Estimate) -> np.ndarray:
    """The first image, the one with the worst block, the reference, and the errors of the worst one's blocks."""
    errors = worst_channel(block_errors(denoised, reference))
    worst = int(np.abs(errors).max(axis=(1, 2)).argmax())
    truth = reference.pixels[0]
    gain = statistics(truth).target_gain
    gain = gain if np.isfinite(gain) else 1.0
    shown = [encode_color(np.nan_to_num(image), gain) for image in (denoised[0], denoised[worst], truth)]
    shown.append(_error_map(errors[worst], truth.shape))
    gap = np.full((truth.shape[0], 2, 3), 255, np.uint8)
    return np.concatenate([piece for image in shown for piece in (image, gap)][:-1], axis=1)


def _error_map(errors: np.ndarray, shape) -> np.ndarray:
    """Blocks in colours, grey where the image has no whole block."""
    colours = colormaps["RdBu_r"](np.clip(0.5 + errors / (2 * FULL_SCALE), 0, 1))[..., :3]
    blocks = np.rint(255 * colours).astype(np.uint8).repeat(BLOCK, axis=0).repeat(BLOCK, axis=1)
    image = np.full(shape, 128, np.uint8)
    tall, wide = min(shape[0], blocks.shape[0]), min(shape[1], blocks.shape[1])
    image[:tall, :wide] = blocks[:tall, :wide]
    return image
