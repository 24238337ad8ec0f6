"""Images of several views of one scene, held against each other through K and the poses.

Points of D seen in one frame lie where D of another frame has them. What C, S and B show at such a point is what they
show there in the other frame; A changes with the vehicle's lamps.
"""

from collections.abc import Iterator
from functools import lru_cache, partial

import numpy as np

from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import pixel_rays, planar_depth, points_at
from varos_warp.dataset.validate.outcome import Validation, problem_of
from varos_warp.errors import InputError

PAIRS = 8
"""Pairs of views compared per camera for the residuals that are reported."""
MOST_POINTS = 20_000
"""Points of a frame that are looked for in the next ones."""
CHUNK = 16
"""Frames that one thread compares in turn."""
FEWEST_POINTS = 200
"""Fewer common points say nothing."""
INDEPENDENT = 1.0 - 0.8**3 + 0.05
"""Share of points outside the box of nine neighbours in some channel, if all pixels were independent of each other (the
tenth of ten numbers is the least or the largest of them in two cases of ten), and a little for chance."""

LEAST = {"C": 0.1, "S": 0.01, "B": 0.1}
"""Share of such points that is no cause for doubt: detail finer than a pixel; S has less of it."""


def check_views(data: Dataset, result: Validation, frames: list[int], quiet: bool = True) -> None:
    """Residuals between views in mm and px, and every one of some frames against its neighbours."""
    if "D" in data.outputs:
        result.guard(data.root, _check_residuals, data, result, frames)
        result.guard(data.root, _check_neighbours, data, result, frames, quiet)


# ----------------------------------------------------------------------------------------------------------- geometry


def back_project(data: Dataset, frame: int, camera: str) -> tuple[np.ndarray, np.ndarray]:
    """Points [H, W, 3] of D in the world (inf where there are none) and the directions to them."""
    depth, T_w_c = planar_depth(data, frame, camera), data.T_w_c(frame, camera)
    rays = pixel_rays(data.intrinsics(camera), *np.indices(depth.shape)) @ T_w_c[:3, :3].T
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(depth)[..., None], rays * depth[..., None] + T_w_c[:3, 3], np.inf), rays


def _points(depth: np.ndarray, K: np.ndarray, T_w_c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] of a depth map in the world, of a grid of about `MOST_POINTS` pixels, and that grid [H, W]."""
    step = max(1, round(np.sqrt(depth.size / MOST_POINTS)))
    pick = np.zeros(depth.shape, bool)
    pick[step // 2::step, step // 2::step] = True
    pick &= np.isfinite(depth)
    return points_at(depth, K, T_w_c, *np.nonzero(pick)), pick


# ---------------------------------------------------------------------------------------------------------- residuals


def _view_pairs(data: Dataset, frames: list[int]) -> Iterator[tuple[str, tuple[int, str], tuple[int, str]]]:
    """Pairs of views that see much the same: frames of one camera up to a second apart, and two cameras at once."""
    second = max(1, round(data.meta["frames"]["rate_hz"]))
    reach = min(second, len(frames) - 1)
    for camera in data.cameras:
        for step, name in {reach: f"D of frames {reach} apart", 1: "D of successive frames"}.items():
            known = set(frames)
            pairs = [(f, f + step) for f in frames if step > 0 and f + step in known]
            for i in np.unique(np.linspace(0, len(pairs) - 1, min(PAIRS, len(pairs))).astype(int)):
                yield f"{camera}: {name}", (pairs[i][0], camera), (pairs[i][1], camera)
    for one, other in zip(data.cameras, data.cameras[1:], strict=False):
        if data.camera(one)["mount"] == data.camera(other)["mount"]:
            for a in frames[::max(1, len(frames) // PAIRS)]:
                yield f"{one}, {other}: D of the same moment", (a, one), (a, other)


def _check_residuals(data: Dataset, result: Validation, frames: list[int]) -> None:
    """Points of D seen in one view lie where D of another view has them.

    Limits: one step of D and half a pixel's footprint at the median distance; one pixel. On a plane nothing but the
    steps remains; half a footprint leaves room for a surface that is rough on the scale of a pixel.
    """
    errors: dict[str, list[np.ndarray]] = {}
    for name, first, second in _view_pairs(data, frames):
        try:
            errors.setdefault(name, []).append(_compare_views(data, first, second))
        except InputError as error:
            result.add(problem_of(data.root, error))
    for name, parts in errors.items():
        metres, pixels, footprint = np.concatenate(parts).T if parts else np.empty((3, 0))
        if len(metres):
            limit = data.meta["depth"]["scale_m"] + 0.5 * np.median(footprint)
            result.measure(f"{name}, median", 1000 * np.median(metres), 1000 * limit, "mm")
            result.measure(f"{name}, median", np.median(pixels), 1.0, "px")


def _compare_views(data: Dataset, first: tuple[int, str], second: tuple[int, str]) -> np.ndarray:
    """Rows (error in depth [m], error there and back [px], footprint of a pixel [m]) of the pixels seen in both."""
    frame, camera = first
    points = _points(planar_depth(data, frame, camera), data.intrinsics(camera), data.T_w_c(frame, camera))[0]
    about, K = data.camera(second[1]), data.intrinsics(second[1])
    T_w_c = data.T_w_c(*second)
    u, v, z = _project(points, K, T_w_c)
    row, col = v - 0.5, u - 0.5
    inside = (z > 0) & (row >= 0) & (col >= 0) & (row < about["height"] - 1) & (col < about["width"] - 1)
    u, v, z, row, col = (x[inside] for x in (u, v, z, row, col))
    seen = _interpolate_depth(planar_depth(data, *second), row, col)
    known = np.isfinite(seen)
    u, v, z, seen = (x[known] for x in (u, v, z, seen))
    rays = np.column_stack([u, v, np.ones_like(u)]) @ np.linalg.inv(K).T @ T_w_c[:3, :3].T
    view = data.intrinsics(first[1]), data.T_w_c(*first)
    there, back = (_project(rays * depth[:, None] + T_w_c[:3, 3], *view) for depth in (z, seen))
    moved = np.hypot(back[0] - there[0], back[1] - there[1])
    return np.column_stack([np.abs(seen - z), moved, z / K[0, 0]])


def _project(points: np.ndarray, K: np.ndarray, T_w_c: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pixel coordinates u, v (first centre at 0.5) and depth z [m] of world points [N, 3]."""
    p = (points - T_w_c[:3, 3]) @ T_w_c[:3, :3] @ K.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return p[:, 0] / p[:, 2], p[:, 1] / p[:, 2], p[:, 2]


