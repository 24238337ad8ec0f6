"""Samples by frame: what the views of a sequence need differs, and the one that needs most need not rule all frames.

Poses along the sequence are judged with few images each (pilot.error); a frame between two of them takes what the more
demanding one needs. As always, what a frame takes follows from the scene alone, not from other frames.
"""

from bisect import bisect_right
from collections.abc import Callable, Hashable, Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from varos_warp.render import pilot
from varos_warp.render.error_law import FEWEST_SPP, REACH, ErrorLaw

SHARE = 0.04
"""Of all samples of a sequence, at most about so many are spent on judging its poses."""
FEWEST_STRETCHES, MOST_STRETCHES = 4, 32
"""Stretches between judged poses: with fewer, or with samples that are few anyway, all frames take the same."""
FEWER = (4, 2, 1)
"""A pose is judged with so many times fewer samples than another one needs,"""
JUDGES = 2
"""by so many images with as many."""
BEYOND, ROUNDS = 1.5, 2
"""If it needs more than so many times what it was judged with, it is judged again with that, so often in all."""
JUDGING_THREADS = 2
"""That judge images while others are rendered."""


def judged_frames(count: int, pixels: float) -> list[int]:
    """Evenly spread frames of ``count`` to judge, with the first and the last; none where that would not pay.

    Args:
        count: Frames of the sequence.
        pixels: Of an image of the pilot over those of an image of the sequence.
    """
    cost = (sum(1.0 / fewer for fewer in FEWER) + JUDGES) * pixels
    stretches = min(int(SHARE * count / cost), MOST_STRETCHES, count - 1)
    if stretches < FEWEST_STRETCHES:
        return []
    return np.linspace(0, count - 1, stretches + 1).round().astype(int).tolist()


@dataclass(frozen=True)
class Look:
    """A few images of one view."""

    spp: list[int]
    """Samples per pixel of each of the ``images``, in ascending order."""
    images: list[np.ndarray]
    """Denoised radiance [H, W, 3]."""
    judges: list[np.ndarray]
    """Radiance of others."""

    def needs(self, target: float, steepest: float) -> int:
        """Samples per pixel that keep the relative RMSE below a target in every channel.

        Between two numbers of samples as they say, beyond as all do. Where the judges are too noisy to tell the square
        of an error (`pilot.JUDGED_TO`), the upper end of what chance leaves open counts, and no fewer are taken than
        were judged.

        Args:
            target: That error.
            steepest: Exponent of the error in the samples, at the least.
        """
        errors, upper = np.swapaxes([pilot.error([image], self.judges, (0.0, 1.0)) for image in self.images], 0, 1)
        vague = np.any(upper**2 > (1.0 + pilot.JUDGED_TO) * errors**2, axis=1)
        errors = np.where(vague[:, None], upper, errors)
        enough = int(np.argmax(errors.max(1) <= target)) if errors[-1].max() <= target else 0
        near = slice(enough - 1, enough + 1) if enough else slice(None)
        needed = ErrorLaw(self.spp[near], errors[near], steepest=steepest).whole_samples(target)
        least = self.spp[-1] if vague[-1] else self.spp[0] // REACH
        return int(np.clip(needed, least, REACH * self.spp[-1]))


def look(image: Callable[[int, int, bool], np.ndarray], spp: int) -> Look:
    """Look at a view.

    Args:
        image: Makes the radiance [H, W, 3] of an image of it, from its samples per pixel, the number of its random
            numbers, and whether to denoise it.
        spp: About what it may need.
    """
    counts = sorted({max(FEWEST_SPP, spp // fewer) for fewer in FEWER})
    images = [image(count, k, True) for k, count in enumerate(counts)]
    return Look(counts, images, [image(spp, len(counts) + k, False) for k in range(JUDGES)])


def samples_needed(image: Callable[[Any, int, int, bool], np.ndarray], views: Iterable[Hashable], spp: int,
                   target: float, steepest: float) -> dict[Any, int]:
    """Samples per pixel that each view needs.

    Args:
        image: Makes the radiance of a view, the first argument, as in `look`.
        views: The views.
        spp: What another view needs, `FEWER[0]` at least.
        target: As in `Look.needs`, like ``steepest``.
    """
    needed, judged = {}, dict.fromkeys(views, spp)
    for _ in range(ROUNDS):
        with ThreadPoolExecutor(JUDGING_THREADS) as pool:  # on a GPU judging takes as long as rendering
            found = {view: pool.submit(look(partial(image, view), count).needs, target, steepest)
                     for view, count in judged.items()}
        needed |= {view: future.result() for view, future in found.items()}
        judged = {view: needed[view] for view, count in judged.items() if needed[view] > BEYOND * count}
    return needed


def stretches(frames: list[int], needed: list[int]) -> list[list[int]]:
    """Pairs of a frame and the samples from there on, from what judged frames need."""
    most = np.maximum(needed[:-1], needed[1:]).tolist()
    return [[frame, spp] for k, (frame, spp) in enumerate(zip(frames, most, strict=False))
            if k == 0 or spp != most[k - 1]]


def extent(given: dict[str, list[list[int]]]) -> tuple[int, int]:
    """The fewest and the most samples of all cameras' `stretches`."""
    counts = [spp for pairs in given.values() for _, spp in pairs]
    return min(counts), max(counts)


def spp_of(plan: dict[str, Any], camera: str, frame: int) -> int:
    """Samples per pixel of A of one frame by a plan, as `Plan.to_dict` has it."""
    given = (plan.get("spp_by_frame") or {}).get(camera)
    return given[bisect_right(given, frame, key=lambda pair: pair[0]) - 1][1] if given else plan["spp"]


def mean_spp(plan: dict[str, Any], camera: str, count: int) -> float:
    """The same, on average over the frames of a sequence."""
    return float(np.mean([spp_of(plan, camera, frame) for frame in range(count)]))
