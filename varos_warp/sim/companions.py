"""Poses over time of the other vehicles of a scene, and of all else that moves besides the one that observes."""

import json
from collections.abc import Callable, Collection, Iterator
from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from varos_warp.files import stamp_of
from varos_warp.scene.description import Scene
from varos_warp.scene.file.load import scene_from_dict, scene_to_dict
from varos_warp.scene.hull import vehicle_radius
from varos_warp.sim.driving import drive
from varos_warp.sim.motion import Trajectory
from varos_warp.sim.poses import poses_along

PosesAt = Callable[[np.ndarray], np.ndarray]
"""Poses [N, 4, 4] at times of the sequence, int64 [N] [ns]."""


def companions(scene: Scene, left_out: Collection[str] = ()) -> dict[str, PosesAt]:
    """Poses T_w_v [N, 4, 4] of the other vehicles of a scene at times of the sequence int64 [N] [ns], by key.

    Each is where its own simulation has it, up to its last frame; there it stays. Keys may be ``left_out``.
    """
    return {
        key: _course(scene.observed_by(vehicle.id)) for key, vehicle in scene.companions.items() if key not in left_out
    }


def motions(scene: Scene, left_out: Collection[str] = ()) -> dict[str, PosesAt]:
    """Poses over time of all of `Scene.tracked`, by key, but those other vehicles that are ``left_out``."""
    found: dict[str, PosesAt] = {
        key: partial(poses_along, block.stops) for key, block in scene.moving.items() if block.path
    }
    return found | {key: poses for key, poses in companions(scene, left_out).items() if key in scene.tracked}


def _course(scene: Scene) -> PosesAt:
    file = scene.trajectory.file
    stamp = stamp_of(scene.resolve(file)) if file else None
    trajectory, end_ns = _course_of(json.dumps(scene_to_dict(scene)), scene.resolve(""), stamp)
    return lambda time_ns: trajectory.from_before(np.minimum(time_ns, end_ns)).poses()


@lru_cache(maxsize=16)
def _course_of(scene: str, folder: Path, stamp: tuple | None) -> tuple[Trajectory, int]:
    """The motion of a scene's vehicle, once for all who ask, and the time of its last frame [ns].

    ``stamp`` differs when the file of a recorded course was saved.
    """
    run = drive(scene_from_dict(json.loads(scene), folder))
    return run.trajectory, int(run.frames.time_ns[-1])


def meetings(scene: Scene, frames: Trajectory, others: dict[str, PosesAt]) -> Iterator[str]:
    """Messages about vehicles whose hulls, taken for spheres, touch at a frame."""
    for key, poses in others.items():
        gap = np.linalg.norm(poses(frames.time_ns)[:, :3, 3] - frames.position, axis=1)
        its, k = vehicle_radius(scene.observed_by(scene.companions[key].id)), int(gap.argmin())
        reach = vehicle_radius(scene) + its
        if gap[k] < reach:
            yield (
                f"trajectory: at {1e-9 * frames.time_ns[k]:.2f} s the vehicle is {gap[k]:.2f} m from {key}, nearer "
                f"than their radii of {reach:.2f} m together"
            )
