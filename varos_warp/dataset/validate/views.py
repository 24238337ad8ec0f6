"""Images of several views of one scene, held against each other through rays and poses.

Points of D seen in one frame lie where D of another frame has them. What C, S and B show at such a point is what they
show there in the other frame; A changes with the vehicle's lamps.
"""

import contextlib
import itertools
from collections import Counter
from collections.abc import Iterator
from functools import lru_cache, partial

import numpy as np

from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project, seen_pixels
from varos_warp.dataset.reader.rows import sight
from varos_warp.dataset.validate.blur import blur_of
from varos_warp.dataset.validate.objects import of_still, swept
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.errors import InputError
from varos_warp.scene.description.image_types import AMBIENT, DEPTH, NORMALS, SEGMENTS

PAIRS = 8
"""Pairs of views compared per camera for the residuals that are reported."""
MOST_POINTS = 20_000
"""Points of a frame that are looked for in the next ones."""
CHUNK = 16
"""Frames that one thread compares in turn."""
ROUGH = 0.2
"""Pixels by which a rough surface may be off between views, at the median."""
FEWEST_POINTS = 200
"""Fewest common points that say something."""
INDEPENDENT = 1.0 - 0.8**3 + 0.05
"""Share of points outside the box of nine neighbours in some channel, if all pixels were independent of each other (the
tenth of ten numbers is the least or the largest of them in two cases of ten), and a little for chance."""

LEAST = {NORMALS: 0.1, SEGMENTS: 0.01, AMBIENT: 0.1}
"""Share of such points that is no cause for doubt: detail finer than a pixel; S has less of it."""


# ----------------------------------------------------------------------------------------------------------- geometry


class _View:
    """What a camera sees at a frame: planar depth [H, W], and pixels of some images [H, W, channels]."""

    def __init__(self, data: Dataset, frame: int, camera: str, letters: str = ""):
        self.model, self.T_w_c = data.camera_model(camera), sight(data, frame, camera)
        self.depth = of_still(data, data.planar_depth(frame, camera), frame, camera)
        self.images = {}
        self.streak = blur_of(data, frame, camera, self.depth).streak if AMBIENT in letters else None
        self.swept = swept(data, frame, camera, self.depth.shape) if AMBIENT in letters else None
        for letter in letters:
            with contextlib.suppress(InputError):  # told of already
                pixels = data.pixels(letter, frame, camera)
                if pixels.shape[:2] == self.depth.shape:
                    self.images[letter] = pixels.reshape(*pixels.shape[:2], -1)


def _matches(first: _View, second: _View) -> list[np.ndarray]:
    """Points of D in one view, of a grid of about `MOST_POINTS` pixels, that another view has, too.

    Returns:
        row, col of the pixels in the first view; u, v [px] and depth z [m] in the second; its own depth there [m].
    """
    row, col, z = seen_pixels(first.depth, MOST_POINTS)
    u, v, z = project(points_at(first.model, first.T_w_c, row, col, z), second.model, second.T_w_c).T
    height, width = second.depth.shape
    inside = (z > 0) & (u >= 1) & (v >= 1) & (u < width - 1) & (v < height - 1)
    row, col, u, v, z = (x[inside] for x in (row, col, u, v, z))
    seen = _interpolate_depth(second.depth, v - 0.5, u - 0.5)
    return [x[np.isfinite(seen)] for x in (row, col, u, v, z, seen)]


