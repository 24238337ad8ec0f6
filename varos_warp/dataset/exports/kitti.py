"""KITTI odometry: sequences/NN with image_2 (and image_3), calibration and times; poses/NN.txt.

Depth has the units of KITTI's depth benchmark, 256 to the metre and 0 for none, in ``depth_2`` (and ``depth_3``).
"""

import warnings

import numpy as np

from varos_warp.dataset.exports.job import Job, numbers, seconds
from varos_warp.scene.frames import inverse

IMAGES = "AD"
PER_METRE = 256.0
T_CAMERA_VELODYNE = np.array([[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
"""There is no lidar: one with KITTI's axes (x forward, y left, z up) in the place of the camera."""


def write(job: Job) -> None:
    """Write one sequence of the first camera and, if the next is its rectified partner to the right, of that."""
    number = job.data.meta["sequence"]
    folder = f"sequences/{number}"
    left, *others = job.cameras
    baselines = {camera: b for camera in others if (b := baseline(job, left, camera)) is not None}
    pair = [left, *list(baselines)[:1]]
    if skipped := [camera for camera in job.cameras if camera not in pair]:
        warnings.warn(f"KITTI holds a rectified pair at most: {', '.join(skipped)} left out", stacklevel=2)
    for place, camera in enumerate(pair, start=2):
        for i, frame in enumerate(job.data.frames):
            job.link(camera, job.images, frame, f"{folder}/image_{place}/{i:06d}.png")
        if job.has_depth:
            job.depths(camera, lambda i, place=place: f"{folder}/depth_{place}/{i:06d}.png", PER_METRE)
    time_ns, T_w_c = job.poses(left)
    job.text(f"{folder}/times.txt", [seconds(t - time_ns[0]) for t in time_ns])
    job.text(f"{folder}/calib.txt", calibration(job.data.intrinsics(left, "opencv"),
                                                baselines[pair[1]] if len(pair) > 1 else 0.0))
    T = inverse(T_w_c[0]) @ T_w_c
    T[0] = np.eye(4)
    job.text(f"poses/{number}.txt", [numbers(pose[:3]) for pose in T])


def calibration(K: np.ndarray, baseline_m: float) -> list[str]:
    """P0 to P3 and Tr: 0 and 2 are the left camera, 1 and 3 the right; pykitti asks for all of them."""
    left, right = np.column_stack([K, np.zeros(3)]), np.column_stack([K, [-K[0, 0] * baseline_m, 0.0, 0.0]])
    rows = {"P0": left, "P1": right, "P2": left, "P3": right, "Tr": T_CAMERA_VELODYNE}
    return [f"{name}: {numbers(matrix)}" for name, matrix in rows.items()]


def baseline(job: Job, left: str, right: str) -> float | None:
    """Metres from one camera to the other along x, where the pair is rectified; None where it is not."""
    if not np.allclose(job.data.intrinsics(left), job.data.intrinsics(right), rtol=1e-12):
        return None
    T = np.linalg.inv(job.poses(left)[1]) @ job.poses(right)[1]
    shape = np.eye(4)
    shape[0, 3] = T[0, 0, 3]
    size = 1.0 + np.abs(job.poses(left)[1][:, :3, 3]).max()
    return float(T[0, 0, 3]) if T[0, 0, 3] > 0 and np.allclose(T, shape, rtol=0, atol=1e-12 * size) else None
