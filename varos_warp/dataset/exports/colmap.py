"""COLMAP: the text model sparse/0 with the exact cameras and poses, without points, and the images.

(https://colmap.github.io/format.html) ``colmap point_triangulator`` finds the points.
"""

import numpy as np

from varos_warp.dataset.exports.job import Job, numbers, quaternion
from varos_warp.scene.frames import inverse

IMAGES = "A"


def write(job: Job) -> None:
    """Write cameras.txt, images.txt and points3D.txt, and the images under ``images/cam<id>``."""
    lines = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[] (fx fy cx cy)"]
    for number, camera in enumerate(job.cameras, start=1):
        K, facts = job.data.intrinsics(camera), job.data.camera(camera)
        lines.append(f"{number} PINHOLE {facts['width']} {facts['height']} {numbers(K[[0, 1, 0, 1], [0, 1, 2, 2]])}")
    job.text("sparse/0/cameras.txt", lines)
    job.text("sparse/0/images.txt", _images(job))
    job.text("sparse/0/points3D.txt", ["# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]"])


def _images(job: Job) -> list[str]:
    """Two lines an image: world to camera, scalar first; then its points, of which there are none."""
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    count = 0
    for number, camera in enumerate(job.cameras, start=1):
        T_c_w = np.array([inverse(T) for T in job.poses(camera)[1]])
        rows = np.column_stack([quaternion(T_c_w, scalar_first=True), T_c_w[:, :3, 3]])
        for frame, row in zip(job.data.frames, rows, strict=True):
            name = f"cam{camera}/{job.data.layout.png(camera, job.images, frame).name}"
            job.link(camera, job.images, frame, f"images/{name}")
            count += 1
            lines += [f"{count} {numbers(row)} {number} {name}", ""]
    return lines
