"""A note beside every export on the shutters of its cameras, of which no format knows, and the poses of their rows."""

from collections.abc import Iterator

from varos_warp.dataset import files
from varos_warp.dataset.export.job import Job
from varos_warp.dataset.reader.rows import is_rolling

FOLDER = "shutter"


def write(job: Job) -> None:
    """Write ``shutter/README.txt`` and link the poses of rows beside it; nothing where no camera has a shutter."""
    if not any(job.data.camera(camera).get("shutter") for camera in job.cameras):
        return
    job.text(f"{FOLDER}/README.txt", [
        "Time stamps of this export are of the middle of the exposure of the middle row, and so are its camera poses.",
        "A pixel is the mean over the exposure of its row; depth is of the middle of it.", "",
        *(line for camera in job.cameras for line in _camera(job, camera))])
    for camera in job.cameras:
        if is_rolling(job.data.camera(camera)):
            source = job.data.layout.row_poses(camera)
            files.link(source, job.out / FOLDER / source.name)


def _camera(job: Job, camera: str) -> Iterator[str]:
    """What there is to know of one."""
    about = job.data.camera(camera)
    shutter = about.get("shutter")
    if shutter is None:
        yield f"{camera}: each image is of one instant."
        return
    yield f"{camera}: exposure_s {shutter['exposure_s']!r}, readout_s {shutter['readout_s']!r}" + (
        " (global shutter)." if not shutter["readout_s"] else ", line_delay_s "
        f"{shutter['readout_s'] / about['height']!r} (rolling shutter, first row first).")
    if shutter["readout_s"]:
        yield f"  Row r is exposed about its time stamp + ((r + 0.5) / {about['height']} - 0.5) * {shutter['readout_s']!r} s."
    if is_rolling(about):
        yield f"  {job.data.layout.row_poses(camera).name}: pose of the camera at that time for every row: numpy, float64"
        yield f"  [{len(job.data)} frames, {about['height']} rows, 7], x y z, quaternion w x y z; camera (OpenCV axes) to"
        yield "  world (z up, metres)."
