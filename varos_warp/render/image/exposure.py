"""Exposure correction (paper 3.2.1): the gain that each frame of A, B and P gets before its 8 bit PNG.

The gains of a sequence follow from the statistics of all its frames, so that they do not depend on the order, the
shards or the interruptions in which the frames were rendered.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from varos_warp.products.images.registry import OUTPUTS
from varos_warp.scene.description.exposure import Gain, PercentileMeter, WhiteBalance, gain_of, white_balance_of
from varos_warp.scene.lights.balance import MOST_BALANCE, lamp_gains

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

GREY_WORLD: Literal["grey_world"] = "grey_world"
"""White balance by the mean of each frame."""
Rgb = tuple[float, float, float]
FrameGain = float | Rgb
"""Gain of a frame: of all channels, or of an image with white balance of red, green and blue."""


@dataclass(frozen=True)
class Channels:
    """What white balance depends on: statistics of red, green and blue by themselves."""

    highlight: Rgb
    """`HIGHLIGHT_PERCENTILE`, or where that is black, the brightest."""
    mean: Rgb
    """Means by the weights of a meter."""
    metered: Rgb | None = None
    """Percentile of each channel that a meter reads, or where that is black, the brightest; None: there is no meter."""

    @property
    def grey_gains(self) -> np.ndarray:
        """Gains [3] in the green one's that make the means equal, within `MOST_BALANCE`; NaN for a black frame."""
        mean = np.array(self.mean)
        if not mean.max() > 0.0:
            return np.full(3, np.nan)
        wanted = np.divide(mean[1], mean, out=np.full(3, np.inf), where=mean > 0.0)
        red, _, blue = np.clip(wanted, 1.0 / MOST_BALANCE, MOST_BALANCE)
        return np.array([red, 1.0, blue])


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
    channels: Channels | None = None
    """Statistics of each channel; None where there is no white balance."""

    def balanced(self, balance: np.ndarray) -> "Statistics":
        """Statistics of the frame with each channel times its gain [3], as far as those of its channels tell.

        Highlight and what a meter reads are the largest of the channels' own, each by its gain: no channel clips more
        than asked, all together at most three times as much. The mean is that of the balanced frame; the log-average
        grows with it, as it does exactly if all is of one colour.
        """
        if self.channels is None or np.isnan(self.highlight):
            return self
        highlight = float((balance * self.channels.highlight).max())
        metered = None if self.channels.metered is None else float((balance * self.channels.metered).max())
        mean = float((LUMINANCE * balance * self.channels.mean).sum())
        grown = mean / float((LUMINANCE * self.channels.mean).sum())
        return Statistics(self.log_average * grown, highlight, metered, None if metered is None else mean)

    @property
    def target_gain(self) -> float:
        """Gain that would suit this frame alone: the key value, unless the highlights would burn out."""
        return min(KEY_VALUE / self.log_average, 1.0 / self.highlight)

    def metered_gain(self, meter: PercentileMeter) -> float:
        """Gain that would suit this frame alone by a meter; NaN where it reads black."""
        if not (self.metered and self.mean):
            return np.nan
        return min(meter.level / self.metered, meter.mean / self.mean if meter.mean else np.inf)


def statistics(radiance: np.ndarray, meter: PercentileMeter | None = None, by_channel: bool = False) -> Statistics:
    """Statistics of one frame of linear radiance [H, W, 3] (the contents of its half-float EXR).

    ``by_channel`` adds those that white balance needs. All scale with the radiance, so that twice the light means
    exactly half the gain.
    """
    # each channel by itself, with pixels side by side, takes less time
    red, green, blue = (np.maximum(radiance[..., i].astype(np.float64), 0.0) for i in range(3))
    brightest = np.maximum(np.maximum(red, green), blue)
    highlight = float(np.percentile(brightest, HIGHLIGHT_PERCENTILE)) or float(brightest.max())
    if not highlight > 0.0:
        black = Channels((0.0,) * 3, (0.0,) * 3, (0.0,) * 3 if meter else None) if by_channel else None
        return Statistics(np.nan, np.nan, *((0.0, 0.0) if meter else (None, None)), black)
    # no matrix product: how BLAS sums depends on its threads
    luminance = red * LUMINANCE[0] + green * LUMINANCE[1] + blue * LUMINANCE[2]
    log_average = float(np.exp(np.log(np.maximum(luminance, FLOOR * highlight)).mean()))
    channels = _of_channels((red, green, blue), meter) if by_channel else None
    if meter is None:
        return Statistics(log_average, highlight, channels=channels)
    metered = weighted_percentile(brightest, meter.percentile) or float(brightest.max())
    weight = centre_weights(*luminance.shape)
    return Statistics(log_average, highlight, metered, float((weight * luminance).sum() / weight.sum()), channels)


