"""Pictures for the eye: small ones of images, the contact sheet, and the small images that a page carries along."""

import base64
import io
import itertools
from dataclasses import dataclass
from pathlib import Path

import matplotlib.colors  # noqa: F401 - not first in several threads at once: its parts import each other
import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.products.images.depth import DEPTH_LEVELS
from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.image_types import DEPTH

WIDTHS = (640, 512, 400, 320, 256, 200, 160)
"""Widths of embedded images [pixels]; the first that fits is taken."""
MOST_IMAGES = 1200
"""Embedded in a page."""
BUDGET = 12_000_000
"""Bytes of all embedded images; a third more as base64."""


def spread(frames: list[int], count: int) -> list[int]:
    """Choose at most ``count`` of the frames, evenly spread from the first to the last."""
    picks = np.unique(np.linspace(0, len(frames) - 1, min(count, len(frames))).round().astype(int))
    return [frames[i] for i in picks]


def whole_frames(data: Dataset, camera: str) -> list[int]:
    """Frames of which every output is there."""
    return [f for f in data.frames if all(files.is_complete(data.layout.image(camera, o, f)) for o in data.outputs)]


# ------------------------------------------------------------------------------------------------------------ colours


def preview(
    data: Dataset, output: str, frame: int, camera: str | None, width: int, near_far: tuple[float, float] | None = None
):
    """A small picture (PIL) for the eye: A, B and C as they are, D from near (bright) to far (dark), S by object.

    F by the colours of the Middlebury benchmark, where the longest flow is the most saturated.

    It is ``width`` pixels wide; ``near_far`` are the distances [m] of the brightest and the darkest colour of D, by
    default those of the image.
    """
    from PIL import Image

    pixels = data.pixels(output, frame, camera)
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    if OUTPUTS[output].averages:
        pixels = OUTPUTS[output].colors(pixels, data.meta, near_far)
        return Image.fromarray(pixels).resize((width, height), Image.Resampling.BOX)
    middles = np.ix_(
        *(
            ((np.arange(few) + 0.5) * many / few).astype(int)  # the middles of even parts
            for many, few in zip(pixels.shape[:2], (height, width), strict=True)
        )
    )
    if pixels.shape[1] < width:  # every pixel is shown, and coloured once
        return Image.fromarray(OUTPUTS[output].colors(pixels, data.meta, near_far)[middles])
    return Image.fromarray(OUTPUTS[output].colors(pixels[middles], data.meta, near_far))


def depth_ends(data: Dataset, frames: list[int], cameras: tuple[str, ...]) -> tuple[float, float]:
    """Distances [m] between which nearly all of D lies in these frames; the range of D where it has none."""
    start, end = data.meta["depth"]["range_m"]
    samples = [data.pixels(DEPTH, frame, camera)[::7, ::7].ravel() for camera in cameras for frame in frames]
    found = np.concatenate([*samples, np.zeros(0, np.uint16)])
    found = found[found < DEPTH_LEVELS]
    if not found.size:
        return max(start, 1e-3), end
    near, far = np.percentile(found, (0.5, 99.5)) * ((end - start) / DEPTH_LEVELS) + start
    return max(float(near), 1e-3), max(float(far), float(near) + 1e-2)


# ------------------------------------------------------------------------------------------------------ contact sheet


def contact_sheet(data: Dataset, path: Path, columns: int = 5, width: int = 384) -> None:
    """One picture of a dataset: a row for each of A, B, C, D (of each camera), a column for each of some frames."""
    from PIL import Image, ImageDraw

    rows = []
    for camera in data.cameras:
        picks = spread(whole_frames(data, camera), columns)
        rows += [[(preview(data, o, f, camera, width), f"{camera} {o} {f}") for f in picks] for o in data.outputs]
    rows = [row for row in rows if row]
    if not rows:
        return
    heights = [row[0][0].height + 2 for row in rows]
    sheet = Image.new("RGB", (max(map(len, rows)) * (width + 2), sum(heights)), "white")
    draw = ImageDraw.Draw(sheet)
    for y, row in zip(np.cumsum([0, *heights]).tolist(), rows, strict=False):
        for i, (image, label) in enumerate(row):
            sheet.paste(image, (i * (width + 2), y))
            draw.text((i * (width + 2) + 5, y + 3), label, fill="white", stroke_width=1, stroke_fill="black")
    files.write_png(path, np.asarray(sheet))


# ------------------------------------------------------------------------------------------------------------ filmstrip


@dataclass(frozen=True)
class Filmstrip:
    """Small images of some frames, for a page to carry along."""

    frames: list[int]
    """Numbers of the frames shown."""
    width: int
    """Width of every image [pixels]."""
    images: dict[str, dict[str, list[str]]]
    """Images by camera and output: base64 of WebP, one for each of the frames."""
    near_far: tuple[float, float]
    """Distances [m] of the ends of D's colours."""


def filmstrip(data: Dataset, quiet: bool = True, budget: int = BUDGET) -> Filmstrip:
    """Small images of as many frames, and as large, as fit into a number of bytes."""
    common = sorted(set.intersection(*(set(whole_frames(data, camera)) for camera in data.cameras)))
    if not common or not data.outputs:
        return Filmstrip([], 0, {}, (0.0, 1.0))
    frames = spread(common, max(2, MOST_IMAGES // (len(data.cameras) * len(data.outputs))))
    ends = depth_ends(data, spread(frames, 12), data.cameras) if DEPTH in data.outputs else (0.0, 1.0)
    largest = min(WIDTHS[0], max(data.camera(camera)["width"] for camera in data.cameras))
    for width in [largest, *(w for w in WIDTHS if w < largest)]:
        sample = _encode(data, spread(frames, 6), width, ends, True)
        if _size(sample) * len(frames) / min(6, len(frames)) < 0.9 * budget:
            break
    images = _encode(data, frames, width, ends, quiet)
    while _size(images) > budget and len(frames) > 2:  # a sample is a sample
        frames = frames[::2]
        images = {c: {o: strip[::2] for o, strip in outputs.items()} for c, outputs in images.items()}
    return Filmstrip(frames, width, images, ends)


def _size(images: dict) -> float:
    """Bytes of the images, not of their base64."""
    return sum(len(text) for outputs in images.values() for strip in outputs.values() for text in strip) * 3 / 4


def _encode(data: Dataset, frames: list[int], width: int, ends: tuple[float, float], quiet: bool) -> dict:
    """base64 of every image, by camera and output."""

    def encode(camera: str, output: str, frame: int) -> str:
        buffer = io.BytesIO()
        quality = 88 if OUTPUTS[output].is_color else 80
        preview(data, output, frame, camera, width, ends).save(buffer, "WEBP", quality=quality, method=3)
        return base64.b64encode(buffer.getvalue()).decode()

    work = zip(*itertools.product(data.cameras, data.outputs, frames), strict=True)
    texts = iter(list(in_threads("report", encode, *work, unit="images", quiet=quiet)))
    return {
        camera: {output: list(itertools.islice(texts, len(frames))) for output in data.outputs}
        for camera in data.cameras
    }
