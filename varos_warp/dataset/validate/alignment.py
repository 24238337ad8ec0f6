"""Images against poses to a hundredth of a pixel: B of one view warped into another by D, K and the poses.

What is left over is measured in each of 24 blocks by one Lucas-Kanade step. A single block of a sound dataset is off by
0.04 px, at random, since B is noisy. An error of K or of the mounting shifts all blocks by a known law: the part of the
shifts that follows it is found by least squares, and its noise falls with the square root of the blocks.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from math import ceil, sqrt

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter, minimum_filter
from scipy.spatial.transform import Rotation

from varos_warp.dataset.progress import in_threads
from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project
from varos_warp.dataset.reader.rows import sight
from varos_warp.dataset.validate.blur import blur_of
from varos_warp.dataset.validate.objects import of_still, swept
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.errors import InputError
from varos_warp.scene.description.image_types import AMBIENT, DEPTH
from varos_warp.scene.optics.camera import CameraModel

BLOCKS = 4, 6
"""Rows and columns of blocks of an image."""
MOST_PIXELS = 150_000
"""Pixels of a view that are warped."""
KEPT_VIEWS = 16
"""Views that are kept for further pairs, 8 MB each at 1280x720."""
STARTS = 6
"""Pairs of frames for each distance in time; distances double while views overlap."""
SHARP_PX = 0.1
"""Standard error [px] above which a block has too little texture to tell."""
FEWEST_BLOCKS = 48
"""Fewest blocks that say something of the ten unknowns."""
FLOOR_PX = 0.005
"""What interpolation of aliased texture may add: of B without noise, at 144x80 pixels, 0.002."""
MARGIN = 4.0
"""Limits in standard errors. Sound data of the demo, in clear and turbid water, of one camera and a pair, hardly moving
or without texture, lies at 0.8 to 2.5, half or less of the limit with the floor."""
UNKNOWNS = {
    "x": 1e-3,
    "y": 1e-3,
    "z": 1e-3,
    "roll": 1e-3,
    "pitch": 1e-3,
    "yaw": 1e-3,
    "f": 1e-3,
    "cx": 1.0,
    "cy": 1.0,
    "D": 1e-3,
}
"""Unknowns with small steps: the camera's mounting [m, rad], focal length and scale of D [shares], principal point
[px]."""


@dataclass
class View:
    """Planar depth [H, W], brightness of B [H, W], which may be None, model and pose of a camera."""

    depth: np.ndarray
    light: np.ndarray
    smooth: np.ndarray
    """bool [H, W]: no edge of D within two pixels."""
    model: CameraModel
    T_w_c: np.ndarray
    """[4, 4], or that of each row."""
    displaced: float
    """What its exposure displaces at most [px], on the mean of a streak."""

    @classmethod
    def of(cls, data: Dataset, frame: int, camera: str) -> "View":
        """The square root of linear light makes noise even; it does not depend on the gain."""
        depth, light = data.planar_depth(frame, camera), data.image(AMBIENT, frame, camera).mean(-1)
        if light.shape != depth.shape:
            raise InputError("has another size than D", file=data.layout.image(camera, AMBIENT, frame))
        depth = of_still(data, depth, frame, camera)
        near = np.where(np.isfinite(depth), depth, 1e9).astype(np.float32)
        smooth = maximum_filter(near, 5) < 1.05 * minimum_filter(near, 5)
        smooth[:3], smooth[-3:], smooth[:, :3], smooth[:, -3:] = False, False, False, False
        smooth &= (near < 1e9) & ~swept(data, frame, camera, depth.shape)
        return cls(
            near,
            np.sqrt(np.maximum(light, 0.0)),
            smooth,
            data.camera_model(camera),
            sight(data, frame, camera),
            blur_of(data, frame, camera, depth).displaced,
        )


def warp(first: View, second: View, row, col, z, scale: float = 1.0) -> np.ndarray:
    """Points (u, v, z) [N, 3] in a second view of pixels (row, col) of a first with depth ``scale`` z [N]."""
    return project(points_at(first.model, first.T_w_c, row, col, scale * z), second.model, second.T_w_c)


def lucas_kanade(xx, xy, yy, xe, ye) -> tuple[np.ndarray, np.ndarray]:
    """Step in x and y from the sums of products of gradients x, y and the difference e that the step explains."""
    determinant = xx * yy - xy * xy
    return (yy * xe - xy * ye) / determinant, (xx * ye - xy * xe) / determinant


def shifts(first: View, second: View) -> dict[str, np.ndarray]:
    """The Lucas-Kanade step of each block with texture that both views see.

    Returns:
        ``d`` [n, 2]: where B of the second view has what B of the first shows, less where D and poses have it [px];
        ``error`` [n]: its standard error [px]; ``row``, ``col``, ``z`` [n]: middle of the block in the first view.
    """
    step = ceil(sqrt(first.depth.size / MOST_PIXELS))
    row, col = (grid.ravel() for grid in np.indices(first.depth.shape)[:, ::step, ::step])
    row, col = (x[first.smooth[row, col]] for x in (row, col))
    z = first.depth[row, col]
    u, v, there = warp(first, second, row, col, z).T
    height, width = second.depth.shape
    seen = (there > 0) & (u > 3) & (v > 3) & (u < width - 3) & (v < height - 3)
    row, col, z, u, v, there = (x[seen] for x in (row, col, z, u, v, there))
    seen = second.smooth[v.astype(int), u.astype(int)]
    seen &= np.abs(map_coordinates(second.depth, [v - 0.5, u - 0.5], order=1) - there) < 0.01 * there
    row, col, z, u, v = (x[seen] for x in (row, col, z, u, v))
    here = first.light[row, col].astype(float)
    at = lambda dx, dy: map_coordinates(second.light, [v - 0.5 + dy, u - 0.5 + dx], order=1)  # noqa: E731
    gx, gy, e = (at(1, 0) - at(-1, 0)) / 2, (at(0, 1) - at(0, -1)) / 2, here - at(0, 0)
    w = 1.0 / (1.0 + (e / (2.5 * np.median(np.abs(e)) + 1e-6)) ** 2) if len(e) else e
    block = row * BLOCKS[0] // first.depth.shape[0] * BLOCKS[1] + col * BLOCKS[1] // first.depth.shape[1]
    total = lambda x: np.bincount(block, x, BLOCKS[0] * BLOCKS[1])  # noqa: E731
    with np.errstate(divide="ignore", invalid="ignore"):
        xx, xy, yy, xe, ye, weight = map(total, (w * gx * gx, w * gx * gy, w * gy * gy, w * gx * e, w * gy * e, w))
        d = np.stack(lucas_kanade(xx, xy, yy, xe, ye), -1)
        least = (xx + yy) / 2 - np.hypot((xx - yy) / 2, xy)
        error = np.sqrt(total(w * e * e) / weight / least)
        middle = [total(w * x) / weight for x in (row, col, z)]
    good = (np.bincount(block, minlength=BLOCKS[0] * BLOCKS[1]) >= 200 / step) & (error < SHARP_PX)
    good &= np.isfinite(d).all(-1) & (np.abs(d) < 3.0).all(-1)
    return {"d": d[good], "error": error[good]} | dict(zip(("row", "col", "z"), (x[good] for x in middle), strict=True))


def _moved(first: View, second: View, blocks: dict, name: str, size: float, stereo: bool) -> np.ndarray:
    """How far [n, 2] blocks move in the second view when one of `UNKNOWNS` changes, of both views or (stereo) one."""

    def changed(view: View) -> View:
        turn, K = np.eye(4), view.model.K.copy()
        motion = np.where(np.array(["x", "y", "z", "roll", "pitch", "yaw"]) == name, size, 0.0)
        turn[:3, :3], turn[:3, 3] = Rotation.from_rotvec(motion[3:]).as_matrix(), motion[:3]
        K[[0, 1], [0, 1]] *= 1.0 + size * (name == "f")
        K[:2, 2] += size * np.array([name == "cx", name == "cy"])
        return replace(view, model=replace(view.model, K=K), T_w_c=view.T_w_c @ turn)

    new = warp(
        first if stereo else changed(first),
        changed(second),
        blocks["row"],
        blocks["col"],
        blocks["z"],
        1.0 + size * (name == "D"),
    )
    return (new - warp(first, second, blocks["row"], blocks["col"], blocks["z"]))[:, :2]


def compare(
    view: Callable[[int, str], View], pair: tuple[tuple[int, str], tuple[int, str]]
) -> tuple[np.ndarray, ...] | InputError | None:
    """Shifts [2n] [px] between two views, their weights [2n], and how far a step of each of `UNKNOWNS` moves them.

    Two views of one camera are compared both ways. ``view`` reads that of a frame and a camera. None where one is
    blurred so that nothing is to be found out.
    """
    try:
        first, second = (view(*which) for which in pair)
    except InputError as error:
        return error
    if max(first.displaced, second.displaced) > FLOOR_PX:
        return None
    stereo, parts = pair[0][1] != pair[1][1], []
    for one, other in ((first, second),) if stereo else ((first, second), (second, first)):
        found = shifts(one, other)
        J = [_moved(one, other, found, name, size, stereo) for name, size in UNKNOWNS.items()]
        # no block is trusted to better than 0.03 px: denoised noise is correlated
        parts.append(
            (
                found["d"].ravel(),
                np.repeat(1.0 / np.hypot(found["error"], 0.03), 2),
                np.stack([j.ravel() for j in J], -1),
            )
        )
    return tuple(np.concatenate(x) for x in zip(*parts, strict=True))


def systematic(d: np.ndarray, w: np.ndarray, J: np.ndarray) -> tuple[float, float]:
    """Shift common to all blocks [px] that a change of `UNKNOWNS` explains, and the standard error of it.

    ``d`` [2n] are shifts, x and y in turn, ``w`` one over their errors, ``J`` [2n, unknowns] what each unknown does to
    them.
    """
    robust = np.ones(len(d))
    for _ in range(8):
        U, S, _ = np.linalg.svd(J * (w * robust)[:, None], full_matrices=False)
        # what hardly moves any block is left alone: it could be anything
        U = U[:, S > 1e-3 * S[0]]
        made = U @ (U.T @ (d * w * robust)) / (w * robust)
        robust = 1.0 / np.sqrt(1.0 + ((d - made) * w / 2.0) ** 2)
    mean = lambda x: np.sqrt(2.0 * np.average(x**2, weights=(w * robust) ** 2))  # noqa: E731
    return float(mean(made)), float(mean(d - made) * np.sqrt(U.shape[1] / len(d)))


def _pairs(data: Dataset, frames: list[int]) -> dict[str, list]:
    """Pairs of views by kind: of one camera 1, 2, 4 ... frames apart, and of two cameras at the same moment."""
    found: dict[str, list] = {}
    for camera in data.cameras:
        if data.camera(camera)["mount"] == "world":
            continue
        step = 1
        while step < len(frames) and step <= 64:
            for i in np.unique(np.linspace(0, len(frames) - 1 - step, STARTS).astype(int)):
                found.setdefault(camera, []).append(((frames[i], camera), (frames[i + step], camera)))
            step *= 2
    for i, camera in enumerate(data.cameras[1:], 1):
        other = data.cameras[i - 1]
        if data.camera(camera)["mount"] == data.camera(other)["mount"]:
            some = np.unique(np.linspace(0, len(frames) - 1, 2 * STARTS).astype(int)) if frames else []
            found[f"{other}, {camera}"] = [((frames[k], other), (frames[k], camera)) for k in some]
    return found


def check_alignment(data: Dataset, result: Validation, frames: list[int], quiet: bool = True) -> None:
    """B is where D, K and the poses have it, to `MARGIN` standard errors of all blocks: 0.02 px in the demo."""
    if not {AMBIENT, DEPTH} <= set(data.outputs):
        return
    view = lru_cache(KEPT_VIEWS)(partial(View.of, data))
    for name, pairs in _pairs(data, frames).items():
        parts = []
        for found in in_threads(f"alignment {name}", partial(compare, view), pairs, unit="pairs", quiet=quiet):
            if isinstance(found, InputError):
                result.add(result.problem_of(found))
            elif found is not None:
                parts.append(found)
        if sum(len(d) for d, _, _ in parts) < 2 * FEWEST_BLOCKS:
            continue
        d, w, J = (np.concatenate(x) for x in zip(*parts, strict=True))
        value, error = systematic(d, w, J)
        result.measure(
            f"{name}: B against D, K and poses, shift of one block, median",
            np.median(np.hypot(*d.reshape(-1, 2).T)),
            0.25,
            "px",
        )
        result.measure(f"{name}: B against D, K and poses, systematic shift", value, FLOOR_PX + MARGIN * error, "px")
