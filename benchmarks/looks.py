"""Statistics by which pictures, synthetic or real, are told apart: necessary for realism, not sufficient.

    python -m benchmarks.looks PICTURES... [--gain 1.0] [-o looks.json]

Pictures are 8 bit files (PNG, JPEG), whose sRGB curve is undone, or EXR, whose linear values are multiplied by a gain.
Of the linear luminance of each:

power slope     exponent of frequency of the power spectrum, by least squares over rings from 4 cycles an image to half
                of the Nyquist frequency, under a Hann window, mean over the squares of the picture. Under water about
                -2.5 (Balboa and Grzywacz 2003, Vision Research 43, 2527), of photographs in air -1.6 to -3.0 (Tolhurst
                et al. 1992)
upper slope     of the five highest of the 13 rings
log gradients   standard deviation and kurtosis of the differences of log(luminance + 0.01) between neighbours along
                rows: few hard edges on nothing have a large kurtosis, a normal distribution has 3
clipped         share of the pixels with all channels at white
dark            share of the pixels below 1 % of white
"""

import sys
from collections.abc import Iterable
from dataclasses import asdict, astuple, dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.stats import kurtosis

from benchmarks.machine import command, markdown, save
from varos_warp.dataset.files import read_exr
from varos_warp.scene.images import srgb_to_linear

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Rec. 709."""
RINGS = 13
LOWEST = 4.0
"""The lowest frequency [cycles an image]."""
UPPER = 5
"""Rings of the upper band."""
OFFSET = 0.01
"""Added to luminance before its logarithm, so that noise in black does not count."""
SMALLEST = 64
"""Sides of pictures [pixels] below which there are fewer frequencies than rings."""
WHITE, DARK = 254.0 / 255.0, 0.01


@dataclass(frozen=True)
class Look:
    """The numbers of one picture."""

    power_slope: float
    upper_slope: float
    gradient_std: float
    gradient_kurtosis: float
    clipped: float
    dark: float


def look_of(pixels: np.ndarray) -> Look:
    """Statistics of a picture, linear float [H, W, 3] with white at 1, neither black nor smaller than 64 pixels."""
    luminance = pixels @ LUMINANCE
    if min(luminance.shape) < SMALLEST or not luminance.any():
        raise ValueError(f"is black, or smaller than {SMALLEST} x {SMALLEST} pixels")
    slope, upper = power_slopes(luminance)
    std, kurtosis = gradient_moments(luminance)
    # white of 8 bits by their curve
    clipped = (pixels.min(-1) >= srgb_to_linear(np.array(WHITE))).mean()
    return Look(slope, upper, std, kurtosis, float(clipped), float((luminance < DARK).mean()))


def power_slopes(luminance: np.ndarray) -> tuple[float, float]:
    """Exponents of frequency of the power spectrum of [H, W]: of all rings, and of the upper ones."""
    side = min(luminance.shape)
    cycles = np.hypot(*np.meshgrid(*[np.fft.fftfreq(side, 1.0 / side)] * 2))
    power = np.mean([_power(square) for square in _squares(luminance)], axis=0)
    edges = np.geomspace(LOWEST, side / 4.0, RINGS + 1)
    rings = [(cycles >= low) & (cycles < high) for low, high in pairwise(edges)]
    # at the mean of the logarithms that the ring has, which no geometric mean of its edges is where it has few
    log_f = np.array([np.log(cycles[ring]).mean() for ring in rings])
    log_power = np.log([max(power[ring].mean(), np.finfo(float).tiny) for ring in rings])
    return (float(np.polyfit(log_f, log_power, 1)[0]), float(np.polyfit(log_f[-UPPER:], log_power[-UPPER:], 1)[0]))


def _squares(luminance: np.ndarray) -> Iterable[np.ndarray]:
    """Squares that cover a picture, half over each other."""
    side = min(luminance.shape)
    long = luminance if luminance.shape[1] >= side and luminance.shape[0] == side else luminance.T
    for start in range(0, long.shape[1] - side + 1, max(side // 2, 1)):
        yield long[:, start : start + side]


def _power(square: np.ndarray) -> np.ndarray:
    window = np.hanning(len(square))
    return np.abs(np.fft.fft2((square - square.mean()) * window[:, None] * window)) ** 2


def gradient_moments(luminance: np.ndarray) -> tuple[float, float]:
    """Standard deviation and kurtosis of the differences of log luminance along rows; of an even picture 0 and 0."""
    step = np.diff(np.log(luminance + OFFSET), axis=1).ravel()
    return float(step.std()), float(kurtosis(step, fisher=False)) if step.any() else 0.0


def read_picture(path: Path, gain: float = 1.0) -> np.ndarray:
    """Linear float [H, W, 3] of a file; ``gain`` makes that of an EXR white at 1, and what is brighter is clipped."""
    if path.suffix.lower() == ".exr":
        channels = read_exr(path)
        return np.clip(gain * np.stack([channels[c] for c in "RGB"], -1).astype(float), 0.0, 1.0)
    with Image.open(path) as image:
        return srgb_to_linear(np.asarray(image.convert("RGB")).astype(float) / 255.0)


def table(looks: dict[str, Look]) -> str:
    """A line of Markdown for each picture, and their median."""
    rows = {name: astuple(look) for name, look in looks.items()}
    rows["median"] = tuple(np.median([*rows.values()], axis=0))
    head = ("picture", "power slope", "upper slope", "log gradients: std", "kurtosis", "clipped", "dark")
    return markdown(head, [(name, *(f"{value:.3g}" for value in row)) for name, row in rows.items()])


def main(arguments: list[str] | None = None) -> int:
    """Print a table; exit status 2 where a picture cannot be read."""
    parser = command(__doc__, device=None)
    parser.add_argument("pictures", nargs="+", type=Path)
    parser.add_argument("--gain", type=float, default=1.0, help="of linear values of EXR")
    parser.add_argument("-o", "--out", type=Path, help="JSON with the same numbers")
    asked = parser.parse_args(arguments)
    looks = {}
    for path in asked.pictures:
        try:
            looks[str(path)] = look_of(read_picture(path, asked.gain))
        except (OSError, ValueError) as error:
            print(f"{path}: {error}", file=sys.stderr)
            return 2
    print(table(looks))
    save(asked.out, {name: asdict(look) for name, look in looks.items()})
    return 0


if __name__ == "__main__":
    sys.exit(main())
