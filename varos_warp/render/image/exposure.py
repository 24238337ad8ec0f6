"""Exposure correction (paper 3.2.1): the gain that each frame of A, B and P gets before its 8 bit PNG.

The gains of a sequence follow from the statistics of all its frames, so that they do not depend on the order, the
shards or the interruptions in which the frames were rendered.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.exposure import Gain, PercentileMeter, gain_of

KEY_VALUE = 0.18
"""Linear value that the log-average luminance of a frame is exposed to (Reinhard et al. 2002)."""
HIGHLIGHT_PERCENTILE = 99.0
"""Share of the pixels [%] that a frame's own gain keeps below white."""
FLOOR = 1e-3
"""Luminance, as a share of the highlights, below which darkness no longer asks for more gain."""
TIME_CONSTANT_S = 1.0
"""Standard deviation [s] of the Gaussian that smooths the logarithm of the gain over time."""

EDGE_WEIGHT = 0.25
"""What a pixel in the middle of an edge of the image counts for a meter, beside one in the centre; one in a corner
counts the square of it."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of linear red, green and blue in the luminance (Rec. 709)."""


@dataclass(frozen=True)
class Statistics:
    """What the exposure of a frame depends on; NaN for a black frame."""

    log_average: float
    """Geometric mean of the luminance."""
    highlight: float
    """`HIGHLIGHT_PERCENTILE` of each pixel's brightest channel."""

    metered: float | None = None
    """What a meter reads: the percentile, or where that is black, the brightest pixel. None where there is no meter."""
    mean: float | None = None
    """Mean of the luminance by the weights of a meter."""

    @property
    def target_gain(self) -> float:
        """Gain that would suit this frame alone: the key value, unless the highlights would burn out."""
        return min(KEY_VALUE / self.log_average, 1.0 / self.highlight)

    def metered_gain(self, meter: PercentileMeter) -> float:
        """Gain that would suit this frame alone by a meter; NaN where it reads black."""
        if not (self.metered and self.mean):
            return np.nan
        return min(meter.level / self.metered, meter.mean / self.mean if meter.mean else np.inf)


def statistics(radiance: np.ndarray, meter: PercentileMeter | None = None) -> Statistics:
    """Statistics of one frame of linear radiance [H, W, 3] (the contents of its half-float EXR).

    All scale with the radiance, so that twice the light means exactly half the gain.
    """
    # each channel by itself, with pixels side by side, takes less time
    red, green, blue = (np.maximum(radiance[..., i].astype(np.float64), 0.0) for i in range(3))
    brightest = np.maximum(np.maximum(red, green), blue)
    highlight = float(np.percentile(brightest, HIGHLIGHT_PERCENTILE)) or float(brightest.max())
    if not highlight > 0.0:
        return Statistics(np.nan, np.nan, *((0.0, 0.0) if meter else ()))
    # no matrix product: how BLAS sums depends on its threads
    luminance = red * LUMINANCE[0] + green * LUMINANCE[1] + blue * LUMINANCE[2]
    log_average = float(np.exp(np.log(np.maximum(luminance, FLOOR * highlight)).mean()))
    if meter is None:
        return Statistics(log_average, highlight)
    metered = weighted_percentile(brightest, meter.percentile) or float(brightest.max())
    weight = centre_weights(*luminance.shape)
    return Statistics(log_average, highlight, metered, float((weight * luminance).sum() / weight.sum()))


def centre_weights(height: int, width: int) -> np.ndarray:
    """What each pixel counts for a meter [H, W]: parabolas from 1 in the centre to `EDGE_WEIGHT` at the edges.

    Products and sums only, which every machine rounds alike.
    """

    def along(count: int) -> np.ndarray:
        place = (2.0 * np.arange(count) + 1.0 - count) / count
        return 1.0 - (1.0 - EDGE_WEIGHT) * place * place

    return along(height)[:, None] * along(width)


def weighted_percentile(values: np.ndarray, percentile: float) -> float:
    """The least of some values [H, W], those of half floats from 0 on, that leaves no more weight above than asked.

    Half floats from 0 on are in the order of their bits, of which there are few: that takes a tenth of sorting's time.
    """
    bits = values.astype(np.float16).view(np.uint16).ravel()
    weight = np.cumsum(np.bincount(bits, centre_weights(*values.shape).ravel()))
    number = np.searchsorted(weight, percentile / 100.0 * weight[-1])
    return float(np.uint16(min(number, len(weight) - 1)).view(np.float16))


def setting_of(scene: Any, camera: str, output: str) -> Gain:
    """What a scene says of the gains of an image type of a camera; of P, what it says of A."""
    view = next(each for each in scene.vehicle.cameras if each.id == camera)
    return gain_of(scene.render.exposure, view.exposure, OUTPUTS[output].settings)


def known_gain(setting: Gain, output: str) -> float | None:
    """The gain, where it is known before any frame is rendered: a number, or ``constant`` for B; P follows A."""
    if OUTPUTS[output].like:
        return None
    if isinstance(setting, float | int):
        return float(setting)
    return OUTPUTS[output].constant_gain if setting == "constant" else None


def meter_of(setting: Gain) -> PercentileMeter | None:
    """The meter by which a setting exposes; None if it does so by the brightness of the frames, or not at all."""
    return setting if isinstance(setting, PercentileMeter) else None


def gains(setting: Gain, output: str, time_s: np.ndarray, frames: list[Statistics]) -> np.ndarray:
    """Gain [N] of every frame of one camera.

    Args:
        setting: A number: that gain. ``constant``: 1 for B, the median over the sequence for A. ``adaptive``:
            follows the light, smoothed over time. A meter: as it reads, smoothed over time.
        output: ``A``, ``B`` or ``P``.
        time_s: Time [N] of each frame, ascending [s].
        frames: Statistics [N] of each frame, by the meter if there is one.
    """
    count, known = len(time_s), known_gain(setting, output)
    if known is not None:
        return np.full(count, known)
    meter = meter_of(setting)
    target = np.log([frame.metered_gain(meter) if meter else frame.target_gain for frame in frames])
    if np.isnan(target).all():
        return np.ones(count)
    if setting == "constant":
        return np.full(count, float(np.exp(np.nanmedian(target))))
    return np.exp(_smooth(np.asarray(time_s, float), target))


def _smooth(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Gaussian mean of ``values`` [N] over time; black frames (NaN) take what the nearest ones say."""
    known = ~np.isnan(values)
    time_known, values_known = time_s[known], values[known]
    result = np.empty_like(values)
    for k, t in enumerate(time_s):
        distance = np.square((time_known - t) / TIME_CONSTANT_S) / 2.0
        weight = np.exp(distance.min() - distance)  # relative to the nearest, so that a long gap does not underflow
        result[k] = weight @ values_known / weight.sum()
    return result
