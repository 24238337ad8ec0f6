"""The small visual odometry over several seeds, against the true poses."""

from dataclasses import dataclass

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, project, seen_pixels
from varos_warp.dataset.readiness.odometry.mono import MonoOdometry
from varos_warp.dataset.readiness.odometry.score import failed, path_length, score
from varos_warp.dataset.readiness.odometry.stereo import StereoOdometry
from varos_warp.dataset.readiness.odometry.tracking import View
from varos_warp.scene.description.image_types import DEPTH

LEAST_FRAMES = 8
"""Fewer do not tell an error from what an alignment takes up."""
LEAST_PATH = 1e-3
"""Metres; a camera that moves less stands still."""
OVERLAP = 0.2
"""Share of the first frame's points that a second camera must see to make a pair."""


@dataclass(frozen=True)
class Odometry:
    """Errors for all seeds; frames that were lost, which went on at the last speed, count in them."""

    cameras: list[str]
    seeds: int
    ate_m: list[float | None]
    """Absolute trajectory error for each seed [m]; None if not even a first pair of views was found."""
    ate_share: list[float | None]
    """Absolute trajectory error over the length of the path, for each seed."""
    drift: list[float | None]
    lost: list[int]
    """Frames without a pose."""
    frames: int
    path_m: float
    failed_steps: list[float]
    """Share of the seeds for which the step from each frame to the next failed, as `failed` tells."""

    def plain(self) -> dict:
        """Return plain types for JSON, with mean and standard deviation over the seeds."""
        told = ("ate_m", "ate_share", "drift", "lost")
        means = {
            f"{name}_{what}": _of(getattr(self, name), how)
            for name in told
            for what, how in (("mean", np.mean), ("std", np.std))
        }
        return self.__dict__ | {"failed_share": float(np.mean(self.failed_steps))} | means


def _of(values: list, how) -> float | None:
    """Combine the values of all seeds; None if one of them has none: a mean of the others would look too good."""
    return None if None in values else float(how(values))


def odometries(data: Dataset, camera: str, seeds: int) -> tuple[dict[str, Odometry], list[str]]:
    """``mono`` and ``stereo`` by name, and why one is left out."""
    true = data.views(camera)[1]
    length = path_length(true[:, :3, 3])
    if len(data) < LEAST_FRAMES:
        return {}, [f"the odometry: it needs {LEAST_FRAMES} frames"]
    if length < LEAST_PATH:
        return {}, ["the odometry: the camera stands still"]
    found = {"mono": _over_seeds(data, [camera], seeds, lambda seed: MonoOdometry(View(data, camera), seed))}
    other, why = _partner(data, camera)
    if other is None:
        return found, [f"stereo odometry: {why}"]
    T_r_l = np.linalg.inv(data.camera(other)["T_v_c"]) @ np.array(data.camera(camera)["T_v_c"])
    found["stereo"] = _over_seeds(
        data, [camera, other], seeds, lambda seed: StereoOdometry(View(data, camera), View(data, other), T_r_l, seed)
    )
    return found, []


def _over_seeds(data: Dataset, cameras: list[str], seeds: int, make) -> Odometry:
    poses, scores, lost, fails = data.views(cameras[0])[1], [], [], []
    truth = poses[:, :3, 3]
    for seed in range(seeds):
        T_c_w, gone = make(seed).run()
        lost.append(int(gone.sum()))
        fails.append(failed(T_c_w, gone, poses))
        places = -np.einsum("nji,nj->ni", T_c_w[:, :3, :3], T_c_w[:, :3, 3])
        moved = gone[1:].sum() < len(gone) - 1
        scores.append(score(places, truth, with_scale=len(cameras) == 1) if moved else None)
    columns = {
        name: [None if s is None else getattr(s, name) for s in scores] for name in ("ate_m", "ate_share", "drift")
    }
    return Odometry(
        cameras,
        seeds,
        **columns,
        lost=lost,
        frames=len(truth),
        path_m=path_length(truth),
        failed_steps=np.mean(fails, 0).tolist(),
    )


def _partner(data: Dataset, camera: str) -> tuple[str | None, str]:
    """The camera of the same size on the vehicle that sees most of what this one sees, or None; and why."""
    others = [other for other in data.cameras if other != camera and "T_v_c" in data.camera(other)]
    if not others or "T_v_c" not in data.camera(camera):
        return None, "it needs two cameras on the vehicle"
    others = [other for other in others if _size(data, other) == _size(data, camera)]
    if not others:
        return None, "corners are followed from one camera to the other, and these differ in resolution"
    if DEPTH not in data.outputs:
        return None, "without D it is not known what two cameras both see"
    share = {
        other: _overlap(data, camera, other)
        for other in others
        if np.array_equal(data.time_ns(camera), data.time_ns(other))
    }
    best = max(share, key=lambda other: share[other], default=None)
    if best is None or share[best] < OVERLAP:
        return None, "no two cameras see the same place at the same time"
    return best, ""


def _size(data: Dataset, camera: str) -> tuple[int, int]:
    return data.camera(camera)["width"], data.camera(camera)["height"]


def _overlap(data: Dataset, camera: str, other: str) -> float:
    """Share of what a camera sees in the first frame that lies in the image of another."""
    frame, about = data.frames[0], data.camera(other)
    row, col, z = seen_pixels(data.planar_depth(frame, camera), 500)
    if not len(z):
        return 0.0
    points = points_at(data.camera_model(camera), data.T_w_c(frame, camera), row, col, z)
    u, v, depth = project(points, data.camera_model(other), data.T_w_c(frame, other)).T
    with np.errstate(invalid="ignore"):
        return float(((u >= 0) & (u < about["width"]) & (v >= 0) & (v < about["height"]) & (depth > 0)).mean())
