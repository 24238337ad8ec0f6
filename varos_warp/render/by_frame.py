"""Samples by frame: what the views of a sequence need differs, and the one that needs most need not rule all frames.

Poses along the sequence are judged with few images each (pilot.error); a frame between two of them takes what the more
demanding one needs. As always, what a frame takes follows from the scene alone, not from other frames.
"""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from varos_warp.render import pilot
from varos_warp.render.error_law import FEWEST_SPP, ErrorLaw

SHARE = 0.04
"""Of all samples of a sequence, at most so many are spent on judging its poses."""
FEWEST_STRETCHES, MOST_STRETCHES = 4, 32
"""Stretches between judged poses: with fewer, or with samples that are few anyway, all frames take the same."""
FEWER = 4
"""Each pose is judged with the samples of the most demanding view, and with so many times fewer,"""
JUDGES = 2
"""by so many images with as many."""
REACH = 3
"""Up to so many times beyond what was judged, errors are extrapolated."""


def judged_frames(count: int, pixels: float) -> list[int]:
    """Evenly spread frames of ``count`` to judge, with the first and the last; none where that would not pay.

    Args:
        count: Frames of the sequence.
        pixels: Of an image of the pilot over those of an image of the sequence.
    """
    cost = (1.0 + 1.0 / FEWER + JUDGES) * pixels
    stretches = min(int(SHARE * count / cost), MOST_STRETCHES, count - 1)
    if stretches < FEWEST_STRETCHES:
        return []
    return np.linspace(0, count - 1, stretches + 1).round().astype(int).tolist()


@dataclass(frozen=True)
class Look:
    """A few images of one view."""

    spp: list[int]
    """Samples per pixel of each of the ``images``."""
    images: list[np.ndarray]
    """Denoised radiance [H, W, 3]."""
    judges: list[np.ndarray]
    """Radiance of others."""

    def needs(self, target: float, steepest: float) -> int:
        """Samples per pixel that keep the relative RMSE below a target in every channel.

        Args:
            target: That error.
            steepest: Exponent of the error in the samples, at the least.
        """
        law = ErrorLaw(self.spp, np.array([pilot.error([one], self.judges) for one in self.images]), steepest=steepest)
        return int(np.clip(law.whole_samples(target), self.spp[0] // REACH, REACH * self.spp[-1]))


def look(image: Callable[[int, int], Any], spp: int) -> Look:
    """Look at a view.

    Args:
        image: Makes an image of it, with ``denoised``, from its samples per pixel and the number of its random numbers.
        spp: What the most demanding view needs.
    """
    counts = [max(FEWEST_SPP, spp // FEWER), spp]
    images = [image(count, k).denoised for k, count in enumerate(counts)]
    return Look(counts, images, [image(spp, len(counts) + k).radiance for k in range(JUDGES)])


def stretches(frames: list[int], needed: list[int]) -> list[list[int]]:
    """Pairs of a frame and the samples from there on, from what judged frames need."""
    most = np.maximum(needed[:-1], needed[1:]).tolist()
    return [[frame, spp] for k, (frame, spp) in enumerate(zip(frames, most, strict=False))
            if k == 0 or spp != most[k - 1]]


def spp_of(plan: dict[str, Any], camera: str, frame: int) -> int:
    """Samples per pixel of A of one frame by a plan, as `Plan.to_dict` has it."""
    given = (plan.get("spp_by_frame") or {}).get(camera)
    return given[bisect_right(given, frame, key=lambda pair: pair[0]) - 1][1] if given else plan["spp"]


def mean_spp(plan: dict[str, Any], camera: str, count: int) -> float:
    """The same, on average over the frames of a sequence."""
    return float(np.mean([spp_of(plan, camera, frame) for frame in range(count)]))
