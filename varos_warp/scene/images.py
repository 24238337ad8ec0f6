"""Pictures: files of many kinds as linear reflectances, refused by name where they are not what they seem."""

import contextlib
import io
import logging
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from varos_warp.errors import InputError, refused_as
from varos_warp.limits import check_limit

logging.getLogger("PIL").addHandler(logging.NullHandler())  # what it logs of damaged files: not to stderr

_ONE_AT_A_TIME = threading.Lock()


@dataclass(frozen=True)
class Picture:
    """A picture as a surface shows it."""

    texels: np.ndarray
    """uint8 [H, W, 3], sRGB, rows from the top: the file's own texels."""
    alpha: np.ndarray | None = None
    """uint8 [h, w], of the file's own size; None: it has none."""

    @staticmethod
    def plain() -> "Picture":
        """A picture of one white texel."""
        return Picture(np.full((1, 1, 3), 255, np.uint8))

    @property
    def is_constant(self) -> bool:
        """True if a picture of more than one texel is one colour throughout."""
        return self.texels.size > 3 and not np.any(self.texels != self.texels[:1, :1])


def read_picture(source: Path | bytes, key: str, mask: Path | None = None) -> Picture:
    """The picture in a file, or in the bytes of one.

    Args:
        mask: A picture whose brightness is the alpha, in place of its own.

    Raises:
        InputError: It is no picture, of a kind that has no meaning as a colour, or larger than the limit.
    """
    with _readable(source, key) as image:
        picture = Picture(_texels(image), _alpha(image))
    if mask is None:
        return picture
    with _readable(mask, key) as image:
        return Picture(picture.texels, np.asarray(_of_8_bits(image).convert("L")))


@contextlib.contextmanager
def _readable(source: Path | bytes, key: str) -> Iterator[Image.Image]:
    """Open an image as `open_image` does, for use as a picture; all that is wrong with it is an `InputError`."""
    file = None if isinstance(source, bytes) else source

    def unread(error: Exception) -> InputError:
        problem = str(error).strip() or type(error).__name__
        if isinstance(source, bytes):
            problem = f"the picture in the file is of a kind that is not known, or damaged ({source[:12]!r} ...)"
        remedy = "Export it anew, as PNG or JPEG."
        return InputError(f"cannot be read as an image: {problem}", file=file, key=key, remedy=remedy)

    with refused_as(unread), open_image(source, key) as image:  # Pillow raises many kinds on damaged files
        _refuse_odd(image, key, file)
        yield image


def _refuse_odd(image: Image.Image, key: str, file: Path | None) -> None:
    """Refuse pictures of 32 bits a channel: what is white in them is not said."""
    if image.mode == "F" or (image.mode == "I" and image.format != "PNG"):
        raise InputError(
            "has 32 bits a channel, of which nobody says what is white",
            file=file,
            key=key,
            remedy="Save it with 8 or 16 bits a channel, in sRGB.",
        )


def _alpha(image) -> np.ndarray | None:
    """Alpha of a picture; None if it has none."""
    if image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info:
        return np.asarray(image.convert("RGBA").getchannel("A"))
    return None


@contextlib.contextmanager
def open_image(
    source: Path | bytes, key: str | None = None, limit: str = "TEXTURE_PIXELS", formats: tuple[str, ...] | None = None
) -> Iterator[Image.Image]:
    """An image file, or the bytes of one, whose pixels can be decoded without filling the memory.

    Args:
        limit: Name of the limit of its pixels.
        formats: Formats that it may have, by Pillow's names; None: all that Pillow knows.

    Raises:
        InputError: If it has more pixels than the limit.
    """
    file = None if isinstance(source, bytes) else source
    with _opened(io.BytesIO(source) if isinstance(source, bytes) else source, formats) as image:
        check_limit(limit, image.width * image.height, file=file, key=key)
        yield image


def _opened(file, formats) -> Image.Image:
    """An image whose size is read, without Pillow's own limit, which is a global: ours is checked next."""
    with _ONE_AT_A_TIME:
        largest, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
        try:
            return Image.open(file, formats=formats)
        finally:
            Image.MAX_IMAGE_PIXELS = largest


def linear(texels: np.ndarray) -> np.ndarray:
    """Linear reflectances, float32, of sRGB values of 8 bits."""
    return _SRGB_TO_LINEAR[texels]


def _texels(image: Image.Image) -> np.ndarray:
    """The sRGB values of an image, uint8 [H, W, 3]."""
    return np.asarray(_of_8_bits(image).convert("RGB"))


def _of_8_bits(image: Image.Image) -> Image.Image:
    """Return the image, scaled to 8 bits if it is grey of 16 bits, which Pillow would cut off."""
    if not image.mode.startswith("I"):
        return image
    values = np.asarray(image, np.float32)
    return Image.fromarray(np.clip(values / 65535.0 * 255.0, 0, 255).astype(np.uint8))


def srgb_to_linear(values: np.ndarray) -> np.ndarray:
    """Linear values of sRGB ones in 0..1 (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


_SRGB_TO_LINEAR = srgb_to_linear(np.arange(256) / 255.0).astype(np.float32)
