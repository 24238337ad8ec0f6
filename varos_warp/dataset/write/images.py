"""The image files of a frame: which ones there are to be, which are missing, and how what was rendered becomes them."""

import contextlib
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.layout import Layout
from varos_warp.dataset.timing import Clock
from varos_warp.dataset.write.develop import Developer
from varos_warp.errors import InputError
from varos_warp.products.images.radiance import to_half
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.render.image import exposure
from varos_warp.render.image.denoise import denoise_image

_oidn_turn = threading.Lock()
"""Images wait here for each other, outside of the clock; the filter itself takes one at a time (oidn.py)."""


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
    """Statistics for the exposure of A, B and P."""
    empty: bool = False
    """True if it shows that no surface is in sight."""


@dataclass(frozen=True)
class Store:
    """Writes images, from any thread."""

    layout: Layout
    scene: Any
    denoisers: dict[str, str | None]
    """What denoises A (and P) and B on the host, where the renderer did not."""
    has: Callable[[Path], bool] = files.is_complete
    """Tells whether an image file is there already, and good."""

    @property
    def render(self) -> Any:
        """The scene's block of that name."""
        return self.scene.render

    @cached_property
    def rules(self) -> dict[tuple[str, str], exposure.Rule]:
        """How images of colour are exposed, by camera and letter: that for lamps reads their files."""
        letters = [letter for letter in self.render.outputs if OUTPUTS[letter].is_color]
        return {
            (view, letter): exposure.rule_of(self.scene, view, letter)
            for view in self.layout.cameras
            for letter in letters
        }

    def missing(self, frames: list[int]) -> Iterator[ImageJob]:
        """What there is to render of these frames."""
        for frame in frames:
            for camera in self.layout.cameras:
                letters = "".join(
                    letter
                    for letter in self.render.outputs
                    if not all(map(self.has, self.layout.rendered(camera, letter, frame, vars(self.render))))
                )
                if letters:
                    yield ImageJob(frame, camera, letters)

    def write(self, job: ImageJob, letter: str, image, clock: Clock) -> Stored:
        """Write what was rendered of one type; ``clock`` counts the time for ``denoise`` and ``encode``.

        A RuntimeError tells that the image is not fit to be written, such as one with NaN.
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
        product, paths = OUTPUTS[letter], self.layout.image_files(camera, letter, frame, vars(self.render))
        if "_linear" in paths:
            with clock("encode"):
                files.write_exr(paths["_linear"], product.floats(image))
        denoised = image.denoised if image.denoised is not None else self._denoise(image, letter, clock)
        with clock("encode"):
            half, clamped = to_half(denoised)
            files.write_exr(paths["_exr"], {"RGB": half})
            rule = self.rules[camera, letter]
            if (gain := rule.known(letter)) is not None:
                Developer(self.layout, self.scene).write(camera, letter, frame, half, gain)
            return Stored(clamped, rule.statistics(half))

    def _denoise(self, image, letter: str, clock: Clock) -> np.ndarray:
        method = self.denoisers[OUTPUTS[letter].settings]
        with _oidn_turn if method == "oidn" else contextlib.nullcontext(), clock("denoise"):
            return denoise_image(image, method)

    def _write_geometry(self, job: ImageJob, letter: str, image) -> bool:
        """What is not radiance; returns whether it holds no surface at all."""
        product = OUTPUTS[letter]
        for folder, path in self.layout.image_files(job.camera, letter, job.frame, vars(self.render)).items():
            if folder:
                files.write_exr(path, product.floats(image))
            else:
                files.write_image(path, product.pixels(image, self.render))
        return product.is_empty(image, self.render)
