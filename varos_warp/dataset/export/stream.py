"""One stream file of everything in the order of time (paper 4.1.2, table 7), and the images that it points to."""

from varos_warp.dataset import files
from varos_warp.dataset.export.job import Job
from varos_warp.dataset.stream import dataset_messages, write_stream

IMAGES = "ABCDS"


def write(job: Job) -> None:
    """Write stream.sbst, and every image type of the chosen cameras under ``images/cam<id>/<type>``."""
    images = []
    for camera in job.cameras:
        for letter in job.data.outputs:
            for frame in job.data.frames:
                path = f"images/cam{camera}/{letter}/{job.data.layout.png(camera, letter, frame).name}"
                job.link(camera, letter, frame, path)
                images.append((camera, letter, frame, path))
    if "S" in job.data.outputs:
        files.write_json(job.out / job.data.layout.segments.name, files.read_json(job.data.layout.segments))
    write_stream(job.out / "stream.sbst", dataset_messages(job.data, images))
