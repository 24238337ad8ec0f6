"""Loop closures: frames that see a place again which the camera had left, by true poses and depths."""

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project, seen_pixels
from varos_warp.dataset.reader.rows import sight
from varos_warp.dataset.readiness.frames.truth import hidden_behind

SAME, LEFT = 0.5, 0.25
"""Share of a frame's points that another sees: from the first on it is the same place, below the second it was left."""
MOST_FRAMES, POINTS = 200, 100
"""Most frames that are compared (every n-th frame of a longer dataset), and points of each frame."""


def overlaps(data: Dataset, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Places of frames [n], and the share of what each sees that each of them sees, unhidden, [n, n]."""
    chosen = np.unique(np.linspace(0, len(data) - 1, min(len(data), MOST_FRAMES)).round().astype(int))
    model, about, points = data.camera_model(camera), data.camera(camera), []
    for index in chosen:
        frame = data.frames[index]
        row, col, z = seen_pixels(data.planar_depth(frame, camera), POINTS)
        points.append(points_at(model, sight(data, frame, camera), row, col, z))
    size, owner = [about["width"], about["height"]], np.repeat(np.arange(len(chosen)), [len(p) for p in points])
    share, everything = np.zeros((len(chosen), len(chosen))), np.concatenate(points)
    count = np.bincount(owner, minlength=len(chosen))
    for j, index in enumerate(chosen):
        frame = data.frames[index]
        seen = project(everything, model, sight(data, frame, camera))
        with np.errstate(invalid="ignore"):
            there = (seen[:, 2] > 0) & ((seen[:, :2] >= 0) & (seen[:, :2] < size)).all(1)
        there &= ~hidden_behind(data.planar_depth(frame, camera), seen)
        share[:, j] = np.bincount(owner, there, len(chosen)) / np.maximum(count, 1)
    return chosen, share


def closures(share: np.ndarray) -> list[tuple[int, int]]:
    """(later, earlier) frames of which each sees half of what the other does, and left it in between.

    Of each later frame the earlier one with the largest overlap; ``share`` [n, n] is as `overlaps` makes it.
    """
    both, found = np.minimum(share, share.T), []
    for late in range(len(share)):
        away = np.flatnonzero(both[late, :late] < LEFT)
        early = both[late, : away[-1]] if len(away) else np.zeros(0)
        if len(early) and early.max() >= SAME:
            found.append((late, int(early.argmax())))
    return found


def loop_closures(data: Dataset, camera: str) -> list[tuple[int, int]]:
    """(frame, earlier frame) by their numbers."""
    chosen, share = overlaps(data, camera)
    return [(data.frames[chosen[late]], data.frames[chosen[early]]) for late, early in closures(share)]
