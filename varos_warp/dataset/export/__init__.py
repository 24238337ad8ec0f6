"""Datasets in the formats of other programs: one module a format.

Each has ``write(job)`` and ``IMAGES``, the letters of the images that it needs, where ``A`` without ``B`` stands for
the colour images that are chosen. If the format has no room for all cameras, it has ``cameras(job)``, the ids of those
that it holds, and ``HOLDS``, which they are; if it has readings of other sensors than `EXPORTED`, it has ``SENSORS``;
if it is nothing without some images, ``NEEDS``.

Images are linked or copied as they are; depth is encoded anew where a format has units of its own. No format states a
shutter, so `shutters` writes a note of it, and `moving` the poses of what moves. An export is made in a hidden folder
beside its own and renamed when it is complete.
"""

import warnings
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from varos_warp.dataset import files
from varos_warp.dataset.export.shared import moving, shutters
from varos_warp.dataset.export.shared.job import EXPORTED, Clocked, Job
from varos_warp.errors import InputError, did_you_mean
from varos_warp.scene.description.image_types import AMBIENT, DEPTH, WATER

LABELS = ("coco", "yolo", "bop")
"""Formats of labels, which need image S."""
FORMATS = ("euroc", "tum", "kitti", "colmap", "nerfstudio", "mcap", "stream", "vslamlab", *LABELS, "corners")
"""Names of the modules here; docs/exports.md says what each writes."""
SEQUENCES = ("euroc", "tum", "kitti", "mcap", "vslamlab")
"""Formats for odometry and SLAM, which need motion."""
LATEST_NS = (2**31 - 86_400) * 10**9
"""ROS counts the seconds in 32 bits with a sign; a sequence lasts a day at most."""


def export(
    dataset_root,
    to: str,
    out,
    images: str = WATER,
    cameras=None,
    quiet: bool = True,
    raw: bool = False,
    start_ns: int = 0,
    scene_dir: str | Path = ".",
) -> Job:
    """Write a dataset in another format.

    Args:
        dataset_root: Folder of the dataset.
        to: One of `FORMATS`.
        out: Folder of the export, which must not be there yet.
        images: Which of ``A`` and ``B`` are the colour images.
        cameras: Ids of the cameras; None: all. TUM takes the first, KITTI the first and its rectified partner.
        quiet: No progress on stderr.
        raw: Uncompressed images beside the compressed ones, of MCAP only.
        start_ns: Time of the sequence's beginning [ns], which is added to all stamps; KITTI's stay relative.
        scene_dir: Folder of the dataset's scene file, to which its meshes are relative; for labels and corners.

    Returns:
        What was written and from where.

    Raises:
        InputError: If the dataset lacks what the format needs, ``out`` is there or cannot be written.
    """
    if to not in FORMATS:
        raise InputError(
            "is no format",
            key="to",
            value=to,
            remedy=did_you_mean(to.lower(), FORMATS) or f"There are: {', '.join(FORMATS)}; mcap is that of ROS.",
        )
    if raw and to != "mcap":
        raise InputError("is for mcap only", key="raw", value=raw, remedy="Leave it out.")
    if not Path(scene_dir).is_dir():
        raise InputError(
            "there is no such folder",
            key="scene_dir",
            value=str(scene_dir),
            remedy="Name the one that the scene file lies in.",
        )
    if not 0 <= start_ns < LATEST_NS:
        raise InputError(
            "is no time that every format has",
            key="start_ns",
            value=start_ns,
            remedy="Give nanoseconds since 1970, of a time before the year 2038.",
        )
    data, module = Clocked(dataset_root, start_ns), import_module(f"{__name__}.{to}")
    if not data.frames:
        raise InputError("the dataset has no frames", file=data.root, remedy="Render some first.")
    if module.IMAGES and not _has_all_types(module):
        _require_colors(data, images)
    _require_types(data, to, getattr(module, "NEEDS", ""))
    chosen = tuple(dict.fromkeys(cameras or data.cameras))
    for camera in chosen:
        data.camera(camera)
    job = Job(
        data,
        Path(out),
        images if module.IMAGES else "",
        chosen,
        quiet,
        raw,
        getattr(module, "SENSORS", EXPORTED),
        Path(scene_dir),
    )
    if hasattr(module, "cameras"):
        job = replace(job, cameras=tuple(module.cameras(job)))
    if left := [camera for camera in chosen if camera not in job.cameras]:
        warnings.warn(f"{to} holds {module.HOLDS}; left out: {', '.join(left)}", stacklevel=2)
    _tell_what_is_missing(data, to, module)
    # ``A`` alone among A and B stands for the chosen one
    wanted = {images if letter == WATER and not _has_all_types(module) else letter for letter in module.IMAGES}
    data.require_images(sorted(wanted & set(data.outputs)), job.cameras)
    with files.new_folder(job.out) as temp:
        module.write(replace(job, out=temp))
        if module.IMAGES:
            shutters.write(replace(job, out=temp))
        moving.write(replace(job, out=temp))
    return job


def _tell_what_is_missing(data: Clocked, to: str, module) -> None:
    """Warn of a dataset that gives a format less than its users look for."""
    if to in SEQUENCES and len(data) == 1:
        warnings.warn(
            f"{to} is for odometry and SLAM, and this dataset has one frame: its cameras do not move", stacklevel=3
        )
    if DEPTH in module.IMAGES and DEPTH not in data.outputs and not _has_all_types(module):
        warnings.warn(
            "the dataset has no D, so there is neither depth nor what follows from it, such as points: add D to "
            "render.outputs and `run` again",
            stacklevel=3,
        )


def _has_all_types(module) -> bool:
    """Return whether a format holds images of every type, whichever are the colour images, or if there are none."""
    return {WATER, AMBIENT} <= {*module.IMAGES}


def _require_types(data: Clocked, to: str, needs: str) -> None:
    """Refuse a dataset without images that a format is nothing without; of colour images `_require_colors` tells."""
    if lacks := [letter for letter in needs if letter not in (*data.outputs, WATER)]:
        raise InputError(
            f"needs image {lacks[0]}, and the dataset has {', '.join(data.outputs)}",
            file=data.root,
            key="to",
            value=to,
            remedy=f"Add {lacks[0]} to render.outputs and `run` again: it makes what is missing.",
        )


def _require_colors(data: Clocked, images: str) -> None:
    """Refuse a dataset without the colour images that are chosen."""
    colors = [letter for letter in data.outputs if letter in (WATER, AMBIENT)]  # P does not lie on D
    if images not in colors:
        raise InputError(
            "are no colour images of this dataset",
            key="images",
            value=images,
            remedy=f"It has: {', '.join(colors)}." if colors else "Render A or B first.",
        )
