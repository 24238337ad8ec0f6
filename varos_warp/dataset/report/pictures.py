"""Pictures for the eye: colours of D, S and F, the contact sheet, and the small images that a page carries along."""

import base64
import io
import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib import colormaps  # not first in several threads at once: its parts import each other
from matplotlib.colors import hsv_to_rgb

from varos_warp.dataset import files
from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.render.image.outputs import DEPTH_LEVELS, OUTPUTS

WIDTHS = (640, 512, 400, 320, 256, 200, 160)
"""Of embedded images; the first that fits."""
MOST_IMAGES = 1200
"""Embedded in a page."""
BUDGET = 12_000_000
"""Bytes of all embedded images; a third more as base64."""


def spread(frames: list[int], count: int) -> list[int]:
    """At most ``count`` of the frames, evenly spread from the first to the last."""
    picks = np.unique(np.linspace(0, len(frames) - 1, min(count, len(frames))).round().astype(int))
    return [frames[i] for i in picks]


def whole_frames(data: Dataset, camera: str) -> list[int]:
    """Frames of which every output is there."""
    return [f for f in data.frames if all(files.is_complete(data.layout.png(camera, o, f)) for o in data.outputs)]


# ------------------------------------------------------------------------------------------------------------ colours


def preview(data: Dataset, output: str, frame: int, camera: str | None, width: int,
            near_far: tuple[float, float] | None = None):
    """A small picture (PIL) for the eye: A, B and C as they are, D from near (bright) to far (dark), S by object.

    F by the colours of the Middlebury benchmark, where the longest flow is the most saturated.

    It is ``width`` pixels wide; ``near_far`` are the distances [m] of the brightest and the darkest colour of D, by
    default those of the image.
    """
    from PIL import Image

    pixels = data.pixels(output, frame, camera)
    height = max(1, round(pixels.shape[0] * width / pixels.shape[1]))
    if output in "DSF":  # neither distances nor numbers of objects have a mean across an edge, nor have motions
        pixels = pixels[np.ix_(*(((np.arange(few) + 0.5) * many / few).astype(int)  # the middles of even parts
                                 for many, few in zip(pixels.shape[:2], (height, width), strict=True)))]
        if output == "S":
            return Image.fromarray(_segment_colors(pixels))
        if output == "F":
            return Image.fromarray(flow_colors(OUTPUTS["F"].decode(pixels)))
        return Image.fromarray(_depth_colors(pixels, near_far, data.meta["depth"]["range_m"]))
    return Image.fromarray(pixels).resize((width, height), Image.Resampling.BOX)


def depth_ends(data: Dataset, frames: list[int], cameras: tuple[str, ...]) -> tuple[float, float]:
    """Distances [m] between which nearly all of D lies in these frames; the range of D where it has none."""
    start, end = data.meta["depth"]["range_m"]
    samples = [data.pixels("D", frame, camera)[::7, ::7].ravel() for camera in cameras for frame in frames]
    found = np.concatenate([*samples, np.zeros(0, np.uint16)])
    found = found[found < DEPTH_LEVELS]
    if not found.size:
        return start, end
    near, far = np.percentile(found, (0.5, 99.5)) * ((end - start) / DEPTH_LEVELS) + start
    return max(float(near), 1e-3), max(float(far), float(near) + 1e-2)


def _depth_colors(pixels: np.ndarray, near_far: tuple[float, float] | None, range_m) -> np.ndarray:
    """Colours of D, even steps of its logarithm between two distances; black where nothing is within the range."""
    hit, (start, end) = pixels < DEPTH_LEVELS, range_m
    depth = np.maximum(start + pixels * ((end - start) / DEPTH_LEVELS), 1e-4)
    near, far = near_far or ((depth[hit].min(), depth[hit].max() * 1.001) if hit.any() else (1.0, 2.0))
    share = np.log(far / depth) / np.log(far / near)
    colors = (colormaps["viridis"](np.clip(share, 0, 1))[..., :3] * 255).astype(np.uint8)
    colors[~hit] = 0
    return colors


def _segment_colors(pixels: np.ndarray) -> np.ndarray:
    """A colour for each number, unlike those of its neighbours (hues a golden section apart); black where it is 0."""
    number = pixels.astype(float)
    hsv = np.stack([number * 0.618034 % 1.0, 0.4 + 0.5 * (number * 0.37 % 1.0), np.where(pixels > 0, 0.95, 0.0)], -1)
    return (hsv_to_rgb(hsv) * 255).astype(np.uint8)


def flow_colors(flow: np.ndarray) -> np.ndarray:
    """uint8 [H, W, 3] of a flow [H, W, 2]: the wheel of Baker et al. (2011), white at rest, black where it is NaN.

    Hue is the direction: red to the right, yellow down, blue to the left, violet up. The 99 % quantile of the lengths
    has full colour.
    """
    known = np.isfinite(flow).all(-1)
    u, v = np.moveaxis(np.where(known[..., None], flow, 0.0), -1, 0)
    length = np.hypot(u, v)
    longest = max(float(np.quantile(length[known], 0.99)), 1e-6) if known.any() else 1.0
    turn = (np.arctan2(-v, -u) / np.pi + 1.0) / 2.0
    wheel = np.cumsum([0, 15, 6, 4, 11, 13, 6]) / 55  # red, yellow, green, cyan, blue, magenta, red
    hue = np.stack([np.interp(turn, wheel, ends) for ends in (
        (1, 1, 0, 0, 0, 1, 1), (0, 1, 1, 1, 0, 0, 0), (0, 0, 0, 1, 1, 1, 0))], -1)
    colors = 1.0 - np.minimum(length / longest, 1.0)[..., None] * (1.0 - hue)
    return np.where(known[..., None], np.rint(255 * colors), 0).astype(np.uint8)


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
    """Of every image, in pixels."""
    images: dict[str, dict[str, list[str]]]
    """By camera and output: base64 of WebP, one for each of the frames."""
    near_far: tuple[float, float]
    """Distances [m] of the ends of D's colours."""


def filmstrip(data: Dataset, quiet: bool = True, budget: int = BUDGET) -> Filmstrip:
    """As many frames, as large as fit into a number of bytes.

    Raises:
        InputError: If an image cannot be read.
    """
    common = sorted(set.intersection(*(set(whole_frames(data, camera)) for camera in data.cameras)))
    if not common or not data.outputs:
        return Filmstrip([], 0, {}, (0.0, 1.0))
    frames = spread(common, max(2, MOST_IMAGES // (len(data.cameras) * len(data.outputs))))
    ends = depth_ends(data, spread(frames, 12), data.cameras) if "D" in data.outputs else (0.0, 1.0)
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
    return {camera: {output: list(itertools.islice(texts, len(frames))) for output in data.outputs}
            for camera in data.cameras}