def _interpolate_depth(depth: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Bilinear in 1 / z, which is exact on a plane; NaN next to an edge (10 %) or to nothing."""
    r, c = np.floor(row).astype(int), np.floor(col).astype(int)
    corners = np.stack([depth[r, c], depth[r, c + 1], depth[r + 1, c], depth[r + 1, c + 1]])
    fr, fc = row - r, col - c
    weights = np.stack([(1 - fr) * (1 - fc), (1 - fr) * fc, fr * (1 - fc), fr * fc])
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = corners.max(0) < 1.1 * corners.min(0)
        return np.where(np.isfinite(corners).all(0) & flat, 1.0 / np.sum(weights / corners, axis=0), np.nan)


# ---------------------------------------------------------------------------------------------------------- residuals


def _view_pairs(data: Dataset, frames: list[int]) -> Iterator[tuple[str, tuple[int, str], tuple[int, str]]]:
    """Pairs of views that see much the same: frames of one camera up to a second apart, and two cameras at once."""
    reach, known = min(max(1, round(data.meta["frames"]["rate_hz"])), len(frames) - 1), set(frames)
    for camera in data.cameras:
        for step, name in {reach: f"D of frames {reach} apart", 1: "D of successive frames"}.items():
            starts = [f for f in frames if step > 0 and f + step in known]
            for i in np.unique(np.linspace(0, len(starts) - 1, min(PAIRS, len(starts))).astype(int)):
                yield f"{camera}: {name}", (starts[i], camera), (starts[i] + step, camera)
    for one, other in itertools.pairwise(data.cameras):
        if data.camera(one)["mount"] == data.camera(other)["mount"]:
            for a in frames[:: max(1, len(frames) // PAIRS)]:
                yield f"{one}, {other}: D of the same moment", (a, one), (a, other)


def check_residuals(data: Dataset, result: Validation, frames: list[int]) -> None:
    """Points of D seen in one view lie where D of another view has them.

    Limits: one step of D and a fifth of a pixel's footprint at the median distance; a fifth of a pixel. On a plane
    nothing but the steps remains (the demo: 0.2 mm, 0.0003 px); the rest is for surfaces rough on the scale of a pixel.
    """
    errors: dict[str, list[np.ndarray]] = {}
    for name, first, second in _view_pairs(data, frames):
        try:
            errors.setdefault(name, []).append(_residuals(_View(data, *first), _View(data, *second)))
        except InputError as error:
            result.add(result.problem_of(error))
    for name, parts in errors.items():
        metres, pixels, footprint = np.concatenate(parts).T if parts else np.empty((3, 0))
        if len(metres):
            limit = data.meta["depth"]["scale_m"] + ROUGH * np.median(footprint)
            result.measure(f"{name}, median", 1000 * np.median(metres), 1000 * limit, "mm")
            result.measure(f"{name}, median", np.median(pixels), ROUGH, "px")


def _residuals(first: _View, second: _View) -> np.ndarray:
    """Rows (error in depth [m], error there and back [px], footprint of a pixel [m]) of the pixels seen in both."""
    row, col, u, v, z, seen = _matches(first, second)
    points = points_at(second.model, second.T_w_c, v - 0.5, u - 0.5, seen)
    back = project(points, first.model, first.T_w_c).T
    pixels = np.hypot(back[0] - col - 0.5, back[1] - row - 0.5)
    return np.column_stack([np.abs(seen - z), pixels, z / second.model.K[0, 0]])


# --------------------------------------------------------------------------------------------------------- neighbours


def _compare(first: _View, second: _View, step_m: float) -> dict[str, float]:
    """How far two frames of a camera are apart, D in steps of ``step_m``; nothing where they have too little in common.

    Returns:
        ``D``: |median error in depth| over what is allowed. C, S, B: share of common points that show in the
        first frame what none of the nine pixels about them shows in the second, channel by channel.
    """
    matches = _matches(first, second)
    row, col, u, v, z, seen = matches
    if len(z) < FEWEST_POINTS:
        return {}
    found = {DEPTH: abs(np.median(seen - z)) / (step_m + 0.1 * np.median(z) / second.model.K[0, 0])}
    row, col, u, v, *_ = (x[np.abs(seen - z) < 0.02 * z].astype(int) for x in matches)
    letters = first.images.keys() & second.images.keys()
    if AMBIENT in letters and not np.hypot(*(first.streak - second.streak)) <= 1.0:
        letters -= {AMBIENT}  # it is blurred otherwise
    for letter in sorted(letters, key=list(LEAST).index):
        if letter == AMBIENT:
            row, col, u, v = (x[~(first.swept[row, col] | second.swept[v, u])] for x in (row, col, u, v))
        if len(row) < FEWEST_POINTS:
            break
        here, there = first.images[letter][row, col].astype(np.int32), second.images[letter]
        nine = np.stack([there[v + i, u + j] for i in (-1, 0, 1) for j in (-1, 0, 1)]).astype(np.int32)
        slack = letter != SEGMENTS  # a step of rounding
        found[letter] = float(((here < nine.min(0) - slack) | (here > nine.max(0) + slack)).any(-1).mean())
    return found


def check_neighbours(data: Dataset, result: Validation, frames: list[int], quiet: bool) -> None:
    """A frame that fits fewer than half of its neighbours holds images of another one, or its pose is another's.

    Limits. D: one step and a tenth of a pixel's footprint for the median of the signed error, from which roughness
    cancels. C, S, B, where D fits: as many points as if all pixels were independent, and not more than `LEAST` and five
    times the sequence's median. Each limit stands beside that median, but every frame is held against it.
    """
    for camera in data.cameras:
        pairs: dict[tuple[int, int], dict[str, float]] = {}
        starts, compare = range(0, len(frames), CHUNK), partial(_compare_chunk, data, camera, frames)
        for chunk in in_threads(f"views {camera}", compare, starts, unit=f"x {CHUNK} frames", quiet=quiet):
            result.add_all(
                [result.problem_of(found) for found in chunk.values() if isinstance(found, InputError)], "images"
            )
            pairs |= {pair: found for pair, found in chunk.items() if isinstance(found, dict)}
        problems: list[str] = []
        for letter in (DEPTH, *LEAST):
            shares = {
                pair: found[letter]
                for pair, found in pairs.items()
                if letter in found and (letter == DEPTH or found[DEPTH] <= 1.0)
            }
            if not shares:
                continue
            median, limit = float(np.median(list(shares.values()))), 1.0
            if letter == DEPTH:
                result.measure(f"{camera}: D against neighbours, share of what is allowed", median, limit, "")
            else:
                limit = min(INDEPENDENT, max(LEAST[letter], 5.0 * median))
                result.measure(
                    f"{camera}: {letter} against neighbours, points that differ", 100 * median, 100 * limit, "%"
                )
            problems += [
                f"{data.layout.image(camera, letter, frame).name}: does not fit the frames about it: it shows "
                "another view than that of its pose"
                for frame in _misfits({pair: share > limit for pair, share in shares.items()})
            ]
        result.add_all(problems, "images")


def _compare_chunk(data: Dataset, camera: str, frames: list[int], start: int) -> dict:
    """Results of `_compare` by pair, for some frames and the two before each, or why one cannot be read."""
    letters = "".join(letter for letter in LEAST if letter in data.outputs)
    view, pairs = lru_cache(3)(lambda frame: _View(data, frame, camera, letters)), {}
    for i in range(start, min(start + CHUNK, len(frames))):
        for earlier in frames[max(0, i - 2) : i]:
            try:
                pairs[earlier, frames[i]] = _compare(view(earlier), view(frames[i]), data.meta["depth"]["scale_m"])
            except InputError as error:
                pairs[earlier, frames[i]] = error
    return pairs


def _misfits(apart: dict[tuple[int, int], bool]) -> list[int]:
    """Frames that fit fewer than half of their neighbours, of pairs of which it is known whether they are apart.

    The one with the most misfits comes first, and what it explains counts no more against its neighbours.
    """
    near = Counter(frame for pair in apart for frame in pair)
    others: dict[int, set[int]] = {frame: set() for frame in near}
    for one, other in (pair for pair, is_apart in apart.items() if is_apart):
        others[one].add(other)
        others[other].add(one)
    doubtful = {frame for frame in near if len(others[frame]) > near[frame] / 2}
    wrong = []
    while doubtful:
        worst = max(doubtful, key=lambda frame: (len(others[frame]), len(others[frame]) / near[frame]))
        if not others[worst]:
            break
        wrong.append(worst)
        doubtful.remove(worst)
        for other in others[worst]:
            others[other].discard(worst)
    return sorted(wrong)
