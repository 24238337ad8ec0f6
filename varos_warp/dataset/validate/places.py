"""S against the scene: what an object's number marks lies, by D and the poses, in the box of that object.

The box is known of parametric objects that stand still only: meshes are files from outside of the dataset, and where
copies of `scatter` stand only all meshes together tell.
"""

import numpy as np

from varos_warp.dataset.reader.dataset import Dataset
from varos_warp.dataset.reader.points import points_at, seen_pixels
from varos_warp.dataset.validate.outcome import Validation
from varos_warp.scene.description.world import MeshObject
from varos_warp.scene.geometry.build import object_part
from varos_warp.scene.load import scene_from_dict
from varos_warp.scene.optics.camera import CameraModel

MOST_POINTS = 20_000
"""Points of a frame that are looked at."""
FEWEST_POINTS = 30
"""Fewer of an object say nothing."""


def boxes(data: Dataset) -> dict[int, np.ndarray]:
    """Lowest and highest corner [2, 3] [m] of the parametric objects, by their numbers in S; none without S and D."""
    scene, found = scene_from_dict(data.meta["scene"]), {}
    for i, block in enumerate(scene.objects if {"D", "S"} <= set(data.outputs) else ()):
        if not isinstance(block, MeshObject) and not block.path:
            corners = object_part(scene, block.model_copy(update={"chord_error_m": None}), f"objects.{i}").vertices
            low, high = corners.min(0), corners.max(0)
            # steps of D, and that the default mesh is coarser than the one rendered
            slack = 2.0 * data.meta["depth"]["scale_m"] + 0.01 * (high - low).max()
            found[scene.number_of(f"objects.{i}")] = np.stack([low - slack, high + slack])
    return found


def sums(depth: np.ndarray, model: CameraModel, T_w_c: np.ndarray, numbers: np.ndarray, boxes: dict) -> np.ndarray:
    """Of one frame, a row for each of ``boxes``: points with its number, those within, sums of x, y, z [n, 5].

    Args:
        depth: Planar depth [H, W] [m]; inf where there is none.
        model: The camera.
        T_w_c: Pose [4, 4] of the camera, or that of each row.
        numbers: S [H, W].
        boxes: Corners [2, 3] by number.
    """
    row, col, z = seen_pixels(depth, MOST_POINTS)
    points, here = points_at(model, T_w_c, row, col, z), numbers[row, col]
    found = []
    for number, (low, high) in boxes.items():
        own = points[here == number]
        found.append([len(own), ((own >= low) & (own <= high)).all(-1).sum(), *own.sum(0)])
    return np.array(found)


def judge(data: Dataset, result: Validation, camera: str, boxes: dict, sums: np.ndarray) -> None:
    """More than half of the points with an object's number lie in its box; if not, where they lie is told."""
    keys = {number: f"number {number} (objects.{number - 1 - (data.meta['scene'].get('terrain') is not None)})"
            for number in boxes}
    for (number, _), (count, within, *total) in zip(boxes.items(), sums, strict=True):
        if count >= FEWEST_POINTS and within < count / 2:
            middle = np.array(total) / count
            others = [keys[n] for n, (low, high) in boxes.items() if ((middle >= low) & (middle <= high)).all()]
            where = f"; they lie where {others[0]} is" if others else ""
            result.add(f"{camera}: S: {100 - 100 * within / count:.0f} % of the points of {keys[number]} do not lie "
                       f"where the scene has it{where}")
