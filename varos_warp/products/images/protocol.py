"""What an image type is: all that rendering, writing, reading, checking and showing images ask of one.

An image type is an object whose class extends `ImageProduct`. The defaults suit one that follows from the first hits of
the pixels' centres and has one file a frame: such a type states what has no default, and `of_hits`, `pixels`.
"""

from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from varos_warp.scene.description import Scene
from varos_warp.scene.description.vehicle import Camera


class Source(Enum):
    """What an image is made from."""

    WATER = "light in water, by samples of paths"
    AMBIENT = "uniform light without water, by samples"
    FIRST_HITS = "first hits of the pixels' centres"
    NEXT_FRAME = "first hits, seen again in the next frame"
    PARTICLES = "bodies in the water, drawn one by one"


class LetsThrough(Protocol):
    """Water, as far as image T asks."""

    def left(self, distance: np.ndarray) -> np.ndarray:
        """Share of light that is neither absorbed nor scattered over distances [...] [m], float64 [..., 3]."""


class FirstHits(NamedTuple):
    """What the rays through the pixels' centres hit first, on the host."""

    planes: Mapping[str, np.ndarray]
    """The ``planes`` that were asked for: ``normal`` float32 [H, W, 3] in the world, towards the camera;
    ``depth`` and ``distance`` float32 [H, W] [m], along the camera's axis from the lens and along the ray from where it
    enters the water; ``instance`` int32 [H, W], from 1. Where nothing is hit: 0, inf, inf, 0. ``purity`` float32
    [H, W]: of rays spread over the pixel as samples of A, the share that hits the instance of its centre."""
    water: "LetsThrough"
    """Water of the scene, as the camera sees it."""
    material_ids: np.ndarray
    """Number of the material of each instance, and of nothing (0), int32 [N + 1]."""


class FrameFiles(Protocol):
    """The files of one frame of a camera, for checks: each is read once."""

    data: Any
    """The `Dataset`."""
    frame: int
    camera: str
    shape: tuple[int, int]
    """Height and width of the camera's images."""

    def pixels(self, letter: str) -> np.ndarray:
        """What the finished image of a type holds, of the size and type that it must have."""

    def file(self, letter: str) -> Path:
        """The finished image of a type."""

    def exr(self, path: Path) -> dict[str, np.ndarray]:
        """Channels of an EXR."""

    def tell(self, name: str, problem: str) -> None:
        """Note a problem of a file."""

    @property
    def planar(self) -> np.ndarray:
        """Image D in metres along the camera's axis [H, W]; inf where it has none."""

    @property
    def flow(self) -> Any:
        """Image F with all its digits, as `Dataset.flow` reads it."""

    def along_axis(self, distance: np.ndarray) -> np.ndarray:
        """Distances [H, W] [m] along the pixels' rays in the water as planar depth."""


@runtime_checkable
class ImageProduct(Protocol):
    """An image type."""

    letter: str
    content: str
    """What it holds, in the paper's words (table 6)."""
    method: str
    """How it is made, in words for a plan; ``{water}`` and ``{ambient}`` stand for those of samples and denoisers."""
    source: Source = Source.FIRST_HITS
    planes: tuple[str, ...] = ()
    """Which planes of `FirstHits` it needs."""

    rays: int = 0
    """Rays of its own for each pixel, besides that of the centre; for planes that need them."""

    channels: int
    """Channels per pixel of the finished image: 1, [H, W], or 3, [H, W, 3]."""
    dtype: type
    """Data type of the finished image (paper, table 4)."""
    suffix: str = ".png"
    """Suffix of the finished image's file: .png, or .exr for float32 in channels R, G and B."""
    folders: Mapping[str, str] = {"": ""}
    """Endings of its folders, which are named after its letter: none for the finished image, ``_exr`` ... for floats
    beside it; with the key of ``render`` that asks for them, or none where they are always there."""
    released: bool = False
    """True if the released sequence of the paper has it, so that every dataset tells of it."""
    convention: str = ""
    """What dataset.json says of it."""
    readme: str = ""
    """A chapter of README.txt, for datasets that have it."""
    parts: tuple[str, ...] = ()
    """What a `Frame` of a dataset has of it besides the image, such as ``F_occluded``."""
    bytes_a_pixel: float
    """Approximate bytes per pixel of its files, in the template harbour_wall."""

    is_color: bool = False
    """True if it is linear radiance, which is denoised, and exposed once all frames are known (`Radiance`)."""
    beside: tuple[str, ...] = ()
    """Keys of a scene that none of its files follows from, whatever they say (`scene/description/looks.py`): versions
    of a scene that differ in these only share its files. Of all other keys, and of new ones, it is made anew."""
    like: str = ""
    """Letter of another type, with whose samples, denoiser and exposure it is made."""
    denoise_key: str = ""
    """Key of ``render`` that says what denoises it."""
    noise_key: str = ""
    """Key of ``render`` with the sensor that it is seen by (`CameraNoise`), so that its finished image is noisy."""
    constant_gain: float | None = None
    """Gain by ``constant`` exposure; None: that of the sequence's brightness."""
    blurs: bool = True
    """True if the camera's shutter blurs it."""
    averages: bool = True
    """True if a mean of pixels means something, as in a smaller picture."""

    @property
    def settings(self) -> str:
        """The letter under which the scene says how it is made."""
        return self.like or self.letter

    def wanted(self, render: Mapping[str, Any]) -> list[str]:
        """Endings of the folders of `folders` that a scene's block ``render`` asks for."""
        return [folder for folder, key in self.folders.items() if not key or render.get(key)]

    def seen_by(self, scene: Scene, camera: Camera) -> Camera:
        """The camera through which it is seen."""
        return camera

    def of_hits(self, hits: FirstHits) -> Any:
        """The rendered image, of a type whose source is `Source.FIRST_HITS`."""
        raise TypeError(f"image {self.letter} does not follow from first hits")

    def pixels(self, image: Any, render: Any) -> np.ndarray:
        """The finished image of a rendered one; ``render`` is the scene's block of this name. Not of radiance."""
        raise TypeError(f"image {self.letter} is exposed, not encoded")

    def floats(self, image: Any) -> dict[str, np.ndarray]:
        """Channels, float32 [H, W], of the EXR beside the finished image, if `folders` has one."""
        raise TypeError(f"image {self.letter} has no floats beside its file")

    def is_empty(self, image: Any, render: Any) -> bool:
        """Return whether a rendered image, not of radiance, shows that no surface is in sight."""
        return False

    def decode(self, pixels: np.ndarray, scale: Any = None) -> np.ndarray:
        """The image of a finished one; ``scale`` is the gain of radiance, the range of D."""
        return pixels

    def check(self, files: FrameFiles) -> Iterable[tuple[str, str]]:
        """What is wrong with its files of a frame: names of files, and problems."""
        return ()

    def colors(self, pixels: np.ndarray, meta: Mapping[str, Any], near_far: tuple[float, float] | None) -> np.ndarray:
        """uint8 [H, W, 3] for the eye, of a finished image and what dataset.json says.

        ``near_far`` are distances [m] of the ends of colours, of a type that shows distances; None: those of the image.
        """
        return pixels
