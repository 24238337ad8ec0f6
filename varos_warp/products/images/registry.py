"""The image types by letter. The lines of the registry stand in scene/description/image_types.py."""

from importlib import import_module

from varos_warp.products.images.protocol import ImageProduct
from varos_warp.scene.description.image_types import IMAGE_TYPES


def _product(place: str) -> ImageProduct:
    module, name = place.split(".")
    product: ImageProduct = getattr(import_module(f"varos_warp.products.images.{module}"), name)
    return product


OUTPUTS: dict[str, ImageProduct] = {letter: _product(line.product) for letter, line in IMAGE_TYPES.items()}
"""Every image type by its letter."""
DENOISE_KEYS = {letter: image.denoise_key for letter, image in OUTPUTS.items() if image.denoise_key and not image.like}
"""Letters of what has a denoiser of its own, with its key in ``render`` and in ``samples`` of dataset.json."""


def colors(letters: list[str]) -> list[str]:
    """Letters of those image types that are radiance."""
    return [letter for letter in letters if OUTPUTS[letter].is_color]
