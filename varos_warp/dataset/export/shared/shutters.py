"""A note beside every export on the shutters of its cameras, of which no format knows, and the poses of their rows."""

import warnings
from collections.abc import Iterator

from varos_warp.dataset import files
from varos_warp.dataset.export.shared.job import Job
from varos_warp.dataset.reader.rows import is_rolling, lasts
from varos_warp.errors import counted

FOLDER = "shutter"


def write(job: Job) -> None:
    """Write ``shutter/README.txt`` and link the poses of rows beside it; nothing where no camera has a shutter."""
    if not any(map(lasts, map(job.data.camera, job.cameras))):
        return
    job.text(
        f"{FOLDER}/README.txt",
        [
            "Time stamps of this export are of the middle of the exposure of the middle row, "
            "and so are its camera poses.",
            "A pixel is the mean over the exposure of its row; depth and points are of the middle of that.",
            "",
            *(line for camera in job.cameras for line in _camera(job, camera)),
        ],
    )
    rolling = [camera for camera in job.cameras if is_rolling(job.data.camera(camera))]
    for camera in rolling:
        source = job.data.layout.row_poses(camera)
        files.link(source, job.out / FOLDER / source.name)
    if rolling:
        warnings.warn(
            f"the format knows no rolling shutter: poses of {', '.join(rolling)} are of the time stamp, the "
            f"middle row; {FOLDER}/README.txt tells where those of the rows are",
            stacklevel=3,
        )


def _camera(job: Job, camera: str) -> Iterator[str]:
    """What there is to know of one."""
    about = job.data.camera(camera)
    exposure, rows = about.get("exposure"), about["height"]
    if not lasts(about):
        yield f"{camera}: each image is of one instant."
        return
    time_s, readout_s = exposure["time_s"], exposure["readout_s"]
    if not readout_s:
        yield f"{camera}: global shutter, exposure time_s {time_s!r}."
        return
    yield f"{camera}: rolling shutter, first row first: exposure time_s {time_s!r}, readout_s {readout_s!r},"
    yield f"  line_delay_s {readout_s / rows!r}. The middle of the exposure of row r, from 0, is at its time stamp"
    yield f"  + ((r + 0.5) / {rows} - 0.5) * {readout_s!r} s."
    if is_rolling(about):
        yield f"  {job.data.layout.row_poses(camera).name}: pose of the camera at that time for every row: NumPy,"
        yield (
            f"  float64 [{counted(len(job.data), 'frame')}, {rows} rows, 7], x y z, quaternion w x y z; "
            "camera (OpenCV axes) to"
        )
        yield "  world (z up, metres)."
