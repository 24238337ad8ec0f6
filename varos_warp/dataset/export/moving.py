"""Poses of what moves beside every export: of objects, and of other vehicles' bodies."""

from collections.abc import Iterator

import numpy as np

from varos_warp.dataset.export.job import Job, numbers, quaternion, seconds

FOLDER = "moving"


def write(job: Job) -> None:
    """Write a trajectory as TUM has them, ``moving/KEY.txt``, of each, and README.txt; nothing where nothing moves."""
    if not job.data.moving:
        return
    job.text(f"{FOLDER}/README.txt", _readme(job))
    for key in job.data.moving:
        time_ns, T = job.data.poses(key)
        job.text(f"{FOLDER}/{key}.txt", [f"# T_w_o of {key}", "# timestamp tx ty tz qx qy qz qw",
                                         *(f"{seconds(t)} {row}" for t, row in zip(time_ns, _rows(T), strict=True))])


def _readme(job: Job) -> Iterator[str]:
    yield "Poses T_w_o of what moves at every frame: seconds, x y z, quaternion x y z w; from its own axes to the"
    yield "world of the dataset, z up, in metres. Where an export has another world, as KITTI has that of the first"
    yield "camera pose, these are in the dataset's all the same:"
    for camera in job.cameras:
        yield f"  first T_w_c of {camera} (OpenCV axes): {_rows(job.data.views(camera)[1][:1])[0]}"
    yield ""
    for entry in job.data.meta["moving"]:
        low, high = map(numbers, entry["box_m"])
        yield f"{entry['key']}: number {entry['id']} in S; its box in its own axes [m]: low {low}, high {high}"


def _rows(T: np.ndarray) -> list[str]:
    """Position and quaternion of each pose [N, 4, 4], scalar last."""
    return [numbers(row) for row in np.column_stack([T[:, :3, 3], quaternion(T, scalar_first=False)])]