def _of_channels(planes: tuple[np.ndarray, np.ndarray, np.ndarray], meter: PercentileMeter | None) -> Channels:
    """Statistics of red, green and blue [H, W]."""
    weight = centre_weights(*planes[0].shape)
    highlight = [float(np.percentile(plane, HIGHLIGHT_PERCENTILE)) or float(plane.max()) for plane in planes]
    mean = [float((weight * plane).sum() / weight.sum()) for plane in planes]
    if meter is None:
        return Channels(as_rgb(highlight), as_rgb(mean))
    metered = [weighted_percentile(plane, meter.percentile) or float(plane.max()) for plane in planes]
    return Channels(as_rgb(highlight), as_rgb(mean), as_rgb(metered))


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


@dataclass(frozen=True)
class Rule:
    """How the frames of an image type of a camera get their gains."""

    gain: Gain
    balance: Literal["grey_world"] | Rgb | None = None
    """White balance: by the frames, by the same gains in all of them, or none."""

    @property
    def meter(self) -> PercentileMeter | None:
        """The meter by which it exposes, if any."""
        return meter_of(self.gain)

    def statistics(self, radiance: np.ndarray) -> Statistics:
        """What it depends on of one frame [H, W, 3] (`statistics`)."""
        return statistics(radiance, self.meter, self.balance is not None)

    def known(self, output: str) -> FrameGain | None:
        """The gain, where it is known before any frame is rendered (`known_gain`)."""
        gain = known_gain(self.gain, output)
        if gain is None or self.balance is None:
            return gain
        return None if self.balance == GREY_WORLD else as_rgb(gain * part for part in self.balance)

    def gains(self, output: str, time_s: np.ndarray, frames: list[Statistics]) -> np.ndarray:
        """Gain of every frame of one camera [N], or with white balance of each channel [N, 3] (`gains`)."""
        if self.balance is None:
            return gains(self.gain, output, time_s, frames)
        balance = self._balances(np.asarray(time_s, float), frames)
        balanced = [frame.balanced(of_frame) for frame, of_frame in zip(frames, balance, strict=True)]
        return gains(self.gain, output, time_s, balanced)[:, None] * balance

    def _balances(self, time_s: np.ndarray, frames: list[Statistics]) -> np.ndarray:
        """White balance [N, 3] of every frame, in the gain of green: smoothed as the gain is, or as constant."""
        if self.balance != GREY_WORLD:
            return np.tile(np.array(self.balance), (len(time_s), 1))
        target = np.log([frame.channels.grey_gains if frame.channels else np.full(3, np.nan) for frame in frames])
        if np.isnan(target).all():
            return np.ones_like(target)
        if self.gain == "constant":
            return np.tile(np.exp(np.nanmedian(target, axis=0)), (len(time_s), 1))
        return np.exp(np.stack([_smooth(time_s, channel) for channel in target.T], axis=-1))


def rule_of(scene: Any, camera: str, output: str) -> Rule:
    """How a scene exposes an image type of a camera; P as A.

    Raises:
        InputError: If white balance is for lamps, and none lights what is in focus.
    """
    view = next(each for each in scene.vehicle.cameras if each.id == camera)
    setting = scene.render.exposure, view.exposure, OUTPUTS[output].settings
    return rule_by(gain_of(*setting), white_balance_of(*setting), lambda: lamp_gains(scene, view))


def rule_by(gain: Gain, balance: WhiteBalance, of_lamps: Callable[[], Iterable[float]]) -> Rule:
    """The rule of two settings of a scene; ``of_lamps`` gives the gains of white balance for lamps."""
    if balance == "lamps":
        return Rule(gain, as_rgb(of_lamps()))
    return Rule(gain, GREY_WORLD if balance == GREY_WORLD else None)


def as_rgb(values: Iterable[float]) -> Rgb:
    """Three numbers."""
    red, green, blue = map(float, values)
    return red, green, blue


def as_gain(of_frame: float | list[float]) -> FrameGain:
    """Gain of a frame of a row of an array as a list: a number, or three."""
    return as_rgb(of_frame) if isinstance(of_frame, list) else of_frame


def in_words(gain: FrameGain) -> str:
    """A gain to three digits; of an image with white balance those of red, green and blue."""
    return " / ".join(f"{part:.3g}" for part in (gain if isinstance(gain, tuple) else [gain]))


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
