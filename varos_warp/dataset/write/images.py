"""The image files of a frame: which ones there are to be, which are missing, and how what was rendered becomes them."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.timing import Clock
from varos_warp.errors import InputError
from varos_warp.render.image import exposure
from varos_warp.render.image.denoise import denoise_image
from varos_warp.render.image.outputs import OUTPUTS, flow_channels, linear_channels, to_half

_EVERY_HALF = np.nan_to_num(np.arange(1 << 16, dtype=np.uint16).view(np.float16), posinf=np.inf, neginf=-np.inf)
"""By its bits; 0 for what is not a number, which no image has."""
_oidn_turn = threading.Lock()
"""Open Image Denoise uses all cores and much memory: one image at a time."""


class ImageJob(NamedTuple):
    """Images to be rendered at once."""

    frame: int
    camera: str
    letters: str
    """Image types."""


@dataclass
class Stored:
    """What is known of an image once it is written."""

    clamped: int = 0
    """Values that were cut to the largest half float."""
    statistics: exposure.Statistics | None = None
    """Of A, B and P."""
    empty: bool = False
    """Whether C, D or S holds no surface at all."""


@dataclass(frozen=True)
class Store:
    """Writes images, from any thread."""

    layout: Layout
    render: object
    """The scene's block of that name."""
    denoisers: dict[str, str | None]
    """What denoises A (and P) and B on the host, where the renderer did not."""
    has: Callable[[Path], bool] = files.is_complete
    """Whether an image file is there already, and good."""

    def missing(self, frames: list[int]) -> Iterator[ImageJob]:
        """What there is to render of these frames."""
        for frame in frames:
            for camera in self.layout.cameras:
                letters = "".join(letter for letter in self.render.outputs if not all(map(
                    self.has, self.layout.rendered(camera, letter, frame, self.render.linear_exr,
                                                            self.render.depth_exr))))
                if letters:
                    yield ImageJob(frame, camera, letters)

    def write(self, job: ImageJob, letter: str, image, clock: Clock) -> Stored:
        """Write what was rendered of one type; ``clock`` counts the time for ``denoise`` and ``encode``.

        Raises:
            InputError: If the disk refuses it.
            RuntimeError: If the image is not fit to be written, such as one with NaN.
        """
        try:
            if OUTPUTS[letter].is_color:
                return self._write_color(job, letter, image, clock)
            with clock("encode"):
                return Stored(empty=self._write_geometry(job, letter, image))
        except InputError:
            raise
        except ValueError as error:
            raise RuntimeError(f"frame {job.frame}, camera {job.camera}, image {letter}: {error}") from error

    def _write_color(self, job: ImageJob, letter: str, image, clock: Clock) -> Stored:
        """A, B or P: as rendered where asked for, denoised as half floats, and exposed if the gain is known."""
        frame, camera, _ = job
        if letter in "AP" and self.render.linear_exr:
            with clock("encode"):
                files.write_exr(self.layout.linear(camera, frame, letter), linear_channels(image))
        denoised = image.denoised if image.denoised is not None else self._denoise(image, letter, clock)
        with clock("encode"):
            half, clamped = to_half(denoised)
            files.write_exr(self.layout.exr(camera, letter, frame), {"RGB": half})
            gain = exposure.known_gain(getattr(self.render.exposure, OUTPUTS[letter].settings), letter)
            if gain is not None:
                files.write_png(self.layout.png(camera, letter, frame), develop(letter, half, gain))
            return Stored(clamped, exposure.statistics(half))

    def _denoise(self, image, letter: str, clock: Clock) -> np.ndarray:
        method = self.denoisers[OUTPUTS[letter].settings]
        with _oidn_turn if method == "oidn" else contextlib.nullcontext(), clock("denoise"):
            return denoise_image(image, method)

    def _write_geometry(self, job: ImageJob, letter: str, image) -> bool:
        """C, D, S or F; returns whether no pixel of C, D or S holds anything."""
        frame, camera, _ = job
        if letter == "D":
            if self.render.depth_exr:
                channels = {"Z": image.depth, "range": image.range}
                files.write_exr(self.layout.exr(camera, letter, frame),
                                {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()})
        if letter == "F":
            files.write_exr(self.layout.exr(camera, letter, frame), flow_channels(image))
        distance = "depth" if self.render.depth_kind == "z" else "range"
        values = getattr(image, {"C": "normal", "D": distance, "S": "instance", "F": "flow"}[letter])
        scale = self.render.depth_range_m if letter == "D" else None
        files.write_png(self.layout.png(camera, letter, frame), OUTPUTS[letter].encode(values, scale))
        if letter == "F":
            return False
        return not (values < scale[1] if letter == "D" else values != 0).any()


def develop(letter: str, half: np.ndarray, gain: float) -> np.ndarray:
    """Pixels of A, B or P, uint8 [H, W, 3], of half floats: the curve of every half float, looked up.

    That is what `OUTPUTS[letter].encode` makes of them, in a sixth of its time at 1280 x 720.
    """
    return np.take(OUTPUTS[letter].encode(_EVERY_HALF, gain), half.view(np.uint16))
