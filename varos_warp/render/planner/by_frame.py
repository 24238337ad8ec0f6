"""Samples by frame: what the views of a sequence need differs, and the one that needs most need not rule all frames.

Poses along the sequence are tried with a few images each (errors.Made), closer together where their needs are unlike.
A frame between two poses takes a number between theirs, in proportion, or what the more demanding one needs if they are
unlike even so. As always, what a frame takes follows from the scene alone, not from other frames.
"""

from collections.abc import Callable, Iterable
from functools import partial
from heapq import nlargest
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from varos_warp.render.planner import errors
from varos_warp.render.planner.errors import REACH, ErrorLaw, Made, Samples, error, of_others

SHARE = 0.07
"""Share of a sequence's samples that trying its poses may cost, about."""
FEWEST_STRETCHES, MOST_STRETCHES = 4, 32
"""Stretches between evenly spread poses; with fewer, or where few samples are needed, all frames take the same."""
UNLIKE = 1.5
"""The ends of a stretch are unlike if one needs more than so many times the samples of the other."""
HALVINGS, HALVED = 2, 0.25
"""Stretches with unlike ends are halved this often, each time at most this share of the poses."""
FEWER = (4, 2, 1)
"""A pose is tried with the samples that it may need over each of these; the three images tell each other's errors."""
A_POSE = sum(1.0 / fewer for fewer in FEWER)
"""Samples of these images, over those that the pose may need."""
FIRST = 1
"""Samples that the first poses may need, or twice the fewest, or a `REACH`-th of what the noisiest view needs, if that
is more."""
BEYOND, MOST_IMAGES = 1.5, 6
"""Images are added one by one while a pose needs more than 1.5 times the most samples that it was tried with, or while
its images do not tell, up to six."""

Place = tuple[str, int]
"""Camera and frame."""


def tried_frames(count: int, pixels: float) -> list[int]:
    """Evenly spread frames of ``count`` to try, with the first and the last; none where that would not pay.

    Args:
        count: Frames of the sequence.
        pixels: Of an image of the pilot over those of an image of the sequence.
    """
    stretches = min(int(SHARE * count / (A_POSE * pixels)), MOST_STRETCHES, count - 1)
    if stretches < FEWEST_STRETCHES:
        return []
    return np.linspace(0, count - 1, stretches + 1).round().astype(int).tolist()


def first_guess(samples: Samples) -> float:
    """Samples that a view may need of which nothing is known: its images are to have two unlike numbers of them."""
    return max(FIRST, 2 * samples.fewest)


class Need(NamedTuple):
    """What images of a view say of the samples that it needs."""

    spp: float
    told: bool
    """True if the images tell it."""


def need(made: list[Made], target: float, samples: Samples) -> Need:
    """Samples per pixel that keep the relative RMSE below a target in every channel.

    Between two numbers of samples as they say, beyond as all do; no more than were enough. Where the images are too
    noisy to tell the square of an error (`errors.PRECISE`), the upper end of what chance leaves open counts, and where
    that is above the target, no fewer are taken than were tried.

    Args:
        made: Images of the view, those that are denoised with samples in ascending order.
        target: That error.
        samples: Of the integrator.
    """
    tried = [one for one in made if one.denoised is not None]
    counts = [one.spp for one in tried]
    found, upper = np.swapaxes([of_others(error, one, made, (0.0, 1.0)) for one in tried], 0, 1)
    vague = np.any(upper**2 > (1.0 + errors.PRECISE) * found**2, axis=1)
    found = np.where(vague[:, None], upper, found)
    failed = np.flatnonzero(found.max(1) > target)
    enough = int(failed[-1]) + 1 if failed.size else 0  # the first number from which on all are
    near = slice(enough - 1, enough + 1) if 0 < enough < len(counts) else slice(None)
    needed = ErrorLaw(counts[near], found[near], samples.steepest).samples(target)
    most = counts[enough] if enough < len(counts) else REACH * counts[-1]
    told = not vague[-1] or upper[-1].max() <= target
    least = counts[0] / REACH if told else counts[-1]
    return Need(samples.rounded(max(least, min(needed, most))), told)


def trial(image: Callable[[float, int, bool], Made], spp: float, samples: Samples) -> list[Made]:
    """A few images of a view.

    Args:
        image: Makes one, from its samples per pixel, the number of its random numbers, and whether to denoise it.
        spp: About what it may need.
        samples: Of the integrator.
    """
    counts = [samples.rounded(spp / fewer) for fewer in FEWER]
    return [image(count, k, count not in counts[:k]) for k, count in enumerate(counts)]


def samples_needed(image: Callable[[float, int, bool], Made], spp: float, target: float, samples: Samples) -> float:
    """Samples per pixel that a view needs; arguments as of `trial` and `need`."""
    made = trial(image, spp, samples)
    while True:
        said, most = need(made, target, samples), max(one.spp for one in made)
        if len(made) == MOST_IMAGES or (said.told and said.spp <= BEYOND * most):
            return said.spp
        made.append(image(max(said.spp, most), len(made), said.spp > most))


def samples_along(
    image: Callable[[Place, float, int, bool], Made],
    views: list[Place],
    worst: tuple[Place, float],
    target: float,
    samples: Samples,
    each: Callable[..., Iterable] = map,
) -> dict[Place, float]:
    """Samples per pixel that views along a sequence need, and others halfway where they differ much.

    Args:
        image: Makes an image of a view, the first argument, as in `trial`.
        views: The first views.
        worst: The view that is thought to need most, and what it needs.
        target: As in `need`.
        samples: Of the integrator.
        each: Applies a function to several views, as ``map`` does; perhaps at once.
    """
    place, most = worst
    needed, least = {place: most}, first_guess(samples)
    tried = dict.fromkeys(sorted({*views} - {place}), max(least, most / REACH))

    def one(view, spp):
        return samples_needed(partial(image, view), spp, target, samples)

    for _ in range(HALVINGS + 1):
        needed |= zip(tried, each(one, tried, tried.values()), strict=True)
        tried = halfway(needed, least)
    return needed


def halfway(needed: dict[Place, float], least: float) -> dict[Place, float]:
    """Views between neighbours that are unlike, and about what they may need, which is ``least`` or more."""
    unlike = {
        (a, b): max(needed[a], needed[b]) / min(needed[a], needed[b])
        for a, b in pairwise(sorted(needed))
        if a[0] == b[0] and b[1] - a[1] > 1
    }
    chosen = nlargest(round(HALVED * len(needed)), (ends for ends in unlike if unlike[ends] > UNLIKE), key=unlike.get)
    return {(a[0], (a[1] + b[1]) // 2): max(least, 0.5 * (needed[a] + needed[b])) for a, b in chosen}


def knots(needed: dict[Place, float]) -> dict[str, list[list[float]]]:
    """Pairs of a frame and its samples, between which they change in proportion."""
    given = {}
    for (camera, frame), spp in sorted(needed.items()):
        pairs = given.setdefault(camera, [])
        before = pairs[-1] if pairs else [frame, spp]
        if spp > UNLIKE * before[1]:
            pairs.append([before[0] + 1, spp])
        elif before[1] > UNLIKE * spp:
            pairs.append([frame - 1, before[1]])
        pairs.append([frame, spp])
    return given