def _interpolate_depth(depth: np.ndarray, row: np.ndarray, col: np.ndarray) -> np.ndarray:
    """Bilinear in 1 / z, which is exact on a plane; NaN next to an edge (10 %) or to nothing."""
    r, c = np.floor(row).astype(int), np.floor(col).astype(int)
    corners = np.stack([depth[r, c], depth[r, c + 1], depth[r + 1, c], depth[r + 1, c + 1]])
    fr, fc = row - r, col - c
    weights = np.stack([(1 - fr) * (1 - fc), (1 - fr) * fc, fr * (1 - fc), fr * fc])
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = corners.max(0) < 1.1 * corners.min(0)
        return np.where(np.isfinite(corners).all(0) & flat, 1.0 / np.sum(weights / corners, axis=0), np.nan)

# --------------------------------------------------------------------------------------------------------- neighbours


class _Frames:
    """Images of one camera; the last few stay in memory."""

    def __init__(self, data: Dataset, camera: str):
        self.data, self.camera, self.K = data, camera, data.intrinsics(camera)
        self.letters = [letter for letter in "CSB" if letter in data.outputs]
        self.read = lru_cache(3)(self._read)

    def _read(self, frame: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Planar depth [H, W] and the pixels of C, S and B as far as they are there; int32, H, W, channels."""
        images = {}
        for letter in self.letters:
            try:
                pixels = self.data.pixels(letter, frame, self.camera)
            except InputError:  # told of already
                continue
            if pixels.shape[:2] == (self.data.camera(self.camera)["height"], self.data.camera(self.camera)["width"]):
                images[letter] = pixels.reshape(*pixels.shape[:2], -1).astype(np.int32)
        return planar_depth(self.data, frame, self.camera), images

    def compare(self, first: int, second: int) -> dict[str, float] | None:
        """How far two frames are apart; None: they have too little in common.

        Returns:
            ``D``: |median error in depth| over what is allowed. C, S, B: share of common points that show in the
            first frame what none of the nine pixels about them shows in the second, channel by channel.
        """
        (depth, images), (other, others) = self.read(first), self.read(second)
        points, pick = _points(depth, self.K, self.data.T_w_c(first, self.camera))
        u, v, z = _project(points, self.K, self.data.T_w_c(second, self.camera))
        height, width = other.shape
        inside = (z > 0) & (u >= 1) & (v >= 1) & (u < width - 1) & (v < height - 1)
        u, v, z = u[inside], v[inside], z[inside]
        seen = _interpolate_depth(other, v - 0.5, u - 0.5)
        known = np.isfinite(seen)
        if known.sum() < FEWEST_POINTS:
            return None
        allowed = self.data.meta["depth"]["scale_m"] + 0.1 * np.median(z[known]) / self.K[0, 0]
        found = {"D": abs(np.median(seen[known] - z[known])) / allowed}
        visible = known & (np.abs(seen - z) < 0.02 * z)
        row, col = v[visible].astype(int), u[visible].astype(int)
        for letter in images.keys() & others.keys() if visible.sum() >= FEWEST_POINTS else ():
            here = images[letter][pick][inside][visible]
            nine = np.stack([others[letter][row + i, col + j] for i in (-1, 0, 1) for j in (-1, 0, 1)])
            slack = letter != "S"  # a step of rounding
            outside = (here < nine.min(0) - slack) | (here > nine.max(0) + slack)
            found[letter] = float(outside.any(-1).mean())
        return found


def _check_neighbours(data: Dataset, result: Validation, frames: list[int], quiet: bool) -> None:
    """A frame that fits fewer than half of its neighbours holds images of another one, or its pose is another's.

    Limits. D: one step and a tenth of a pixel's footprint for the median of the signed error, from which roughness
    cancels. C, S, B: as many points as if all pixels were independent, and not more than `LEAST` and five times the
    sequence's median.
    """
    for camera in data.cameras:
        pairs: dict[tuple[int, int], dict[str, float]] = {}
        starts, compare = range(0, len(frames), CHUNK), partial(_compare_chunk, data, camera, frames)
        for found, problems in in_threads(f"views {camera}", compare, starts, unit=f"x {CHUNK} frames", quiet=quiet):
            pairs |= found
            result.add_all(problems, "images")
        limits = _limits(pairs)
        for letter, limit in limits.items():
            _measure_neighbours(result, camera, letter, _shares(pairs, letter), limit)
        result.add_all([problem for letter in "DCSB" if letter in limits
                        for problem in _misfits(data, camera, letter, pairs, limits)], "images")


def _compare_chunk(data: Dataset, camera: str, frames: list[int], start: int) -> tuple[dict, list[str]]:
    """What `_Frames.compare` finds for some frames and the two before each, and what cannot be read."""
    kept, pairs, problems = _Frames(data, camera), {}, []
    for i in range(start, min(start + CHUNK, len(frames))):
        for earlier in frames[max(0, i - 2):i]:
            try:
                found = kept.compare(earlier, frames[i])
            except InputError as error:
                problems.append(problem_of(data.root, error))
            else:
                pairs |= {(earlier, frames[i]): found} if found else {}
    return pairs, problems


def _limits(pairs: dict) -> dict[str, float]:
    """Of what `_Frames.compare` finds, by letter."""
    limits = {"D": 1.0} if pairs else {}
    for letter in "CSB":
        if shares := _shares(pairs, letter):
            limits[letter] = min(INDEPENDENT, max(LEAST[letter], 5.0 * float(np.median(shares))))
    return limits


def _shares(pairs: dict, letter: str) -> list[float]:
    """What `_Frames.compare` finds of a letter: of D in all pairs, of the others in those whose D fits."""
    return [p[letter] for p in pairs.values() if letter in p and (letter == "D" or p["D"] <= 1.0)]


def _measure_neighbours(result: Validation, camera: str, letter: str, found: list[float], limit: float) -> None:
    """Report the sequence's median, beside the limit that each of its frames is held against."""
    if letter == "D":
        result.measure(f"{camera}: D against neighbours, share of what is allowed", np.median(found), limit, "")
    else:
        result.measure(f"{camera}: {letter} against neighbours, points that differ", 100 * np.median(found),
                       100 * limit, "%")


def _misfits(data: Dataset, camera: str, letter: str, pairs: dict, limits: dict[str, float]) -> Iterator[str]:
    """Frames that fit fewer than half of their neighbours; of C, S and B only where D fits.

    The one with the most misfits comes first, and what it explains counts no more against its neighbours.
    """
    near: dict[int, list[int]] = {frame: [] for frame in data.frames}
    apart: dict[int, set[int]] = {frame: set() for frame in data.frames}
    for (one, other), found in pairs.items():
        if letter in found and (letter == "D" or found["D"] <= 1.0):
            for here, there in ((one, other), (other, one)):
                near[here].append(there)
                if found[letter] > limits[letter]:
                    apart[here].add(there)
    doubtful = {frame for frame in data.frames if len(apart[frame]) > len(near[frame]) / 2}
    wrong = []
    while doubtful:
        worst = max(doubtful, key=lambda frame: (len(apart[frame]), len(apart[frame]) / len(near[frame])))
        if not apart[worst]:
            break
        wrong.append(worst)
        doubtful.remove(worst)
        for other in apart[worst]:
            apart[other].discard(worst)
    for frame in sorted(wrong):
        yield (f"{data.layout.png(camera, letter, frame).name}: does not fit the frames about it: it shows another "
               "view than that of its pose")
