"""The registry of image types: what every product states, and that nothing else knows them by their letters."""

import tokenize
from pathlib import Path

import numpy as np
import pytest

import varos_warp
from varos_warp.products.images.protocol import ImageProduct, Source
from varos_warp.products.images.registry import DENOISE_KEYS, OUTPUTS
from varos_warp.scene.description import image_types
from varos_warp.scene.description.image_types import IMAGE_TYPES
from varos_warp.scene.description.render import Render

ROOT = Path(varos_warp.__file__).parent
NAMED = {value for name, value in vars(image_types).items() if name.isupper() and isinstance(value, str)}
OTHERS = {
    "scene/images.py",
    "scene/lights/ies.py",
    "scene/lights/goniometry.py",
    "scene/geometry/files/off.py",
    "cli/datasets.py",
    "cli/options.py",
    "dataset/validate/alignment.py",
    "sim/simulator.py",
}
"""Files where such letters in quotes mean something else: modes of Pillow, types of IES, units, an unknown.

The command line says its default without loading anything."""


@pytest.mark.parametrize("letter", OUTPUTS)
def test_every_line_of_the_registry_leads_to_a_product_of_its_letter(letter):
    product = OUTPUTS[letter]
    assert isinstance(product, ImageProduct)
    assert product.letter == letter
    assert product.content
    assert product.method.format(water="x", ambient="y")
    assert product.suffix in (".png", ".exr")
    assert "" in product.folders
    assert product.is_color == (product.source in (Source.WATER, Source.AMBIENT))
    assert set(product.folders.values()) - {""} <= set(Render.model_fields)


def test_pixels_are_those_of_the_papers_table_4_and_of_later_types():
    assert {k: (o.channels, np.dtype(o.dtype).itemsize * 8) for k, o in OUTPUTS.items()} == {
        "A": (3, 8),
        "B": (3, 8),
        "C": (3, 8),
        "D": (1, 16),
        "S": (1, 16),
        "P": (3, 8),
        "F": (3, 16),
        "T": (3, 32),
        "U": (1, 8),
        "N": (1, 8),
    }


def test_a_scene_may_ask_for_every_type_and_for_no_other():
    assert Render(outputs=list(OUTPUTS)).outputs == list(IMAGE_TYPES)
    with pytest.raises(ValueError, match="Input should be 'A', 'B', 'C'"):
        Render(outputs=["X"])


def test_denoisers_have_the_keys_of_the_scene_file():
    assert DENOISE_KEYS == {"A": "denoise", "B": "denoise_b"}


def letters_in_quotes(path):
    """Strings in a file that are the letter of an image type which has a name."""
    with tokenize.open(path) as file:
        return [
            token.string
            for token in tokenize.generate_tokens(file.readline)
            if token.type == tokenize.STRING and token.string[1:-1] in NAMED
        ]


def test_no_other_room_knows_image_types_by_letters_in_quotes():
    found = {path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*.py") if letters_in_quotes(path)}
    known = {name for name in found if name.startswith(("products/images/", "scene/description/image_types.py"))}
    assert found - known == OTHERS
