"""TUM RGB-D: colour, depth and the course of one camera (https://cvg.cit.tum.de/data/datasets/rgbd-dataset/file_formats).

Depth is 5000 to the metre, so 16 bit end at 13.107 m; what is farther becomes 0, which means none.
"""

import numpy as np

from varos_warp.dataset.export.shared.job import Job, lens_of, numbers, quaternion, seconds
from varos_warp.scene.description.image_types import DEPTH, WATER

IMAGES = WATER + DEPTH
HOLDS = "one camera"
PER_METRE = 5000.0


def cameras(job: Job) -> tuple[str, ...]:
    """The first camera."""
    return job.cameras[:1]


def write(job: Job) -> None:
    """Write the lists, groundtruth.txt, accelerometer.txt, camera.txt and the images of the first camera."""
    camera = job.cameras[0]
    lens_of(job, camera, "TUM")
    time_ns, T_w_c = job.data.views(camera)
    stamps = [seconds(t) for t in time_ns]
    job.link_images(camera, (f"rgb/{stamp}.png" for stamp in stamps))
    job.text("rgb.txt", ["# color images", "# timestamp filename", *(f"{s} rgb/{s}.png" for s in stamps)])
    if job.has_depth:
        job.depths(camera, (f"depth/{stamp}.png" for stamp in stamps), PER_METRE)
        job.text("depth.txt", ["# depth maps", "# timestamp filename", *(f"{s} depth/{s}.png" for s in stamps)])
        job.text("associations.txt", [f"{s} rgb/{s}.png {s} depth/{s}.png" for s in stamps])
    rows = np.column_stack([T_w_c[:, :3, 3], quaternion(T_w_c, scalar_first=False)])
    job.text(
        "groundtruth.txt",
        [
            "# camera in the world: OpenCV axes, world z up",
            "# timestamp tx ty tz qx qy qz qw",
            *(f"{s} {numbers(row)}" for s, row in zip(stamps, rows, strict=True)),
        ],
    )
    if "imu0" in job.data.recorded:
        imu = job.data.imu()
        job.text(
            "accelerometer.txt",
            [
                f"# specific force in the IMU's axes [m/s^2], {job.noise('imu0')}",
                "# timestamp ax ay az",
                *(f"{seconds(t)} {numbers(a)}" for t, a in zip(imu["time_ns"], imu["acceleration"], strict=True)),
            ],
        )
    facts = job.data.camera(camera)
    job.text(
        "camera.txt",
        [
            "# pinhole without distortion; the centre of the top left pixel is (0, 0)",
            "# fx fy cx cy width height depth_units_per_metre",
            f"{numbers(job.fx_fy_cx_cy(camera))} {facts['width']} {facts['height']} 5000",
        ],
    )
