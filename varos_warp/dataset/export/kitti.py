"""KITTI odometry: sequences/NN with grey and colour images, calibration and times; poses/NN.txt.

Depth has the units of KITTI's depth benchmark, 256 to the metre and 0 for none. It lies in ``depth_2`` (and
``depth_3``) of the sequence, and under ``train`` as the benchmark names and numbers it, beside its colour images.
"""

import numpy as np

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job, baseline, lens_of, numbers, seconds
from varos_warp.scene.description.image_types import DEPTH, WATER
from varos_warp.scene.frames import inverse

IMAGES = WATER + DEPTH
HOLDS = "one camera, or a rectified pair"
PER_METRE = 256.0
T_CAMERA_VELODYNE = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
"""There is no lidar: one with KITTI's axes (x forward, y left, z up) in the place of the camera."""


def cameras(job: Job) -> tuple[str, ...]:
    """The first camera and, if there is one, its rectified partner to the right."""
    left, *others = job.cameras
    return (left, *[camera for camera in others if baseline(job, left, camera) is not None][:1])


def write(job: Job) -> None:
    """Write one sequence of one camera, or of a left and a right one."""
    number = job.data.meta["sequence"]
    folder = f"sequences/{number}"
    left, *right = job.cameras
    for camera in job.cameras:
        lens_of(job, camera, "KITTI")
    for place, camera in enumerate(job.cameras, start=2):
        names = [f"{i:06d}.png" for i in range(len(job.data))]
        job.greys(camera, [f"{folder}/image_{place - 2}/{name}" for name in names])
        job.link_images(camera, [f"{folder}/image_{place}/{name}" for name in names])
        if job.has_depth:
            job.depths(camera, [f"{folder}/depth_{place}/{name}" for name in names], PER_METRE)
            _depth_benchmark(job, folder, f"train/varos_drive_{number}_sync", place)
    time_ns, T_w_c = job.data.views(left)
    job.text(f"{folder}/times.txt", [seconds(t - time_ns[0]) for t in time_ns])
    baseline_m = baseline(job, left, right[0]) if right else None
    job.text(f"{folder}/calib.txt", calibration(job.data.intrinsics(left, "opencv"), baseline_m or 0.0))
    T = inverse(T_w_c[0]) @ T_w_c
    T[0] = np.eye(4)
    job.text(f"poses/{number}.txt", [numbers(pose[:3]) for pose in T])


def _depth_benchmark(job: Job, folder: str, drive: str, place: int) -> None:
    """Link the same depth and colour files where the loaders of the depth benchmark look for them."""
    for i in range(len(job.data)):
        files.link(
            job.out / f"{folder}/depth_{place}/{i:06d}.png",
            job.out / f"{drive}/proj_depth/groundtruth/image_{place:02d}/{i:010d}.png",
        )
        files.link(
            job.out / f"{folder}/image_{place}/{i:06d}.png", job.out / f"{drive}/image_{place:02d}/data/{i:010d}.png"
        )


def calibration(K: np.ndarray, baseline_m: float) -> list[str]:
    """P0 to P3 and Tr: 0 and 2 are the left camera, 1 and 3 the right; pykitti asks for all of them."""
    left, right = np.column_stack([K, np.zeros(3)]), np.column_stack([K, [-K[0, 0] * baseline_m, 0.0, 0.0]])
    rows = {"P0": left, "P1": right, "P2": left, "P3": right, "Tr": T_CAMERA_VELODYNE}
    return [f"{name}: {numbers(matrix)}" for name, matrix in rows.items()]
